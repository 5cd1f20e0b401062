"""Answers for programs: JSON and CSV, streamed, every number exact.

Numbers are written so that reading them gives the same float64. JSON has no word for nan and infinity: null.
CSV writes them ``nan`` and ``inf``, as NumPy and pandas read them; a field that holds nothing is empty.
"""

import csv
import json
import math
from collections.abc import Iterable
from typing import Any, TextIO

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


def write_json(stream: TextIO, head: dict[str, Any], chunks: Iterable[dict[str, list[Any]]]) -> None:
    """Write one JSON document: the fields of *head*, then ``answers``, one a line.

    Parameters
    ----------
    stream : text file
        Where to write.
    head : dict
        What holds for all answers.
    chunks : iterable of dict
        Answers, field by field.
    """
    opening = json.dumps(plain(head), allow_nan=False)
    stream.write(opening[:-1] + ', "answers": [')
    separator = "\n"
    for chunk in chunks:
        for values in zip(*chunk.values(), strict=True):
            answer = plain(dict(zip(chunk, values, strict=True)))
            stream.write(separator + json.dumps(answer, allow_nan=False))
            separator = ",\n"
    stream.write("\n]}\n")


def write_csv(stream: TextIO, chunks: Iterable[dict[str, list[Any]]]) -> None:
    """Write a header and a line an answer; three numbers take three columns.

    Parameters
    ----------
    stream : text file
        Where to write.
    chunks : iterable of dict
        Answers, field by field; at least one chunk, which may be empty.
    """
    writer = csv.writer(stream, lineterminator="\n")
    has_header = False
    for chunk in chunks:
        if not has_header:
            writer.writerow(name for field in chunk for name in _column_names(field))
            has_header = True
        columns = [column for field, values in chunk.items() for column in _columns(field, values)]
        writer.writerows(zip(*columns, strict=True))


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


def _column_names(field: str) -> list[str]:
    if field == "query":  # plain x, y, z: what is written can be read again as points
        return list(AXES)
    return [f"{field}_{axis}" for axis in VECTORS[field]] if field in VECTORS else [field]


def _columns(field: str, values: list[Any]) -> list[list[Any]]:
    if field not in VECTORS:
        return [values]
    return [[vector[axis] for vector in values] for axis in range(3)]
