"""Report of a scan against its part, as one HTML file.

It has the verdict, a picture, a histogram and the worst points.
"""

import base64
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import proximity
from proximity.cli.output import number
from proximity.cli.parts.deviations import DIGITS, PLACE_DIGITS, Deviations
from proximity.lab.figures import pages
from proximity.scene.picture import Picture, load_renderer, sheet
from proximity.system.extras import needed
from proximity.system.whole_file import whole_file

TEMPLATE = Path(__file__).with_name("page.html.j2")
_BINS = 61  # odd, so that one bin is around zero
_HEAD = ("point", "x", "y", "z", "signed distance", "nearest part")


def check_libraries() -> None:
    """Import the libraries for drawing.

    A missing one is thus reported before the scan is read.
    """
    load_renderer()
    with needed("a report needs", "picture"):
        import jinja2  # noqa: F401


def write_report(path: Path, scene: "proximity.Scene", part: str, scan: str, found: Deviations) -> None:
    """Write the report as a page. It replaces an existing file."""
    within, units = found.within or 0.0, found.units
    reach = within * found.metres
    picture = Picture(
        scene, part, found.shown * found.metres, None, units, found.metres, reach=(-reach, reach)
    )
    worst = [
        (f"#{each['row']}", *(number(value, PLACE_DIGITS) for value in each["query"]),
         number(each["signed_distance"], DIGITS), each["part_name"])
        for each in found.worst
    ]  # fmt: skip
    thinned = (
        f" {len(found.shown)} points are drawn; the bar shows their share."
        if len(found.shown) < found.count
        else ""
    )

    def draw() -> dict[str, str]:
        image = base64.b64encode(sheet.draw(picture)).decode()
        view = f'<img alt="the points on the part" src="data:image/png;base64,{image}">'
        return {"view": view, "histogram": pages.svg(_histogram(found, within), "histogram")}

    page = pages.render_page(TEMPLATE, {
        "title": f"{scan} against {part}",
        "is_good": not found.farther_count,
        "outcome": "Failed" if found.farther_count else "Passed",
        "verdict": f"{found.share_within()}; {found.farther_count} of {found.count} points are farther.",
        "summary": found.sentence().splitlines(),
        "sections": [
            ("Deviations on the part", "view", (), (),
             f"Red is inside, blue outside; the darkest colours are beyond the tolerance.{thinned}"),
            ("Distribution", "histogram", (), (),
             "The outermost bars hold all points beyond them; the lines are the tolerance."),
            ("The worst points", "", _HEAD, worst,
             f"In {units}, negative inside; points are numbered from 0 in the order of the file."),
        ],
        "origin": f"proximity {proximity.__version__}; distances are exact to the triangles of the part.",
    }, draw, ())  # fmt: skip
    with whole_file(path) as stream:
        stream.write(page.encode())


def _histogram(found: Deviations, within: float) -> Callable[[Any, Any], None]:
    """Return a function that draws the histogram of the signed distances."""
    end = max(1.5 * within, min(4.0 * within, float(np.abs(found.distances).max(initial=0.0)))) or 1.0
    counts, edges = np.histogram(np.clip(found.distances, -end, end), _BINS, (-end, end))
    middles = (edges[1:] + edges[:-1]) / 2
    colours = [pages.COLOURS[int(abs(middle) > within)] for middle in middles]

    def draw(figure: Any, _: Any) -> None:
        axes = figure.subplots()
        axes.bar(middles, counts, np.diff(edges), color=colours)
        for tolerance in (-within, within):
            axes.axvline(tolerance, color=pages.INK, linewidth=1.0, linestyle="--")
        axes.set(xlabel=f"signed distance, {found.units}", ylabel="points", xlim=(-end, end))

    return draw
