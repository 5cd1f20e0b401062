"""The records of a STEP file, found in a time that grows with the length of its text, whatever it holds.

The patterns neither backtrack nor start again within what they have passed: quantifiers are possessive, and a
string, a comment or a record that is not closed reaches to the end of the text.
"""

import re
from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

REFERENCE = re.compile(r"#\d+")
QUOTED = r"'[^']*+(?:'|\Z)|/\*(?s:.*?)(?:\*/|\Z)"
"""Strings and comments; a doubled quote ends one string and begins the next."""

_QUOTED = re.compile(QUOTED)
_STRING = re.compile(r"'((?:[^']|'')*+)'")


class Record(NamedTuple):
    """A record with its number."""

    own: str  # "#12"
    kind: str  # "PRODUCT"; "" if it is complex
    arguments: str  # strings and comments are blank
    references: list[str]
    strings: list[str]


class StepText:
    """The text of a STEP file."""

    def __init__(self, text: str) -> None:
        self.text = text

    @cached_property
    def blank(self) -> str:
        """The text with strings and comments blanked, so that a semicolon is an end."""
        return _QUOTED.sub(lambda match: " " * len(match[0]), self.text)

    def records(self, *kinds: str) -> Iterator[Record]:
        """Yield the records of some kinds, which are regular expressions, in the order of the file."""
        pattern = rf"(#\d++)\s*+=\s*+({'|'.join(kinds)})\s*+\(([^;]*+)"
        for match in re.finditer(pattern, self.blank):
            strings = _STRING.findall(self.text[match.start(3) : match.end(3)])
            references = REFERENCE.findall(match[3])
            plain = [string.replace("''", "'") for string in strings]
            yield Record(match[1], match[2], match[3], references, plain)
