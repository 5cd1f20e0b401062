"""Difference of a force from that of a real wall: in total, at its onset, at rest, and in work.

A real wall's force begins with a step, c v. When that step is shifted by 0.1 ms, the total error changes by
1.5 points at 0.25 m/s and by 5 points at 1 m/s, the spread of an analysis of forces every 0.1 ms.
"""

import math
from dataclasses import dataclass

import numpy as np

from proximity.lab.simulation.closed_loop import Response, real_wall

FELT_SWING = 0.005  # N, p-p: about the threshold at 250 Hz, 1 µm of a fingertip; assumed
ONSET_FORCE = 0.1  # N, minimum force of a felt wall; assumed
REST_TIME = 0.090  # s of the hold, that count as rest
REST_END = 0.010  # s from the end of rest to the release


@dataclass(frozen=True, slots=True)
class Deviation:
    """A press compared with the same press on a real wall."""

    error: float  # rms of the difference of the forces over the rms of the real one, from contact on
    onset: float  # s, delay of the start of the force
    penetration: float  # m, of the pad's far side past the wall, before the release
    steady_error: float  # N, mean force at rest less the real one
    ripple: float  # N, standard deviation of the force at rest
    swing: float  # N, of the force at rest, minimum to maximum
    peak: float  # N, largest force
    peak_error: float  # N, that less the largest of the real one
    work_error: float  # J, of the finger until the release, less the real one; negative: the wall feeds it


def deviation(response: Response, reference: Response | None = None) -> Deviation:
    """Return the differences of a press from the same press on a real wall."""
    real = reference or real_wall(response.hand, response.press, like=response)
    before_release = response.times < response.press.release_time
    is_rest = rest(response)
    return Deviation(
        force_error(response, real),
        onset(response) - onset(real),
        float(response.thimble[before_release].max()),
        float(response.force[is_rest].mean() - real.force[is_rest].mean()),
        float(response.force[is_rest].std()),
        float(np.ptp(response.force[is_rest])),
        float(response.force.max()),
        float(response.force.max() - real.force.max()),
        work(response) - work(real),
    )


def force_error(response: Response, reference: Response) -> float:
    """Return the rms of the difference of two forces over the rms of the second, from contact on."""
    force, real = response.force[response.zero :], reference.force[reference.zero :]
    # Not by the norm of linalg, whose threads wait for each other.
    return math.sqrt(float(np.square(force - real).sum() / np.square(real).sum()))


def onset(response: Response, threshold: float = ONSET_FORCE) -> float:
    """Return the time after the contact at which the force is first felt, s; inf if never."""
    is_felt = response.force[response.zero :] >= threshold
    return float(np.argmax(is_felt)) * response.step if is_felt.any() else math.inf


def rest(response: Response) -> np.ndarray:
    """Return which instants count as rest, (N,) bool: the end of the hold."""
    end = response.press.release_time - REST_END
    return (response.times >= end - REST_TIME) & (response.times < end)


def work(response: Response) -> float:
    """Return the work of the finger on pad and wall until the release, J."""
    last = response.zero + round(response.press.release_time / response.step)
    part = slice(response.zero, last + 1)
    return float(np.trapezoid(response.force[part] * response.finger_speed[part], dx=response.step))


def drum_offset(response: Response, wall_speed: float = 0.0) -> float:
    """Return the drum's distance past the wall when the link meets it, m; nan if they never meet."""
    met = np.flatnonzero(response.contact > 0.0)
    if not len(met):
        return math.nan
    row = int(met[0])
    return float(response.drum[row] - wall_speed * response.times[row])


def drum_lag(response: Response) -> float:
    """Return the drum's position, m past the wall, when the link meets it or the wall: 0 is in time."""
    arrived = np.flatnonzero((response.contact > 0.0) | (response.link >= 0.0))
    return float(response.drum[arrived[0]]) if len(arrived) else math.nan
