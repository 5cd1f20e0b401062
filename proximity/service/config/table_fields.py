"""Table of a scene file, whose values are checked for type and range.

Errors are collected, and reading continues with a valid value, so that the first error reported is the first
in the file.
"""

import difflib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from proximity.checks import as_number, is_whole
from proximity.service.config.toml_document import Document, Path, spelled

REQUIRED: Any = object()
"""Marks a key without a default."""
MAX_SHOWN = 60  # characters
MAX_SHOWN = 10**20


@dataclass(frozen=True, slots=True)
class Range:
    """Range of accepted numbers, and their unit."""

    unit: str
    lowest: float = -math.inf
    highest: float = math.inf
    is_above: bool = False  # the lower bound is excluded

    def holds(self, value: float) -> bool:
        """Return whether a number is within the range. Nan and infinities are never within it."""
        is_high = value > self.lowest if self.is_above else value >= self.lowest
        return is_high and value <= self.highest and math.isfinite(value)

    def __str__(self) -> str:
        return f"{self._bounds()} ({self.unit})" if self.unit else self._bounds()

    def _bounds(self) -> str:
        if self.highest < math.inf:
            return f"{'above ' if self.is_above else 'from '}{self.lowest:g} to {self.highest:g}"
        if self.lowest > -math.inf:
            return f"above {self.lowest:g}" if self.is_above else f"of {self.lowest:g} or more"
        return "that is finite"


class Table:
    """A table of a document, and the keys that it may contain.

    *path*: path of the table in the document. *content*: value at that path; an empty dict if the table is
    missing. An error is collected for a value that is not a table.
    """

    def __init__(self, document: Document, path: Path, content: Any, known: Sequence[str]) -> None:
        self._document, self._path = document, path
        self._content: dict[str, Any] = content if isinstance(content, dict) else {}
        self._meant: set[str] = set()  # keys whose misspelling was probably found
        if not isinstance(content, dict):
            header = f"[[{spelled(path[:-1])}]]" if isinstance(path[-1], int) else f"[{spelled(path)}]"
            document.complain(path, f"{spelled(path)} is {shown(content)}, expected a table: {header}")
        for key in self._content:
            if key not in known:
                self._refuse(key, known)

    def has(self, key: str) -> bool:
        """Return whether a key is present, even if its value is invalid."""
        return key in self._content

    def value(self, key: str) -> Any:
        """Return the raw TOML value of a key, or None if the key is missing."""
        return self._content.get(key)

    @property
    def folder(self) -> str:
        """Folder to which the paths in the table are relative."""
        return self._document.folder

    def complain(self, key: str, sentence: str) -> None:
        """Collect an error about a key. The message is the key followed by *sentence*."""
        path = (*self._path, key)
        self._document.complain(path, f"{spelled(path)} {sentence}")

    def text(self, key: str, default: Any = REQUIRED, *, meaning: str) -> Any:
        """Read a non-empty text. Error messages name *meaning* as the expected value."""
        return self._value(key, default, f"{meaning}, as text in quotes", _as_text)

    def truth(self, key: str, default: bool) -> bool:
        """Read true or false."""
        return bool(self._value(key, default, "true or false", _as_truth))

    def number(self, key: str, default: Any, accepted: Range) -> Any:
        """Read a number within a range."""
        return self._value(key, default, f"a number {accepted}", lambda value: _as_number(value, accepted))

    def whole(self, key: str, default: Any, accepted: Range) -> Any:
        """Read a whole number within a range."""
        expected = f"a whole number {accepted}"
        return self._value(key, default, expected, lambda value: _as_whole(value, accepted))

    def one_of(self, key: str, default: Any, words: Sequence[str]) -> Any:
        """Read a text that must be one of the given words."""
        expected = " or ".join(f'"{word}"' for word in words)
        return self._value(key, default, expected, lambda value: value if value in words else None)

    def texts(self, key: str, default: Any, *, meaning: str) -> Any:
        """Read one text or a list of texts. Return an empty tuple if a required value is missing."""
        found = self._value(key, default, f"{meaning}, as text in quotes, or a list of texts", _as_texts)
        return () if found is REQUIRED else found

    def numbers(self, key: str, default: Any, count: int | None, accepted: Range) -> Any:
        """Read a list of *count* numbers within a range. A *count* of None allows any length above zero."""
        value = self._content.get(key)
        if isinstance(value, list):
            if len(value) != (count or len(value)) or not value:
                numbers = "1 number" if len(value) == 1 else f"{len(value)} numbers"
                self.complain(key, f"has {numbers}, expected {count or 'some'} ({accepted.unit})")
                return default
            for index, item in enumerate(value):
                if _as_number(item, accepted) is None:
                    self.complain(key, f"has {shown(item)} at index {index}, expected a number {accepted}")
                    return default
        expected = f"{count} numbers ({accepted.unit}) in brackets"
        return self._value(key, default, expected, _as_numbers)

    def number_or_numbers(self, key: str, default: Any, count: int | None, accepted: Range) -> Any:
        """Read one number within a range, or a list of *count* such numbers."""
        is_listed = isinstance(self._content.get(key), list)
        return (
            self.numbers(key, default, count, accepted) if is_listed else self.number(key, default, accepted)
        )

    def _value(self, key: str, default: Any, expected: str, read: Callable[[Any], Any]) -> Any:
        """Return the converted value of a key.

        If the key is missing or its value is invalid, return the default.
        """
        if key not in self._content:
            if default is REQUIRED and key not in self._meant:
                path = (*self._path, key)
                self._document.complain(self._path, f"{spelled(path)} is missing, expected {expected}")
            return default
        value = read(self._content[key])
        if value is None:
            self.complain(key, f"is {shown(self._content[key])}, expected {expected}")
            return default
        return value

    def _refuse(self, key: str, known: Sequence[str]) -> None:
        close = difflib.get_close_matches(key, known, n=1)
        self._meant.update(close)
        hint = f"did you mean {close[0]}?" if close else f"expected {', '.join(known)}"
        where = f"[{spelled(self._path)}]" if self._path else "the file"
        self._document.complain((*self._path, key), f"{where} has no key {key!r}: {hint}")


def _as_text(value: Any) -> str | None:
    return value if isinstance(value, str) and value.strip() else None


def _as_truth(value: Any) -> bool | None:
    return value if isinstance(value, bool) else None


def _as_number(value: Any, accepted: Range) -> float | None:
    number = as_number(value)
    return number if accepted.holds(number) else None


def _as_whole(value: Any, accepted: Range) -> int | None:
    return value if is_whole(value) and _as_number(value, accepted) is not None else None


def _as_numbers(value: Any) -> tuple[float, ...] | None:
    return tuple(map(float, value)) if isinstance(value, list) else None


def _as_texts(value: Any) -> tuple[str, ...] | None:
    listed = value if isinstance(value, list) else [value]
    return tuple(listed) if listed and all(map(_as_text, listed)) else None


def shown(value: Any) -> str:
    """Return a short representation of a value in TOML syntax, for messages."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, dict):
        return "a table"
    if isinstance(value, list):
        return "a list" if value else "an empty list"
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, int) and abs(value) > MAX_SHOWN:
        return "a number that is too large"
    text = repr(value) if isinstance(value, str) else str(value)
    return text if len(text) <= MAX_SHOWN else f"{text[:MAX_SHOWN]}…"
