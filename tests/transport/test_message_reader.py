"""Distrust: what is let through, what is counted, and which runs of a publisher count."""

import struct
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from wire import MS, NOW, SESSION, Clock, Wire, frame, sealed

from proximity.core.receiver_state import MOST_AT_ONCE, MOST_FLAWED, MOST_SKIPPED
from proximity.message import FRAME, MAX_RECORDS, MOVES, POSES, Defect, Message
from proximity.transport.message_reader import MessageReader

SECOND = 1000 * MS


class Bench:
    """A reader at a wire."""

    def __init__(self, *, shares_clock=True, kinds=(FRAME,), **settings):
        self.clock, self.wire = Clock(), Wire(shares_clock)
        self.reader = MessageReader(self.wire, kinds, self.clock, **settings)

    @property
    def counts(self):
        return self.reader.counts

    def arrive(self, *messages):
        """Let messages arrive; their numbers that were let through, (session, sequence)."""
        for data in messages:
            self.wire.put(data)
        return [tuple(data[16:32].view("<u8").tolist()) for _, data, _ in self.reader.messages()]

    def arrive_frame(self, sequence, session=0, sent=None):
        """Let a frame of a session arrive that is sent now, unless said."""
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


def test_repeated_and_overtaken_messages_are_old():
    bench = Bench()

    assert [bench.arrive_frame(number) for number in (4, 4, 3, 0, 5)] == [True, False, False, False, True]
    assert bench.counts.flawed == {Defect.OLD: 3}
    assert bench.counts.lost == 0


@given(st.lists(st.integers(0, 40), min_size=1, max_size=40))
def test_received_and_lost_are_all_that_was_published_since_the_first(numbers):
    bench = Bench()
    for number in numbers:
        bench.arrive_frame(number)

    counts = bench.counts
    assert counts.received + counts.lost == max(numbers) - numbers[0] + 1
    assert counts.received + counts.flawed[Defect.OLD] == len(numbers)


def test_losses_go_on_being_counted_when_the_publisher_starts_anew():
    bench = Bench()
    bench.arrive_frame(10)
    bench.arrive_frame(12)
    bench.arrive_frame(3, session=1)  # three of the new run were lost
    bench.arrive_frame(4, session=1)

    counts = bench.counts
    assert (counts.received, counts.lost, counts.sessions) == (4, 1 + 3, 2)


def test_number_far_beyond_the_last_is_none_of_the_run():
    """One numbered 2**64 - 1 made all that followed look overtaken, until another run."""
    bench = Bench()
    assert bench.arrive_frame(0)
    assert not bench.arrive_frame(2**64 - 1)
    assert not bench.arrive_frame(MOST_SKIPPED + 1)
    assert bench.arrive_frame(MOST_SKIPPED)
    assert bench.counts.lost == MOST_SKIPPED - 1

    assert bench.arrive_frame(2**64 - 1, session=1)  # of another run it may be the first
    assert not bench.arrive_frame(0, session=1)
    assert bench.arrive_frame(0, session=2)
    assert bench.counts.lost == MOST_SKIPPED - 1  # of a run that was joined late none is known to be missing


@pytest.mark.parametrize("shares_clock", [True, False])
def test_publisher_started_anew_counts_at_once(shares_clock):
    """However soon."""
    bench = Bench(shares_clock=shares_clock)
    bench.arrive_frame(1000)
    bench.clock.now += 1

    assert bench.arrive_frame(0, session=1)
    assert bench.counts.sessions == 2


@pytest.mark.parametrize("shares_clock", [True, False])
@pytest.mark.parametrize("silence", [0, 10 * SECOND])
def test_messages_of_an_earlier_run_never_come_back(shares_clock, silence):
    bench = Bench(shares_clock=shares_clock)
    old = [sealed(frame(NOW, 1), number) for number in range(5)]
    bench.arrive(*old)
    bench.clock.now += SECOND
    bench.arrive_frame(0, session=1)
    bench.clock.now += silence

    assert bench.arrive(*old) == []
    assert bench.counts.flawed == {Defect.OLD: 5}


def test_messages_of_an_earlier_run_that_was_never_seen_are_told_by_when_they_were_sent():
    """On the clock that this machine shares; however long the present run is silent."""
    bench = Bench()
    bench.arrive_frame(0, session=1)
    bench.clock.now += 10 * SECOND

    assert not bench.arrive_frame(77, session=0, sent=NOW - SECOND)
    assert bench.counts.flawed == {Defect.OLD: 1}


def test_calendar_put_back_does_not_stop_a_publisher_on_this_machine():
    bench = Bench()
    bench.arrive_frame(1000)
    bench.clock.now += MS

    assert bench.arrive_frame(0, session=-10_000 * SECOND)
    bench.clock.now += MS
    assert bench.arrive_frame(1, session=-10_000 * SECOND)
    assert not bench.arrive_frame(1000)


def test_calendar_put_back_stops_a_publisher_elsewhere_until_the_old_run_is_silent():
    bench = Bench(shares_clock=False)
    bench.arrive_frame(1000)
    bench.clock.now += 50 * MS
    assert not bench.arrive_frame(0, session=-10_000 * SECOND)
    bench.clock.now += MS

    assert bench.arrive_frame(1, session=-10_000 * SECOND)
    assert not bench.arrive_frame(1000)


def test_run_that_was_interrupted_by_another_goes_on_with_new_numbers():
    """Two publishers at one address, one after the other, and the first is still there."""
    bench = Bench()
    bench.arrive_frame(10)
    bench.arrive_frame(0, session=5)
    bench.clock.now += 50 * MS + 1

    assert not bench.arrive_frame(10)
    assert bench.arrive_frame(12)
    assert bench.counts.lost == 1


@pytest.mark.parametrize("shares_clock", [True, False])
@pytest.mark.parametrize("other", [5, -5])
def test_two_publishers_at_one_address_are_not_believed_in_turn(shares_clock, other):
    """As of two services that send datagrams to one port: the distances would be of two scenes in turn."""
    bench = Bench(shares_clock=shares_clock)
    bench.arrive_frame(0)
    bench.clock.now += 51 * MS
    seen = []
    for number in range(1, 100):
        for session in (other, 0):
            bench.clock.now += MS
            seen.append((session, bench.arrive_frame(number, session)))

    assert [session for session, is_taken in seen if is_taken] == [other] * 99
    assert (bench.counts.flawed, bench.counts.sessions) == ({Defect.OLD: 99}, 2)


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
    """A flood of garbage leaves the reader its time, and so do good ones."""
    name, default = ("most_flawed", MOST_FLAWED) if is_flawed else ("most_at_once", MOST_AT_ONCE)
    most = default if is_default else 3
    bench = Bench(**({} if is_default else {name: most}))
    flood = [b"garbage" if is_flawed else sealed(frame(count=1), number) for number in range(most)]

    assert len(bench.arrive(*flood, sealed(frame(count=1), most))) == (0 if is_flawed else most)
    assert bench.counts.flawed.total() == (most if is_flawed else 0)
    assert bench.arrive() == [(SESSION, most)]


def test_room_is_not_read_beyond_what_arrived():
    """What an earlier message left there is not taken for the end of a shorter one."""
    bench = Bench()
    bench.arrive(sealed(frame(count=5), 1))

    assert bench.arrive(sealed(frame(count=5), 2)[:-1]) == []
    assert bench.counts.flawed == {Defect.SIZE: 1}
