"""Kernels that process input and output of all fingers in one call per tick."""

import numpy as np
import pytest

from proximity.kernels.tracking.motion import BACKWARDS, FUTURE, TOO_OLD, USABLE
from proximity.message import MEASUREMENT
from proximity.service import finger_kernels

OLDEST_NS, LATEST_NS = 920, 1000


def interpreted(kernel):
    """Return the uncompiled function of a kernel."""
    return getattr(kernel, "py_func", kernel)


HOW = pytest.mark.parametrize("how", [lambda kernel: kernel, interpreted], ids=["compiled", "interpreted"])


@HOW
@pytest.mark.parametrize("columns", [1, 3])
def test_newest_samples_follow_the_rules(how, columns):
    """Update 500 of 700 fingers, in random order."""
    rng = np.random.default_rng(columns)
    newest_ns, newest = rng.integers(900, 1100, 700), rng.random((700, columns))
    fingers, given_ns = rng.permutation(700)[:500], rng.integers(900, 1100, 500)
    given = rng.random((500, columns))
    given[rng.random(500) < 0.2, rng.integers(columns)] = np.nan
    all_before_ns, all_before = newest_ns.copy(), newest.copy()
    defects, refused_ns = np.full(500, 7, np.uint8), np.zeros(700, np.int64)

    def update(latest_ns):
        how(finger_kernels.update_newest)(
            newest_ns, newest, refused_ns, np.zeros(700, np.int64), fingers, given_ns, given, defects,
            OLDEST_NS, latest_ns,
        )  # fmt: skip

    update(LATEST_NS)
    before_ns, before = all_before_ns[fingers], all_before[fingers]
    is_known, is_repeated = np.isfinite(given).all(axis=1), given_ns == before_ns
    is_future = is_known & ~is_repeated & (given_ns > LATEST_NS)
    is_too_old = is_known & ~is_repeated & (given_ns < OLDEST_NS)
    is_back = is_known & ~is_future & ~is_too_old & (given_ns < before_ns)
    is_refused = is_future | is_too_old | is_back
    is_used = is_known & ~is_refused
    assert is_too_old.any() and is_back.any() and is_repeated.any()
    for which, defect in ((is_future, FUTURE), (is_too_old, TOO_OLD), (is_back, BACKWARDS)):
        np.testing.assert_array_equal(defects == defect, which)
    np.testing.assert_array_equal(defects == USABLE, ~is_refused)
    np.testing.assert_array_equal(newest_ns[fingers], np.where(is_used, given_ns, before_ns))
    np.testing.assert_array_equal(newest[fingers][is_used], given[is_used])
    np.testing.assert_array_equal(newest[fingers][is_refused], before[is_refused])
    assert np.isnan(newest[fingers][~is_known, 0]).all()
    others = np.setdiff1d(np.arange(700), fingers)
    np.testing.assert_array_equal(newest[others], all_before[others])
    np.testing.assert_array_equal(newest_ns[others], all_before_ns[others])

    update(2 * LATEST_NS)
    np.testing.assert_array_equal(defects == finger_kernels.REFUSED, is_refused)
    np.testing.assert_array_equal(defects == USABLE, ~is_refused)


@HOW
@pytest.mark.parametrize(
    ("fingers", "is_lost"),
    [
        ([0, 1, 2, 3, 4], [True] * 5),
        ([4, 2, 0, 1, 3], [True] * 5),
        ([0, 1, 2, 3], [False] * 4),  # the fifth may be elsewhere
        ([0, 1, 2, 3, 3], [False] * 5),
        ([4, 5, 6, 7], [False, True, True, True]),  # the second hand has three fingers
    ],
)
def test_hand_is_lost_only_where_all_its_fingers_are_given_at_one_position(how, fingers, is_lost):
    defects, count = np.zeros(len(fingers), np.uint8), len(fingers)
    how(finger_kernels.update_newest)(
        np.zeros(8, np.int64), np.ones((8, 3)), np.zeros(8, np.int64), np.arange(8), np.array(fingers),
        np.full(count, 950), np.zeros((count, 3)), defects, OLDEST_NS, LATEST_NS,
    )  # fmt: skip
    assert (defects == finger_kernels.LOST).tolist() == is_lost


@HOW
def test_samples_from_before_an_instant_are_dropped(how):
    newest_ns, newest = np.array([9, 10, 11]), np.ones((3, 3))

    how(finger_kernels.drop_stale)(newest_ns, newest, 10)

    assert np.isnan(newest[:, 0]).tolist() == [True, False, False]
    assert newest_ns.tolist() == [9, 10, 11]


def test_record_of_a_measurement_is_that_of_messages():
    assert finger_kernels.MEASUREMENT_RECORD == MEASUREMENT
