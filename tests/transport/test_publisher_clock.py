"""The clock of a publisher on another machine: never too early, and used only after it was seen to run."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from proximity.transport.publisher_clock import (
    JUMP_NS,
    NS_PER_DRIFT,
    PACE_NS,
    SETTLING_NS,
    TRANSIT_NS,
    ForeignClock,
)

MS = 1_000_000
AHEAD = 123_456_789_000  # ns by which the other clock is ahead of ours


def hear(clock, sent, transit=MS // 2, **settings):
    """Deliver a message sent at *sent*, on our clock."""
    clock.arrived(sent + AHEAD, sent + transit, **settings)


def settled(transit=MS // 2):
    """Return a certain clock behind a path of that transit time, and when the next message is sent."""
    clock = ForeignClock()
    for sent in range(0, 2 * SETTLING_NS, MS):
        hear(clock, sent, transit)
    assert clock.is_certain
    return clock, 2 * SETTLING_NS


def run(clock, start, duration, transit=MS // 2, period=MS):
    """Deliver messages sent from *start* on, on our clock; none may seem younger than it is.

    Return when the next one would be sent.
    """
    for sent in range(start, start + duration, period):
        hear(clock, sent, transit)
        assert is_old_or_true(clock, sent, transit)
    return start + duration


def is_old_or_true(clock, sent, transit):
    """Test whether the age of a late message is known, up to drift and what no receiver can detect."""
    drift = 60 * JUMP_NS // NS_PER_DRIFT
    age = clock.theirs(sent + transit) - (sent + AHEAD)
    return not clock.is_certain or age >= transit - PACE_NS - drift


def becomes_certain(clock, start, offset=AHEAD, **first):
    """Deliver messages of another clock until it is certain, after `SETTLING_NS`; return that instant."""
    for sent in range(start, start + SETTLING_NS, MS):
        clock.arrived(sent + offset, sent + MS // 2, **(first if sent == start else {}))
        assert not clock.is_certain
    end = start + SETTLING_NS
    clock.arrived(end + offset, end + MS // 2)
    assert clock.is_certain
    return end


def shows(clock, now, offset=AHEAD, within=MS // 10):
    """Test whether the estimate of their clock is right, given messages that take half a ms."""
    return abs(clock.theirs(now) - (now + offset - MS // 2 + TRANSIT_NS)) <= within


def test_clock_that_was_never_heard_or_is_reset_is_ours():
    clock, _ = settled()
    clock.reset()
    for unheard in (ForeignClock(), clock):
        assert unheard.theirs(17) == 17 and not unheard.is_certain


def test_fastest_message_tells_the_clock():
    clock = ForeignClock()
    for sent, transit in ((0, 9 * MS), (MS, 3 * MS), (2 * MS, 8 * MS)):
        hear(clock, sent, transit)

    drifted = clock.theirs(100 * MS) - (100 * MS + AHEAD - 3 * MS + TRANSIT_NS)
    assert -10 * MS // NS_PER_DRIFT <= drifted <= 0


@given(st.lists(st.integers(TRANSIT_NS, 500 * MS), min_size=2, max_size=50))
def test_their_clock_is_never_thought_earlier_than_it_is_less_what_all_took(transits):
    """A computed age is too short by the shortest transit at most, less the allowance for it."""
    clock, now, fastest = ForeignClock(), 0, 500 * MS
    for number, transit in enumerate(transits):
        now = max(now, number * MS + transit)  # our clock does not run backwards
        hear(clock, number * MS, now - number * MS)
        fastest = min(fastest, now - number * MS)

    drift = len(transits) + now // NS_PER_DRIFT
    assert now + AHEAD - fastest + TRANSIT_NS - drift <= clock.theirs(now) <= now + AHEAD


def test_clock_that_drifts_is_followed():
    clock, start = settled()
    slow, hour = 1 - 100e-6, 3600 * 1000 * MS  # on their clock
    for passed in range(0, hour, hour // 10_000):
        clock.arrived(start + AHEAD + round(passed * slow), start + passed + MS // 2)

    assert abs(clock.theirs(start + hour) - (start + AHEAD + round(hour * slow))) < MS


@pytest.mark.parametrize(
    ("messages", "is_certain"),
    [
        ([(0, MS)], False),
        ([(sent, MS) for sent in range(0, SETTLING_NS, MS)], False),
        ([(sent, MS) for sent in range(0, SETTLING_NS + MS, MS)], True),
        ([(0, MS), (200 * MS, MS)], True),  # a slow publisher
        ([(0, 90 * MS), (60 * MS, 35 * MS), (96 * MS, MS)], False),  # the first were delayed: a restart
    ],
)
def test_clock_is_certain_once_it_was_seen_to_run(messages, is_certain):
    clock = ForeignClock()
    for sent, transit in messages:
        hear(clock, sent, transit)
    assert clock.is_certain is is_certain


@given(st.integers(2, 300), st.integers(0, 3000), st.integers(1, 2))
def test_row_of_old_messages_that_comes_at_once_settles_nothing(count, gap_ns, parts):
    """Nor in two parts: 100 ms later on arrival against `count` ms later at the sender is not a clock's rate.

    A clock half as fast or half as fast again is accepted: `PACE_NS` is half of `SETTLING_NS`.
    """
    clock = ForeignClock()
    for number in range(count * parts):
        part, row = divmod(number, count)
        if part and 50 <= count <= 150:
            return  # nearly the rate of a clock
        clock.arrived(number * MS, part * 100 * MS + row * gap_ns)
    assert not clock.is_certain


def test_settled_clock_stays_so_when_a_way_becomes_faster_or_slower():
    clock, start = settled()
    hear(clock, start, 300 * MS)
    hear(clock, start + MS, 0)
    hear(clock, start + 2 * MS, JUMP_NS // 2, is_new_run=True)  # another process, on a path that is no longer

    assert clock.is_certain
    assert clock.theirs(start + 10 * MS) == pytest.approx(start + 10 * MS + AHEAD + TRANSIT_NS, abs=MS)


@pytest.mark.parametrize(
    ("jump", "is_new_run"), [(-2 * JUMP_NS, True), (2 * JUMP_NS, True), (2 * JUMP_NS, False)]
)
def test_other_clock_is_learnt_anew(jump, is_new_run):
    """A machine that restarts: its monotonic clock jumps; forward it may jump at any time."""
    clock, start = settled()
    end = becomes_certain(clock, start, AHEAD + jump, is_new_run=is_new_run)
    assert shows(clock, end, AHEAD + jump)


@pytest.mark.parametrize("is_new_run", [False, True])
@pytest.mark.parametrize("behind", [7 * MS, 100 * MS, 500 * MS, 900 * MS, 100 * JUMP_NS])
def test_clock_that_was_put_back_makes_all_stale_until_it_is_known_again(behind, is_new_run):
    """Or when another machine takes over immediately."""
    clock, start = settled()
    end = becomes_certain(clock, start, AHEAD - behind, is_new_run=is_new_run)
    assert shows(clock, end, AHEAD - behind)


@pytest.mark.parametrize("wrong", [-10 * JUMP_NS, 2**61])
@pytest.mark.parametrize("count", [1, 5])
def test_instants_that_cannot_be_make_all_stale_until_the_clock_is_known_again(wrong, count):
    """Messages of one kind arrive in order: an earlier instant shows that one of the two is wrong."""
    clock, start = settled()
    for number in range(count):
        sent = wrong + number * MS if wrong > 0 else start + AHEAD + wrong
        clock.arrived(sent, start + number * MS)
        assert not clock.is_certain
    end = becomes_certain(clock, start + count * MS)

    assert shows(clock, end)


@pytest.mark.parametrize("period", [MS, 11 * MS, 20 * MS])
@pytest.mark.parametrize("early", [26 * MS, 60 * MS, 500 * MS, 990 * MS, 1500 * MS])
@pytest.mark.parametrize("is_first", [False, True])
def test_instant_that_is_too_early_is_undone_by_those_that_follow(early, period, is_first):
    clock, start = (ForeignClock(), 0) if is_first else settled()
    clock.arrived(start + AHEAD + early, start + MS // 2)
    assert not clock.is_certain
    end = run(clock, start + period, SETTLING_NS + 3 * period, period=period)

    assert clock.is_certain and shows(clock, end, within=MS)


@pytest.mark.parametrize("pause", [MS, 2 * JUMP_NS])
@pytest.mark.parametrize("delay", [JUMP_NS // 2, 2 * JUMP_NS])
def test_way_that_becomes_longer_for_good_is_not_another_clock(delay, pause):
    """No message arrives during the delay, as messages of one kind arrive in order."""
    clock, start = settled()
    silence = delay + pause
    for passed in range(silence, silence + 10 * JUMP_NS, MS):
        clock.arrived(start + passed - delay + AHEAD, start + passed)

    assert clock.is_certain
    off = start + passed + AHEAD - clock.theirs(start + passed)
    assert -TRANSIT_NS <= off <= (silence + 10 * JUMP_NS) // NS_PER_DRIFT


@pytest.mark.parametrize("slow", [100 * MS, 300 * MS, 600 * MS, 900 * MS])
@pytest.mark.parametrize("is_gradual", [False, True])
def test_way_that_becomes_longer_at_once_or_slowly_is_only_drift(slow, is_gradual):
    clock, start = settled()
    for sent in range(start, start + JUMP_NS * is_gradual, MS):
        transit = MS // 2 + slow * (sent - start) // JUMP_NS
        hear(clock, sent, transit)
        assert is_old_or_true(clock, sent, transit)
        start = sent + MS
    run(clock, start, 10 * JUMP_NS, slow)

    assert clock.is_certain


def test_way_that_becomes_longer_without_end_is_not_another_clock():
    clock, start = settled()
    for passed in range(0, 4 * JUMP_NS, MS):
        clock.arrived(start + passed // 2 + AHEAD, start + passed)

    assert clock.is_certain
    assert start + passed + AHEAD - clock.theirs(start + passed) <= 4 * JUMP_NS // NS_PER_DRIFT


@pytest.mark.parametrize("slow", [30 * MS, 500 * MS, 900 * MS, 1500 * MS])
@pytest.mark.parametrize("count", [1, 3, 40, 60])
def test_way_that_was_short_once_and_is_long_again_brings_no_former_clock_back(slow, count):
    """The former clock was wrong by the transit time: messages that fit it are old."""
    clock, start = settled(slow)
    start += slow  # messages sent until then are lost: none overtakes
    for number in range(count):
        hear(clock, start + number * MS)
    run(clock, start + count * MS, 5 * JUMP_NS, slow)


@pytest.mark.parametrize("slow", [30 * MS, 500 * MS, 1500 * MS])
def test_burst_of_old_messages_brings_no_former_clock_back(slow):
    """Delayed messages arrive together, in order, repeatedly."""
    clock, now = settled(slow)
    hear(clock, now)  # before a fast message the delay of the others is unknown
    for _ in range(20):
        now += slow
        for sent in range(now - slow, now, MS):
            hear(clock, sent, now - sent)
            assert is_old_or_true(clock, sent, now - sent)
    assert now + AHEAD - clock.theirs(now) < PACE_NS


def test_messages_of_another_kind_that_were_overtaken_prove_no_mistake():
    clock, start = settled(500 * MS)
    start += 500 * MS
    clock.arrived(start + AHEAD, start, kind=1)
    for sent in range(start - 400 * MS, start + 3 * JUMP_NS, MS):
        clock.arrived(sent + AHEAD, sent + 500 * MS, kind=2)
        assert is_old_or_true(clock, sent, 500 * MS)


@pytest.mark.parametrize("slow", [100 * MS, 500 * MS, 900 * MS])
@pytest.mark.parametrize(("pause", "early"), [(0, 0), (10 * MS, 0), (2 * JUMP_NS, 0), (MS, 500 * MS)])
def test_publisher_that_starts_anew_behind_a_late_way_is_old(slow, pause, early):
    """Also after an instant that was too early."""
    clock, start = settled()
    if early:
        clock.arrived(start + AHEAD + early, start + MS // 2)
    start += pause
    hear(clock, start, slow, is_new_run=True)
    run(clock, start + MS, 5 * JUMP_NS, slow)

    assert clock.is_certain or early


rows_of_ways = st.tuples(
    st.integers(MS, 700 * MS), st.integers(1, 400), st.sampled_from([MS, 7 * MS]), st.booleans()
)


@given(st.lists(rows_of_ways, min_size=1, max_size=12))
def test_no_row_of_ways_and_runs_makes_what_is_old_seem_young(rows):
    """With correct instants in order, the transit time may change at will, and runs may begin."""
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
