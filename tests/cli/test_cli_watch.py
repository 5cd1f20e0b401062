"""``proximity watch``: display of a reading, and following a service until stopped."""

import io
import json
import os
import re
import signal
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import queued_transport
from ports import free_port
from publishing import publishing
from rich.console import Console
from sealed_frames import SESSION, frame, sealed

from proximity.cli import tables
from proximity.cli.service import finger_view, watch_view
from proximity.cli.service.finger_view import frame_document
from proximity.message import CONTACT, FRAME, ContactFlag, Defect, Mode, Source, State
from proximity.recording.frame_bytes import frame_type
from proximity.transport import Counts, Reading, forget, open_outlet, open_publisher, open_subscriber
from proximity.transport.message_key import write_key

ADDRESS = "queue:proximity"
SEEN = watch_view.Seen(
    ADDRESS, Counts(received=500, lost=2, refused=1, flawed=Counter({Defect.CHECKSUM: 3})), 999.6, 0.001
)

COMMAND = ("watch",)


def reading(state=State.OK, count=3, age_ns=1_300_000, **fields):
    """Return a reading of fingers 10 mm, 20 mm, … away; *fields* are of the first finger."""
    message = frame(count)
    message.header["session"], message.header["epoch"], message.header["missed"] = SESSION, 4, 17
    for name, value in fields.items():
        message.records[name][0] = value
    return Reading(state, True, 0, age_ns, message.header[()].copy(), message.records.copy())


def drawn(shown, *, width=120, color=False, row_count=20, seen=SEEN, drums=None):
    """Return the lines that a terminal of that width would show."""
    stream = io.StringIO()
    console = Console(
        file=stream, width=width, force_terminal=color, color_system="standard" if color else None
    )
    console.print(watch_view.picture(shown, seen, row_count=row_count, drums=drums))
    return stream.getvalue().splitlines()


def row_of(finger, *arguments, **options):
    """Return the line of a finger."""
    return next(text for text in drawn(*arguments, **options) if bare(text).split()[:1] == [str(finger)])


def bare(text):
    """Return text without colours and cursor movements."""
    return re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", text)


NAMED = replace(SEEN, part_names=("lid", "a name of many more letters"))
SILENT = watch_view.Seen(ADDRESS, Counts(received=500), 0.0, 3.21)
APPROACH = {
    "part": 12, "signed_distance": 0.03, "lower": 0.03, "upper": 0.03, "predicted_distance": 0.06,
    "time_to_contact": 0.0414, "approach_speed": 0.2124, "mode": Mode.POSITION,
}  # fmt: skip
BOUNDS = {
    "lower": 0.03, "upper": 0.0905, "flags": ContactFlag.TRACKED | ContactFlag.BOUNDED,
    "time_to_contact": 0.2, "time_to_contact_lower": 0.011,
}  # fmt: skip
FAR = {"lower": -12.5, "upper": 999.9, "flags": ContactFlag.TRACKED, "part": 4095}
CASES = {  # title: reading, fingers without tracking, options of the drawing
    **{f"state {state.name}": ({"state": state}, [], {}) for state in State},
    "approach": (APPROACH, [], {}),
    "bounds": (BOUNDS, [], {}),
    "one finger is not tracked": ({}, [0], {}),
    "stale": ({"state": State.STALE, "age_ns": 3_300_000_000}, [0, 1, 2], {"seen": SILENT}),
    "starting without a pose": ({"state": State.STARTING, "header": State.STARTING}, [0, 1, 2], {}),
    "stale without a pose": ({"state": State.STALE, "header": State.STALE}, [0, 1, 2], {}),
    "left hand": ({"state": State.DEGRADED, "count": 10}, [5, 6, 7, 8, 9], {}),
    "right hand": ({"state": State.DEGRADED, "count": 10}, [0, 1, 2, 3, 4], {}),
    "half of each hand": ({"state": State.DEGRADED, "count": 10}, [3, 4, 5, 6, 7], {}),
    "one of five": ({"state": State.DEGRADED, "count": 5}, [1], {}),
    "twelve fingers": ({"count": 12, "lower": -1.0}, [1], {"row_count": 3}),
    "no drums yet": ({}, [], {"drums": []}),
    "unknown numbers": ({"mode": 77, "part": -1, "approach_speed": np.nan}, [], {}),
    "name of a part": ({"part": 0}, [], {"seen": NAMED}),
    "long name of a part": ({"part": 1}, [], {"seen": NAMED}),
    "part without a name": ({"part": 2}, [], {"seen": NAMED}),
    "no part": ({"part": -1}, [], {"seen": NAMED}),
    **{f"width {width}": (FAR, [], {"width": width}) for width in (40, 91, 92)},
}


def test_readings_are_drawn_and_told_in_a_line_as_recorded(recorded):
    text = ""
    for title, (fields, lost, options) in CASES.items():
        header = fields.get("header")
        shown = reading(**{name: value for name, value in fields.items() if name != "header"})
        shown.header["state"] = shown.header["state"] if header is None else header
        for row in lost:
            forget(shown.contacts[row : row + 1])
        lines = drawn(shown, **options)
        assert max(map(len, lines)) <= options.get("width", 120)
        line = watch_view.line(shown, options.get("seen", SEEN))
        text += "\n".join([f"--- {title}", *(each.rstrip() for each in lines), line, "", ""])

    recorded("watch", re.sub(r"\d\d:\d\d:\d\d", "hh:mm:ss", text))


def test_before_the_first_frame_the_silence_is_told():
    never = Reading(State.STALE, False, 0, -1, None, np.zeros(0, CONTACT))

    lines = drawn(never, seen=watch_view.Seen(ADDRESS, Counts(), 0.0, 2.0))

    assert len(lines) == 2 and "no frame from queue:proximity yet, for 2.0 s" in lines[0]


@pytest.mark.parametrize("width", [70, 120])
def test_touch_is_a_red_field(width):
    shown = reading(signed_distance=-0.0012, lower=-0.0012, upper=-0.0012, time_to_contact=0.0)

    row = row_of(0, shown, width=width, color=True)

    red = re.search(r"\x1b\[1;37;41m([^\x1b]+)\x1b", row)
    assert "1.20 mm inside" in red[1]
    assert "now" in row


def test_stale_is_a_red_line():
    shown = reading(State.STALE, age_ns=3_300_000_000)
    forget(shown.contacts)
    red = re.search(r"\x1b\[1;37;41m([^\x1b]+)\x1b", drawn(shown, seen=SILENT, color=True)[0])[1]
    assert len(red) == 120
    assert red.strip() == "STALE  no frame for 3.2 s: all distances are unknown"


@pytest.mark.parametrize("width", [14, 60])
def test_bar_is_as_wide_as_its_ruler_and_grows_with_the_distance(width):
    free = [finger_view.bar(mm, mm, np.nan, width, "green").plain for mm in (0.5, 30.0, 60.0, 119.0, 500.0)]

    assert all(len(text) == width for text in [*free, finger_view.ruler(width)])
    assert finger_view.ruler(width).split()[-1] == "120"
    full = [text.count("█") for text in free]
    assert full[1:3] == [width // 4, width // 2]
    assert full[0] == 0 and free[0].strip()
    assert free[4].endswith("»") and not free[3].endswith("»")


def test_rate_is_of_the_last_second(monkeypatch):
    queued_transport.register(monkeypatch)
    now = [100.0]
    with open_subscriber(ADDRESS) as subscriber, open_publisher(ADDRESS) as publisher:
        following = watch_view.Follower(subscriber, gather=0.0, clock=lambda: now[0])
        rates, silences = [], []
        for turn in range(120):
            now[0] += 0.05
            if turn < 80:
                for _ in range(20 if turn < 40 else 10):
                    publisher.publish(frame(now_ns=time.monotonic_ns()))
            _, seen = following.look(0.0)
            rates.append(seen.rate_hz)
            silences.append(seen.silent_s)

    assert rates[39] == pytest.approx(400.0)
    assert rates[79] == pytest.approx(200.0)
    assert rates[-1] == 0.0
    assert silences[79] == 0.0
    assert silences[-1] == pytest.approx(2.0)


@pytest.fixture(autouse=True)
def queued(monkeypatch):
    """Receive frames through a queue of this process."""
    queued_transport.register(monkeypatch)


@pytest.fixture
def service():
    """Publish frames until the end of the test."""

    def message():
        made = frame(2, now_ns=time.monotonic_ns())
        made.header["valid_until_ns"] += 10**10  # a slow machine is not shown as LATE
        return made

    with publishing(ADDRESS, message):
        yield


def test_pipe_gets_plain_lines(run, service, monkeypatch):
    monkeypatch.setattr(tables, "LINE_EVERY_S", 0.1)

    result = run(ADDRESS, "--limit", 1)

    lines = result.out.splitlines()
    assert (result.code, result.err) == (0, "")
    assert len(lines) >= 2
    assert "\x1b" not in result.out
    assert all(re.fullmatch(r"[\d:]{8} [A-Z]+: \d+ Hz, .*", text) for text in lines)
    assert "; 0: 10.00 mm, retract; 1: 20.00 mm, retract" in result.out


def test_json_is_a_line_for_every_frame_that_came(run):
    outlet = open_outlet(ADDRESS)
    for number in range(20):
        outlet.send(np.frombuffer(sealed([number], 2), np.uint8))

    began_ns = time.monotonic_ns()
    result = run(ADDRESS, "--limit", 0.2, "--json")

    assert (result.code, result.err) == (0, "")
    frames = list(map(json.loads, result.out.splitlines()))
    assert all(began_ns <= told["received_ns"] <= time.monotonic_ns() for told in frames)
    assert [told["sequence"] for told in frames] == list(range(20))
    assert (frames[0]["state"], frames[0]["session"], len(frames[0]["fingers"])) == ("ok", SESSION, 2)
    finger = frames[0]["fingers"][1]
    assert (finger["finger"], finger["signed_distance"], finger["mode"]) == (1, 0.02, "retract")
    assert finger["flags"] == ["tracked", "predicted", "exact", "signed", "in_range"]
    assert finger["time_to_contact"] is None  # infinite, which JSON cannot represent
    assert finger["normal"] == [0.0, 0.0, 1.0] and finger["part_name"] is None


def test_json_names_parts_states_and_numbers_that_are_not_known():
    message = frame(2)
    message.records["part"], message.records["mode"] = [1, 7], [Mode.FORCE, 99]
    message.header["state"] = State.LATE
    (one,) = message.seal(SESSION, 3).view(frame_type(FRAME.size(2)))

    told = frame_document(one, ("lid", "box"))

    assert (told["state"], told["sequence"]) == ("late", 3)
    assert [finger["part_name"] for finger in told["fingers"]] == ["box", None]
    assert [finger["mode"] for finger in told["fingers"]] == ["force", "99"]


def test_json_of_nothing_is_exit_code_1(run):
    result = run(ADDRESS, "--limit", 0.1, "--json")

    assert (result.code, result.out) == (1, "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_terminal_gets_a_table_until_told_to_stop(run, service, monkeypatch, number):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("LINES", "30")
    shown = watch_view.picture
    count = []

    def picture(*arguments, **options):
        count.append(1)
        if len(count) == 3:
            os.kill(os.getpid(), number)
        return shown(*arguments, **options)

    monkeypatch.setattr(watch_view, "picture", picture)
    result = run(ADDRESS)

    assert (result.code, result.err) == (0, "")
    assert re.search(r"^ +1 +0 +20\.00 █", bare(result.out), re.MULTILINE)
    assert result.out.endswith("\x1b[?25h")  # the cursor is visible again


def test_nothing_that_comes_is_exit_code_1(run):
    result = run(ADDRESS, "--limit", 0.3)

    assert result.code == 1
    assert "STALE: 0 Hz, 0 lost, 0 refused; no frame from queue:proximity yet, for 0." in result.out


def test_key_of_another_is_told(run, tmp_path):
    """The line reports that no message is verified, not that none arrives."""
    path, port = tmp_path / "frames.key", free_port()
    write_key(str(path))
    address = f"udp://127.0.0.1:{port}"
    with publishing(address, lambda: frame(now_ns=time.monotonic_ns()), 0.01):
        result = run(f"{address}?key={path}", "--limit", 1.2)

    assert result.code == 1
    assert f"messages are not verified by the key of {address}?key={path}" in result.out


def test_held_part_and_its_connections_are_named():
    """A held part has no fingers: a line names the nearby parts."""
    shown = reading(count=2, part=1)
    shown.header["source"] = Source.HELD
    shown.contacts["source"], shown.contacts["part"] = Source.HELD, (1, 0)
    seen = replace(SEEN, part_names=("base", "lid"), finger_names=("pin 1", "pin 2"))

    line = watch_view.line(shown, seen)

    assert "OK: held: pin, 1000 Hz" in line and line.endswith("; to lid: 10.00 mm; to base: 20.00 mm")
    table = "\n".join(drawn(shown, seen=seen))
    assert "the held part is tracked, and in time" in table and "finger" not in table
    stale = replace(shown, state=State.STALE)
    assert "no new pose of the held part: its distances are unknown" in watch_view.line(stale, seen)
