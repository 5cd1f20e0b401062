"""``proximity clearance``: how far the parts of a file are apart, and which touch or overlap."""

import csv
import io
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli import progress
from proximity.cli.options import (
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
from proximity.cli.output import MISSING, counted, in_unit, length, print_block, printable, write_document
from proximity.system.table_text import table_text

if TYPE_CHECKING:
    import proximity
    from proximity.cli.tables import Column

EXIT_NEARER = 1
PAIRS_SHOWN = 20
DIGITS = 6
"""Significant, of numbers in the table."""
CONTACT_M = 1e-8
"""Gaps and depths up to this count as contact: what STEP's import rounds parts of a metre by."""
DISPENSABLE = ("to", "from", "overlap")
"""Columns to leave out, in this order, until the table is as narrow as the terminal."""
Values = dict[str, Any]


@with_option_groups
def clearance(
    words: Annotated[
        list[str],
        argument("FILE [PART [PART]]", f"{FILE_HELP} Then one part against the others, or two parts."),
    ],
    below: Annotated[
        float | None,
        option("DISTANCE", "Only pairs nearer than this; the exit code tells.", callback=within(0.0)),
    ] = None,
    contact: Annotated[
        float | None,
        option(
            "LENGTH", "Gaps and depths up to this are touching; 1e-5 mm if not given.", callback=within(0.0)
        ),
    ] = None,
    ignore_touching: Annotated[
        bool,
        flag("--ignore-touching", "With --below: leave out pairs that touch without a common volume."),
    ] = False,
    allow: Annotated[
        Path | None,
        option("FILE", "With --below: leave out the pairs of this CSV file, as --csv writes it."),
    ] = None,
    list_all: Annotated[bool, flag("--all", "All pairs, not only the nearest 20.")] = False,
    csv_path: Annotated[Path | None, option("FILE", "Write the pairs to a CSV file, too.", "--csv")] = None,
    as_json: JSON = False,
    *,
    reading: Reading,
) -> None:
    """Measure how far the parts of FILE are apart, the nearest pair first.

    For every two parts: the shortest distance, its two ends, whether the parts touch, cross, or one is
    inside the other, the volume that both of them fill, and the depth: how far the first must move to be
    free of the second (--csv and --json have the direction, too). One PART is measured against all
    others, two against each other; `proximity check` lists the names. Several files are one scene, with
    parts where they are in their files; a word behind the first that is the name of a file of parts is
    such a file.

    Distances are exact to the triangles. In a STEP file, parts that touch may be 1e-6 mm apart or cross by as
    much: up to --contact they count as touching.

    With --below the exit code is 1 if a pair is nearer than that, and 0 if none is. Pairs that are meant to
    be near are left out with --ignore-touching, or listed once with --csv and named with --allow.

    Examples:
      proximity clearance gearbox.step
      proximity clearance gearbox.step shaft
      proximity clearance gearbox.step lid base --json
      proximity clearance knob.stl plate.stl
      proximity clearance gearbox.step --below 0.5 --csv too_near.csv
      proximity clearance gearbox.step --below 0.5 --ignore-touching --allow wanted.csv
    """
    files, names = _files_and_names(words)
    refuse(
        (len(names) > 2, "PART", f"{len(names)} names are given, expected two at most"),
        (len(names) == 2 and list_all, "--all", "two parts are one pair"),
        (below is None and ignore_touching, "--ignore-touching", "requires --below"),
        (below is None and allow is not None, "--allow", "requires --below"),
    )
    from proximity.formats import metres_per_unit

    metres, scene = metres_per_unit(reading.units), reading.load(*files)
    file, allowed = " + ".join(map(str, files)), set() if allow is None else _allowed(allow)
    limit = CONTACT_M if contact is None else contact * metres
    with progress.spinner(f"measuring {file}"):
        found = _pairs(scene, names, None if below is None else below * metres, is_whole=list_all)
        pairs = [
            _values(scene, pair, metres, limit)
            for pair in found
            if frozenset(map(table_text, pair[:2])) not in allowed
        ]
    if ignore_touching:
        pairs = [pair for pair in pairs if pair["relation"] != "touching" or pair["overlap"]]
    if csv_path is not None:
        _write_csv(csv_path, pairs, reading.units)
    if as_json:
        write_document({"file": file, "units": reading.units, "below": below, "pairs": pairs})
    elif len(names) == 2 and pairs:
        print_block(_lines(pairs[0], reading.units))
    else:
        _print_table(pairs if list_all else pairs[:PAIRS_SHOWN], reading.units)
        typer.echo(_summary(pairs, below, reading.units, names, len(scene.parts), is_whole=list_all))
    if below is not None and pairs:
        raise typer.Exit(EXIT_NEARER)


def _files_and_names(words: list[str]) -> tuple[list[Path], list[str]]:
    """The files, which are the first word and those that are the name of one, and the names of parts."""
    from proximity.formats import EXTENSIONS

    known = (*EXTENSIONS, ".prox", SCENE_FILE)
    files = [word for word in words[1:] if word.lower().endswith(known) and Path(word).is_file()]
    names = [word for word in words[1:] if word not in files]
    return [Path(word) for word in (words[0], *files)], names


def _allowed(path: Path) -> set[frozenset[str]]:
    """Pairs of a CSV file with the columns first and second, by names as `table_text` writes them."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            rows = list(csv.DictReader(stream))
            return {frozenset((table_text(row["first"]), table_text(row["second"]))) for row in rows}
    except OSError as failure:
        reason = f"{path}: cannot be read ({failure.strerror or failure})"
    except (KeyError, TypeError, UnicodeDecodeError, csv.Error):
        reason = f"{path}: expected CSV with the columns first and second"
    raise typer.BadParameter(reason, param_hint="--allow")


def _pairs(
    scene: "proximity.Scene", names: list[str], below: float | None, *, is_whole: bool
) -> list["proximity.Clearance"]:
    """The pairs that are asked for; *below*: m."""
    if len(names) == 2:
        found = [scene.clearance(*names)]
    else:
        most = None if is_whole or below is not None else PAIRS_SHOWN
        limit = {} if below is None else {"max_distance": below}
        found = scene.closest_pairs(most=most, of=names[0] if names else None, **limit)
    return [pair for pair in found if below is None or pair.distance < below]


def _values(scene: "proximity.Scene", pair: "proximity.Clearance", metres: float, contact: float) -> Values:
    """What is said about a pair, in the user's unit; *contact*: m, up to which it touches."""
    import numpy as np

    import proximity
    from proximity.cli.output import in_units

    ends = pair.point_on_first[None], pair.point_on_second[None]
    deep = None if pair.distance > 0.0 else scene.penetration(pair.first, pair.second)
    is_contact = pair.distance + (0.0 if deep is None else deep.depth) <= contact
    return {
        "first": pair.first,
        "second": pair.second,
        "distance": float(in_units(np.array([pair.distance]), metres, *ends)[0]),
        "relation": str(proximity.Relation.TOUCHING if is_contact else pair.relation),
        "overlap": _overlap(scene, pair, metres),
        "depth": 0.0 if deep is None else in_unit(deep.depth, metres),
        "direction": deep.direction.tolist() if deep is not None and not is_contact else None,
        "from": in_units(ends[0], metres)[0].tolist(),
        "to": in_units(ends[1], metres)[0].tolist(),
    }


def _overlap(scene: "proximity.Scene", pair: "proximity.Clearance", metres: float) -> float | None:
    """The volume that two parts have in common; None where a part is open."""
    from proximity.errors import MeshError
    from proximity.scene.overlap import overlap

    if pair.distance > 0.0:
        return 0.0
    try:
        common = overlap(scene, pair.first, pair.second)
    except MeshError:
        return None
    return 0.0 if common is None else in_unit(common.volume, metres**3)


def _volume(pair: Values) -> str:
    if pair["overlap"] is None:
        return "unknown: a part is open"
    return length(pair["overlap"], DIGITS) if pair["overlap"] else MISSING


def _depth(pair: Values) -> str:
    return MISSING if pair["direction"] is None else length(pair["depth"], DIGITS)


def _point(position: list[float]) -> str:
    return "  ".join(length(coordinate, DIGITS) for coordinate in position)


def _lines(pair: Values, units: str) -> Iterator[tuple[str, str]]:
    """Labels and values of one pair."""
    yield "distance", f"{length(pair['distance'])} {units}, {pair['relation']}"
    for end, part in (("from", "first"), ("to", "second")):
        yield end, f"{_point(pair[end])} {units} ({pair[part]})"
    if pair["overlap"] != 0.0:
        yield "overlap", _volume(pair) + (f" {units}\N{SUPERSCRIPT THREE}" if pair["overlap"] else "")
    if (depth := _depth(pair)) != MISSING:
        along = "  ".join(f"{part + 0.0:.4g}" for part in (round(each, 4) for each in pair["direction"]))
        yield "depth", f"{depth} {units}: moved by it along {along}, {pair['first']} is free"


def _print_table(pairs: list[Values], units: str) -> None:
    from proximity.cli.tables import Column, print_fitting, results_console

    if not pairs:
        return
    columns = [
        Column("first", "first", False, [printable(pair["first"]) for pair in pairs]),
        Column("second", "second", False, [printable(pair["second"]) for pair in pairs]),
        Column("distance", f"distance [{units}]", True, [length(pair["distance"], DIGITS) for pair in pairs]),
        Column("relation", "relation", False, [pair["relation"] for pair in pairs]),
        Column("overlap", f"overlap [{units}\N{SUPERSCRIPT THREE}]", True, list(map(_volume, pairs))),
        *_depth_column(pairs, units),
        Column("from", f"from [{units}]", True, [_point(pair["from"]) for pair in pairs]),
        Column("to", f"to [{units}]", True, [_point(pair["to"]) for pair in pairs]),
    ]
    print_fitting(results_console(), columns, DISPENSABLE, "a wider one, a pipe or --json")


def _depth_column(pairs: list[Values], units: str) -> "Iterator[Column]":
    """The column of depths, where one pair overlaps."""
    from proximity.cli.tables import Column

    depths = list(map(_depth, pairs))
    if {*depths} != {MISSING}:
        yield Column("depth", f"depth [{units}]", True, depths)


def _summary(
    pairs: list[Values], below: float | None, units: str, names: list[str], part_count: int, *, is_whole: bool
) -> str:
    """One sentence about what was found."""
    of = "parts" if not names else f"{printable(names[0])} and another part"
    if len(names) == 2:
        of = " and ".join(map(printable, names))
    count = part_count - 1 if names else part_count * (part_count - 1) // 2
    if count == 0:
        return "There is only one part, and no other to compare it with."
    if below is not None:
        near = f"nearer than {length(below)} {units}"
        if not pairs:
            return f"No pair of {of} is {near}." if len(names) < 2 else f"{of} are not {near}."
        hidden = len(pairs) - PAIRS_SHOWN
        shown = f"; these are the first {PAIRS_SHOWN}, --all lists all" if hidden > 0 and not is_whole else ""
        return f"{counted(len(pairs), 'pair')} of {count} {'is' if len(pairs) == 1 else 'are'} {near}{shown}."
    meeting = sum(pair["relation"] != "apart" for pair in pairs)
    if len(pairs) < count:
        least = "all of them" if meeting == len(pairs) else f"{meeting} of them"
        return (
            f"These are the nearest {len(pairs)} of {counted(count, 'pair')}; {least} touch or overlap; "
            "--all lists all."
        )
    return f"{counted(count, 'pair')}; {meeting} of them touch or overlap."


def _write_csv(path: Path, pairs: list[Values], units: str) -> None:
    """Write a line a pair; columns of lengths end in their unit."""
    from proximity.system.whole_file import whole_file

    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    ends = [f"{end}_{axis}_{units}" for end in ("from", "to") for axis in "xyz"]
    ends += [f"depth_{units}", *(f"direction_{axis}" for axis in "xyz")]
    writer.writerow(["first", "second", f"distance_{units}", "relation", f"overlap_{units}3", *ends])
    for pair in pairs:
        volume = "" if pair["overlap"] is None else pair["overlap"]
        named = table_text(pair["first"]), table_text(pair["second"])
        depth = [pair["depth"], *(pair["direction"] or [""] * 3)]
        points = *pair["from"], *pair["to"]
        writer.writerow([*named, pair["distance"], pair["relation"], volume, *points, *depth])
    with whole_file(path) as stream:
        stream.write(text.getvalue().encode())
