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


@pytest.mark.parametrize(
    ("jump", "is_new_run"), [(-2 * JUMP_NS, True), (2 * JUMP_NS, True), (2 * JUMP_NS, False)]
)
def test_other_clock_is_learnt_anew(jump, is_new_run):
    """A machine started anew: its monotonic clock jumps; forward it may do so at any time."""
    clock, start = settled()
    clock.arrived(start + AHEAD + jump, start + MS // 2, is_new_run=is_new_run)
    assert not clock.is_settled

    clock.arrived(start + AHEAD + jump + SETTLING_NS, start + MS // 2 + SETTLING_NS)
    assert clock.is_settled
    assert clock.theirs(start) == start + AHEAD + jump - MS // 2 + TRANSIT_NS


def test_old_message_does_not_move_a_clock():
    clock, start = settled()
    clock.arrived(start + AHEAD - 10 * JUMP_NS, start)

    assert clock.is_settled
    assert clock.theirs(start) == pytest.approx(start + AHEAD - MS // 2 + TRANSIT_NS, abs=MS // NS_PER_DRIFT)


@pytest.mark.parametrize("silence", [MS, 2 * JUMP_NS])
@pytest.mark.parametrize("delay", [JUMP_NS // 2, 2 * JUMP_NS])
def test_way_that_becomes_longer_for_good_is_not_another_clock(delay, silence):
    """Nothing may come for as long as the delay, as when it is there from one message to the next."""
    clock, start = settled()
    for passed in range(silence, silence + 10 * JUMP_NS, MS):
        clock.arrived(start + passed - delay + AHEAD, start + passed)

    assert clock.is_settled
    off = start + passed + AHEAD - clock.theirs(start + passed)
    assert -TRANSIT_NS <= off <= (silence + 10 * JUMP_NS) // NS_PER_DRIFT


def test_way_that_becomes_longer_without_end_is_not_another_clock():
    clock, start = settled()
    for passed in range(0, 4 * JUMP_NS, MS):
        clock.arrived(start + passed // 2 + AHEAD, start + passed)

    assert clock.is_settled
    assert start + passed + AHEAD - clock.theirs(start + passed) <= 4 * JUMP_NS // NS_PER_DRIFT


def test_clock_that_was_put_back_makes_all_old_until_a_new_run():
    clock, start = settled()
    ahead = AHEAD - 100 * JUMP_NS
    for passed in range(0, JUMP_NS, MS):
        clock.arrived(start + passed + ahead, start + passed)
        assert clock.theirs(start + passed) - (start + passed + ahead) > 99 * JUMP_NS

    clock.arrived(start + passed + ahead, start + passed, is_new_run=True)
    assert not clock.is_settled
    assert clock.theirs(start + passed) == start + passed + ahead + TRANSIT_NS


def test_new_run_of_a_process_on_a_way_that_is_no_longer_leaves_the_clock_settled():
    clock, start = settled()
    clock.arrived(start + AHEAD - JUMP_NS // 2, start, is_new_run=True)

    assert clock.is_settled


@pytest.mark.parametrize("count", [1, 5])
def test_messages_of_an_instant_that_cannot_be_do_not_make_all_others_old(count):
    clock, start = settled()
    for number in range(count):
        clock.arrived(2**61 + number * MS, start + number * MS)
        assert not clock.is_settled
    start += count * MS
    for sent in range(start, start + SETTLING_NS, MS):
        hear(clock, sent)
        assert not clock.is_settled
    hear(clock, start + SETTLING_NS)

    assert clock.is_settled
    drift = 2 * SETTLING_NS // NS_PER_DRIFT
    assert clock.theirs(start) == pytest.approx(start + AHEAD - MS // 2 + TRANSIT_NS, abs=drift)


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
