"""A certificate as files: one HTML page that opens anywhere, and the same as JSON beside it for machines.

``page.html.j2`` is the whole page, filled in by Jinja with the document and its pictures.
"""

import json
import math
import os
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.errors import ServiceError
from proximity.lab.certificate import wording
from proximity.lab.certificate.starting_positions import surface_samples
from proximity.lab.figures import pages, style
from proximity.lab.figures.pages import COLOURS, DASHES, INK, render_page
from proximity.scene.scene import Scene
from proximity.system.extras import needed
from proximity.system.whole_file import whole_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SUFFIXES = (".html", ".json")
CLOUD = 1200  # points of the surface in the page
FILTERS = (
    wording.counted, wording.fed, wording.goal, wording.microseconds, wording.millimetres, wording.missed,
    wording.percent, wording.three,
)  # fmt: skip


def check_report_name(path: str | os.PathLike[str]) -> None:
    """Refuse what is no name of a report."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise ServiceError(f"{target} does not end in {' or '.join(SUFFIXES)}")
    if not target.parent.is_dir():
        raise ServiceError(f"{target}: there is no folder {target.parent}")


def check_libraries(path: str | os.PathLike[str]) -> None:
    """Refuse the name of a page where a library that draws pages is missing."""
    if Path(path).suffix.lower() != ".json":
        with needed("pages need", "sim"):
            import_module("jinja2")
        style.load_figure()


def write_report(path: str | os.PathLike[str], reported: dict[str, Any], scene: Scene) -> tuple[Path, ...]:
    """Write JSON, and then the page if the name ends in .html; each file wholly or not at all."""
    check_report_name(path)
    target = Path(path)
    numbers = target.with_suffix(".json")
    with whole_file(numbers) as stream:
        stream.write(as_json(reported).encode())
    if target.suffix.lower() == ".json":
        return (numbers,)
    surface, _ = surface_samples(scene, CLOUD, np.random.default_rng(0))
    text = page(reported, surface)
    with whole_file(target) as stream:
        stream.write(text.encode())
    return target, numbers


def as_json(reported: dict[str, Any]) -> str:
    """Return a document as text; what is no number becomes null."""
    return json.dumps(_plain(reported), allow_nan=False, indent=1, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def page(reported: dict[str, Any], surface: np.ndarray) -> str:
    """Return the report for people; points of the *surface*, (K, 3) m, stand around the worst positions."""

    def draw() -> dict[str, str]:
        return {"tails": draw_tails(reported), "places": draw_positions(reported, surface)}

    def extract(key: str, times: dict[str, Any]) -> Any:
        return times[key]

    # Jinja has a loop of its own.
    values = {name: value for name, value in reported.items() if name != "loop"}
    values |= {"service": reported["loop"], "words": wording.WORDS}
    return render_page(Path(__file__).with_name("page.html.j2"), values, draw, (*FILTERS, extract))


def draw_tails(reported: dict[str, Any]) -> str:
    """Return how many ticks took longer than a time, for each motion and the loop; both axes logarithmic."""

    def draw(figure: "Figure", _: Any) -> None:
        panel, loop = figure.add_subplot(), reported["loop"]
        rows = [(case["name"], case["tail"], case["ticks"]) for case in reported["cases"]]
        for name, kind in (("service: computing", "compute"), ("service: woken late", "lateness")):
            rows.append((name, loop[kind]["tail"], loop["ticks"]))
        for number, (name, tail, ticks) in enumerate(rows):
            times, counts = np.array(tail, np.float64).T
            panel.step(
                np.maximum(times, 1.0) / 1e3, counts / ticks, label=name, where="post",
                color=COLOURS[number % len(COLOURS)], linestyle=DASHES[number % len(DASHES)], linewidth=1.3,
            )  # fmt: skip
        _mark_periods(panel, reported["cases"][0]["periods"])
        panel.set(xscale="log", yscale="log", xlabel="time of a tick [µs]", ylabel="share that took longer")
        panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))

    return pages.svg(draw, "tails")


def _mark_periods(panel: "Axes", periods: list[dict[str, Any]]) -> None:
    for number, period in enumerate(each["period_s"] for each in periods):
        rise = 3 + 8 * (number % 2)  # neighbours may be close
        panel.axvline(1e6 * period, color=INK, linewidth=0.7, linestyle=":")
        panel.annotate(
            f"{1e3 * period:g} ms", (1e6 * period, 1.0), xytext=(0, rise), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", fontsize=7,
        )  # fmt: skip


def draw_positions(reported: dict[str, Any], surface: np.ndarray) -> str:
    """Return where the worst positions are, seen along two axes, with points of the surface, (K, 3) m."""

    def draw(figure: "Figure", _: Any) -> None:
        panels = figure.subplots(1, 2)
        for panel, (across, up) in zip(panels, ((0, 1), (0, 2)), strict=True):
            cloud = 1e3 * surface[:CLOUD]
            panel.plot(
                cloud[:, across], cloud[:, up], ".", color=INK, alpha=0.5, markersize=1.8, markeredgewidth=0
            )
            for number, goal in enumerate(reported["search"]):
                places = 1e3 * np.array([place["position"] for place in goal["places"]])
                is_within = goal["within_budget"]
                panel.plot(
                    places[:, across], places[:, up], "osv^D*"[number % 6], color=COLOURS[number],
                    markersize=5.5, fillstyle="full" if is_within else "none",
                    label=f"{goal['manner']}, {'budget' if is_within else 'exact'}",
                )  # fmt: skip
            panel.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]", aspect="equal")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")

    return pages.svg(draw, "places")
