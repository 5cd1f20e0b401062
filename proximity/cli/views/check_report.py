"""The report of ``proximity check`` on a scene: as plain values and as text."""

import math
import re
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

import proximity
from proximity.cli.console import print_block, print_fitting, table_of
from proximity.cli.lengths import in_unit, in_units
from proximity.cli.wording import FEW_DIGITS, MISSING, counted, length, number, printable
from proximity.mesh.vertex_weld import open_edges

NAMES_SHOWN = 3  # parts named with a remark; the others are counted
PARTS_SHOWN = 20
A_NUMBER = re.compile(r"\d+(?:\.\d+)?(?:e[+-]?\d+)?")
ALL_OF_RANGE = re.compile(r"(\S+ to \S+) of \1 ")
DISPENSABLE = ("volume", "manifold3d", "shells", "oriented", "watertight")
"""Columns to leave out, in this order, until the table is as narrow as the terminal."""

Values = dict[str, Any]


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
        "size": in_units(_between(lower, upper), metres).tolist(),
        "lower": in_units(lower, metres).tolist(),
        "upper": in_units(upper, metres).tolist(),
        "total": _total(parts),
        "parts": parts,
    }


def print_report(console: Console, report: Values, *, is_whole: bool) -> None:
    """Print the report for people.

    *console*: where to print; where it is no terminal, lines are not folded to a width. *is_whole*: whether
    to list all parts; else those beyond `PARTS_SHOWN` are counted.
    """
    parts, units = report["parts"], report["units"]
    declared = (
        "as --units says" if report["file_units"] == units != "mm" else "assumed: the file declares none"
    )
    declared = "declared by the file" if report["file_units_declared"] else declared
    print_block(
        console,
        [
            ("file", report["file"]),
            *([("compiled from", report["compiled_from"])] if report["compiled_from"] else []),
            ("format", report["format"]),
            ("units of file", f"{report['file_units']} ({declared})"),
            ("size", f"{_size(report['size'])} {units}"),
            ("from", f"{_corner(report['lower'])} {units}"),
            ("to", f"{_corner(report['upper'])} {units}"),
            ("parts", str(len(parts))),
            *(("note", note) for note in report["notes"]),
        ],
    )
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
    print_block(console, _remarks(parts, units))


def _part_values(part: "proximity.Part", metres: float) -> Values:
    found, mesh = part.solid.diagnosis, part.solid.mesh
    middles = np.empty((0, 3)) if found.is_watertight else open_edges(mesh.vertices, mesh.faces)
    unclosed = part.pose.point(middles)
    lower, upper = np.array(found.lower), np.array(found.upper)
    return {
        "name": part.name,
        "size": in_units(_between(lower, upper), metres).tolist(),
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
        "lower": in_units(lower, metres).tolist(),
        "upper": in_units(upper, metres).tolist(),
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


def _between(lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        difference: np.ndarray = upper - lower
    return difference


def _total(parts: list[Values]) -> Values:
    volumes = [part["volume"] for part in parts]
    return {
        "part_count": len(parts),
        "face_count": sum(part["face_count"] for part in parts),
        "vertex_count": sum(part["vertex_count"] for part in parts),
        "shell_count": sum(part["shell_count"] for part in parts),
        "watertight_count": sum(part["is_watertight"] for part in parts),
        "oriented_count": sum(part["is_oriented"] for part in parts),
        "inside_count": sum(part["has_inside"] for part in parts),
        "solid_count": sum(part["manifold"]["is_solid"] for part in parts),
        "volume": in_unit(sum(volumes), 1.0),
    }


def _table(parts: list[Values], report: Values, left_out: tuple[str, ...]) -> Table:
    units, count = report["units"], len(report["parts"])
    columns: list[tuple[str, str, bool, Callable[[Values], str]]] = [  # key, title, whether right, cell
        ("part", "part", False, lambda part: printable(part["name"])),
        ("size", f"size [{units}]", True, lambda part: _size(part["size"])),
        ("faces", "faces", True, lambda part: str(part["face_count"])),
        ("shells", "shells", True, lambda part: str(part["shell_count"])),
        ("watertight", "watertight", False, lambda part: _yes(part["is_watertight"])),
        ("oriented", "oriented", False, lambda part: _yes(part["is_oriented"])),
        ("volume", f"volume [{units}\N{SUPERSCRIPT THREE}]", True, lambda part: _volume(part["volume"])),
        ("sign", "sign", False, lambda part: part["sign_method"]),
        ("manifold3d", "manifold3d", False, lambda part: _opinion(part["manifold"])),
    ]
    total = report["total"]
    total_cells = {
        "part": f"{count} parts",
        "size": _size(report["size"]),
        "faces": str(total["face_count"]),
        "shells": str(total["shell_count"]),
        "watertight": f"{total['watertight_count']} of {count}",
        "oriented": f"{total['oriented_count']} of {count}",
        "volume": _volume(total["volume"]),
        "sign": f"{total['inside_count']} of {count}",
        "manifold3d": f"{total['solid_count']} of {count}",
    }
    columns = [column for column in columns if column[0] not in left_out]
    table = table_of((title, is_right) for _, title, is_right, _ in columns)
    for part in parts:
        table.add_row(*(Text(cell(part)) for _, _, _, cell in columns))
    if count > 1:
        table.add_row(*(Text(total_cells[key], style="bold") for key, _, _, _ in columns))
    return table


def _corner(position: list[float]) -> str:
    return "  ".join(length(coordinate, FEW_DIGITS) for coordinate in position)


def _size(size: list[float]) -> str:
    return " \N{MULTIPLICATION SIGN} ".join(length(side, FEW_DIGITS) for side in size)


def _volume(volume: float) -> str:
    return MISSING if math.isnan(volume) else number(volume)


def _yes(truth: bool) -> str:
    return "yes" if truth else "no"


def _opinion(manifold: Values) -> str:
    return "solid" if manifold["is_solid"] else f"no: {manifold['status']}"


def _remarks(parts: list[Values], units: str) -> list[tuple[str, str]]:
    return [
        *_grouped(parts, "sign", lambda part: f"{part['sign_method']}: {part['sign_reason']}"),
        *_open_edges([part for part in parts if part["open_edge_count"]], units),
        *_grouped(parts, "repaired", lambda part: part["repairs_described"]),
        *_grouped(parts, "no inside", lambda part: "" if part["has_inside"] else "distances are unsigned"),
    ]


def _open_edges(parts: list[Values], units: str) -> list[tuple[str, str]]:
    lines = [
        f"{counted(part['open_edge_count'], 'edge')}, the first near {_corner(part['open_edge'])} {units} "
        f"({part['name']})"
        for part in parts[:NAMES_SHOWN]
    ]
    if len(parts) > NAMES_SHOWN:
        lines.append(f"edges of {counted(len(parts) - NAMES_SHOWN, 'more part')}; --json lists them")
    return [("not closed", line) for line in lines]


def _grouped(parts: list[Values], label: str, sentence_of: Callable[[Values], str]) -> list[tuple[str, str]]:
    """Say each sentence once, with the parts it is about; where only numbers differ, their range stands."""
    groups: dict[str, list[tuple[str, str]]] = {}
    for part in parts:
        if sentence := sentence_of(part):
            groups.setdefault(A_NUMBER.sub("0", sentence), []).append((sentence, part["name"]))
    return [
        (
            label,
            f"{_with_ranges([sentence for sentence, _ in group])} ({_listed([name for _, name in group])})",
        )
        for group in groups.values()
    ]


def _with_ranges(sentences: list[str]) -> str:
    """Return sentences that differ in numbers only as one: "Merged 4 to 28 equal vertices."."""
    columns = zip(*(A_NUMBER.findall(sentence) for sentence in sentences), strict=True)
    ranges = iter([sorted(set(column), key=float) for column in columns])

    def spelled_range(_: re.Match[str]) -> str:
        spelt = next(ranges)
        return spelt[0] if len(spelt) == 1 else f"{spelt[0]} to {spelt[-1]}"

    return ALL_OF_RANGE.sub("all ", A_NUMBER.sub(spelled_range, sentences[0]))


def _listed(names: list[str]) -> str:
    shown = ", ".join(names[:NAMES_SHOWN])
    rest = len(names) - NAMES_SHOWN
    return f"{shown} and {rest} more" if rest > 0 else shown
