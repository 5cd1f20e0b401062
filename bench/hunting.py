"""Cures for the hunting of a drum at rest, whose wall lies between two counts of its encoder.

Without a cure the servo's integral drives the drum back and forth between the two counts. Each cure is tested
with walls at random within a count, after slow and fast touches; the worst counts. Dither and friction
compensation are tested here only; they do not help, and the servo does not use them. ``python
bench/hunting.py`` prints the table of the documentation.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from proximity.decaff.drum.drum_model import Drum, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, Servo, servo_for
from proximity.decaff.glove.glove import DRUMS
from proximity.lab.simulation.closed_loop import DecaffLoop, Response
from proximity.lab.simulation.devices import Decaff, Hand
from proximity.lab.simulation.metrics import deviation, rest
from proximity.lab.simulation.target_policies import Target, TargetPolicy

SPEEDS = (0.1, 1.0)  # m/s, of the touch
HOLD = 0.5  # s, after which a drum rests
PHASES = 16  # of the encoder, at random
SETTLING = 0.060  # s after the touch, start of the search for single steps
SLOW = 0.010  # s: slower changes are not steps
STILL = 1e-4  # N p-p, without a frequency
MIN_FREQUENCY = 50.0  # Hz: lower ones are one step, not an oscillation
SPEED_CUTOFF = 300.0  # Hz, of the speed that is smoothed
COMPENSATED = 8  # samples after a count, for which friction is compensated

Force = Callable[[float], float]
"""Force added to a servo's demand, N, by the last reading of the drum, m, at each sample."""


@dataclass(frozen=True, slots=True)
class Cure:
    """Change to a drum and its servo."""

    words: str
    fineness: int = 1  # by which the encoder is finer
    has_deadband: bool = False
    added: Callable[[Drum, Servo], Force] | None = None


@dataclass(frozen=True, slots=True)
class Rest:
    """Force of a drum with a cure; each is the worst of all phases and speeds except for the frequency."""

    swing: float  # N p-p, at rest
    frequency: float  # Hz, of the largest swing; nan: it is still
    error: float  # share, of the force, after a slow touch
    step: float  # N p-p, while the drum comes to rest


def rest_of(drum: Drum, cure: Cure, *, phases: int = PHASES, speeds: Sequence[float] = SPEEDS) -> Rest:
    """Return the residual motion of a drum with a cure."""
    motor = replace(drum.motor, encoder_counts=drum.motor.encoder_counts * cure.fineness)
    swings, frequencies, errors, steps = [], [], [], []
    for placed in with_random_phases(replace(drum, motor=motor), phases):
        servo = servo_for(placed, SERVO_RATE)
        servo = servo if cure.has_deadband else replace(servo, deadband=0.0)
        for speed in speeds:
            response = _press(Decaff(placed, servo), speed, cure)
            found = deviation(response)
            swings.append(found.swing)
            frequencies.append(_frequency(response))
            errors.append(found.error if speed == speeds[0] else 0.0)
            steps.append(_largest_step(response))
    return Rest(max(swings), frequencies[int(np.argmax(swings))], max(errors), max(steps))


def markdown(phases: int = PHASES) -> str:
    """Return the residual motion of every drum with every cure, as a table."""
    rows = [f"| cure | {' | '.join(DRUMS)} |", f"|---|{'---|' * len(DRUMS)}"]
    for cure in CURES.values():
        cells = [cell(rest_of(drum, cure, phases=phases)) for drum in DRUMS.values()]
        rows.append(f"| {cure.words} | {' | '.join(cells)} |")
    return "\n".join(rows)


def cell(found: Rest) -> str:
    """Return the cell of one drum with one cure."""
    often = f"{found.frequency:.0f} Hz" if found.frequency > MIN_FREQUENCY else "once"
    swing = "still" if math.isnan(found.frequency) else f"{_short(found.swing)} mN, {often}"
    return f"{swing}; {_short(found.step)} mN; {100.0 * found.error:.1f} %"


def _short(force: float) -> str:
    """Return a force in mN, with two digits at least."""
    return f"{1e3 * force:.{0 if force >= 0.010 else 1}f}"


def _press(glove: Decaff, speed: float, cure: Cure) -> Response:
    hand = Hand()
    loop = DecaffLoop(hand, hand.press(speed, hold=HOLD), glove)
    policy = TargetPolicy(Target.TIME_STAMPED, glove.holding)
    force = cure.added(glove.drum, glove.servo) if cure.added else None
    while not loop.is_over:
        if force is not None:
            loop.drum.servo["demanded"] += force(loop.drum.reported)
        loop.tick(policy.command(loop.distance_sample()))
    return loop.response


def _frequency(response: Response) -> float:
    force = response.force[rest(response)]
    if np.ptp(force) < STILL:
        return math.nan
    spectrum = np.abs(np.fft.rfft((force - force.mean()) * np.hanning(len(force))))
    return float(np.fft.rfftfreq(len(force), response.step)[int(spectrum.argmax())])


def _largest_step(response: Response) -> float:
    """Return the swing of the force less its mean over `SLOW`, from `SETTLING` until rest."""
    width = round(SLOW / response.step)
    first = response.zero + round(SETTLING / response.step)
    force = response.force[first - width // 2 : int(np.argmax(rest(response))) + width // 2]
    sums = np.cumsum(np.append(0.0, force))
    means = (sums[width:] - sums[:-width]) / width
    return float(np.ptp(force[width // 2 :][: len(means)] - means))


# --- added forces ---


def _dither(counts: float) -> Callable[[Drum, Servo], Force]:
    """Return an alternating force, a sample each way, that moves a free drum by *counts* p-p."""

    def of(drum: Drum, servo: Servo) -> Force:
        size = 8.0 * drum.mass * counts * drum.resolution * servo.rate**2
        sign = [1.0]

        def force(now: float) -> float:
            sign[0] = -sign[0]
            return size * sign[0]

        return force

    return of


def _friction(drum: Drum, servo: Servo) -> Force:
    """Return the drum's friction, in the direction of its last count, for a few samples."""
    read, direction, left = math.nan, 0.0, 0

    def force(now: float) -> float:
        nonlocal read, direction, left
        left = max(0, left - 1)
        if now != read and not math.isnan(read):
            direction, left = math.copysign(1.0, now - read), COMPENSATED
        read = now
        return drum.friction * direction if left else 0.0

    return force


def _smooth_speed(drum: Drum, servo: Servo) -> Force:
    """Return the change of the damping when its speed is low-passed."""
    share = -math.expm1(-2.0 * math.pi * SPEED_CUTOFF / servo.rate)
    read, smooth = math.nan, 0.0

    def force(now: float) -> float:
        nonlocal read, smooth
        speed = 0.0 if math.isnan(read) else (now - read) * servo.rate
        read = now
        smooth += share * (speed - smooth)
        return servo.damping * (speed - smooth)

    return force


CURES = {
    "none": Cure("none"),
    "friction": Cure("friction compensation", added=_friction),
    "small dither": Cure("dither of a hundredth of a count, 1500 Hz", added=_dither(0.01)),
    "dither": Cure("dither of half a count, 1500 Hz", added=_dither(0.5)),
    "encoder4": Cure("encoder interpolated 4 times", 4),
    "encoder8": Cure("encoder interpolated 8 times", 8),
    "deadband": Cure("deadband, built in", has_deadband=True),
    "smooth": Cure("deadband, speed smoothed at 300 Hz", has_deadband=True, added=_smooth_speed),
    "both": Cure("deadband, encoder interpolated 8 times", 8, has_deadband=True),
}
"""Cures by their names."""

if __name__ == "__main__":
    print(markdown())
