"""Detection of a steady force, compared with reference values and with a detector in plain numpy."""

import math

import numpy as np
import pytest

from proximity.decaff.controller.compiled import SETTINGS, STEADY, in_c, memory
from proximity.decaff.controller.settings import Limits, SteadyRule, steady_numbers
from proximity.errors import ArgumentError

RATE = 3000.0
ANY_SPEED = SteadyRule(slow_speed=math.inf)  # as in the reference's table, whose rule has no speed limit


class SteadyForce:
    """Detector of a steady force, sampled at *rate* Hz, as in the controller."""

    def __init__(self, rate: float, rule: SteadyRule | None = None) -> None:
        _, settings, content = memory(SETTINGS)
        for name, number in steady_numbers(rate, rule or SteadyRule()).items():
            settings[name] = number
        _, self._watch, watched = memory(STEADY)
        self._content = watched[0], content[0]

    def take(self, force: float, speed: float) -> bool:
        """Return whether the force, N, is steady; *speed*, m/s, is the finger's."""
        return bool(in_c("is_steady")(*self._content, force, speed))


def steady_at(force, speed=0.0, rule=ANY_SPEED):
    watch = SteadyForce(RATE, rule)
    speeds = np.broadcast_to(speed, np.shape(force))
    return [watch.take(float(one), float(pace)) for one, pace in zip(force, speeds, strict=True)]


def oracle(force, rule=ANY_SPEED):
    """Apply the rule in plain numpy: two one-pole low-passes, then windows."""
    share = 1.0 - math.exp(-2.0 * math.pi * rule.cutoff / RATE)
    filtered = np.zeros((2, len(force) + 1))
    for k, one in enumerate(force):
        filtered[0, k + 1] = filtered[0, k] + share * (one - filtered[0, k])
        filtered[1, k + 1] = filtered[1, k] + share * (filtered[0, k + 1] - filtered[1, k])
    size, smooth, found = round(rule.window * RATE), filtered[1, 1:], []
    for k in range(len(force)):
        past = smooth[max(0, k - size + 1) : k + 1]
        if k < size:
            found.append(False)
            continue
        varies = past.max() - past.min() >= max(rule.ripple, rule.ripple_share * past.max())
        drifts = abs(smooth[k] - smooth[k - size]) >= rule.slope * size / RATE
        found.append(bool(not varies and not drifts and past.min() > rule.least))
    return found


@pytest.mark.parametrize("seed", range(2))
def test_watch_agrees_with_plain_numpy(seed):
    rng = np.random.default_rng(seed)
    knots = np.cumsum(rng.normal(0.0, 0.06, 12)) + 0.4
    force = np.interp(np.arange(1500), np.linspace(0, 1499, 12), knots) + rng.normal(0.0, 0.01, 1500)

    found = steady_at(force)
    assert found == oracle(force)
    assert 0 < sum(found) < len(found)


def test_finger_must_be_slow_for_a_window():
    force, speed = np.full(900, 0.8), np.zeros(900)
    speed[400] = 0.01
    found = steady_at(force, speed, SteadyRule())

    assert found[399] and not any(found[400:549])
    assert found[555]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SteadyRule(window=0.0), "window is 0.0, expected a positive number of seconds"),
        (lambda: SteadyRule(ripple=-0.1), "ripple is -0.1, expected a number of newtons of 0 or more"),
        (lambda: SteadyForce(0.0), "rate is 0.0, expected a positive number of hertz"),
        (lambda: Limits(lost_time=-1.0), "lost_time is -1.0, expected a positive number of seconds"),
    ],
)
def test_what_cannot_be_is_named(make, message):
    with pytest.raises(ArgumentError) as caught:
        make()

    assert message in str(caught.value)
