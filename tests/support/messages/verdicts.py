"""Verdicts that receivers in every language must reach: one table, with a test for each receiver.

A `Step` is an arriving frame, and whether it is accepted or why not. Sessions are relative to `SESSION`, send
times to the arrival time.
"""

from collections.abc import Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import NamedTuple

from wire import MS, NOW, SESSION, frame, sealed

from proximity.core.receiver_state import AHEAD_NS, LAST_NS, MAX_RUNS, MAX_SKIPPED, RESTART_SILENCE_NS
from proximity.message import Defect
from proximity.message.envelope import CHECKED_FROM

OLD, FUTURE, CONTENT = Defect.OLD, Defect.FUTURE, Defect.CONTENT
SILENCE = RESTART_SILENCE_NS
FAR = 2**64 - 1


class Step(NamedTuple):
    """A frame with session and number, and its verdict."""

    session: int
    sequence: int
    verdict: Defect | None = None
    later: int = MS  # ns after the frame before
    sent: int = 0
    header: Mapping[str, int] = MappingProxyType({})  # fields that differ from those of a valid frame
    record: Mapping[str, object] = MappingProxyType({})  # fields of its second contact
    cut: int = 0  # missing bytes; negative: extra bytes
    flip: int = -1  # a byte with a flipped bit


class Row(NamedTuple):
    """Steps for local or remote publishers, with or without a key."""

    shares_clock: tuple[bool, ...]
    is_keyed: tuple[bool, ...]
    steps: tuple[Step, ...]
    lost: int = 0

    def counts(self) -> tuple[int, int, int]:
        """Numbers of accepted messages, lost numbers and runs."""
        used = [step.session for step in self.steps if step.verdict is None]
        return len(used), self.lost, 1 + sum(one != other for one, other in pairwise(used))


BOTH = (True, False)
SHARED, FOREIGN, OPEN, KEYED = (True,), (False,), (False,), (True,)


def _header(verdict: Defect | None, **values: int) -> Step:
    return Step(0, 1, verdict, header=values)


def _record(verdict: Defect | None, **values: object) -> Step:
    return Step(0, 1, verdict, record=values)


def _instants(verdict: Defect, instant: int) -> tuple[Step, ...]:
    """Steps with an impossible time of sending, or of the poses."""
    return _header(verdict, publish_ns=instant), _header(verdict, pose_ns=instant)


def _two_publishers(other: int) -> Row:
    """Two services on one port: their distances would alternate between two scenes."""
    steps = (Step(other * (k % 2), k, None if k % 2 else OLD) for k in range(2, 100))
    return Row(BOTH, OPEN, (Step(0, 0), Step(other, 1, later=SILENCE + 1), *steps), lost=1 + 49)


ROWS = {
    "repeated and overtaken": Row(
        BOTH,
        BOTH,
        (Step(0, 4), Step(0, 4, OLD), Step(0, 3, OLD), Step(0, 0, OLD), Step(0, 5), Step(0, 9)),
        lost=3,
    ),
    "numbers far beyond the last": Row(
        BOTH,
        BOTH,
        (
            Step(0, 0),
            Step(0, FAR, OLD),
            Step(0, MAX_SKIPPED + 1, OLD),
            Step(0, MAX_SKIPPED),
            Step(1, FAR),
            Step(1, 0, OLD),
            Step(2, FAR - 1),
            Step(2, FAR),
            Step(3, 4),
        ),
        lost=MAX_SKIPPED - 1 + 4,  # a run that was joined late counts no loss before its first message
    ),
    "another run at once": Row(
        BOTH, BOTH, (Step(0, 1000), Step(0, 1002), Step(1, 3, later=1), Step(1, 4)), lost=1 + 3
    ),
    "another run from its beginning": Row(BOTH, BOTH, (Step(0, 1000), Step(1, 0, later=1), Step(1, 1))),
    "an earlier run never comes back": Row(
        BOTH,
        BOTH,
        (Step(0, 0), Step(0, 1), Step(1, 0), Step(0, 1, OLD), Step(0, 0, OLD, 10_000 * MS), Step(1, 1)),
    ),
    "an interrupted run goes on": Row(
        BOTH,
        OPEN,
        (Step(0, 10), Step(5, 0), Step(0, 12, OLD, SILENCE), Step(0, 10, OLD, 1), Step(0, 12)),
        lost=1,
    ),
    "two publishers side by side": _two_publishers(5),
    "two publishers side by side, the other with its calendar put back": _two_publishers(-5),
    "a calendar put back, here": Row(
        SHARED,
        OPEN,
        (
            Step(0, 1000),
            Step(-9, 0, OLD, sent=-2 * MS),
            Step(-9, 0, OLD, 10_000 * MS, -20_000 * MS),  # a run not seen before
            Step(-9, 0),
            Step(-9, 1),
            Step(0, 1001, OLD),
        ),
    ),
    "a calendar put back, elsewhere": Row(
        FOREIGN,
        OPEN,
        (Step(0, 1000), Step(-9, 0, OLD, SILENCE), Step(-9, 1, later=1), Step(0, 1001, OLD)),
        lost=1,
    ),
    "a recording that the key verifies": Row(
        BOTH, KEYED, (Step(0, 5), Step(9, 0), Step(0, 6, OLD, 200 * SILENCE), Step(8, 9, OLD), Step(9, 1))
    ),
    "runs that are remembered": Row(
        SHARED,
        OPEN,
        (
            *(Step(k, 3) for k in range(MAX_RUNS + 2)),
            Step(1, 4, OLD),
            Step(0, 0),
            Step(MAX_RUNS + 1, 9, OLD),
        ),
        lost=3 * (MAX_RUNS + 1),
    ),
    "instants that no clock shows": Row(
        BOTH,
        BOTH,
        (
            Step(0, 0),
            _header(CONTENT, pose_ns=-1),
            _header(CONTENT, pose_ns=-(2**63)),
            *_instants(FUTURE, LAST_NS + 1),
            *_instants(FUTURE, 2**61 + 1),
            *_instants(FUTURE, 2**62),
            *_instants(FUTURE, 2**62 + 1),
            *_instants(FUTURE, 2**63 - 1),
            Step(0, 1),
        ),
    ),
    "sent before a clock began, here": Row(
        SHARED, BOTH, (_header(CONTENT, publish_ns=-1), _header(CONTENT, publish_ns=-(2**63)), Step(0, 1))
    ),
    "sent before a clock began, elsewhere": Row(
        FOREIGN, BOTH, (_header(FUTURE, publish_ns=-1), _header(FUTURE, publish_ns=-(2**63)), Step(0, 1))
    ),
    "the last instant of a clock": Row(FOREIGN, BOTH, (Step(0, 0), _header(None, publish_ns=LAST_NS))),
    "instants of the future, here": Row(
        SHARED,
        BOTH,
        (
            Step(0, 0, FUTURE, sent=AHEAD_NS + 1),
            _header(FUTURE, pose_ns=NOW + 100 * MS),
            Step(0, 0, sent=AHEAD_NS),
            _record(CONTENT, pose_ns=NOW + 100 * MS),
        ),
    ),
    "instants of the future, elsewhere": Row(
        FOREIGN, BOTH, (Step(0, 0, sent=3600_000 * MS), _header(FUTURE, pose_ns=NOW + 100 * MS))
    ),
    "contents without sense": Row(
        BOTH,
        BOTH,
        (
            Step(0, 0),
            _header(CONTENT, state=6),
            _header(CONTENT, source=3),
            *(_record(CONTENT, **{name: float("nan")}) for name in ("lower", "upper", "signed_distance")),
            *(_record(CONTENT, **{name: float("nan")}) for name in ("predicted_distance", "predicted_upper")),
            _record(CONTENT, time_to_contact=0.1),
            _record(CONTENT, predicted_lower=0.06),
            _record(CONTENT, surface=3),
            _record(CONTENT, mode=4),
            _record(CONTENT, source=3),
            _record(CONTENT, force_is_valid=2),
            _record(CONTENT, flags=0, mode=4),
            _record(CONTENT, position=(0, 0, float("inf"))),
            _record(CONTENT, position=(0, float("nan"), 0)),
            _record(CONTENT, source=1, position=(0, 0, float("inf"))),
            _record(CONTENT, normal=(0, 0, 1.0012)),
            _record(CONTENT, normal=(1e300, 0, 0)),
            _record(CONTENT, pose_ns=NOW - 1000 * MS),
            _record(None, upper=float("inf")),
            Step(0, 2),
            Step(0, 3, record={"source": 1, "position": (0, float("nan"), 0)}),
            Step(0, 4, record={"normal": (float("nan"),) * 3}),
            Step(0, 5, record={"normal": (0, 0, 1.0009)}),
            Step(0, 6, record={"flags": 0, "lower": float("nan"), "pose_ns": -(2**63)}),
        ),
    ),
    "bytes that are no message": Row(
        BOTH,
        BOTH,
        (
            *(
                Step(0, 0),
                Step(0, 1, Defect.SHORT, cut=10_000),
                Step(0, 1, Defect.SIZE, cut=8),
                Step(0, 1, Defect.SIZE, cut=-1),
            ),
            *(
                Step(0, 1, Defect.MAGIC, flip=0),
                Step(0, 1, Defect.VERSION, flip=8),
                Step(0, 1, Defect.CHECKSUM, flip=200),
            ),
            Step(0, 1, Defect.CHECKSUM, flip=CHECKED_FROM - 1),
            Step(0, 1),
        ),
    ),
}
"""Table of steps by subject."""


def datagrams(row: Row) -> list[tuple[bytes, int, Defect | None]]:
    """Bytes, arrival time and verdict of each step."""
    arrived, now = [], NOW
    for step in row.steps:
        now += step.later
        message = frame(now + step.sent, 3)
        for part, values in ((message.header, step.header), (message.records[1], step.record)):
            for name, value in values.items():
                part[name] = value
        data = bytearray(sealed(message, step.sequence, SESSION + step.session))
        data = data[: max(len(data) - step.cut, 7)] if step.cut >= 0 else data + bytes(-step.cut)
        if step.flip >= 0:
            data[step.flip] ^= 1
        arrived.append((bytes(data), now, step.verdict))
    return arrived


CASES = [
    (name, shares_clock, is_keyed)
    for name, row in ROWS.items()
    for shares_clock in row.shares_clock
    for is_keyed in row.is_keyed
]
"""Names of rows, with the kind of publisher."""
