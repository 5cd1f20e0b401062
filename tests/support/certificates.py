"""A certificate with invented times, for tests of its reports."""

import numpy as np
import shapes

from proximity import Scene, Solid
from proximity.lab.certificate.certification import Certificate
from proximity.lab.certificate.measurement import MotionTiming
from proximity.lab.certificate.subject import Subject
from proximity.lab.certificate.work import GOALS
from proximity.lab.certificate.worst_positions import SearchResult, WorstPosition
from proximity.service import Report

TICKS = 2000
SHARES = {"exact": 0.75, "bounded": 0.25, "skipped": 0.0}


def ball_subject(radius=0.05, subdivisions=2, **settings):
    return Subject(Scene([Solid(*shapes.sphere(radius, subdivisions), name="ball")]), **settings)


def timing(name, microseconds, counts=True):
    """Tick times that rise evenly from 1 µs to *microseconds*."""
    times = np.linspace(1e3, 1e3 * microseconds, TICKS).astype(np.int64)
    return MotionTiming(name, 5, times.copy(), times + 500, times, 600, SHARES, counts)


def loop(compute_us=100, late_us=20, ticks=TICKS, missed=0, period=0.001):
    """A report of a loop with equal compute times and lateness in every tick."""
    report = Report(round(1e9 * period), ticks=ticks, missed=missed, notes=["core: stays on <1>"])
    for _ in range(ticks):
        report.compute.record(round(1e3 * compute_us))
        report.lateness.record(round(1e3 * late_us))
    return report


def found():
    places = (
        WorstPosition(np.array([0.001, 0.002, 0.003]), 508, -0.05, -0.007, "medial", 400),
        WorstPosition(np.array([0.0, 0.0, 0.0]), 300, -0.05, -0.05, "centre", 300),
    )
    return {goal: SearchResult(goal, places, 12.0, 100, goal.has_budget) for goal in GOALS}


def certificate(timings=None, report=None, **settings):
    subject = ball_subject(files=("a/ball & <co>.stl",), **settings)
    timings = (timing("random", 100), timing("worst, passing", 400)) if timings is None else timings
    return Certificate(subject, 7, TICKS, 2.0, found(), tuple(timings), loop() if report is None else report)
