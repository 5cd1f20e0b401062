"""The report for people: one HTML file that opens anywhere, without anything from outside.

``page.html.j2`` is the whole page, filled in by Jinja with the document and its pictures.
"""

from pathlib import Path
from typing import Any

import numpy as np

from proximity.lab.certificate import wording
from proximity.lab.certificate.report import plots
from proximity.lab.figures.html_page import render_page

FILTERS = (
    wording.counted, wording.fed, wording.goal, wording.microseconds, wording.millimetres, wording.missed,
    wording.percent, wording.three,
)  # fmt: skip


def extract(key: str, times: dict[str, Any]) -> Any:
    """Return one entry of a table, for `map` in the page."""
    return times[key]


def page(reported: dict[str, Any], surface: np.ndarray) -> str:
    """Return the report.

    *surface*: (K, 3) m; points of the surface, for the picture of the worst places.
    """

    def draw() -> dict[str, str]:
        return {
            "tails": plots.draw_tails(reported),
            "places": plots.draw_places(reported, surface),
            "feeling": plots.draw_feeling(reported),
        }

    # Jinja has a loop of its own.
    values = {name: value for name, value in reported.items() if name != "loop"}
    values |= {"service": reported["loop"], "words": wording.WORDS}
    return render_page(Path(__file__).with_name("page.html.j2"), values, draw, (*FILTERS, extract))
