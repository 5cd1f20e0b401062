"""Estimates of a calibration with their uncertainties, and the calibration computed from them.

An uncertainty is half of the 95 % confidence interval, which is estimated from repeats (Student's t) and
widened by the resolution of one count or one sample, as that is common to all repeats. Repeats do not show
systematic errors, such as those of a spring scale that reads too much.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from proximity.decaff.calibration import fit
from proximity.decaff.calibration.drum_chirp import drum_stiffness
from proximity.decaff.calibration.readings import Asked, Readings
from proximity.decaff.calibration.tasks import (
    BACKLASH,
    FREE,
    HELD,
    LATENCY,
    POSE_TASKS,
    POSES,
    PULL,
    TOUCH,
    Bench,
    Ready,
    Task,
    tasks_for,
)
from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.calibration import Calibration

COVERED = 0.975  # quantile of Student's t for 95 %, on both sides
HALF_COUNT = 0.5

Reading = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Estimate:
    """One number of a calibration, in SI units or counts."""

    key: str
    label: str
    unit: str  # of the reported value
    shown: float  # factor of the reported value
    value: float
    half_width: float  # of the 95 % confidence interval; inf for a single reading
    model: float  # as designed; nan if the design does not give it
    readings: int

    @property
    def is_as_modelled(self) -> bool:
        """Whether the model's number is unknown or within the uncertainty."""
        return not abs(self.value - self.model) > self.half_width


class Session:
    """A calibration in progress: its glove, instruments and present readings."""

    def __init__(self, bench: Bench, readings: Readings, skipped: Sequence[str] = ()) -> None:
        self.bench, self.readings = bench, readings
        self.tasks = tuple(task for task in tasks_for(bench) if task.key not in skipped)

    def next(self) -> Asked | None:
        """Return the next measurement, or None if all are done."""
        return self.readings.next(self.tasks, self.bench)

    def skip(self, task: Task) -> None:
        """Skip a task until the session is opened again."""
        self.tasks = tuple(each for each in self.tasks if each is not task)

    def repeat(self) -> bool:
        """Remove the newest reading, and return whether there was one."""
        return self.readings.drop_newest()

    def missing(self) -> list[str]:
        """Return the keys of unfinished tasks that a calibration needs."""
        needed = [task for task in tasks_for(self.bench) if task not in (FREE, HELD)]
        return [task.key for task in needed if len(self.of(task)) < task.repeats]

    def take(self, asked: Asked, ready: Ready) -> None:
        """Perform a measurement, and store its reading."""
        free = self.readings.agreeing(FREE, self.bench)
        viscous = float(np.mean([reading["viscous"] for reading in free])) if free else 0.0
        bench = Bench(self.bench.instruments, self.bench.glove, viscous)
        bend = asked.bend if asked.bend is not None else 0.0
        self.readings.add(asked.task, asked.task.measure(bench, bend, ready))

    def of(self, task: Task) -> list[Reading]:
        """Return the readings of a task that agree."""
        return self.readings.agreeing(task, self.bench)

    def estimates(self) -> list[Estimate]:
        """Return the estimates that the present readings give."""
        found = []
        for key, label, unit, shown, task, number, model, hidden in _quantities(self.bench):
            readings = self.of(task)
            values = np.array([number(reading) for reading in readings])
            if len(values) and np.isfinite(values).all():
                half = math.hypot(_half_width(values), max(map(hidden, readings)))
                found.append(
                    Estimate(key, label, unit, shown, float(values.mean()), half, model, len(values))
                )
        return found

    def calibration(self, name: str) -> Calibration:
        """Return the calibration of a glove whose tasks are all done. *name*: of hand and finger."""
        values = {estimate.key: estimate.value for estimate in self.estimates()}
        touches, glove = self.of(TOUCH), self.bench.glove
        made = Calibration(
            made=self.readings.began,  # the oldest reading ages first
            counts=np.array([values[task.key] for task in POSE_TASKS]),
            bends=np.array(POSES),
            touch_offset=fit.touch_offset(
                glove, [touch["counts"] for touch in touches], [touch["angle"] for touch in touches]
            ),
            cable_compliance=values["cable_compliance"],
            backlash=values["backlash"],
            latency=values["latency"],
            phalanges=glove.finger.phalanges,
            name=name,
            is_simulated=self.bench.instruments.is_simulated,
            drum_inertia=self._measured(FREE, "inertia"),
            drum_friction=self._measured(FREE, "friction"),
            drum_latency=self._measured(FREE, "latency"),
            design=glove,
        )
        CalibratedGlove(glove, made)
        return made

    def _measured(self, task: Task, name: str) -> float | None:
        readings = self.of(task)
        return max(0.0, float(np.mean([reading[name] for reading in readings]))) if readings else None


def _half_width(values: np.ndarray) -> float:
    count = len(values)
    if count < 2:
        return math.inf
    return float(stdtrit(count - 1, COVERED) * values.std(ddof=1) / math.sqrt(count))


_Quantity = tuple[
    str, str, str, float, Task, Callable[[Reading], float], float, Callable[[Reading], float]
]  # key, label, unit, factor, task, number of a reading, model, resolution


def _quantities(bench: Bench) -> list[_Quantity]:
    glove, drum = bench.glove, bench.drum
    a_count = glove.cable.replica_pulley / glove.potentiometer.gain  # m of cable
    # Conversions from the fixed drum to the cable, and from the drum's axis to the fingertip.
    per_cable, lever = drum_stiffness(glove, 1.0), drum.lever
    designed = glove.potentiometer.counts(glove.replica_angle(POSES))

    def value(name: str, factor: float = 1.0) -> Callable[[Reading], float]:
        return lambda reading: factor * reading.get(name, math.nan)

    def hidden(amount: float) -> Callable[[Reading], float]:
        return lambda reading: amount

    no = hidden(0.0)
    return [
        *(
            (task.key, task.key, "counts", 1.0, task, value("counts"), float(model), hidden(HALF_COUNT))
            for task, model in zip(POSE_TASKS, designed, strict=True)
        ),
        ("backlash", "backlash", "µm", 1e6, BACKLASH, value("backlash"),
         glove.cable.backlash, hidden(HALF_COUNT * a_count)),
        ("cable_compliance", "cable stretch", "µm/N", 1e6, PULL, value("compliance"),
         1.0 / glove.cable.stiffness, hidden(0.5 * HALF_COUNT * a_count)),
        ("touch_offset", "drum zero", "mrad", 1e3, TOUCH, value("offset"), math.nan,
         hidden(HALF_COUNT / glove.potentiometer.gain)),
        ("latency", "glove latency", "ms", 1e3, LATENCY, value("latency"), math.nan, value("sampled")),
        ("drum_mass", "drum mass", "g", 1e3, FREE, value("inertia", lever**-2),
         drum.mass, no),
        ("drum_friction", "drum friction", "mN", 1e3, FREE, value("friction", 1.0 / lever),
         drum.friction, no),
        ("drum_latency", "drum latency", "ms", 1e3, FREE, value("latency"), drum.motor.latency, no),
        ("drum_resolution", "encoder step", "µm", 1e6, FREE, value("step", lever),
         drum.resolution, value("step_error", lever)),
        ("cable_stiffness", "cable spring", "N/mm", 1e-3, HELD,
         value("stiffness", 1.0 / per_cable), glove.cable.stiffness, no),
    ]  # fmt: skip


def as_document(estimates: Sequence[Estimate]) -> dict[str, Any]:
    """Return estimates as a dictionary for a JSON document, in SI units and counts."""
    return {
        estimate.key: {
            "value": estimate.value,
            "uncertainty_95": estimate.half_width if math.isfinite(estimate.half_width) else None,
            "model": estimate.model if math.isfinite(estimate.model) else None,
            "readings": estimate.readings,
        }
        for estimate in estimates
    }


def contradiction(session: Session) -> str:
    """Return a message if the pulled cable and the chirp contradict each other, or an empty string."""
    found = {estimate.key: estimate for estimate in session.estimates()}
    if not {"cable_compliance", "cable_stiffness"} <= set(found):
        return ""
    pulled, swung = found["cable_compliance"], found["cable_stiffness"]
    off = abs(pulled.value - 1.0 / swung.value)
    if off <= math.hypot(pulled.half_width, swung.half_width / swung.value**2):
        return ""
    return (
        f"the pulled cable has {1e-3 / pulled.value:.1f} N/mm and the chirp {1e-3 * swung.value:.1f} N/mm, "
        "which differ by more than their uncertainties: check the clamp and the spring scale"
    )
