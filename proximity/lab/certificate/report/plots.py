"""The pictures of a report, as SVG that may stand in a page, in the page's own colours."""

from typing import TYPE_CHECKING, Any

import numpy as np

from proximity.lab.certificate.report.finger_effect import SPEEDS, felt
from proximity.lab.figures import page_figure
from proximity.lab.figures.page_figure import COLOURS, DASHES, INK

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

CLOUD = 1200
"""Points of the surface that are drawn around the worst places."""


def draw_tails(reported: dict[str, Any]) -> str:
    """Return how many ticks took longer than a time, for each motion and the loop; both axes logarithmic."""

    def draw(figure: "Figure", _: Any) -> None:
        panel = figure.add_subplot()
        rows = [(case["name"], case["tail"], case["ticks"]) for case in reported["cases"]]
        loop = reported["loop"]
        rows += [
            ("service: computing", loop["compute"]["tail"], loop["ticks"]),
            ("service: woken late", loop["lateness"]["tail"], loop["ticks"]),
        ]
        for number, (name, tail, ticks) in enumerate(rows):
            times, counts = np.array(tail, np.float64).T
            panel.step(
                np.maximum(times, 1.0) / 1e3, counts / ticks, label=name, where="post",
                color=COLOURS[number % len(COLOURS)], linestyle=DASHES[number % len(DASHES)], linewidth=1.3,
            )  # fmt: skip
        _mark_periods(panel, reported)
        panel.set(xscale="log", yscale="log", xlabel="time of a tick [µs]", ylabel="share that took longer")
        panel.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))

    return page_figure.svg(draw, "tails")


def draw_places(reported: dict[str, Any], surface: np.ndarray) -> str:
    """Return where the worst places are, seen along two axes, with points of the surface around them.

    *surface*: (K, 3) m.
    """

    def draw(figure: "Figure", _: Any) -> None:
        panels = figure.subplots(1, 2)
        for panel, (across, up) in zip(panels, ((0, 1), (0, 2)), strict=True):
            cloud = 1e3 * surface[:CLOUD]
            panel.plot(
                cloud[:, across], cloud[:, up], ".", color=INK, alpha=0.5, markersize=1.8, markeredgewidth=0
            )
            for number, goal in enumerate(reported["search"]):
                places = 1e3 * np.array([place["position"] for place in goal["places"]])
                panel.plot(
                    places[:, across], places[:, up], "osv^D*"[number % 6], color=COLOURS[number],
                    markersize=5.5, fillstyle="full" if goal["within_budget"] else "none", label=_words(goal),
                )  # fmt: skip
            panel.set(xlabel=f"{'xyz'[across]} [mm]", ylabel=f"{'xyz'[up]} [mm]", aspect="equal")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")

    return page_figure.svg(draw, "places")


def draw_feeling(reported: dict[str, Any]) -> str:
    """Return how deep a finger enters a wall that answers late, with the periods of this scene marked."""

    def draw(figure: "Figure", _: Any) -> None:
        panels = figure.subplots(1, 2)
        delays = np.geomspace(5e-5, 5e-2, 60)
        kinds = (("force_error", "force error [N]"), ("energy_error", "energy error [mJ]"))
        for panel, (kind, label) in zip(panels, kinds, strict=True):
            factor = 1e3 if kind == "energy_error" else 1.0
            for number, speed in enumerate(SPEEDS):
                values = [factor * getattr(felt(delay, speed), kind) for delay in delays]
                panel.plot(
                    1e3 * delays, values, color=COLOURS[number], linestyle=DASHES[number + 1], linewidth=1.3,
                    label=f"{speed:g} m/s",
                )  # fmt: skip
                at = [
                    (1e3 * row["delay_s"], factor * row["speeds"][number][kind])
                    for row in reported["feeling"]
                ]
                panel.plot(*np.array(at).T, "o", color=COLOURS[number], markersize=4)
            panel.set(xscale="log", yscale="log", xlabel="delay [ms]", ylabel=label)
        panels[0].legend(loc="upper left")

    return page_figure.svg(draw, "feeling")


def _words(goal: dict[str, Any]) -> str:
    return f"{goal['manner']}, {'budget' if goal['within_budget'] else 'exact'}"


def _mark_periods(panel: "Axes", reported: dict[str, Any]) -> None:
    for number, row in enumerate(reported["cases"][0]["periods"]):
        period = row["period_s"]
        rise = 3 + 8 * (number % 2)  # neighbours may be close
        panel.axvline(1e6 * period, color=INK, linewidth=0.7, linestyle=":")
        panel.annotate(
            f"{1e3 * period:g} ms", (1e6 * period, 1.0), xytext=(0, rise), xycoords=("data", "axes fraction"),
            textcoords="offset points", ha="center", fontsize=7,
        )  # fmt: skip
