"""The clock of a publisher on another machine: never early, and not believed before it is seen to run."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from proximity.transport.publisher_clock import (
    JUMP_NS,
    NS_PER_DRIFT,
    PACE_NS,
    SETTLING_NS,
    TRANSIT_NS,
    UNCERTAIN_NS,
    ForeignClock,
)

MS = 1_000_000
AHEAD = 123_456_789_000  # ns by which their clock is ahead of ours


def hear(clock, sent, transit=MS // 2):
    """A message sent at *sent*, our clock, arrives."""
    clock.arrived(sent + AHEAD, sent + transit)


def settled():
    clock = ForeignClock()
    for sent in range(0, 2 * SETTLING_NS, MS):
        hear(clock, sent)
    assert clock.is_certain
    return clock, 2 * SETTLING_NS


def test_clock_that_was_never_heard_is_ours():
    assert ForeignClock().theirs(17) == 17
    assert not ForeignClock().is_certain


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


def test_clock_is_certain_once_it_was_seen_to_run():
    clock = ForeignClock()
    for sent in range(0, SETTLING_NS, MS):
        hear(clock, sent)
        assert not clock.is_certain
    hear(clock, SETTLING_NS)

    assert clock.is_certain


def test_slow_publisher_settles_with_its_second_message():
    clock = ForeignClock()
    hear(clock, 0)
    hear(clock, 200 * MS)

    assert clock.is_certain


@given(st.integers(2, 300), st.integers(0, 3000))
def test_row_of_old_messages_that_comes_at_once_settles_nothing(count, gap_ns):
    clock = ForeignClock()
    for number in range(count):
        clock.arrived(number * MS, number * gap_ns)

    assert not clock.is_certain


@pytest.mark.parametrize("count", [10, 300])
def test_row_of_old_messages_in_two_parts_settles_nothing(count):
    """What comes 100 ms later was sent `count` ms later: that is not how a clock runs."""
    clock = ForeignClock()
    for part in range(2):
        for number in range(count):
            clock.arrived((part * count + number) * MS, part * 100 * MS + number)

    assert not clock.is_certain


def test_first_messages_that_were_held_up_do_not_count():
    clock = ForeignClock()
    hear(clock, 0, 90 * MS)
    hear(clock, 60 * MS, 35 * MS)  # much faster: a new beginning
    hear(clock, 96 * MS, MS)

    assert not clock.is_certain


def test_settled_clock_stays_so_when_a_way_becomes_faster_or_slower():
    clock, start = settled()
    hear(clock, start, 300 * MS)
    hear(clock, start + MS, 0)

    assert clock.is_certain
    assert clock.theirs(start + 10 * MS) == start + 10 * MS + AHEAD + TRANSIT_NS


@pytest.mark.parametrize(
    ("jump", "is_new_run"), [(-2 * JUMP_NS, True), (2 * JUMP_NS, True), (2 * JUMP_NS, False)]
)
def test_other_clock_is_learnt_anew(jump, is_new_run):
    """A machine started anew: its monotonic clock jumps; forward it may do so at any time."""
    clock, start = settled()
    clock.arrived(start + AHEAD + jump, start + MS // 2, is_new_run=is_new_run)
    assert not clock.is_certain

    clock.arrived(start + AHEAD + jump + SETTLING_NS, start + MS // 2 + SETTLING_NS)
    assert clock.is_certain
    assert clock.theirs(start) == start + AHEAD + jump - MS // 2 + TRANSIT_NS


def test_old_message_does_not_move_a_clock():
    clock, start = settled()
    clock.arrived(start + AHEAD - 10 * JUMP_NS, start)

    assert clock.is_certain
    assert clock.theirs(start) == pytest.approx(start + AHEAD - MS // 2 + TRANSIT_NS, abs=MS // NS_PER_DRIFT)


def test_clock_that_was_put_back_makes_all_old_until_a_new_run():
    clock, start = settled()
    ahead = AHEAD - 100 * JUMP_NS
    for passed in range(0, JUMP_NS, MS):
        clock.arrived(start + passed + ahead, start + passed)
        assert clock.theirs(start + passed) - (start + passed + ahead) > 99 * JUMP_NS

    clock.arrived(start + passed + ahead, start + passed, is_new_run=True)
    assert not clock.is_certain
    assert clock.theirs(start + passed) == start + passed + ahead + TRANSIT_NS


def test_new_run_of_a_process_on_a_way_that_is_no_longer_leaves_the_clock_settled():
    clock, start = settled()
    clock.arrived(start + AHEAD, start + JUMP_NS // 2, is_new_run=True)

    assert clock.is_certain


@pytest.mark.parametrize("count", [1, 5])
def test_messages_of_an_instant_that_cannot_be_do_not_make_all_others_old(count):
    clock, start = settled()
    for number in range(count):
        clock.arrived(2**61 + number * MS, start + number * MS)
        assert not clock.is_certain
    start += count * MS
    for sent in range(start, start + SETTLING_NS, MS):
        hear(clock, sent)
        assert not clock.is_certain
    hear(clock, start + SETTLING_NS)

    assert clock.is_certain
    drift = 2 * SETTLING_NS // NS_PER_DRIFT
    assert clock.theirs(start) == pytest.approx(start + AHEAD - MS // 2 + TRANSIT_NS, abs=drift)


def run(clock, start, duration, transit=MS // 2, period=MS):
    """Messages that are sent from *start* on, our clock, and arrive; none may seem younger than it is.

    Gives when the next would be sent.
    """
    end = start + duration
    for sent in range(start, end, period):
        hear(clock, sent, transit)
        assert is_old_or_true(clock, sent, transit)
    return end


def is_old_or_true(clock, sent, transit):
    """Whether a message that took long is known to be as old, but for what no receiver can see, or drift."""
    drift = 60 * JUMP_NS // NS_PER_DRIFT
    age = clock.theirs(sent + transit) - (sent + AHEAD)
    return not clock.is_certain or age >= transit - PACE_NS - drift


@pytest.mark.parametrize("period", [MS, 20 * MS])
@pytest.mark.parametrize("early", [26 * MS, 1500 * MS])
def test_instant_that_is_too_early_is_undone_by_those_that_follow(early, period):
    clock, start = settled()
    clock.arrived(start + AHEAD + early, start + MS // 2)
    assert not clock.is_certain
    end = run(clock, start + period, UNCERTAIN_NS + SETTLING_NS + 3 * period, period=period)

    assert clock.is_certain
    assert clock.theirs(end) == pytest.approx(end + AHEAD - MS // 2 + TRANSIT_NS, abs=MS)


def test_instant_that_is_too_early_is_not_undone_sooner():
    clock, start = settled()
    clock.arrived(start + AHEAD + 500 * MS, start + MS // 2)
    for sent in range(start + MS, start + UNCERTAIN_NS, MS):
        hear(clock, sent)
        assert not clock.is_certain
        assert clock.theirs(sent) > sent + AHEAD + 499 * MS


def slow_and_settled(transit):
    """A reader that began behind a way that is longer than it need be."""
    clock = ForeignClock()
    for sent in range(0, 2 * SETTLING_NS, MS):
        hear(clock, sent, transit)
    assert clock.is_certain
    return clock, 2 * SETTLING_NS


@pytest.mark.parametrize("slow", [30 * MS, 1500 * MS])
@pytest.mark.parametrize("count", [1, 60])
def test_way_that_was_short_once_and_is_long_again_brings_no_former_clock_back(slow, count):
    """The former clock was wrong by how long the way is: what fits it is old."""
    clock, start = slow_and_settled(slow)
    start += slow  # what was sent meanwhile is lost: none overtakes
    for number in range(count):
        hear(clock, start + number * MS)
    run(clock, start + count * MS, 5 * JUMP_NS, slow)


@pytest.mark.parametrize("slow", [30 * MS, 1500 * MS])
def test_burst_of_old_messages_brings_no_former_clock_back(slow):
    """What was held up comes at once, in order, again and again."""
    clock, now = slow_and_settled(slow)
    hear(clock, now)  # until one was fast, nothing tells how slow the others were
    for _ in range(20):
        now += slow
        for sent in range(now - slow, now, MS):
            hear(clock, sent, now - sent)
            assert is_old_or_true(clock, sent, now - sent)
    assert now + AHEAD - clock.theirs(now) < PACE_NS


def test_messages_of_another_kind_that_were_overtaken_prove_no_mistake():
    clock, start = slow_and_settled(500 * MS)
    start += 500 * MS
    clock.arrived(start + AHEAD, start, kind=1)
    for sent in range(start - 400 * MS, start + 3 * JUMP_NS, MS):
        clock.arrived(sent + AHEAD, sent + 500 * MS, kind=2)
        assert is_old_or_true(clock, sent, 500 * MS)


@pytest.mark.parametrize("slow", [100 * MS, 900 * MS])
def test_publisher_that_starts_anew_behind_a_late_way_after_a_mistake_is_old(slow):
    clock, start = settled()
    clock.arrived(start + AHEAD + 500 * MS, start + MS // 2)
    clock.arrived(start + MS + AHEAD, start + MS + slow, is_new_run=True)
    run(clock, start + 2 * MS, 5 * JUMP_NS, slow)


@pytest.mark.parametrize("behind", [100 * MS, 900 * MS])
def test_new_run_that_was_sent_before_the_last_of_the_run_before_has_another_clock(behind):
    """As when another machine takes over at once."""
    clock, start = settled()
    clock.arrived(start + AHEAD - behind, start + MS // 2, is_new_run=True)
    assert not clock.is_certain
    for sent in range(start + MS, start + MS + SETTLING_NS, MS):
        clock.arrived(sent + AHEAD - behind, sent + MS // 2)

    assert clock.is_certain
    now = start + SETTLING_NS
    assert clock.theirs(now) == pytest.approx(now + AHEAD - behind - MS // 2 + TRANSIT_NS, abs=MS)


@pytest.mark.parametrize("slow", [100 * MS, 900 * MS])
@pytest.mark.parametrize("is_gradual", [False, True])
def test_way_that_becomes_longer_for_good_is_only_drift(slow, is_gradual):
    clock, start = settled()
    sent = start
    if is_gradual:
        for sent in range(start, start + JUMP_NS, MS):
            transit = MS // 2 + slow * (sent - start) // JUMP_NS
            hear(clock, sent, transit)
            assert is_old_or_true(clock, sent, transit)
    run(clock, sent + MS, 10 * JUMP_NS, slow)

    assert clock.is_certain


@given(
    st.lists(
        st.tuples(
            st.integers(MS, 700 * MS), st.integers(1, 400), st.sampled_from([MS, 7 * MS]), st.booleans()
        ),
        min_size=1,
        max_size=12,
    )
)
def test_no_row_of_ways_and_runs_makes_what_is_old_seem_young(rows):
    """Where instants are right and come in order, ways may change as they like, and runs begin."""
    clock, start = settled()
    now = 0
    for transit, count, period, is_new_run in rows:
        for number in range(count):
            start += period
            now = max(now, start + transit)
            clock.arrived(start + AHEAD, now, is_new_run=is_new_run and number == 0)
            assert is_old_or_true(clock, start, now - start)


@given(st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=5))
def test_any_instants_are_taken(instants):
    clock = ForeignClock()
    for number, sent in enumerate(instants):
        clock.arrived(sent, number * MS)
    assert isinstance(clock.theirs(0), int)


def test_reset_forgets():
    clock, _ = settled()
    clock.reset()

    assert not clock.is_certain
    assert clock.theirs(5) == 5
