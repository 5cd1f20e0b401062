"""Report of ``proximity thickness`` as one HTML file: verdict, picture, and the thinnest positions."""

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import proximity
from proximity.cli.output import length, printable
from proximity.cli.parts.scan_report import TEMPLATE
from proximity.cli.parts.thickness import DIGITS, percent, position_rows, position_titles
from proximity.lab.figures import pages
from proximity.scene.picture.thickness_map import draw_thickness
from proximity.system.whole_file import whole_file


def write_report(
    path: Path,
    scene: proximity.Scene,
    walls: Sequence[proximity.ThinWalls],
    values: Sequence[dict[str, Any]],
    file: str,
    sentence: str,
    below: float,
    units: str,
    metres: float,
) -> None:
    """Write the report as a page. It replaces an existing file."""

    def draw() -> dict[str, str]:
        image = base64.b64encode(draw_thickness(scene, walls, below * metres, unit=units, metres=metres))
        return {"map": f'<img alt="thickness of the parts" src="data:image/png;base64,{image.decode()}">'}

    summary = [
        f"{printable(each['part'])}: least thickness {length(each['lower'], DIGITS)} to "
        f"{length(each['least'], DIGITS)} {units}; {percent(each['share'])} of the surface is thinner than "
        f"{length(below)} {units}."
        for each in values
    ]
    page = pages.render_page(TEMPLATE, {
        "title": f"Thickness of {Path(file).name}",
        "is_good": all(each["is_thin"] is False for each in values),
        "verdict": sentence,
        "summary": summary,
        "sections": [
            ("Thickness", "map", (), (),
             f"Red and orange are below the limit of {length(below)} {units}, yellow and blue above it. The "
             "numbers are those of the table; hidden positions have none."),
            ("The thinnest positions", "", position_titles(units), position_rows(list(values)),
             f"In {units}; faces are numbered as in the file."),
        ],
        "origin": f"proximity {proximity.__version__}; thickness along the normals of the triangles.",
    }, draw, ())  # fmt: skip
    with whole_file(path) as stream:
        stream.write(page.encode())
