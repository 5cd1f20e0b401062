"""One answer for people: labelled lines."""

import math
from collections.abc import Iterable
from typing import Any

from rich.console import Console
from rich.text import Text

from proximity.cli.views.wording import MISSING, number, printable, side

Lines = list[tuple[str, str]]


def print_block(console: Console, lines: Iterable[tuple[str, str]]) -> None:
    """Print labels and values, one pair a line.

    Parameters
    ----------
    console : Console
        Where to print.
    lines : iterable of (label, value)
        What to print.
    """
    for label, value in lines:
        console.print(Text.assemble((f"{label:<15} ", "bold"), printable(value)), soft_wrap=True)


def closest_block(answer: dict[str, Any], units: str, sign: str) -> Lines:
    """Return the lines that tell one closest point.

    Parameters
    ----------
    answer : dict
        The fields of one answer.
    units : str
        What lengths are in.
    sign : str
        How the sign is known.
    """
    where = side(answer["signed_distance"], answer["is_signed"])
    if where is None:
        is_finite = all(map(math.isfinite, answer["query"]))
        return _nothing(f"nan ({TOO_FAR if is_finite else 'the point is not finite'})")
    words = {"surface": "on the surface", "unknown": "which side is unknown"}
    return [
        ("signed distance", f"{number(answer['signed_distance'])} {units}, {words.get(where, where)}"),
        ("closest point", f"{_numbers(answer['point'])} {units}"),
        ("normal", _numbers(answer["gradient"])),
        ("part", str(answer["part_name"])),
        ("face", f"{answer['face']} of the file"),
        ("on", {"face": "a face", "edge": "an edge", "vertex": "a corner"}.get(answer["feature"], MISSING)),
        ("sign", sign),
    ]


def ray_block(answer: dict[str, Any], units: str, sign: str) -> Lines:
    """Return the lines that tell what one ray hits.

    Parameters
    ----------
    answer : dict
        The fields of one answer.
    units : str
        What lengths are in.
    sign : str
        Not reported: a ray needs none.
    """
    del sign
    if answer["face"] is None:
        return _nothing(_why_nothing(answer, "origin", "direction", "nothing in that direction"))
    return [
        ("distance", f"{number(answer['distance'])} {units}"),
        ("point", f"{_numbers(answer['point'])} {units}"),
        ("normal", _numbers(answer["normal"])),
        ("part", str(answer["part_name"])),
        ("face", f"{answer['face']} of the file"),
    ]


def segment_block(answer: dict[str, Any], units: str, sign: str) -> Lines:
    """Return the lines that tell how far one segment is.

    Parameters
    ----------
    answer : dict
        The fields of one answer.
    units : str
        What lengths are in.
    sign : str
        Not reported: the distance of a segment has none.
    """
    del sign
    if answer["face"] is None:
        return _nothing(_why_nothing(answer, "start", "end", "nothing"))
    touch = ", touches the surface" if answer["distance"] == 0.0 else ""
    return [
        ("distance", f"{number(answer['distance'])} {units}{touch}"),
        ("on segment", f"{_numbers(answer['point_on_segment'])} {units}"),
        ("on solid", f"{_numbers(answer['point_on_solid'])} {units}"),
        ("fraction", f"{number(answer['fraction'])} of the way"),
        ("part", str(answer["part_name"])),
        ("face", f"{answer['face']} of the file"),
    ]


TOO_FAR = "too far off to be computed"
NAMES = ("name", "start_name", "end_name")
BLOCKS = {"closest": closest_block, "ray": ray_block, "segment": segment_block}


def block(mode: str, answer: dict[str, Any], units: str, sign: str) -> Lines:
    """Return the lines that tell one answer, with the names of its points where they have some.

    Parameters
    ----------
    mode : str
        A key of `BLOCKS`.
    answer : dict
        The fields of one answer.
    units : str
        What lengths are in.
    sign : str
        How the sign is known.
    """
    named = [(name.replace("_", " "), answer[name]) for name in NAMES if name in answer]
    return [*named, *BLOCKS[mode](answer, units, sign)]


def _numbers(vector: list[float]) -> str:
    return "  ".join(number(value) for value in vector)


def _nothing(why: str) -> Lines:
    return [("distance", why)]


def _why_nothing(answer: dict[str, Any], first: str, second: str, otherwise: str) -> str:
    is_finite = all(math.isfinite(value) for value in (*answer[first], *answer[second]))
    if math.isnan(answer["distance"]):
        otherwise = TOO_FAR
    return f"{number(answer['distance'])} ({otherwise if is_finite else 'the numbers given are not finite'})"
