"""Plot of a calibration: each reading beside the model, and the drum's chirps beside their fits."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.decaff.calibration.drum_chirp import HELD_BEND, answer
from proximity.decaff.calibration.instruments import DrumRecord
from proximity.decaff.calibration.results import Session
from proximity.decaff.calibration.tasks import FREE, HELD, POSE_TASKS, POSES, TOUCH, Task
from proximity.decaff.drum.drum_kernels import SWING
from proximity.lab.figures import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

HEIGHT = 4.4  # inches
BENDS = np.linspace(0.0, 1.0, 201)
MEASURED: style.Stroke = {"color": "#D55E00", "marker": "o", "linestyle": "none"}
LEFT_OUT: style.Stroke = {"color": "0.5", "marker": "x", "linestyle": "none"}
FITTED = style.line(style.TIME_STAMPED)


def write(session: Session, path: Path) -> None:
    """Draw a calibration as a PNG."""
    rows = 2 if any(session.of(task) for task in (FREE, HELD)) else 1
    size = (style.PAGE_WIDTH, HEIGHT * rows / 2)
    style.write_bytes(path, style.render(draw, session, size, "png"))


def draw(figure: "Figure", session: Session) -> None:
    """Draw counts over the bend, touches, and the chirps."""
    chirps = [task for task in (FREE, HELD) if session.of(task)]
    panels = figure.subplots(2 if chirps else 1, 2, squeeze=False)
    for panel in panels.flat[2 + len(chirps) :]:
        panel.set_axis_off()
    _draw_counts(panels[0][0], session)
    _draw_touches(panels[0][1], session)
    for panel, task in zip(panels.flat[2:], chirps, strict=False):
        _draw_chirp(panel, session, task)
    captions = ["counts less those of the model", "touches of the drum about their mean"]
    captions += [f"{task.key}, last of {len(session.of(task))}: {_numbers(session, task)}" for task in chirps]
    style.letter_panels(panels.flat, captions)


def _draw_counts(panel: "Axes", session: Session) -> None:
    glove = session.bench.glove
    found = {one.key: one for one in session.estimates()}
    for task, bend in zip(POSE_TASKS, POSES, strict=True):
        kept, model = session.of(task), found[task.key].model
        _mark(panel, session, task, [bend] * len(session.readings.of(task)), "counts", model, kept)
        one = found[task.key]
        panel.errorbar(bend, one.value - model, one.half_width, color="#0072B2", capsize=2.5, zorder=3,
                       label="mean and its 95 %" if bend == 0.0 else None)  # fmt: skip
    panel.axhline(0.0, **style.GUIDE)
    per_mm = 1e-3 / glove.resolution(BENDS)
    panel.fill_between(BENDS, -per_mm, per_mm, color="0.93", zorder=0, label="± 1 mm of the fingertip")
    panel.set_xlabel("bend of the finger")
    panel.set_ylabel("measured less model [counts]")
    panel.legend()


def _draw_touches(panel: "Axes", session: Session) -> None:
    glove = session.bench.glove
    bends = [float(glove.bend_of_counts(touch["counts"])) for touch in session.readings.of(TOUCH)]
    found = next(one for one in session.estimates() if one.key == "touch_offset")
    factor = 1e3 * float(glove.lever(HELD_BEND))  # 10 % more or less at other bends
    _mark(panel, session, TOUCH, bends, "offset", found.value, session.of(TOUCH), factor)
    half = factor * found.half_width
    panel.axhspan(-half, half, color="#0072B2", alpha=0.25, linewidth=0, label="mean and its 95 %")
    panel.axhline(0.0, **style.GUIDE)
    panel.set_xlabel("bend of the finger, by the model")
    panel.set_ylabel("at the fingertip [mm]")
    panel.legend()


def _draw_chirp(panel: "Axes", session: Session, task: Task) -> None:
    reading = session.of(task)[-1]
    record = _record(reading["record"])
    plant = np.array([tuple(reading.get(name, 0.0) for name in SWING.names or ())], SWING)
    if task is HELD:
        free = session.of(FREE)
        plant["viscous"] = float(np.mean([one["viscous"] for one in free])) if free else 0.0
    fitted = answer(plant, record, reading["latency"])
    read = np.degrees(record.angles - record.angles.mean())
    fitted = np.degrees(fitted - fitted.mean())
    panel.plot(
        record.times,
        read,
        color="#D55E00",
        linewidth=2.2,
        alpha=0.6,
        label="encoder",
    )
    panel.plot(record.times, fitted, **{**FITTED, "linewidth": 0.7}, label="fit")
    panel.set_xlabel("time [s]")
    panel.set_ylabel("angle of the drum [°]")
    panel.legend()


def _numbers(session: Session, task: Task) -> str:
    """What the chirps of a task say."""
    keys = ("drum_mass", "drum_friction", "drum_latency") if task is FREE else ("cable_stiffness",)
    found = {one.key: one for one in session.estimates()}
    return ", ".join(f"{found[key].shown * found[key].value:.3g} {found[key].unit}" for key in keys)


def _mark(
    panel: "Axes",
    session: Session,
    task: Task,
    bends: Sequence[float],
    name: str,
    zero: float,
    kept: list[dict[str, Any]],
    factor: float = 1.0,
) -> None:
    """Mark all readings of a task; those that were left out as crosses."""
    for bend, reading in zip(bends, session.readings.of(task), strict=True):
        is_kept = any(reading is one for one in kept)
        _, names = panel.get_legend_handles_labels()
        label = "reading" if is_kept else "left out: differs"
        panel.plot(
            bend, factor * (reading[name] - zero), **(MEASURED if is_kept else LEFT_OUT),
            label=None if label in names else label,
        )  # fmt: skip


def _record(lists: dict[str, list[float]]) -> DrumRecord:
    times, commanded, angles = (np.array(lists[name]) for name in ("times", "commanded", "angles"))
    return DrumRecord(times, commanded, angles, np.full(len(times), math.nan))
