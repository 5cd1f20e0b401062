"""The report for people: one HTML file that opens anywhere, without anything from outside.

``page.html.j2`` is the whole page, filled in by Jinja with the document and its pictures.
"""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from proximity.certificate import wording
from proximity.certificate.report import plots
from proximity.errors import DecaffError
from proximity.system.extras import installation

FILTERS = (
    wording.counted, wording.fed, wording.goal, wording.microseconds, wording.millimetres, wording.missed,
    wording.percent, wording.three,
)  # fmt: skip


def page(reported: dict[str, Any], surface: np.ndarray) -> str:
    """Return the report.

    Parameters
    ----------
    reported : dict
        See `document`.
    surface : (K, 3) float64, m
        Points of the surface, for the picture of the worst places.

    Raises
    ------
    DecaffError
        If Jinja or matplotlib is not there; it says what to install.
    """
    try:
        jinja, markup = import_module("jinja2"), import_module("markupsafe").Markup
    except ModuleNotFoundError as missing:
        raise DecaffError(
            f"pages need {missing.name}, which is not installed: {installation('sim')}"
        ) from missing
    environment = jinja.Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=jinja.StrictUndefined
    )
    environment.filters |= {each.__name__: each for each in FILTERS}
    environment.filters["extract"] = lambda key, times: times[key]
    pictures = {
        "tails": plots.draw_tails(reported),
        "places": plots.draw_places(reported, surface),
        "feeling": plots.draw_feeling(reported),
    }
    source = Path(__file__).with_name("page.html.j2").read_text(encoding="utf-8")
    text: str = environment.from_string(source).render(
        {name: value for name, value in reported.items() if name != "loop"},  # Jinja has a loop of its own
        service=reported["loop"],
        words=wording.WORDS,
        pictures={name: markup(picture) for name, picture in pictures.items()},
    )
    return text.lstrip() + "\n"
