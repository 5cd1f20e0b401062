"""Report of ``proximity thickness`` as one HTML file: verdict, picture, and the thinnest positions."""

import base64
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import proximity
from proximity.cli.parts.reports.scan import TEMPLATE
from proximity.lab.figures import pages
from proximity.system.whole_file import whole_file


class Page(NamedTuple):
    """Texts of a report; *limit*: the limit with its unit, *titles*: those of the columns of *rows*."""

    title: str
    verdict: str
    is_good: bool
    summary: Sequence[str]
    limit: str
    titles: Sequence[str]
    rows: Sequence[Sequence[str]]


def write_report(path: Path, page: Page, draw: Callable[[], bytes]) -> None:
    """Write the report as a page, which replaces an existing file. *draw* returns the picture as PNG."""

    def pictures() -> dict[str, str]:
        image = base64.b64encode(draw()).decode()
        return {"map": f'<img alt="thickness of the parts" src="data:image/png;base64,{image}">'}

    text = pages.render_page(TEMPLATE, {
        "title": page.title, "is_good": page.is_good, "outcome": "Passed" if page.is_good else "Failed",
        "verdict": page.verdict, "summary": page.summary,
        "sections": [
            ("Thickness", "map", (), (),
             f"Red and orange are below the limit of {page.limit}, yellow and blue above it. The numbers are "
             "those of the table; hidden positions have none."),
            ("The thinnest positions", "", page.titles, page.rows, "Faces are numbered as in the file."),
        ],
        "origin": f"proximity {proximity.__version__}; thickness along the normals of the triangles.",
    }, pictures, ())  # fmt: skip
    with whole_file(path) as stream:
        stream.write(text.encode())
