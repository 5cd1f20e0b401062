"""Publishers that restart, copies of old frames, and publishers on other machines."""

import pytest
from wire import MS, NOW, SESSION, Reader, frame, is_silent, sealed, with_frame

from proximity.message import Defect, State
from proximity.transport.publisher_clock import NS_PER_DRIFT

SECOND = 1000 * MS


def test_restart_is_recovered_from_at_once():
    bench = with_frame(age=0)
    bench.read(10 * MS)
    bench.sequence = 0
    bench.send(frame(bench.clock.now), session=SESSION + 10 * MS)
    reading = bench.read()

    assert (reading.state, reading.is_new, bench.subscriber.counts.sessions) == (State.OK, True, 2)


@pytest.mark.parametrize("silence", [0, SECOND])
def test_copies_of_an_earlier_run_never_make_a_reading_better(silence):
    old = [sealed(frame(NOW + number * MS), number, SESSION) for number in range(100)]
    bench = Reader()
    bench.clock.now = NOW + 150 * MS
    bench.send(frame(bench.clock.now, age=0, distance=0.01), session=SESSION + 150 * MS)
    bench.read()
    expected = bench.read(silence)
    for data in old:
        bench.wire.put(data)
    reading = bench.read()

    assert (reading.state, reading.is_new) == (expected.state, False)
    assert bench.flawed == {Defect.OLD: 100}
    lone = Reader()  # a copy of the only run is stale by its age
    lone.clock.now += SECOND
    lone.send(frame())
    assert lone.read().state is State.STALE


AHEAD = 55_555_000_000  # ns that their clock is ahead


def foreign_bench(frames=60, transit=2 * MS):
    """Return a subscriber that has received *frames* frames, one each ms, from another machine."""
    bench = Reader(shares_clock=False)
    for _ in range(frames):
        hear(bench, transit)
    return bench


def hear(bench, transit=2 * MS, session=SESSION, **settings):
    """Advance the clock by 1 ms and deliver a frame sent *transit* earlier."""
    bench.clock.now += MS
    bench.send(frame(bench.clock.now - transit + AHEAD, **settings), session)
    return bench.read()


def test_publisher_elsewhere_is_believed_when_its_clock_has_been_seen_to_run():
    bench = Reader(shares_clock=False)
    states = [hear(bench).state for _ in range(60)]
    assert states == [State.STALE] * 50 + [State.OK] * 10


def test_age_is_that_of_their_clock():
    reading = hear(foreign_bench(), age=5 * MS)
    assert reading.age_ns == pytest.approx(6 * MS, abs=1000)  # one ms of transit is assumed
    assert reading.now_ns == pytest.approx(int(reading.header["publish_ns"]) + MS, abs=1000)


def test_frame_that_was_held_up_is_older():
    bench = foreign_bench()
    bench.read(30 * MS)  # frames arrive in order: none arrives before
    reading = hear(bench, transit=32 * MS)

    assert reading.state is State.LATE
    assert reading.age_ns == pytest.approx(32 * MS, abs=32 * MS // NS_PER_DRIFT)


@pytest.mark.parametrize("delay", [50 * MS, 1300 * MS])
def test_link_that_becomes_late_for_good_is_never_told_as_fresh(delay):
    """A frame measured 1307.7 ms ago was reported OK, aged 8.2 ms, as from a publisher with another clock."""
    bench = foreign_bench()
    bench.read(delay)  # no frame arrives during the delay
    for _ in range(2000):
        reading = hear(bench, transit=2 * MS + delay)
        assert reading.state in (State.LATE, State.STALE)
        assert reading.age_ns >= delay


def test_frame_of_a_publisher_elsewhere_grows_old_and_one_from_the_future_is_dropped():
    bench = foreign_bench()
    hear(bench, age=-5 * MS - 1)

    assert bench.flawed == {Defect.FUTURE: 1}
    assert bench.read(30 * MS).state is State.LATE
    assert bench.read(100 * MS).state is State.STALE


def test_copies_of_an_old_run_are_not_revived_when_the_present_one_is_silent():
    """Even copies new to this subscriber whose fields say that they are fresh."""
    bench = foreign_bench()
    bench.clock.now += 10 * SECOND
    for number in range(200):
        message = frame(NOW - 100 * SECOND + number * MS, age=0)
        bench.wire.put(sealed(message, number, SESSION - 1000 * SECOND))
    for _ in range(3):
        reading = bench.read(20 * MS)
        assert reading.state is State.STALE and is_silent(reading.contacts)


def test_publisher_that_comes_back_after_copies_is_believed_again():
    """The copies must be absent for 50 ms, and its clock must run for another 50 ms."""
    bench = foreign_bench()
    bench.clock.now += 10 * SECOND
    bench.wire.put(sealed(frame(NOW - 100 * SECOND, age=0), 10**6, SESSION - 1000 * SECOND))
    bench.read()
    states = [hear(bench).state for _ in range(110)]

    assert states == [State.STALE] * 100 + [State.OK] * 10


@pytest.mark.parametrize("jump", [-(2**40), 2**40])
def test_machine_started_anew_is_recovered_from_within_100_ms(jump):
    """Its calendar clock continued, its monotonic clock restarted."""
    bench = foreign_bench()
    bench.clock.now += 20 * SECOND
    states = []
    for _ in range(100):
        bench.clock.now += MS
        bench.send(frame(bench.clock.now + AHEAD + jump), SESSION + 20 * SECOND)
        states.append(bench.read().state)

    assert State.OK in states and states[-1] is State.OK


def test_process_started_anew_on_the_same_machine_is_believed_at_once():
    bench = foreign_bench()
    assert hear(bench, session=SESSION + SECOND).state is State.OK
