"""Clocks that the loop keeps its appointments by."""

import time

import pytest

from proximity.service import MonotonicClock, SkippingClock

MS = 1_000_000


@pytest.mark.parametrize("spin", [0.0, 0.0005])
def test_monotonic_clock_never_wakes_early(spin):
    clock = MonotonicClock(spin)

    for _ in range(20):
        due_ns = time.monotonic_ns() + 600_000
        clock.sleep_until(due_ns)
        assert time.monotonic_ns() >= due_ns


def test_monotonic_clock_does_not_wait_for_what_is_past():
    clock = MonotonicClock()

    clock.sleep_until(clock.now_ns() - 3600 * 1000 * MS)
    clock.sleep_until(-(2**62))

    assert clock.skipped_ns == 0
    assert abs(clock.now_ns() - time.monotonic_ns()) < 10_000 * MS


def test_skipping_clock_jumps_to_the_instant_and_says_how_far_it_is_ahead():
    clock = SkippingClock()
    before = time.monotonic_ns()

    due_ns = clock.now_ns() + 3600 * 1000 * MS
    clock.sleep_until(due_ns)

    assert clock.now_ns() == due_ns
    real = clock.now_ns() - clock.skipped_ns
    assert before <= real <= time.monotonic_ns()


def test_skipping_clock_stands_still_while_its_stopwatch_runs():
    clock = SkippingClock()
    now, begun = clock.now_ns(), clock.stopwatch_ns()

    while clock.stopwatch_ns() - begun < MS:
        pass

    assert clock.now_ns() == now
    assert clock.skipped_ns <= -MS


def test_skipping_clock_never_goes_back():
    clock = SkippingClock()
    clock.sleep_until(clock.now_ns() + 1000 * MS)
    now = clock.now_ns()

    clock.sleep_until(now - 500 * MS)

    assert clock.now_ns() == now
