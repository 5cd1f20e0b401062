"""Command ``proximity clearance``, which measures distances, contacts and overlaps between parts."""

import csv
import io
import math
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli import progress
from proximity.cli.options import (
    ALLOW,
    CONTACT,
    FILE_HELP,
    JSON,
    SCENE_FILE,
    Reading,
    argument,
    flag,
    option,
    refuse,
    with_option_groups,
    within,
)
from proximity.cli.output import (
    MISSING,
    NEGLIGIBLE,
    at_most,
    counted,
    in_unit,
    length,
    print_block,
    printable,
    write_document,
)
from proximity.cli.parts.motion import EXIT_NEARER, Moving, measure_gap, measure_motion
from proximity.system.table_text import table_text

if TYPE_CHECKING:
    from proximity.cli.tables import Column
    from proximity.scene.clashes import MeasuredPair

DIGITS = 6
"""Number of significant digits of numbers in the table."""
FEW_DIGITS = 4
"""Number of significant digits of depths, whose bounds differ by a thousandth."""
DISPENSABLE = ("to", "from", "depth", "overlap")
"""Columns that are omitted in this order until the table fits the terminal."""
Values = dict[str, Any]


@with_option_groups
def clearance(
    words: Annotated[
        list[str],
        argument(
            "FILE [PART [PART]]",
            f"{FILE_HELP} Then one part against the others, or two parts; 'bolt*' names several.",
        ),
    ],
    clashes: Annotated[bool, flag("--clashes", "Only pairs that overlap; exit with code 1 if any.")] = False,
    below: Annotated[
        float | None,
        option(
            "DISTANCE",
            "Only pairs nearer than this, or overlapping; exit with code 1 if any.",
            callback=within(0.0),
        ),
    ] = None,
    contact: CONTACT = None,
    ignore_touching: Annotated[
        bool, flag("--ignore-touching", "With --below: leave out pairs that touch.")
    ] = False,
    allow: ALLOW = None,
    cad: Annotated[
        bool, flag("--cad", "Bounds for the CAD surfaces of STEP files; --below holds for these.")
    ] = False,
    list_all: Annotated[bool, flag("--all", "All pairs, not only the nearest 20.")] = False,
    csv_path: Annotated[Path | None, option("FILE", "Write the pairs to a CSV file, too.", "--csv")] = None,
    as_json: JSON = False,
    *,
    moving: Moving,
    reading: Reading,
) -> None:
    """Measure the distances between the parts of FILE: clashes first, then the nearest pair.

    For every two parts: the shortest distance and its two ends; whether the parts touch, cross, or one is
    inside the other; their common volume; deepest, the largest depth of a point of one inside the other;
    and the way out, the shortest displacement that frees the first from the second. One PART is measured
    against all others, two against each other; `proximity check` lists the names. Several files are one
    scene, with parts in their positions.

    A screw overlaps its hole by the approximation of round surfaces by triangles. Pairs whose deepest
    point is within --contact touch: they fit. With --clashes the exit code is 1 if a pair overlaps by more,
    and 0 if none does. With --below it is 1 if a pair is nearer, or overlaps. List intended clashes
    once with --csv, and pass the file to --allow.

    Distances are those of the triangles, which deviate from the curved surfaces of a STEP file. With --cad
    each pair has two bounds, between which the distance of the CAD surfaces is, and --below lists a pair
    unless its lower bound keeps the distance. A pair then clashes only if its deepest point exceeds the
    deviations of both parts: the others may fit.

    With --hinge, --slide or --poses PART moves, and the answer is its smallest distance over the whole
    motion, also between the sampled poses: to all others, or to the second PART. With --below the exit code
    is 0 only if it certainly keeps that distance. --csv writes the curve. --along gives the distance that
    the first PART can move before it touches the second.

    Examples:
      proximity clearance gearbox.step --clashes
      proximity clearance gearbox.step --clashes --cad
      proximity clearance gearbox.step
      proximity clearance gearbox.step shaft
      proximity clearance gearbox.step lid 'screw*' --json
      proximity clearance knob.stl plate.stl
      proximity clearance gearbox.step lid --hinge 0,40,12 1,0,0 0..110 --plot gap.png
      proximity clearance gearbox.step lid --hinge 0,40,12 1,0,0 0..110 --page lid.html
      proximity clearance gearbox.step shaft cover --along z
      proximity clearance gearbox.step --below 0.5 --ignore-touching --allow wanted.csv
    """
    files, names = _files_and_names(words)
    is_gate = clashes or below is not None
    refuse(
        (len(names) > 2, "PART", f"{len(names)} names are given, expected two at most"),
        (len(names) == 2 and list_all, "--all", "two parts are one pair"),
        (clashes and below is not None, "--below", "not allowed with --clashes"),
        (below is None and ignore_touching, "--ignore-touching", "requires --below"),
        (not is_gate and allow is not None, "--allow", "requires --clashes or --below"),
    )
    is_drawn = moving.plot is not None or moving.page is not None
    is_motion = moving.is_given or is_drawn or moving.along is not None
    if is_motion:
        refuse(
            (not moving.is_given and moving.plot, "--plot", "requires --hinge, --slide or --poses"),
            (not moving.is_given and moving.page, "--page", "requires --hinge, --slide or --poses"),
            (moving.page and moving.page.suffix != ".html", "--page", f"{moving.page} does not end in .html"),
            (moving.along and moving.is_given, "--along", "not allowed with another motion"),
            (moving.along and len(names) != 2, "--along", "requires two PARTs"),
            (not names, moving.option_name, "requires the PART that moves"),
            (
                clashes or list_all or ignore_touching or cad,
                moving.option_name,
                "only with --below, --csv or --json",
            ),
        )
    from proximity.cli.parts import measured_pairs
    from proximity.formats import metres_per_unit
    from proximity.scene.clashes import CONTACT as CONTACT_DEPTH
    from proximity.scene.clashes import contact_limit, measure_pairs

    metres, scene = metres_per_unit(reading.units), reading.load(*files)
    if is_motion:
        others = measured_pairs.matching(scene, names[1]) if len(names) == 2 else None
        (part, *more) = measured_pairs.matching(scene, names[0])
        refuse((more, "PART", f"{names[0]!r} names {len(more) + 1} parts, expected one that moves"))
        if moving.along is not None:
            assert others is not None
            refuse((len(others) > 1, "PART", f"{names[1]!r} names several parts, expected one"))
            pair = part, others[0]
            measure_gap(scene, pair, moving.along, units=reading.units, metres=metres, as_json=as_json)
            return
        measure_motion(
            scene, part, others, moving, title=" + ".join(file.name for file in files), below=below,
            units=reading.units, metres=metres, csv_path=csv_path, as_json=as_json,
        )  # fmt: skip
        return
    approximation = 0.0 if scene.report is None else scene.report.approximation
    default = CONTACT_DEPTH if cad else contact_limit(scene)
    limit = default if contact is None else contact * metres
    nearest = 0.0 if below is None else below * metres
    deviations = {part.name: part.deviation for part in scene.parts}
    reach = nearest + (2.0 * max(deviations.values()) if cad and not clashes else 0.0)
    allowed = {} if allow is None else measured_pairs.read_allowed(allow, scene)
    groups, shown = [measured_pairs.matching(scene, name) for name in names], " + ".join(map(str, files))
    with progress.spinner(f"measuring {shown}"):
        found = measured_pairs.find_pairs(scene, groups, reach if is_gate else None, is_whole=list_all)
        pairs = measure_pairs(scene, found, limit, is_cad=cad)
    pairs = measured_pairs.without_allowed(pairs, allowed, allow)
    sentence = measured_pairs.verdict(pairs, limit, approximation, metres, reading.units, is_cad=cad)
    deviation_of = partial(measured_pairs.deviation_of, deviations)
    if is_gate:
        pairs = [
            pair
            for pair in pairs
            if pair.is_clash
            or (not clashes and pair.clearance.distance - (deviation_of(pair) if cad else 0.0) < nearest)
        ]
    if ignore_touching:
        pairs = [pair for pair in pairs if pair.relation != "touching"]
    values = [_values(pair, deviation_of(pair), metres, is_cad=cad) for pair in pairs]
    if csv_path is not None:
        _write_csv(csv_path, values, reading.units)
    if as_json:
        said = {"below": below, "contact": in_unit(limit, metres), "verdict": sentence}
        write_document({"file": shown, "units": reading.units, **said, "pairs": values})
    elif len(pairs) == len(names) - 1 == 1:
        print_block(_lines(values[0], metres, reading.units))
    else:
        _print_table(values if list_all or clashes else values[: measured_pairs.MAX_SHOWN], reading.units)
        if len(scene.parts) == 1:
            typer.echo("There is only one part.")
            return
        if not clashes:
            names = [printable(name) for name in names]
            typer.echo(_summary(values, below, reading.units, names, len(scene.parts), is_whole=list_all))
        if not cad and (difference := _deviation(values, metres, reading.units)):
            typer.echo(difference)
        _print_verdict(sentence, is_clash=any(pair.is_clash for pair in pairs))
    if is_gate and pairs:
        raise typer.Exit(EXIT_NEARER)


def _files_and_names(words: list[str]) -> tuple[list[Path], list[str]]:
    """Split the arguments into files and names of parts.

    The first argument is a file, and so is every other one with a known extension that exists.
    """
    from proximity.formats import EXTENSIONS

    known = (*EXTENSIONS, ".prox", SCENE_FILE)
    files = [word for word in words[1:] if word.lower().endswith(known) and Path(word).is_file()]
    names = [word for word in words[1:] if word not in files]
    return [Path(word) for word in (words[0], *files)], names


def _values(pair: "MeasuredPair", deviation: float, metres: float, *, is_cad: bool) -> Values:
    """Return the values of a pair in the user's unit.

    *deviation*: of the triangles of both parts from the CAD surfaces, m. Infinity becomes None.
    """
    import numpy as np

    from proximity.cli.output import in_units
    from proximity.scene.pairs import widened_bounds

    found, is_known = pair.clearance, deviation < math.inf
    lower, upper = widened_bounds(found.lower, found.distance, deviation)
    bounds = {"lower": in_unit(lower, metres), "upper": in_unit(upper, metres) if is_known else None}
    ends = found.point_on_first[None], found.point_on_second[None]
    return {
        "first": found.first,
        "second": found.second,
        "distance": float(in_units(np.array([found.distance]), metres, *ends)[0]),
        **(bounds if is_cad else {}),
        "deviation": in_unit(deviation, metres) if is_known else None,
        "relation": str(pair.relation),
        "deepest": in_unit(pair.deepest, metres),
        "deepest_lower": in_unit(pair.deepest_lower, metres),
        "overlap": None if pair.volume is None else in_unit(pair.volume, metres**3),
        "depth": in_unit(pair.depth, metres),
        "direction": None if pair.direction is None else pair.direction.tolist(),
        "is_clash": pair.is_clash,
        "from": in_units(ends[0], metres)[0].tolist(),
        "to": in_units(ends[1], metres)[0].tolist(),
    }


def _volume(pair: Values) -> str:
    if pair["overlap"] is None:
        return "unknown: a part is open"
    return length(pair["overlap"], DIGITS) if pair["overlap"] else MISSING


def _deviation(pairs: list[Values], metres: float, units: str) -> str:
    """Return a sentence on the deviation from the CAD surfaces, or an empty text if it is negligible."""
    deviations = [pair["deviation"] for pair in pairs]
    if None in deviations:
        unknown = counted(deviations.count(None), "pair")
        return f"The distance between the CAD surfaces of {unknown} is not known: see proximity check."
    most = max(deviations, default=0.0)
    if most * metres <= NEGLIGIBLE:
        return ""
    return f"Distances between the CAD surfaces differ by at most {at_most(most)} {units}: see --cad."


def _upper(pair: Values) -> str:
    upper = pair.get("upper")
    return "unknown" if upper is None else length(upper, DIGITS)


def _length(pair: Values, name: str) -> str:
    return length(pair[name], FEW_DIGITS) if pair[name] else MISSING


def _point(position: list[float]) -> str:
    return "  ".join(length(coordinate, DIGITS) for coordinate in position)


def _lines(pair: Values, metres: float, units: str) -> Iterator[tuple[str, str]]:
    """Yield the labels and values that describe one pair."""
    yield "distance", f"{length(pair['distance'])} {units}, {pair['relation']}"
    if "lower" in pair:
        yield "CAD surfaces", f"{length(pair['lower'])} to {_upper(pair)} {units}"
    elif said := _deviation([pair], metres, units):
        yield "note", said
    for end, part in (("from", "first"), ("to", "second")):
        yield end, f"{_point(pair[end])} {units} ({pair[part]})"
    if pair["overlap"] != 0.0:
        yield "overlap", _volume(pair) + (f" {units}\N{SUPERSCRIPT THREE}" if pair["overlap"] else "")
    if pair["deepest"]:
        yield "deepest", f"{_length(pair, 'deepest')} {units}: no point of one is farther inside the other"
    if pair["direction"] is not None:
        along = "  ".join(f"{part + 0.0:.4g}" for part in (round(each, 4) for each in pair["direction"]))
        yield "way out", f"{_length(pair, 'depth')} {units} along {along}: then {pair['first']} is free"


def _print_table(pairs: list[Values], units: str) -> None:
    from proximity.cli.tables import print_fitting, results_console

    if not pairs:
        return
    console, styles = results_console(), ["red" if pair["is_clash"] else "" for pair in pairs]
    columns = _columns(pairs, units, console.width // 4 + 2)
    print_fitting(console, columns, DISPENSABLE, "a wider one, a pipe or --json", styles=styles)


def _columns(pairs: list[Values], units: str, width: int) -> "list[Column]":
    """Return the columns of the table of pairs.

    Names longer than *width* letters take several lines.
    """
    from proximity.cli.tables import Column

    cube, deep = f"{units}\N{SUPERSCRIPT THREE}", any(pair["deepest"] for pair in pairs)
    columns = [
        Column("first", "first", False, [in_lines(printable(pair["first"]), width) for pair in pairs]),
        Column("second", "second", False, [in_lines(printable(pair["second"]), width) for pair in pairs]),
        Column("distance", f"distance [{units}]", True, [length(pair["distance"], DIGITS) for pair in pairs]),
        Column(
            "lower", f"at least [{units}]", True, [length(pair.get("lower", 0.0), DIGITS) for pair in pairs]
        ),
        Column("upper", f"at most [{units}]", True, [_upper(pair) for pair in pairs]),
        Column("relation", "relation", False, [pair["relation"] for pair in pairs]),
        Column("deepest", f"deepest [{units}]", True, [_length(pair, "deepest") for pair in pairs]),
        Column("overlap", f"overlap [{cube}]", True, list(map(_volume, pairs))),
        Column("depth", f"way out [{units}]", True, [_length(pair, "depth") for pair in pairs]),
        Column("from", f"from [{units}]", True, [_point(pair["from"]) for pair in pairs]),
        Column("to", f"to [{units}]", True, [_point(pair["to"]) for pair in pairs]),
    ]
    left_out = set() if deep else {"deepest", "depth"}
    left_out |= {"distance"} if any("lower" in pair for pair in pairs) else {"lower", "upper"}
    if not any(pair["distance"] for pair in pairs):
        left_out.add("distance")
    return [column for column in columns if column.name not in left_out]


def in_lines(name: str, width: int) -> str:
    """Split a name into lines of up to *width* letters, after assemblies or else after separators."""
    lines = [""]
    for word in re.findall(r"[^/]+/?" if "/" in name else r"[^-_. ]*[-_. ]?", name):
        if lines[-1] and len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] += word
    return "\n".join(lines)


def _summary(
    pairs: list[Values], below: float | None, units: str, names: list[str], part_count: int, *, is_whole: bool
) -> str:
    """Return a sentence about the listed pairs."""
    from proximity.cli.parts.measured_pairs import MAX_SHOWN

    count = part_count - 1 if names else part_count * (part_count - 1) // 2
    hidden = 0 if is_whole else max(len(pairs) - MAX_SHOWN, 0)
    if below is not None:
        of = f"{printable(names[0])} and another part" if len(names) == 1 else "parts"
        near, may_be = f"nearer than {length(below)} {units}", any("lower" in pair for pair in pairs)
        if not pairs:
            return f"No pair of {' and '.join(map(printable, names)) if len(names) == 2 else of} is {near}."
        shown = f"; these are the first {MAX_SHOWN}, --all lists all" if hidden else ""
        be = "may be" if may_be else "is" if len(pairs) == 1 else "are"
        return f"{counted(len(pairs), 'pair')} of {count} {be} {near}{shown}."
    meeting = sum(pair["relation"] != "apart" for pair in pairs)
    if hidden or len(pairs) < count:
        listed = f"These are the nearest {len(pairs) - hidden} of {counted(count, 'pair')}; "
        touching = "all of them" if meeting >= len(pairs) else f"{meeting} of them"
        return f"{listed}{touching} touch or overlap; --all lists all."
    return f"{counted(len(pairs), 'pair')}; {meeting} of them touch or overlap."


def _print_verdict(sentence: str, *, is_clash: bool) -> None:
    """Print the verdict, in colour on a terminal."""
    from rich.text import Text

    from proximity.cli.tables import results_console

    results_console().print(Text(sentence, style="bold red" if is_clash else "bold green"))


def _write_csv(path: Path, pairs: list[Values], units: str) -> None:
    """Write a CSV file with a line for each pair. Names of columns with lengths end in the unit."""
    from proximity.system.whole_file import whole_file

    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    ends = [f"{end}_{axis}_{units}" for end in ("from", "to") for axis in "xyz"]
    ends += [f"depth_{units}", *(f"direction_{axis}" for axis in "xyz"), f"deepest_{units}"]
    bounds = ("lower", "upper") if pairs and "lower" in pairs[0] else ()
    ends += [f"{bound}_{units}" for bound in bounds]
    writer.writerow(["first", "second", f"distance_{units}", "relation", f"overlap_{units}3", *ends])
    for pair in pairs:
        volume = "" if pair["overlap"] is None else pair["overlap"]
        named = table_text(pair["first"]), table_text(pair["second"])
        depth = [pair["depth"], *(pair["direction"] or [""] * 3), pair["deepest"]]
        points = *pair["from"], *pair["to"]
        limits = [pair[bound] for bound in bounds]
        writer.writerow([*named, pair["distance"], pair["relation"], volume, *points, *depth, *limits])
    with whole_file(path) as stream:
        stream.write(text.getvalue().encode())
