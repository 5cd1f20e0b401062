"""Whether a force has come to rest: low-passed twice, and looked at over a window."""

from math import exp, pi

import numpy as np

from proximity.native import entry

# --- a rule ---
CUTOFF = 0  # Hz, of each of two low-passes
RIPPLE = 1  # N, that the force may vary by within the window
RIPPLE_SHARE = 2  # of the largest, if that is more
SLOPE = 3  # N/s, from the window's start to its end
LEAST = 4  # N, that the force must have throughout
SLOW_SPEED = 5  # m/s, of the finger; inf: any
RULE_SIZE = 6

# --- what a watch remembers ---
ONCE = 0  # N, low-passed once
TWICE = 1  # N, low-passed twice
COUNT = 2  # samples so far
SLOW_COUNT = 3  # samples for which the finger has been slow
WATCH_SIZE = 4


@entry("float64[:], float64[:], float64[:], float, float, float -> bool")
def watch_force(
    rule: np.ndarray, watch: np.ndarray, window: np.ndarray, force: float, speed: float, period: float
) -> bool:
    """Take a sample; whether the force is steady now. *window* holds as many samples as are looked at."""
    share = 1.0 - exp(-2.0 * pi * rule[CUTOFF] * period)
    watch[ONCE] += share * (force - watch[ONCE])
    watch[TWICE] += share * (watch[ONCE] - watch[TWICE])
    count, size = int(watch[COUNT]), window.shape[0]
    oldest = window[count % size]
    window[count % size] = watch[TWICE]
    watch[COUNT] += 1.0
    watch[SLOW_COUNT] = watch[SLOW_COUNT] + 1.0 if abs(speed) < rule[SLOW_SPEED] else 0.0
    if count < size:
        return False
    low, high = window[0], window[0]
    for value in window:
        low, high = min(low, value), max(high, value)
    varies = high - low >= max(rule[RIPPLE], rule[RIPPLE_SHARE] * high)
    drifts = abs(watch[TWICE] - oldest) >= rule[SLOPE] * size * period
    return low > rule[LEAST] and not varies and not drifts and watch[SLOW_COUNT] >= size
