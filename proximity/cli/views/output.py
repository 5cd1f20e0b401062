"""Answers for programs: JSON and CSV, streamed.

Numbers are written so that reading them gives the same float64. JSON has no word for nan and infinity: null.
CSV writes them ``nan`` and ``inf``, as NumPy and pandas read them; a field that holds nothing is empty. Names
of columns that hold lengths end in their unit; in JSON the head says it once.
"""

import csv
import json
import math
from collections.abc import Iterable
from typing import Any, TextIO

from proximity.errors import ProximityError

AXES = "xyz"
VECTORS = {  # fields of three numbers, and how their columns end
    "query": AXES,
    "origin": AXES,
    "direction": AXES,
    "start": AXES,
    "end": AXES,
    "point": AXES,
    "gradient": AXES,
    "normal": AXES,
    "point_on_segment": AXES,
    "point_on_solid": AXES,
    "barycentric": "012",
}
LENGTHS = {
    "query", "origin", "start", "end", "signed_distance", "distance", "point", "point_on_segment",
    "point_on_solid",
}  # fmt: skip


def write_json(stream: TextIO, head: dict[str, Any], chunks: Iterable[dict[str, list[Any]]]) -> None:
    """Write one JSON document: the fields of *head*, then ``answers``, one a line.

    Where *chunks* end in an error behind some answers, these are written, and its sentence as ``error``: the
    document is complete. An error before any answer leaves nothing written.

    Parameters
    ----------
    stream : text file
        Where to write.
    head : dict
        What holds for all answers.
    chunks : iterable of dict
        Answers, field by field.
    """
    opening = json.dumps(plain(head), allow_nan=False)[:-1] + ', "answers": ['
    separator = "\n"
    try:
        for chunk in chunks:
            stream.write(opening)
            opening = ""
            for values in zip(*chunk.values(), strict=True):
                answer = plain(dict(zip(chunk, values, strict=True)))
                stream.write(separator + json.dumps(answer, allow_nan=False))
                separator = ",\n"
            stream.flush()
    except ProximityError as error:
        if not opening:
            stream.write(f'\n], "error": {json.dumps(str(error))}}}\n')
        raise
    stream.write("\n]}\n")


def write_csv(stream: TextIO, units: str, chunks: Iterable[dict[str, list[Any]]]) -> None:
    """Write a header and a line an answer; three numbers take three columns.

    Parameters
    ----------
    stream : text file
        Where to write.
    units : str
        What lengths are in.
    chunks : iterable of dict
        Answers, field by field; at least one chunk, which may be empty.
    """
    writer = csv.writer(stream, lineterminator="\n")
    has_header = False
    for chunk in chunks:
        if not has_header:
            writer.writerow(name for field in chunk for name in _column_names(field, units))
            has_header = True
        columns = [column for field, values in chunk.items() for column in _columns(field, values)]
        writer.writerows(zip(*columns, strict=True))
        stream.flush()


def plain(value: Any) -> Any:
    """Return *value* with None for every float that JSON has no word for.

    Parameters
    ----------
    value : number, str, None, or a list or dict of such
        What is to be written.
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value


def _column_names(field: str, units: str) -> list[str]:
    ending = f"_{units}" if field in LENGTHS else ""
    if field == "query":  # plain x, y, z: what is written can be read again as points
        return [f"{axis}{ending}" for axis in AXES]
    axes = [f"_{axis}" for axis in VECTORS.get(field, ())] or [""]
    return [f"{field}{axis}{ending}" for axis in axes]


def _columns(field: str, values: list[Any]) -> list[list[Any]]:
    if field not in VECTORS:
        return [values]
    return [[vector[axis] for vector in values] for axis in range(3)]
