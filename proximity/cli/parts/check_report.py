"""The report of ``proximity check`` on a scene: as plain values and as text."""

import math
import re
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.table import Table

import proximity
from proximity.cli.lengths import in_unit, in_units
from proximity.cli.output import (
    FEW_DIGITS,
    MISSING,
    Lines,
    block,
    counted,
    length,
    number,
    print_block,
    printable,
)
from proximity.cli.tables import print_fitting, results_console, table_of
from proximity.mesh.vertex_weld import open_edges

NAMES_SHOWN = 3  # parts named with a remark; the others are counted
PARTS_SHOWN = 20
A_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
ALL_OF_RANGE = re.compile(r"(\S+ to \S+) of \1 ")
DISPENSABLE = ("volume", "manifold3d", "shells", "oriented", "watertight")
"""Columns to leave out, in this order, until the table is as narrow as the terminal."""
YES = {True: "yes", False: "no"}

Values = dict[str, Any]
Cell = Callable[[Values], str]


def _corner(position: list[float]) -> str:
    return "  ".join(length(coordinate, FEW_DIGITS) for coordinate in position)


def _size(values: Values) -> str:
    return " \N{MULTIPLICATION SIGN} ".join(length(side, FEW_DIGITS) for side in values["size"])


def _volume(values: Values) -> str:
    return MISSING if math.isnan(values["volume"]) else number(values["volume"])


def _opinion(part: Values) -> str:
    manifold = part["manifold"]
    return "solid" if manifold["is_solid"] else f"no: {manifold['status']}"


def _share(key: str) -> Cell:
    return lambda total: f"{total[key]} of {total['part_count']}"


HEAD = (
    ("file", "{file}"),
    ("compiled from", "{compiled_from}"),
    ("format", "{format}"),
    ("units of file", "{file_units} ({declared})"),
    ("size", "{size_text} {units}"),
    ("from", "{from_text} {units}"),
    ("to", "{to_text} {units}"),
    ("parts", "{total.part_count}"),
)
COLUMNS: dict[
    str, tuple[str, bool, Cell, Cell]
] = {  # its unit, whether aligned to the right, a part, all parts
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
    """Return the report as plain values; lengths, areas and volumes in the unit."""
    origin = scene.report
    assert origin is not None, "a scene read from a file has a report"
    parts = [_part_values(part, metres) for part in scene.parts]
    lower, upper = _box_of_whole(scene)
    return {
        "file": file,
        "compiled_from": origin.path if origin.path != file else None,
        "format": origin.format,
        "file_units": origin.units,
        "file_units_declared": origin.units_declared,
        "notes": list(origin.notes),
        "units": units,
        **_box(lower, upper, metres),
        "total": _total(parts),
        "parts": parts,
    }


def print_report(report: Values, *, is_whole: bool) -> None:
    """Print the report for people, with all parts or the first `PARTS_SHOWN`."""
    console = results_console()
    parts, units = report["parts"], report["units"]
    declared = "assumed: the file declares none"
    if report["file_units_declared"]:
        declared = "declared by the file"
    elif report["file_units"] == units != "mm":
        declared = "as --units says"
    texts = {
        "declared": declared, "size_text": _size(report),
        "from_text": _corner(report["lower"]), "to_text": _corner(report["upper"]),
    }  # fmt: skip
    head = [line for line in HEAD if line[0] != "compiled from" or report["compiled_from"]]
    print_block([*block(head, report | texts), *(("note", note) for note in report["notes"])])
    console.print()
    shown = parts if is_whole else parts[:PARTS_SHOWN]
    narrower = [DISPENSABLE[:count] for count in range(len(DISPENSABLE) + 1)]
    tables = [_table(shown, report, left_out) for left_out in narrower]
    if left_out := narrower[print_fitting(console, tables)]:
        names = ", ".join(left_out)
        console.print(f"The terminal is too narrow for: {names}. A wider one, a pipe or --json shows them.")
    if len(shown) < len(parts):
        console.print(f"These are the first {len(shown)} of {len(parts)} parts; --all lists all.")
    console.print()
    print_block(_remarks(parts, units))


def _part_values(part: "proximity.Part", metres: float) -> Values:
    found, mesh = part.solid.diagnosis, part.solid.mesh
    middles = np.empty((0, 3)) if found.is_watertight else open_edges(mesh.vertices, mesh.faces)
    unclosed = part.pose.point(middles)
    return {
        "name": part.name,
        "face_count": found.face_count,
        "vertex_count": found.vertex_count,
        "shell_count": found.shell_count,
        "boundary_edge_count": found.boundary_edge_count,
        "nonmanifold_edge_count": found.nonmanifold_edge_count,
        "misoriented_edge_count": found.misoriented_edge_count,
        "open_edge_count": len(unclosed),  # where vertices that a weld would close up count as one
        "open_edge": in_units(unclosed[0], metres).tolist() if len(unclosed) else None,  # in the scene
        "is_watertight": found.is_watertight,
        "is_oriented": found.is_oriented,
        "volume": in_unit(found.volume, metres**3),
        "area": in_unit(found.area, metres**2),
        **_box(np.array(found.lower), np.array(found.upper), metres),
        "has_inside": bool(part.solid.has_inside),
        "sign_method": part.solid.sign_method.value,
        "sign_reason": part.solid.sign_reason,
        "repairs": {**asdict(part.repairs), "weld_distance": in_unit(part.repairs.weld_distance, metres)},
        "repairs_described": part.repairs.describe(),
        "manifold": {"is_solid": found.is_solid_by_manifold, "status": found.manifold_status},
    }


def _box_of_whole(scene: "proximity.Scene") -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner, m, of the box around all faces where they stand in the scene: (3,) each."""
    corners = [
        part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces.ravel()]) for part in scene.parts
    ]
    lower = np.min([of_part.min(axis=0) for of_part in corners], axis=0)
    return lower, np.max([of_part.max(axis=0) for of_part in corners], axis=0)


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


def _table(parts: list[Values], report: Values, left_out: tuple[str, ...]) -> Table:
    columns = {title: column for title, column in COLUMNS.items() if title not in left_out}
    titles = [
        (title + unit.format(report["units"]), is_right) for title, (unit, is_right, *_) in columns.items()
    ]
    table = table_of(titles, ([cell(part) for _, _, cell, _ in columns.values()] for part in parts))
    total = report["total"]
    if total["part_count"] > 1:
        cells = [cell({**total, "size": report["size"]}) for *_, cell in columns.values()]
        table.add_row(*cells, style="bold")
    return table


def _remarks(parts: list[Values], units: str) -> Lines:
    return [
        *_grouped(parts, "sign", lambda part: f"{part['sign_method']}: {part['sign_reason']}"),
        *_open_edges([part for part in parts if part["open_edge_count"]], units),
        *_grouped(parts, "repaired", lambda part: part["repairs_described"]),
        *_grouped(parts, "no inside", lambda part: "" if part["has_inside"] else "distances are unsigned"),
    ]


def _open_edges(parts: list[Values], units: str) -> Lines:
    lines = [
        f"{counted(part['open_edge_count'], 'edge')}, the first near {_corner(part['open_edge'])} {units} "
        f"({part['name']})"
        for part in parts[:NAMES_SHOWN]
    ]
    if len(parts) > NAMES_SHOWN:
        lines.append(f"edges of {counted(len(parts) - NAMES_SHOWN, 'more part')}; --json lists them")
    return [("not closed", line) for line in lines]


def _grouped(parts: list[Values], label: str, sentence_of: Cell) -> Lines:
    """Each sentence once, with the parts it is about; where only numbers differ, their range stands."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for part in parts:
        if sentence := sentence_of(part):
            groups.setdefault(A_NUMBER.sub("0", sentence), []).append((sentence, part["name"]))
    lines = []
    for group in groups.values():
        sentences, names = zip(*group, strict=True)
        rest = len(names) - NAMES_SHOWN
        shown = ", ".join(names[:NAMES_SHOWN]) + (f" and {rest} more" if rest > 0 else "")
        lines.append((label, f"{_with_ranges(sentences)} ({shown})"))
    return lines


def _with_ranges(sentences: tuple[str, ...]) -> str:
    """Return sentences that differ in numbers only as one: "Merged 4 to 28 equal vertices."."""
    columns = zip(*(A_NUMBER.findall(sentence) for sentence in sentences), strict=True)
    ranges = iter([sorted(set(column), key=float) for column in columns])

    def spelled_range(_: re.Match[str]) -> str:
        spelt = next(ranges)
        return spelt[0] if len(spelt) == 1 else f"{spelt[0]} to {spelt[-1]}"

    return ALL_OF_RANGE.sub("all ", A_NUMBER.sub(spelled_range, sentences[0]))
