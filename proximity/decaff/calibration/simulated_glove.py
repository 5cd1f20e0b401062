"""Simulated glove for a calibration, with known parameters, an unsteady hand, and noise.

The random numbers of a reading depend only on the seed and the number of earlier readings. An interrupted
calibration therefore ends with the same numbers as an uninterrupted one.
"""

import math
from dataclasses import replace

import numpy as np

from proximity.decaff.calibration.drum_chirp import HELD_BEND, answer, drum_stiffness, inertia
from proximity.decaff.calibration.fit import step_latency
from proximity.decaff.calibration.instruments import DrumRecord, Instruments
from proximity.decaff.calibration.readings import Asked
from proximity.decaff.calibration.tasks import BACKLASH, FREE, HELD, POSES, PULL, TENSION, TOUCH
from proximity.decaff.drum.drum_kernels import SWING
from proximity.decaff.glove.glove import Glove
from proximity.errors import DecaffError

RATE = 3000.0  # Hz, of the drum
SAMPLES, NOISE = 50, 2.0  # of one reading: number of samples, and noise in counts
HAND, BLOCK = 0.004, 2e-5  # errors in bend of a person, at a pose and at a block
SLIP_SHARE, SLIP = 0.05, 0.06  # share of the poses in which a hand slips, and the bend of a slip
SCALE_ERROR = 0.02  # relative error of a spring scale
TOUCH_ERROR = 3e-4  # rad, error of a person who turns the drum
STEP_RATE, STEP_RISE = 1000.0, 1e-3  # Hz of a step test, and s of its rise
TORQUE_NOISE = 0.02  # share of a chirp
LINK_INERTIA = 7.6e-6  # kg m², of the replica's link, 5 g at the roller
HELD_DAMPING = 0.1  # share of the critical one
FINE_STEP = 2.5e-6  # s, a tenth of that used for identification


class SimulatedGlove:
    """Hand, glove and drum with parameters near those of the design. The class implements both ports."""

    rate = RATE

    def __init__(self, seed: int, design: Glove) -> None:
        if seed < 0:
            raise DecaffError(f"the seed is {seed}, expected 0 or more")
        self._seed = seed
        random = np.random.default_rng([seed])
        cable = replace(
            design.cable,
            hand_pulley=design.cable.hand_pulley * random.uniform(0.95, 1.05),
            stiffness=random.uniform(12e3, 30e3),
            backlash=design.cable.backlash + random.uniform(0.05e-3, 0.3e-3),
        )
        motor = replace(
            design.motor,
            inertia=design.motor.inertia * random.uniform(0.8, 1.3),
            friction=design.motor.friction * random.uniform(0.7, 1.4),
            encoder_counts=int(random.choice([2000, 2048, 4000, 4096])),
        )
        self._glove = replace(design, cable=cable, motor=motor)
        self._drum = replace(design.tip_drum(HELD_BEND), motor=motor)  # its mass is included in the design
        self._mounted = random.uniform(-0.1, 0.1)
        self._latency = random.uniform(2e-3, 12e-3)
        self._drum_latency = design.motor.latency + random.uniform(0.3e-3, 1.5e-3)
        self._random, self._asked = random, ""
        self._bend = self._block_error = 0.0

    @property
    def instruments(self) -> Instruments:
        """Return this glove as the instruments of a calibration."""
        return Instruments(f"a simulated glove, seed {self._seed}", self, self, is_simulated=True)

    @property
    def truth(self) -> dict[str, float]:
        """Return the true parameters, with the same keys as the estimates."""
        counts = self._glove.potentiometer.counts(self._glove.replica_angle(POSES))
        return {
            **{f"pose {i + 1}": float(value) for i, value in enumerate(counts)},
            "touch_offset": self._mounted,
            "cable_compliance": 1.0 / self._glove.cable.stiffness,
            "backlash": self._glove.cable.backlash,
            "latency": self._latency,
            "drum_mass": self._drum.mass,
            "drum_friction": self._drum.friction,
            "drum_latency": self._drum_latency,
            "drum_resolution": self._drum.resolution,
            "cable_stiffness": self._glove.cable.stiffness,
        }

    def prepare(self, asked: Asked, part: int) -> None:
        """Simulate the actions of a person for a part of a task."""
        self._asked, self._part = asked.task.key, part
        self._random = np.random.default_rng([self._seed, asked.number + 1, part])
        is_at_block = self._asked in (BACKLASH.key, PULL.key)
        miss = self._random.normal(0.0, BLOCK if is_at_block else HAND)
        if not is_at_block and self._random.uniform() < SLIP_SHARE:
            miss += SLIP
        if self._asked == PULL.key and part == 1:
            return  # the finger stays where it was
        self._bend = (asked.bend or 0.0) + miss

    def counts(self) -> np.ndarray:
        """Return the potentiometer's readings of a short interval."""
        is_closing = not (self._asked == BACKLASH.key and self._part == 1)
        tension = 0.0
        if self._asked == PULL.key and self._part == 1:
            tension = TENSION * (1.0 + self._random.normal(0.0, SCALE_ERROR))
        replica = float(self._glove.replica_angle(self._bend, tension, is_closing=is_closing))
        noise = self._random.normal(0.0, NOISE, SAMPLES) / self._glove.potentiometer.gain
        return self._glove.potentiometer.read(replica + noise).astype(np.float64)

    def latency(self) -> tuple[float, float]:
        """Return the latency of a step at a random time between two samples, and the sampling interval, s."""
        times = np.arange(60) / STEP_RATE
        step_time = 0.02 + self._random.uniform() / STEP_RATE
        answer_ = np.clip((times - step_time - self._latency) / STEP_RISE, 0.0, 1.0)
        answer_ += self._random.normal(0.0, 0.01, len(times))
        return step_latency(times, answer_, step_time), 1.0 / STEP_RATE

    def angle(self) -> float:
        """Return the reading of the encoder at the angle where the drum touches the replica, rad."""
        replica = self._glove.replica_angle(self._bend)
        return self._read(float(self._glove.drum.drum_angle(replica)) + self._mounted + self._turned())

    def swing(self, torques: np.ndarray) -> DrumRecord:
        """Simulate a swing of the drum, which is free or at the replica according to the task."""
        mass, friction = inertia(self._drum), self._drum.friction * self._drum.lever
        stiffness = damping = 0.0
        if self._asked == HELD.key:
            mass += LINK_INERTIA
            stiffness = drum_stiffness(self._glove, self._glove.cable.stiffness)
            damping = 2.0 * HELD_DAMPING * math.sqrt(stiffness * mass)
        else:
            assert self._asked == FREE.key, "only these tasks swing the drum"
        plant = np.array([(mass, friction, 0.01 * friction, stiffness, damping)], SWING)
        times = np.arange(len(torques)) / RATE
        disturbed = torques + TORQUE_NOISE * np.ptp(torques) / 2.0 * self._random.normal(size=len(torques))
        angles = self._swung(plant, times, disturbed)
        start = self._random.uniform(-0.1, 0.1)
        read = np.array([self._read(start + angle) for angle in angles.tolist()])
        return DrumRecord(times, torques, read, disturbed)

    def _swung(self, plant: np.ndarray, times: np.ndarray, torques: np.ndarray) -> np.ndarray:
        """Compute the angles of the drum under torques, (N,), rad. The drum starts at rest at 0."""
        return answer(plant, DrumRecord(times, torques, times, torques), self._drum_latency, FINE_STEP)

    def _turned(self) -> float:
        assert self._asked == TOUCH.key, "only touches read the drum"
        return float(self._random.normal(0.0, TOUCH_ERROR))

    def _read(self, angle: float) -> float:
        step = self._drum.resolution / self._drum.lever
        return round(angle / step) * step
