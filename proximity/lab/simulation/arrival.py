"""Look-ahead that a drum needs, to stand at a wall before the finger comes.

By a formula, and by looking: presses are simulated with less and less reach until the drum is late.
"""

import math
from dataclasses import replace

from proximity.checks import positive
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.drum.servo import Servo
from proximity.errors import ArgumentError
from proximity.lab.simulation.closed_loop import decaff
from proximity.lab.simulation.devices import Decaff, Hand, Sensing
from proximity.lab.simulation.metrics import drum_lag

SETTLING_SAMPLES = 15.0  # of the servo: what is left of its lag is then small
ARRIVED_WITHIN = 1e-4  # m, from the wall
GRID = 2e-3  # m, of the reaches that are tried
FARTHEST = 0.160  # m, that is tried
SWING = 6  # steps beyond the least reach, that are tried as well
SHORT_HOLD = 1e-3  # s: what comes after the touch does not matter


def arrival_time(drum: Drum, servo: Servo, distance: float) -> float:
    """Return how long a drum is about to take from rest to rest, s: full speed-up, full braking, settling."""
    swing = 2.0 * math.sqrt(positive("distance", distance, "metres") / servo.acceleration)
    return swing + SETTLING_SAMPLES * (servo.period + drum.motor.latency / 1.5)


def look_ahead(speed: float, sensing: Sensing, arrival: float) -> float:
    """Return from how far away a wall must be known, m: what a finger goes until the drum is there."""
    age = sensing.latency + 1.0 / sensing.rate
    return positive("speed", speed, "metres a second") * (age + positive("arrival", arrival, "seconds"))


def needed_look_ahead(hand: Hand, glove: Decaff, speed: float) -> float:
    """Return the least reach with which a drum is in place at the touch, m, in steps of `GRID`."""
    press = hand.press(speed, hold=SHORT_HOLD)

    def is_in_place(count: int) -> bool:
        sensing = replace(glove.sensing, reach=count * GRID)
        return abs(drum_lag(decaff(hand, press, replace(glove, sensing=sensing)))) <= ARRIVED_WITHIN

    late, early = 0, round(FARTHEST / GRID)
    if not is_in_place(early):
        raise ArgumentError(f"the drum is late at {speed:g} m/s, even when known from {FARTHEST:g} m away")
    while early - late > 1:
        middle = (late + early) // 2
        late, early = (late, middle) if is_in_place(middle) else (middle, early)
    # A drum that swings past its position is there for a moment on its path: it must be there from then on.
    later = [count for count in range(early + 1, early + 1 + SWING) if not is_in_place(count)]
    return (max(later, default=late) + 1) * GRID
