"""Report of ``proximity check`` on a scene, as values and as text."""

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

import proximity
from proximity.cli.output import (
    DIGITS,
    FEW_DIGITS,
    MISSING,
    NEGLIGIBLE,
    at_most,
    counted,
    in_unit,
    in_units,
    length,
    number,
    print_block,
    printable,
)
from proximity.cli.tables import Column, print_fitting, results_console
from proximity.formats import metres_per_unit
from proximity.mesh.topology import open_edges

NAMES_SHOWN = 3  # number of parts named in a remark; the others are counted
PARTS_SHOWN = 20
A_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
ALL_OF_RANGE = re.compile(r"(\S+ to \S+) of \1 ")
DISPENSABLE = ("volume", "manifold3d", "shells", "oriented", "watertight")
"""Columns that are omitted in this order until the table fits the terminal."""
YES = {True: "yes", False: "no"}

Values = dict[str, Any]
Cell = Callable[[Values], str]
Lines = Iterator[tuple[str, str]]


def _corner(position: list[float], size: list[float]) -> str:
    """Return a position as text.

    It has more digits if it is far from the origin compared with *size*.
    """
    ratio = max(map(abs, position)) / (max(size) or math.inf)
    digits = FEW_DIGITS + math.ceil(math.log10(max(ratio, 1.0)))
    return "  ".join(length(coordinate, min(digits, DIGITS)) for coordinate in position)


def _size(values: Values) -> str:
    return " \N{MULTIPLICATION SIGN} ".join(length(side, FEW_DIGITS) for side in values["size"])


def _volume(values: Values) -> str:
    return MISSING if math.isnan(values["volume"]) else number(values["volume"])


def _opinion(part: Values) -> str:
    manifold = part["manifold"]
    return "solid" if manifold["is_solid"] else f"no: {manifold['status']}"


def _share(key: str) -> Cell:
    return lambda total: f"{total[key]} of {total['part_count']}"


COLUMNS: dict[
    str, tuple[str, bool, Cell, Cell]
] = {  # unit, whether aligned to the right, cell of a part, cell of all parts
    "part": ("", False, lambda part: printable(part["name"]), lambda total: f"{total['part_count']} parts"),
    "size": (" [{}]", True, _size, _size),
    "faces": ("", True, lambda part: str(part["face_count"]), lambda total: str(total["face_count"])),
    "shells": ("", True, lambda part: str(part["shell_count"]), lambda total: str(total["shell_count"])),
    "watertight": ("", False, lambda part: YES[part["is_watertight"]], _share("watertight_count")),
    "oriented": ("", False, lambda part: YES[part["is_oriented"]], _share("oriented_count")),
    "volume": (" [{}\N{SUPERSCRIPT THREE}]", True, _volume, _volume),
    "sign": ("", False, lambda part: part["sign_method"], _share("inside_count")),
    "manifold3d": ("", False, _opinion, _share("solid_count")),
}


def report_of(scene: "proximity.Scene", file: str, units: str, metres: float) -> Values:
    """Return the report as values for JSON. Lengths, areas and volumes are in the user's unit."""
    origin = scene.report
    assert origin is not None, "a scene read from a file has a report"
    parts = [_part_values(part, metres) for part in scene.parts]
    return {
        "file": file,
        "compiled_from": origin.path if origin.path != file else None,
        "format": origin.format,
        "file_units": origin.units,
        "file_units_declared": origin.units_declared,
        "notes": list(origin.notes),
        "units": units,
        **_box(*scene.bounds, metres),
        "total": _total(parts),
        "parts": parts,
    }


def print_report(report: Values, *, is_whole: bool) -> None:
    """Print the report. Unless *is_whole*, only the first `PARTS_SHOWN` parts are listed."""
    console, parts = results_console(), report["parts"]
    shown = parts if is_whole else parts[:PARTS_SHOWN]
    print_block(_head(report))
    console.print()
    totals = [{**report["total"], "size": report["size"]}] if len(parts) > 1 else []
    columns = [
        Column(
            title,
            title + unit.format(report["units"]),
            is_right,
            [*map(cell, shown), *map(cell_of_all, totals)],
        )
        for title, (unit, is_right, cell, cell_of_all) in COLUMNS.items()
    ]
    print_fitting(
        console, columns, DISPENSABLE, "a wider one, a pipe or --json", styles=["bold"] * len(totals)
    )
    if len(shown) < len(parts):
        console.print(f"These are the first {len(shown)} of {len(parts)} parts; --all lists all.")
    console.print()
    print_block(_remarks(parts, report["units"]))


def _head(report: Values) -> Lines:
    units = report["units"]
    declared = "assumed: the file declares none"
    if report["file_units_declared"]:
        declared = "declared by the file"
    elif report["file_units"] == units != "mm":
        declared = "as --units says"
    yield "file", report["file"]
    if report["compiled_from"]:
        yield "compiled from", report["compiled_from"]
    yield "format", report["format"]
    yield "units of file", f"{report['file_units']} ({declared})"
    yield "size", f"{_size(report)} {units}"
    yield "from", f"{_corner(report['lower'], report['size'])} {units}"
    yield "to", f"{_corner(report['upper'], report['size'])} {units}"
    yield "parts", str(len(report["parts"]))
    for note in report["notes"]:
        yield "note", note


def _part_values(part: "proximity.Part", metres: float) -> Values:
    found, mesh = part.solid.diagnosis, part.solid.mesh
    middles = np.empty((0, 3)) if found.is_watertight else open_edges(mesh)
    unclosed = part.pose.point(middles)
    return {
        "name": part.name,
        "face_count": found.face_count,
        "vertex_count": found.vertex_count,
        "shell_count": found.shell_count,
        "boundary_edge_count": found.boundary_edge_count,
        "nonmanifold_edge_count": found.nonmanifold_edge_count,
        "misoriented_edge_count": found.misoriented_edge_count,
        "open_edge_count": len(unclosed),  # after merging vertices within the weld tolerance
        "open_edge": in_units(unclosed[0], metres).tolist() if len(unclosed) else None,  # in the scene
        "is_watertight": found.is_watertight,
        "is_oriented": found.is_oriented,
        "volume": in_unit(found.volume, metres**3),
        "area": in_unit(found.area, metres**2),
        **_box(np.array(found.lower), np.array(found.upper), metres),
        "has_inside": bool(part.solid.has_inside),
        "deviation": in_unit(part.deviation, metres) if part.deviation < math.inf else None,
        "sign_method": part.solid.sign_method.value,
        "sign_reason": part.solid.sign_reason,
        "repairs": {**asdict(part.repairs), "weld_distance": in_unit(part.repairs.weld_distance, metres)},
        "repairs_described": part.repairs.describe(),
        "manifold": {"is_solid": found.is_solid_by_manifold, "status": found.manifold_status},
    }


def _box(lower: np.ndarray, upper: np.ndarray, metres: float) -> Values:
    with np.errstate(over="ignore"):
        corners = {"size": upper - lower, "lower": lower, "upper": upper}
    return {name: in_units(corner, metres).tolist() for name, corner in corners.items()}


def _total(parts: list[Values]) -> Values:
    counts = ("face_count", "vertex_count", "shell_count")
    truths = {
        "watertight_count": "is_watertight",
        "oriented_count": "is_oriented",
        "inside_count": "has_inside",
    }
    return {
        "part_count": len(parts),
        **{key: sum(part[key] for part in parts) for key in counts},
        **{key: sum(part[truth] for part in parts) for key, truth in truths.items()},
        "solid_count": sum(part["manifold"]["is_solid"] for part in parts),
        "volume": in_unit(sum(part["volume"] for part in parts), 1.0),
    }


def _deviation(part: Values, units: str) -> str:
    """Return a sentence on the deviation of a part, or an empty text if it is negligible."""
    if part["deviation"] is None:
        return "of the triangles from the CAD surfaces: unknown"
    if part["deviation"] * metres_per_unit(units) <= NEGLIGIBLE:
        return ""
    return f"of the triangles from the CAD surfaces: at most {at_most(part['deviation'])} {units}"


def _remarks(parts: list[Values], units: str) -> Lines:
    yield from _grouped(parts, "sign", lambda part: f"{part['sign_method']}: {part['sign_reason']}")
    unclosed = [part for part in parts if part["open_edge_count"]]
    for part in unclosed[:NAMES_SHOWN]:
        where = f"the first near {_corner(part['open_edge'], part['size'])} {units} ({part['name']})"
        yield "not closed", f"{counted(part['open_edge_count'], 'edge')}, {where}"
    if (more := len(unclosed) - NAMES_SHOWN) > 0:
        yield "not closed", f"edges of {counted(more, 'more part')}; --json lists them"
    yield from _grouped(parts, "repaired", lambda part: part["repairs_described"])
    yield from _grouped(parts, "deviation", lambda part: _deviation(part, units))
    yield from _grouped(
        parts, "no inside", lambda part: "" if part["has_inside"] else "distances are unsigned"
    )


def _grouped(parts: list[Values], label: str, sentence_of: Cell) -> Lines:
    """Yield each sentence once, with the parts that it is about.

    Sentences that differ only in numbers are merged, with ranges of the numbers.
    """
    groups: dict[str, list[tuple[str, str]]] = {}
    for part in parts:
        if sentence := sentence_of(part):
            groups.setdefault(A_NUMBER.sub("0", sentence), []).append((sentence, part["name"]))
    for group in groups.values():
        sentences, names = zip(*group, strict=True)
        rest = len(names) - NAMES_SHOWN
        shown = ", ".join(names[:NAMES_SHOWN]) + (f" and {rest} more" if rest > 0 else "")
        yield label, f"{_with_ranges(sentences)} ({shown})"


def _with_ranges(sentences: tuple[str, ...]) -> str:
    """Merge sentences that differ only in numbers, as in "Merged 4 to 28 equal vertices."."""
    columns = zip(*(A_NUMBER.findall(sentence) for sentence in sentences), strict=True)
    ranges = iter([sorted(set(column), key=float) for column in columns])

    def spelled_range(_: re.Match[str]) -> str:
        spelt = next(ranges)
        return spelt[0] if len(spelt) == 1 else f"{spelt[0]} to {spelt[-1]}"

    return ALL_OF_RANGE.sub("all ", A_NUMBER.sub(spelled_range, sentences[0]))
