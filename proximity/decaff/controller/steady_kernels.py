"""Kernels that detect a steady force: low-passed twice and compared over a window."""

from math import exp, pi

import numpy as np

from proximity.kernels.compiler import kernel

# --- a rule ---
RULE_CUTOFF = 0  # Hz, of each of two low-passes
RULE_RIPPLE = 1  # N, that the force may vary by within the window
RULE_RIPPLE_SHARE = 2  # of the largest, if that is more
RULE_SLOPE = 3  # N/s, from the window's start to its end
RULE_LEAST = 4  # N, that the force must have throughout
RULE_SLOW_SPEED = 5  # m/s, of the finger; inf: any
RULE_SIZE = 6

# --- what a watch remembers ---
WATCH_ONCE = 0  # N, low-passed once
WATCH_TWICE = 1  # N, low-passed twice
WATCH_COUNT = 2  # samples so far
WATCH_SLOW_COUNT = 3  # samples for which the finger has been slow
WATCH_SIZE = 4


@kernel
def watch_force(
    rule: np.ndarray, watch: np.ndarray, window: np.ndarray, force: float, speed: float, period: float
) -> bool:
    """Take a sample; whether the force is steady now. *window* holds as many samples as are looked at."""
    share = 1.0 - exp(-2.0 * pi * rule[RULE_CUTOFF] * period)
    watch[WATCH_ONCE] += share * (force - watch[WATCH_ONCE])
    watch[WATCH_TWICE] += share * (watch[WATCH_ONCE] - watch[WATCH_TWICE])
    count, size = int(watch[WATCH_COUNT]), window.shape[0]
    oldest = window[count % size]
    window[count % size] = watch[WATCH_TWICE]
    watch[WATCH_COUNT] += 1.0
    watch[WATCH_SLOW_COUNT] = watch[WATCH_SLOW_COUNT] + 1.0 if abs(speed) < rule[RULE_SLOW_SPEED] else 0.0
    if count < size:
        return False
    low, high = window[0], window[0]
    for value in window:
        low, high = min(low, value), max(high, value)
    varies = high - low >= max(rule[RULE_RIPPLE], rule[RULE_RIPPLE_SHARE] * high)
    drifts = abs(watch[WATCH_TWICE] - oldest) >= rule[RULE_SLOPE] * size * period
    return low > rule[RULE_LEAST] and not varies and not drifts and watch[WATCH_SLOW_COUNT] >= size
