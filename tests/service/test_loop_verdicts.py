"""The loop accepts and rejects messages like the receivers of all languages, see ``verdicts.py``."""

import sys

import pytest
from fake_service import ManualClock
from far_end import new_name
from ticking import block
from verdicts import ROWS
from wire import MS, NOW, SESSION, Clock, Wire

from proximity.message import POSES, Defect, Message
from proximity.native.mode import IS_AHEAD
from proximity.scene.scene import Scene
from proximity.service import MessageInput, Service, TrackedContacts
from proximity.tracker.tracker import Tracker
from proximity.transport import MessageReader, open_outlet

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or not IS_AHEAD, reason="it needs mailboxes of Linux and compiled kernels"
)
OF_ORDER = {
    name: row.steps
    for name, row in ROWS.items()
    if True in row.shares_clock
    and False in row.is_keyed
    and all(
        step.verdict in (None, Defect.OLD) and step.later % MS == 0 and not step.header and not step.record
        for step in row.steps
    )
}
"""Rows about sessions and numbers at whole milliseconds, the ticks of the loop."""


def poses(step, now):
    message = Message(POSES, 1)
    message.header["send_ns"] = now + step.sent
    message.records["pose_ns"], message.records["position"] = now, 0.1
    return message.seal(SESSION + step.session, step.sequence)


@pytest.mark.parametrize("name", OF_ORDER)
def test_messages_of_order_are_counted_as_by_a_reader(name):
    address, clock, due = f"shm://{new_name()}", ManualClock(NOW), {}
    outlet, wire, there = open_outlet(address), Wire(), Clock()
    reader, now = MessageReader(wire, [POSES], there), NOW
    for step in OF_ORDER[name]:
        now += step.later
        due[now] = poses(step, now).copy()
        wire.put(due[now])
        there.now = now
        assert bool(list(reader.messages())) == (step.verdict is None)

    def sleep_until(due_ns):
        clock.now = max(clock.now, due_ns)
        if due_ns in due:
            outlet.send(due[due_ns])

    clock.sleep_until = sleep_until
    tracked = TrackedContacts(Tracker(Scene([block("block", (0, 0, 0), 0.03)]), fingers=1, radius=0.005))
    service = Service(
        tracked, MessageInput(address, 1, clock=clock.now_ns), [], period=0.001, valid_for=0.005, clock=clock
    )
    report = service.run(tick_count=(now - NOW) // MS + 2)
    outlet.close()

    assert len(OF_ORDER) >= 4
    expected = [f"{address}: {reader.counts}"] if reader.counts.unused or reader.counts.lost else []
    assert [note for note in report.notes if note.startswith(address)] == expected
