"""Report of a certificate as a JSON document or a picture.

``schema`` is 2. It is increased when a key is removed or changes its meaning. Times are in nanoseconds,
lengths in metres, forces in newtons and energies in joules. A percentile of too few ticks is null.
"""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.errors import ServiceError
from proximity.lab.certificate.certification import Certificate
from proximity.lab.certificate.measurement import MotionTiming
from proximity.lab.certificate.starting_positions import surface_samples
from proximity.lab.certificate.subject import RADIUS, fingerprint
from proximity.lab.certificate.times import Times, curve, over_count, percentiles, tail
from proximity.lab.certificate.worst_positions import SearchResult
from proximity.lab.figures import style
from proximity.lab.paper.trajectories import Press
from proximity.lab.paper.walls import FINGER, energy_excess, steady_excess
from proximity.scene.scene import Scene
from proximity.system import machine

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SCHEMA = 2
KIND = "proximity latency certificate"
SPEEDS = (0.1, 0.5, 1.0)
"""Speeds of fingers that meet a wall, m/s."""
NUMBERS = ".json"
CLOUD = 1200  # points of the surface in the picture
SIZE = (style.PAGE_WIDTH, 5.6)
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "black", "0.5")
MARKS = "osv^D*"


def document(certificate: Certificate, gate: float | None = None, *, version: str = "") -> dict[str, Any]:
    """Return all numbers of a certificate. Its verdict is for *gate*, s, by default the scene's period."""
    subject, loop = certificate.subject, certificate.loop
    period = subject.period if gate is None else gate
    lower, upper = subject.scene.bounds
    return {
        "kind": KIND,
        "schema": SCHEMA,
        "scene": {
            "sha256": fingerprint(subject.scene),
            "files": [Path(file).name for file in subject.files],
            "parts": len(subject.scene.parts),
            "faces": subject.face_count,
            "bounds": [lower.tolist(), upper.tolist()],
        },
        "machine": machine.describe(),
        "versions": {"proximity": version, **machine.versions()},
        "settings": {
            "seed": certificate.seed,
            "ticks": certificate.tick_count,
            "loop_s": certificate.seconds,
            "fingers": subject.fingers,
            "period_s": subject.period,
            "latency_s": subject.latency,
            "budget": subject.budget,
            "working_range_m": subject.working_range,
            "radius_m": subject.settings.get("radius", RADIUS),
            "gate_s": gate,
            "not_measured": list(subject.not_measured),
        },
        "search": [_goal(each) for each in certificate.found.values()],
        "cases": [_case(each, period) for each in certificate.timings],
        "loop": {
            "period_s": 1e-9 * loop.period_ns,
            "ticks": loop.ticks,
            "missed": loop.missed,
            "compute": _times(loop.compute, period),
            "lateness": _times(loop.lateness, period),
            "notes": list(loop.notes),
        },
        "at_the_finger": _at_the_finger(certificate),
        "verdict": certificate.verdict(period),
        "machine_verdict": certificate.machine_verdict(),
    }


def _goal(found: SearchResult) -> dict[str, Any]:
    """Return the costliest positions for a goal, with their work (nodes and leaves) and distance bounds."""
    return {
        "manner": str(found.goal.mode),
        "within_budget": found.goal.has_budget,
        "typical_work": found.typical_work,
        "start_count": found.start_count,
        "is_complete": found.is_complete,
        "places": [
            {
                "position": worst.position.tolist(),
                "work": worst.work,
                "lower": worst.lower,
                "upper": worst.upper,
                "origin": worst.origin,
                "start_work": worst.start_work,
            }
            for worst in found.positions
        ],
    }


def _case(timing: MotionTiming, period: float) -> dict[str, Any]:
    """Return the processor time of ticks, their wall-clock time, and the shortest time of three runs."""
    return {
        "name": timing.name,
        "counts": timing.counts,
        "fingers": timing.fingers,
        "ticks": len(timing.thread_ns),
        "most_work": timing.max_work,
        "shares": timing.shares,
        "compute": _times(timing.thread_ns, period),
        "wall": percentiles(timing.wall_ns),
        "best": percentiles(timing.best_ns),
    }


def _times(times: Times, period: float) -> dict[str, Any]:
    """Return percentiles of times, the number above the period, and a curve of times and counts."""
    return {**percentiles(times), "over_period": over_count(times, period), "tail": curve(times)}


def _at_the_finger(certificate: Certificate) -> dict[str, Any]:
    """Return the delay of a tick and its effect on a finger at several speeds.

    The delay is the sum of the slowest computing time and the wake-up lateness, both p99.9.
    """
    loop = certificate.loop
    times: list[Times] = [loop.compute, *(each.thread_ns for each in certificate.timings if each.counts)]
    slowest = max(tail(percentiles(each))[1] for each in times)
    delay = 1e-9 * (slowest + tail(percentiles(loop.lateness))[1])
    return {"delay_s": delay, "speeds": [felt(delay, speed) for speed in SPEEDS]}


def felt(delay: float, speed: float) -> dict[str, float]:
    """Return penetration, m, force error, N, and energy error, J, that a delay causes at a finger's speed.

    The finger enters a simulated wall by speed times delay before the wall reacts. For a prescribed motion,
    the force at rest is then too high by equation (10), and the operator's work too large by equation (15).
    The finger is that of the paper, and the press is assumed.
    """
    penetration, press = speed * delay, Press(speed=speed)
    return {
        "speed": speed,
        "penetration": penetration,
        "force_error": steady_excess(press.depth, penetration, FINGER, FINGER),
        "energy_error": energy_excess(press, penetration, FINGER),
    }


def as_json(reported: dict[str, Any]) -> str:
    """Return a document as JSON text, with null for non-finite numbers."""
    return json.dumps(_plain(reported), allow_nan=False, indent=1, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def check_report(path: Path) -> None:
    """Raise an error for a path that cannot be written, before anything is measured."""
    form = path.suffix.lower().removeprefix(".")
    if path.suffix.lower() != NUMBERS and form not in style.FORMATS:
        raise ServiceError(
            f"{path} does not end in {NUMBERS} or {', '.join(f'.{one}' for one in style.FORMATS)}"
        )
    if not path.parent.is_dir():
        raise ServiceError(f"{path}: no folder {path.parent}")
    if path.suffix.lower() != NUMBERS:
        style.load_figure()


def write_report(path: Path, reported: dict[str, Any], scene: Scene) -> None:
    """Write a document as JSON or as a picture, according to the suffix of *path*."""
    if path.suffix.lower() == NUMBERS:
        style.write_bytes(path, as_json(reported).encode())
        return
    surface, _ = surface_samples(scene, CLOUD, np.random.default_rng(0))
    form = path.suffix.lower().removeprefix(".")
    drawn = style.render(lambda figure, _: _draw(figure, reported, surface), None, SIZE, form)
    style.write_bytes(path, drawn)


def _draw(figure: "Figure", reported: dict[str, Any], surface: np.ndarray) -> None:
    """Draw the tails of all times, and the worst positions in two views."""
    above, below = figure.subfigures(2, 1, squeeze=False)[:, 0]
    _draw_tails(above.subplots(), reported)
    panels = below.subplots(1, 2)
    for panel, (across, up) in zip(panels, ((0, 1), (0, 2)), strict=True):
        panel.plot(1e3 * surface[:, across], 1e3 * surface[:, up], ".", color="0.6", markersize=1.5)
        for number, goal in enumerate(reported["search"]):
            places = 1e3 * np.array([place["position"] for place in goal["places"]])
            panel.plot(
                places[:, across], places[:, up], MARKS[number % len(MARKS)], color=COLOURS[number],
                fillstyle="full" if goal["within_budget"] else "none", label=goal_words(goal),
            )  # fmt: skip
        panel.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]", aspect="equal")
    below.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")


def _draw_tails(panel: "Axes", reported: dict[str, Any]) -> None:
    """Draw the share of ticks longer than a time, for each motion and for the loop."""
    loop = reported["loop"]
    rows = [(case["name"], case["compute"], case["ticks"]) for case in reported["cases"]]
    rows += [("service: computing", loop["compute"], loop["ticks"])]
    rows += [("service: woken late", loop["lateness"], loop["ticks"])]
    for number, (name, found, ticks) in enumerate(rows):
        times, counts = np.array(found["tail"], np.float64).T
        colour = COLOURS[number % len(COLOURS)]
        panel.step(np.maximum(times, 1.0) / 1e3, counts / ticks, label=name, where="post", color=colour)
    period = reported["verdict"]["period_s"]
    panel.axvline(1e6 * period, **style.GUIDE)
    panel.set(xscale="log", yscale="log", xlabel="time of a tick [µs]", ylabel="share that took longer")
    panel.set_title(f"dotted: {1e3 * period:g} ms", loc="left")
    panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))


def goal_words(goal: dict[str, Any]) -> str:
    """Return a text that describes the goal of a search."""
    return f"{goal['manner']}, {'within the budget' if goal['within_budget'] else 'exact'}"
