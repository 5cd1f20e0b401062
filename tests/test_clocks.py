"""The clock of a publisher on another machine: never early, and not believed before it is seen to run."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from proximity.transport.clocks import JUMP_NS, NS_PER_DRIFT, SETTLING_NS, TRANSIT_NS, ForeignClock

MS = 1_000_000
AHEAD = 123_456_789_000  # ns by which their clock is ahead of ours


def hear(clock, sent, transit=MS // 2):
    """A message sent at *sent*, our clock, arrives."""
    clock.arrived(sent + AHEAD, sent + transit)


def settled():
    clock = ForeignClock()
    for sent in range(0, 2 * SETTLING_NS, MS):
        hear(clock, sent)
    assert clock.is_settled
    return clock, 2 * SETTLING_NS


def test_clock_that_was_never_heard_is_ours():
    assert ForeignClock().theirs(17) == 17
    assert not ForeignClock().is_settled


def test_fastest_message_tells_the_clock():
    clock = ForeignClock()
    for sent, transit in ((0, 9 * MS), (MS, 3 * MS), (2 * MS, 8 * MS)):
        hear(clock, sent, transit)

    drifted = clock.theirs(100 * MS) - (100 * MS + AHEAD - 3 * MS + TRANSIT_NS)
    assert -10 * MS // NS_PER_DRIFT <= drifted <= 0


@given(st.lists(st.integers(TRANSIT_NS, 500 * MS), min_size=2, max_size=50))
def test_their_clock_is_never_thought_earlier_than_it_is_less_what_all_took(transits):
    """An age that comes of it is too short by the fastest way at most, less what is allowed for it."""
    clock, now, fastest = ForeignClock(), 0, 500 * MS
    for number, transit in enumerate(transits):
        now = max(now, number * MS + transit)  # our clock does not go back
        hear(clock, number * MS, now - number * MS)
        fastest = min(fastest, now - number * MS)

    drift = len(transits) + now // NS_PER_DRIFT
    assert now + AHEAD - fastest + TRANSIT_NS - drift <= clock.theirs(now) <= now + AHEAD


def test_clock_that_drifts_is_followed():
    clock, start = settled()
    slow = 1 - 100e-6  # of theirs
    hour = 3600 * 1000 * MS
    for passed in range(0, hour, hour // 10_000):
        clock.arrived(start + AHEAD + round(passed * slow), start + passed + MS // 2)
    now = start + hour

    assert abs(clock.theirs(now) - (start + AHEAD + round(hour * slow))) < MS


def test_one_message_settles_nothing():
    clock = ForeignClock()
    hear(clock, 0)

    assert not clock.is_settled


def test_clock_is_settled_once_it_was_seen_to_run():
    clock = ForeignClock()
    for sent in range(0, SETTLING_NS, MS):
        hear(clock, sent)
        assert not clock.is_settled
    hear(clock, SETTLING_NS)

    assert clock.is_settled


def test_slow_publisher_settles_with_its_second_message():
    clock = ForeignClock()
    hear(clock, 0)
    hear(clock, 200 * MS)

    assert clock.is_settled


@given(st.integers(2, 300), st.integers(0, 3000))
def test_row_of_old_messages_that_comes_at_once_settles_nothing(count, gap_ns):
    clock = ForeignClock()
    for number in range(count):
        clock.arrived(number * MS, number * gap_ns)

    assert not clock.is_settled


@pytest.mark.parametrize("count", [10, 60, 150, 300])
def test_row_of_old_messages_in_two_parts_settles_nothing(count):
    """What comes 100 ms later was sent `count` ms later: that is not how a clock runs."""
    clock = ForeignClock()
    for part in range(2):
        for number in range(count):
            clock.arrived((part * count + number) * MS, part * 100 * MS + number)

    assert not clock.is_settled


def test_first_messages_that_were_held_up_do_not_count():
    clock = ForeignClock()
    hear(clock, 0, 90 * MS)
    hear(clock, 60 * MS, 35 * MS)  # much faster: a new beginning
    hear(clock, 96 * MS, MS)

    assert not clock.is_settled


def test_settled_clock_stays_so_when_a_way_becomes_faster_or_slower():
    clock, start = settled()
    hear(clock, start, 300 * MS)
    hear(clock, start + MS, 0)

    assert clock.is_settled
    assert clock.theirs(start + 10 * MS) == start + 10 * MS + AHEAD + TRANSIT_NS


def test_other_clock_is_learnt_anew():
    """A machine started anew, or slept: its monotonic clock jumps."""
    for jump in (-2 * JUMP_NS, 2 * JUMP_NS):
        clock, start = settled()
        clock.arrived(start + AHEAD + jump, start + MS // 2)
        assert not clock.is_settled

        clock.arrived(start + AHEAD + jump + SETTLING_NS, start + MS // 2 + SETTLING_NS)
        assert clock.is_settled
        assert clock.theirs(start) == start + AHEAD + jump - MS // 2 + TRANSIT_NS


def test_old_message_neither_settles_nor_moves_a_clock_for_good():
    clock, start = settled()
    clock.arrived(start + AHEAD - 10 * JUMP_NS, start)
    assert not clock.is_settled

    for sent in range(start + MS, start + 2 * SETTLING_NS, MS):
        hear(clock, sent)
    assert clock.is_settled
    assert clock.theirs(start) == start + AHEAD - MS // 2 + TRANSIT_NS


@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=5))
def test_any_instants_are_taken(instants):
    clock = ForeignClock()
    for number, sent in enumerate(instants):
        clock.arrived(sent, number * MS)
    assert isinstance(clock.theirs(0), int)


def test_reset_forgets():
    clock, _ = settled()
    clock.reset()

    assert not clock.is_settled
    assert clock.theirs(5) == 5
