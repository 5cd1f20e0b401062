"""What comes in and goes out each tick, in one call for all fingers."""

import numpy as np
import pytest

from proximity.kernels.contact_record import BOUNDED, CONTACT_RECORD, EXACT, IN_RANGE, TRACKED
from proximity.kernels.tracking.motion import BACKWARDS, FUTURE, TOO_OLD, USABLE
from proximity.service import finger_kernels

OLDEST_NS, LATEST_NS = 920, 1000


def interpreted(kernel):
    """The same, not compiled."""
    return getattr(kernel, "py_func", kernel)


@pytest.mark.parametrize("how", [lambda kernel: kernel, interpreted], ids=["compiled", "interpreted"])
@pytest.mark.parametrize("columns", [1, 3])
def test_samples_are_admitted_by_the_rules(how, columns):
    rng = np.random.default_rng(columns)
    kept_ns, given_ns = rng.integers(900, 1100, (2, 500))
    kept, given = rng.random((2, 500, columns))
    given[rng.random(500) < 0.2, rng.integers(columns)] = np.nan
    before_ns, before = kept_ns.copy(), kept.copy()
    defects, refused_ns = np.full(500, 7, np.uint8), np.zeros(500, np.int64)
    admit = how(finger_kernels.admit)

    admit(kept_ns, kept, given_ns, given, refused_ns, defects, OLDEST_NS, LATEST_NS)

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
    np.testing.assert_array_equal(kept_ns, np.where(is_used, given_ns, before_ns))
    np.testing.assert_array_equal(kept[is_used], given[is_used])
    np.testing.assert_array_equal(kept[is_refused], before[is_refused])
    assert np.isnan(kept[~is_known, 0]).all()

    admit(kept_ns, kept, given_ns, given, refused_ns, defects, OLDEST_NS, 2 * LATEST_NS)
    np.testing.assert_array_equal(defects == finger_kernels.REFUSED, is_refused)
    np.testing.assert_array_equal(defects == USABLE, ~is_refused)


@pytest.mark.parametrize("how", [lambda kernel: kernel, interpreted], ids=["compiled", "interpreted"])
def test_samples_from_before_an_instant_expire(how):
    kept_ns, kept = np.array([9, 10, 11]), np.ones((3, 3))

    how(finger_kernels.expire)(kept_ns, kept, 10)

    assert np.isnan(kept[:, 0]).tolist() == [True, False, False]
    assert kept_ns.tolist() == [9, 10, 11]


@pytest.mark.parametrize("how", [lambda kernel: kernel, interpreted], ids=["compiled", "interpreted"])
def test_overview_of_contacts(how):
    contacts = np.zeros(5, CONTACT_RECORD)
    contacts["flags"] = [
        TRACKED | BOUNDED | IN_RANGE,
        TRACKED | BOUNDED,
        TRACKED | IN_RANGE | EXACT,
        BOUNDED | IN_RANGE,  # not tracked
        0,
    ]
    contacts["pose_ns"] = [30, 20, 40, 10, 5]

    assert how(finger_kernels.overview)(contacts) == (20, 3, 1)
    assert how(finger_kernels.overview)(contacts[3:]) == (finger_kernels.LATEST, 0, 0)
