"""Records of a STEP file by their numbers, with parsed arguments.

Records are parsed when they are read. Strings are not kept, since no geometry depends on them.
"""

import re
from functools import cached_property
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.step.step_records import StepText

Arguments = list[Any]
"""Nested list of arguments: floats, references and enumerations as text, and None for a string, $ or *."""

_RECORD = re.compile(r"#(\d++)\s*+=\s*+([^;]*+)")
_TOKEN = re.compile(r"#\d+|[-+]?\d+\.?\d*(?:[Ee][-+]?\d+)?|\.\w+\.|\w+|[(),$*]")
_FLOAT = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[Ee][-+]?\d+)?")


class Entities:
    """Records of a file by number."""

    def __init__(self, text: StepText) -> None:
        self._text = text
        self._points: dict[str, np.ndarray] = {}

    @cached_property
    def _starts(self) -> dict[int, int]:
        return {int(match[1]): match.start(2) for match in _RECORD.finditer(self._text.blank)}

    def text(self, number: Any) -> str:
        """Return the record with a number such as "#12", without the number."""
        start = self._starts.get(int(number[1:])) if isinstance(number, str) and number[:1] == "#" else None
        if start is None:
            raise MeshFormatError(f"there is no record {number}")
        return self._text.blank[start : self._text.blank.find(";", start)]

    def kind(self, number: Any) -> str:
        """Return the name of a record, or "" for a complex one."""
        return self.text(number).partition("(")[0].strip()

    def record(self, number: Any) -> dict[str, Arguments]:
        """Return the arguments of a record by its name, or by the names of all parts of a complex one."""
        return parsed(self.text(number))

    def arguments(self, number: Any, *kinds: str) -> Arguments:
        """Return the arguments of a record of one of the *kinds*."""
        kind = self.kind(number)
        if kind not in kinds:
            raise MeshFormatError(f"record {number} is {kind or 'complex'}, expected {' or '.join(kinds)}")
        return self.record(number)[kind]

    def vector(self, number: Any) -> np.ndarray:
        """Return the three numbers of a CARTESIAN_POINT or a DIRECTION."""
        if number not in self._points:
            values = np.array(_FLOAT.findall(self.text(number).partition("(")[2]), np.float64)
            if values.shape != (3,):
                raise MeshFormatError(f"record {number} has {len(values)} coordinates, expected 3")
            self._points[number] = values
        return self._points[number]


def parsed(text: str) -> dict[str, Arguments]:
    """Parse a record. Return its arguments by name; a complex record has several names.

    Typed arguments, such as LENGTH_MEASURE(25.4), are returned by their names, too.
    """
    found: dict[str, Arguments] = {}
    stack: list[Arguments] = [[]]
    word, is_open = "", True  # whether an argument is missing at the next comma
    for token in _TOKEN.findall(text):
        if token == "(":
            stack.append([])
            if word:
                found.setdefault(word, stack[-1])
            is_open, word = True, ""
        elif token in ",)":
            if is_open and (token == "," or stack[-1]):
                stack[-1].append(None)
            is_open = token == ","
            if token == ")":
                if len(stack) < 2:
                    raise MeshFormatError("a record has a closing bracket without an opening one")
                closed = stack.pop()
                stack[-1].append(closed)
        elif token[0].isalpha() or token[0] == "_":
            word = token
        else:
            is_open = False
            is_number = token[0] in "+-0123456789"
            stack[-1].append(float(token) if is_number else None if token in "$*" else token)
    return found
