"""Validation of messages: the accepted, the counted and the runs of a publisher."""

import struct
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire import MS, NOW, SESSION, Clock, Wire, frame, sealed

from proximity.core.receiver_state import MAX_AT_ONCE, MAX_FLAWED
from proximity.message import FRAME, MAX_RECORDS, MOVES, POSES, Defect, Message
from proximity.transport.message_reader import MessageReader

SECOND = 1000 * MS


class Bench:
    """A reader of a simulated wire."""

    def __init__(self, *, shares_clock=True, kinds=(FRAME,), **settings):
        self.clock, self.wire = Clock(), Wire(shares_clock)
        self.reader = MessageReader(self.wire, kinds, self.clock, **settings)

    @property
    def counts(self):
        return self.reader.counts

    def arrive(self, *messages):
        """Deliver messages; return (session, sequence) of each accepted one."""
        for data in messages:
            self.wire.put(data)
        return [tuple(data[16:32].view("<u8").tolist()) for _, data, _ in self.reader.messages()]

    def arrive_frame(self, sequence, session=0, sent=None):
        """Deliver a frame of a session, sent now by default."""
        message = frame(self.clock.now if sent is None else sent, 1)
        return self.arrive(sealed(message, sequence, SESSION + session)) != []


def resealed(data):
    return data[:4] + struct.pack("<I", zlib.crc32(data[8:])) + data[8:]


def test_frames_go_through_in_their_order_with_kind_and_instant():
    bench, numbers = Bench(kinds=(POSES, FRAME)), range(3)
    assert bench.arrive(*(sealed(frame(), k) for k in numbers)) == [(SESSION, k) for k in numbers]
    assert (bench.counts.received, bench.counts.lost, bench.counts.sessions) == (3, 0, 1)
    assert not bench.counts.flawed
    message = frame(count=2)
    bench.wire.put(sealed(message, 3))
    ((kind, data, now),) = bench.reader.messages()

    assert (kind, data.tobytes(), now) == (FRAME, message.data.tobytes(), NOW)


GOOD = sealed(frame(count=1), 5)


@pytest.mark.parametrize(
    ("data", "defect"),
    [
        (b"", Defect.SHORT),
        (GOOD[:50], Defect.SHORT),
        (b"garbage " * 20, Defect.MAGIC),
        (Message(POSES, 3).seal(1, 1).tobytes(), Defect.MAGIC),
        (resealed(GOOD[:8] + b"\1\0" + GOOD[10:]), Defect.VERSION),
        (GOOD[:-8], Defect.SIZE),
        (GOOD + b"\0", Defect.SIZE),
        (bytes(FRAME.size(MAX_RECORDS) + 100), Defect.SIZE),
        (GOOD[:200] + b"\xff" + GOOD[201:], Defect.CHECKSUM),
    ],
)
def test_each_flaw_is_counted_and_nothing_goes_through(data, defect):
    bench = Bench()

    assert bench.arrive(data) == []
    assert bench.counts.flawed == {defect: 1}
    assert bench.arrive(GOOD) == [(SESSION, 5)]


def test_flaws_of_the_content_are_counted_and_leave_the_row_as_it_was():
    bench = Bench()
    for defect in (Defect.CONTENT, Defect.FUTURE):
        bench.wire.put(sealed(frame(), 7))
        assert list(bench.reader.messages(lambda *_, defect=defect: defect)) == []

    assert bench.counts.flawed == {Defect.CONTENT: 1, Defect.FUTURE: 1}
    assert bench.arrive_frame(3)
    assert bench.counts.lost == 0


@settings(max_examples=200)
@given(st.lists(st.binary(max_size=500), max_size=5), st.booleans())
def test_no_bytes_raise_or_go_through(packets, shares_clock):
    bench = Bench(shares_clock=shares_clock, kinds=(FRAME, POSES, MOVES))

    assert bench.arrive(*packets) == []
    assert bench.counts.flawed.total() == len(packets)


@settings(max_examples=200)
@given(st.binary(min_size=80, max_size=80), st.binary(min_size=656, max_size=656), st.booleans())
def test_no_content_behind_a_good_checksum_raises(header, contacts, shares_clock):
    bench = Bench(shares_clock=shares_clock)
    bench.arrive_frame(2**40)
    good = sealed(frame(count=2))
    bench.arrive(resealed(good[:16] + header[:72] + good[88:92] + header[76:] + contacts))

    assert bench.counts.received + bench.counts.flawed.total() == 2


@given(st.lists(st.integers(0, 40), min_size=1, max_size=40))
def test_received_and_lost_are_all_that_was_published_since_the_first(numbers):
    bench = Bench()
    for number in numbers:
        bench.arrive_frame(number)

    counts = bench.counts
    assert counts.received + counts.lost == max(numbers) - numbers[0] + 1
    assert counts.received + counts.flawed[Defect.OLD] == len(numbers)


def test_kinds_have_numbers_of_their_own():
    bench = Bench(kinds=(POSES, MOVES))

    assert bench.arrive(
        Message(POSES, 1).seal(9, 5).tobytes(),
        Message(MOVES, 1).seal(9, 0).tobytes(),
        Message(POSES, 2).seal(9, 6).tobytes(),
        Message(MOVES, 1).seal(9, 2).tobytes(),
    ) == [(9, 5), (9, 0), (9, 6), (9, 2)]
    assert (bench.counts.received, bench.counts.lost) == (4, 1)


@pytest.mark.parametrize("is_flawed", [True, False])
@pytest.mark.parametrize("is_default", [True, False])
def test_so_many_messages_are_taken_at_once(is_flawed, is_default):
    """The number of messages per read is limited, valid or not."""
    name, default = ("max_flawed", MAX_FLAWED) if is_flawed else ("max_at_once", MAX_AT_ONCE)
    most = default if is_default else 3
    bench = Bench(**({} if is_default else {name: most}))
    flood = [b"garbage" if is_flawed else sealed(frame(count=1), number) for number in range(most)]

    assert len(bench.arrive(*flood, sealed(frame(count=1), most))) == (0 if is_flawed else most)
    assert bench.counts.flawed.total() == (most if is_flawed else 0)
    assert bench.arrive() == [(SESSION, most)]


def test_room_is_not_read_beyond_what_arrived():
    """The rest of an earlier message in the buffer does not complete a shorter one."""
    bench = Bench()
    bench.arrive(sealed(frame(count=5), 1))

    assert bench.arrive(sealed(frame(count=5), 2)[:-1]) == []
    assert bench.counts.flawed == {Defect.SIZE: 1}
