"""Identification of a drum from its response to a chirp, a torque of rising frequency.

The response of a free drum contains its inertia, friction and latency. That of a drum pressed on the replica
of a fixed finger contains the stiffness of the cable. One record gives one estimate of each. Repeated chirps
show the uncertainty.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from proximity.decaff.calibration.instruments import DrumRecord
from proximity.decaff.drum.drum_kernels import SWING, swing
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.glove.glove import Glove
from proximity.errors import DecaffError

HELD_BEND = 0.5
FREE_SWING = 0.3  # rad, either way, of the free drum at its first frequency; assumed
COASTING = 5.0  # coasting time of the drum, in pushes
OVER_FRICTION = 5.0  # ratio of the free chirp to the friction, at which the drum hardly ever sticks
HELD_FORCE = 3.0  # N at the fingertip, mean of the held chirp
HELD_SHARE = 1.0 / 6.0  # amplitude of the held chirp, as a share of that force
MAX_SHARE = 0.6  # of the motor's torque
SECONDS, RISE = 1.0, 0.1  # s, durations of a chirp and of the rise of the mean force before it
MAX_STEP = 2.5e-5  # s, of the simulated swing
WEAKEST_ANSWER = 4.0  # minimum of a swing from end to end, encoder steps
MAX_MISFIT = 0.15  # maximum share of a swing that the model may leave unexplained
MAX_TORQUE_OFF = 0.3  # share of the chirp by which the motor's torque may differ from the command
LATEST_CURRENT = 0.01  # s, maximum delay of the current behind the command
MIN_CYCLES = 6.0  # samples to a cycle of the fastest swing
DIFFERENCES = (0.02, 0.005)  # shares; smaller differences are hidden by stick-slip friction
SEARCHED = np.geomspace(0.25, 4.0, 33)  # starts of the search, times the modelled inertia or stiffness


@dataclass(frozen=True, slots=True)
class Chirp:
    """A torque that oscillates about a mean, with rising frequency."""

    mean: float  # N m at the drum; negative presses on the finger
    amplitude: float  # N m
    first: float  # Hz
    last: float  # Hz
    push: float = 0.0  # s, of each push after the chirp; the drum then coasts

    def torques(self, rate: float) -> np.ndarray:
        """Return the torques of the chirp and of the pushes after it, (N,), N m."""
        last = min(self.last, rate / MIN_CYCLES)
        times = np.arange(round(SECONDS * rate)) / rate
        phase = 2.0 * math.pi * (self.first * times + (last - self.first) / (2.0 * SECONDS) * times**2)
        # It begins at full torque, so that the mean speed is 0 and a free drum stays in place.
        chirp = self.mean + self.amplitude * np.cos(phase)
        rise = self.mean * np.linspace(0.0, 1.0, round(RISE * rate)) if self.mean else np.zeros(0)
        push = np.zeros(round((1.0 + COASTING) * self.push * rate))
        push[: round(self.push * rate)] = self.amplitude
        return np.concatenate([rise, chirp, *(sign * push for sign in (1.0, -1.0, 1.0, -1.0))])


def free_chirp(drum: Drum) -> Chirp:
    """Return a chirp for a free drum. Its amplitude is a multiple of the friction.

    The drum swings by about 0.6 rad from end to end.
    """
    friction, most = drum.friction * drum.lever, MAX_SHARE * drum.force_limit * drum.lever
    amplitude = min(max(OVER_FRICTION * friction, 0.01 * most), most)
    first = math.sqrt(amplitude / (FREE_SWING * inertia(drum))) / (2.0 * math.pi)
    # In a swing, friction and latency both appear as delays. Coasting distinguishes them.
    push = math.sqrt(2.0 * FREE_SWING * inertia(drum) * max(friction, 0.1 * amplitude)) / amplitude
    return Chirp(0.0, amplitude, first, 8.0 * first, push)


def held_chirp(glove: Glove, drum: Drum) -> Chirp:
    """Return a chirp around the resonance of a drum that presses on the replica of a fixed finger."""
    most = MAX_SHARE * drum.force_limit * drum.lever
    wanted = HELD_FORCE * float(glove.replica_torque(HELD_BEND, 1.0))
    mean = min(wanted, most / (1.0 + HELD_SHARE))
    ringing = math.sqrt(drum_stiffness(glove, glove.cable.stiffness) / inertia(drum)) / (2.0 * math.pi)
    return Chirp(-mean, HELD_SHARE * mean, 0.25 * ringing, 2.0 * ringing)


def inertia(drum: Drum) -> float:
    """Return the inertia of a drum about its axis, kg m², including that of the rotor behind the gear."""
    return drum.mass * drum.lever**2


def drum_stiffness(glove: Glove, cable: float) -> float:
    """Return the stiffness of a cable at the drum, N m/rad, while the finger is fixed. *cable*: in N/m."""
    return cable * glove.cable.replica_pulley**2


def answer(plant: np.ndarray, record: DrumRecord, latency: float, step: float = MAX_STEP) -> np.ndarray:
    """Compute the angles of a drum under the commands of a record, (N,), rad. They begin at 0."""
    times, count = record.times, len(record.times)
    period = (times[-1] - times[0]) / (count - 1)
    steps = math.ceil(period / step)
    edges = times[0] + period / steps * np.arange(count * steps + 1)
    ends = np.append(times, times[-1] + period)
    impulse = np.concatenate([[0.0], np.cumsum(record.commanded * np.diff(ends))])
    means = np.diff(np.interp(edges - latency, ends, impulse)) / (period / steps)
    angles = np.zeros(count)
    swing(plant, means, steps, period / steps, angles)
    return np.interp(times, edges[:-1:steps], angles)


def identify_free(record: DrumRecord, drum: Drum) -> dict[str, float]:
    """Estimate inertia, kg m², friction, N m, viscous friction, N m s, and latency, s, of a free drum."""
    _check_motor(record)
    scale = np.array([inertia(drum), max(drum.friction * drum.lever, 1e-6), 0.0, _period(record)])
    scale[2] = 0.1 * scale[1]

    def plant(numbers: np.ndarray) -> np.ndarray:
        return np.array([(*numbers[:3], 0.0, 0.0)], SWING)

    starts = [scale * [share, 1.0, 1.0, 1.0] for share in SEARCHED]
    span = max(1, round(0.25 / (free_chirp(drum).last * _period(record))))
    names = ("inertia", "friction", "viscous", "latency")
    return dict(zip(names, _fitted(record, plant, scale, starts, span), strict=True))


def identify_held(record: DrumRecord, drum: Drum, glove: Glove, viscous: float) -> dict[str, float]:
    """Estimate the stiffness, N m/rad, and damping, N m s, of a held drum's contact.

    Inertia, friction and latency of the drum are estimated as well.
    """
    _check_motor(record)
    stiff = drum_stiffness(glove, glove.cable.stiffness)
    mass, friction = inertia(drum), max(drum.friction * drum.lever, 1e-6)
    scale = np.array([stiff, 0.1 * math.sqrt(stiff * mass), mass, friction, _period(record)])

    def plant(numbers: np.ndarray) -> np.ndarray:
        stiffness, damping, inertia, friction = numbers[:4]
        return np.array([(inertia, friction, viscous, stiffness, damping)], SWING)

    starts = [scale * [share, 2.0 * math.sqrt(share), 1.2, 1.0, 1.0] for share in SEARCHED]
    names = ("stiffness", "damping", "inertia", "friction", "latency")
    return dict(zip(names, _fitted(record, plant, scale, starts), strict=True))


def encoder_step(angles: np.ndarray) -> tuple[float, float]:
    """Return the step between the angles of an encoder, rad, and its uncertainty.

    Both are nan if no step is visible.
    """
    levels = np.unique(angles)
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-6 * (levels[-1] - levels[0])]
    if len(gaps) < 3:
        return math.nan, math.nan
    least = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    numbers = np.rint((levels - levels[0]) / least)
    slope, origin = np.polyfit(numbers, levels, 1)
    off = levels - (origin + slope * numbers)
    if np.abs(off).max() > 0.1 * least:
        return math.nan, math.nan
    error = math.sqrt(
        float(off @ off) / max(len(off) - 2, 1) / float(((numbers - numbers.mean()) ** 2).sum())
    )
    return float(slope), 2.0 * error + 1e-6 * float(slope)


def _fitted(
    record: DrumRecord,
    plant: Callable[[np.ndarray], np.ndarray],
    scale: np.ndarray,
    starts: list[np.ndarray],
    span: int = 0,
) -> list[float]:
    """Return the numbers of *plant* that fit a record best, searched from the best of *starts*.

    Angles about their mean are fitted or, with a *span*, the turns within *span* samples. A free drum drifts
    with each disturbance of its torque, which hardly affects a turn within a short span.
    """

    def seen(angles: np.ndarray) -> np.ndarray:
        turned = angles[span:] - angles[:-span] if span else angles
        return turned - turned.mean()

    step, _ = encoder_step(record.angles)
    if not np.ptp(record.angles) > WEAKEST_ANSWER * (step if step == step else 0.0):
        raise DecaffError("the drum hardly moved, expected a swing: is the motor on, and is the drum free?")
    angles = seen(record.angles)
    sizes = plant(np.abs(scale))

    def misfit(numbers: np.ndarray) -> np.ndarray:
        made = plant(numbers * scale)
        # Impossible parameters of the search are clipped to the nearest possible ones.
        made["inertia"] = np.maximum(made["inertia"], 0.05 * sizes["inertia"])
        made["friction"] = np.maximum(made["friction"], 0.0)
        computed = answer(made, record, numbers[-1] * scale[-1])
        return seen(computed) - angles

    best = min((start / scale for start in starts), key=lambda start: float(np.sum(misfit(start) ** 2)))
    for difference in DIFFERENCES:
        found = least_squares(misfit, best, "3-point", x_scale="jac", diff_step=difference, max_nfev=60)
        best = found.x
    swung = float(np.sqrt(np.mean(angles**2)))
    left = float(np.sqrt(np.mean(found.fun**2)))
    if not left <= math.hypot(MAX_MISFIT * swung, 0.5 * step if step == step else 0.0):
        raise DecaffError(
            f"the response does not fit a drum: {100 * left / swung:.0f} % of it cannot be explained, "
            f"expected {100 * MAX_MISFIT:.0f} % at most: is the drum blocked, or the finger not fixed?"
        )
    return [float(value) for value in found.x * scale]


def _check_motor(record: DrumRecord) -> None:
    """Raise an error if the motor's torque, computed from its current, differs from the command."""
    swung, count = float(np.std(record.commanded)), len(record.times)
    late = min(math.ceil(LATEST_CURRENT / _period(record)), count - 1)
    # The current is read with a delay of some samples.
    off = min(
        float(np.median(np.abs(record.torques[lag:] - record.commanded[: count - lag])))
        for lag in range(late + 1)
    )
    if not off <= MAX_TORQUE_OFF * swung:
        raise DecaffError(
            f"the motor's torque is {off:.3g} N m off its command, expected "
            f"{MAX_TORQUE_OFF * swung:.3g} N m at most: check its torque constant and limits"
        )


def _period(record: DrumRecord) -> float:
    return float(record.times[-1] - record.times[0]) / (len(record.times) - 1)
