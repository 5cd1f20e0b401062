"""Clocks of the loop, and the histogram of durations."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from proximity.service import Histogram, SkippingClock
from proximity.service.report import MAX_NS

MS = 1_000_000


def test_skipping_clock_jumps_to_the_instant_and_says_how_far_it_is_ahead():
    clock = SkippingClock()
    before = time.monotonic_ns()

    due_ns = clock.now_ns() + 3600 * 1000 * MS
    clock.sleep_until(due_ns)

    assert clock.now_ns() == due_ns
    real = clock.now_ns() - clock.skipped_ns
    assert before <= real <= time.monotonic_ns()


def test_skipping_clock_stands_still_while_time_passes():
    clock = SkippingClock()
    now, begun = clock.now_ns(), time.monotonic_ns()

    while time.monotonic_ns() - begun < MS:
        pass

    assert clock.now_ns() == now
    assert clock.skipped_ns <= -MS


def test_skipping_clock_never_goes_back():
    clock = SkippingClock()
    clock.sleep_until(clock.now_ns() + 1000 * MS)
    now = clock.now_ns()

    clock.sleep_until(now - 500 * MS)

    assert clock.now_ns() == now


def filled(durations):
    histogram = Histogram()
    for duration in durations:
        histogram.record(int(duration))
    return histogram


@given(st.integers(0, MAX_NS))
def test_bin_holds_its_duration_and_is_a_32nd_wide_at_most(duration):
    ((lower, upper, count),) = filled([duration]).rows()
    assert lower <= duration <= upper and count == 1
    assert upper - lower <= lower / 32


def test_bins_touch_each_other_and_cover_all():
    expected = 0
    # Check one duration per bin: bins are contiguous.
    while expected <= MAX_NS:
        ((lower, upper, _),) = filled([expected]).rows()
        assert lower == expected
        expected = upper + 1
    assert expected == MAX_NS + 1


@pytest.mark.parametrize("share", [0.0, 50.0, 99.9])
def test_percentile_is_the_true_one_or_a_32nd_more(share):
    durations = np.random.default_rng(7).lognormal(11.0, 2.0, 5000).astype(np.int64)

    found = filled(durations).percentile(share)

    true = np.percentile(durations, share, method="inverted_cdf")
    assert true <= found <= true * (1 + 1 / 32)


def test_longest_is_exact_and_no_percentile_is_beyond_it():
    histogram = filled([1_000_003, 5])

    assert histogram.max_ns == histogram.percentile(100.0) == histogram.percentile(99.0) == 1_000_003
    assert histogram.percentile(50.0) == 5
    assert histogram.count == 2


def test_nothing_has_no_percentile():
    assert Histogram().percentile(99.0) == 0
    assert list(Histogram().rows()) == []


def test_durations_that_no_bin_is_made_for_are_in_the_first_and_the_last():
    histogram = filled([-5, -(10**9), -(2**62), 2**62])

    rows = list(histogram.rows())
    assert rows[0] == (0, 0, 3)
    assert rows[1][1] == MAX_NS and rows[1][2] == 1
    assert histogram.max_ns == 2**62 == histogram.percentile(100.0)


def test_text_has_three_figures_with_units():
    assert str(filled([1500, 1500, 2_500_000])) == "p50 1.5 µs, p99 2.5 ms, max 2.5 ms"
