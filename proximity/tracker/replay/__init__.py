"""Replay of a recording through a tracker, with a check of every bound.

The clock is simulated: a tick comes as long after the instant of its pose as the latency says, and the next
one follows at once. The tracker is whatever answers ticks; this package knows neither files nor units.
"""

from proximity.tracker.replay.bounds_check import (
    VELOCITY_SHARE,
    BoundsKept,
    CertifiedTimes,
    PredictionsKept,
)
from proximity.tracker.replay.placement import fitted_pose, turn_about_axes
from proximity.tracker.replay.replay_loop import Replay, Ticking, replay
from proximity.tracker.replay.summary import FingerTouches, ReplaySummary, TickTimes, summarise

__all__ = [
    "VELOCITY_SHARE",
    "BoundsKept",
    "CertifiedTimes",
    "FingerTouches",
    "PredictionsKept",
    "Replay",
    "ReplaySummary",
    "TickTimes",
    "Ticking",
    "fitted_pose",
    "replay",
    "summarise",
    "turn_about_axes",
]
