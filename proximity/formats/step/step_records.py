"""Find the records in the text of a STEP file, in time linear in its length for any content.

The patterns neither backtrack nor restart within matched text: quantifiers are possessive, and an unclosed
string, comment or record extends to the end of the text.
"""

import re
from collections.abc import Iterator
from contextlib import suppress
from functools import cached_property
from typing import NamedTuple

REFERENCE = re.compile(r"#\d+")
QUOTED = r"'[^']*+(?:'|\Z)|/\*(?s:.*?)(?:\*/|\Z)"
"""Pattern of strings and comments. A doubled quote ends one string and begins the next."""

_COMMON = {  # bytes that most of the text beyond ASCII has in an encoding
    "Shift-JIS": (  # kana, and runs or whole strings of kanji
        "cp932", rb"\x81\x5b|\x82[\x9f-\xf1]|\x83[\x40-\x96]|(?:[\x88-\x9f\xe0-\xea][\x40-\xfc]){2}"
        rb"|'[\x88-\x9f][\x40-\xfc]'",
    ),
    "GB18030": ("gb18030", rb"(?:[\xb0-\xd7][\xa1-\xfe])+"),
    "Windows-1251": ("cp1251", rb"[\xc0-\xff]{3,}"),
    "Windows-1252": ("cp1252", rb"[\x80-\xff]"),
    "Latin-1": ("latin-1", rb"[\x80-\xff]"),
}  # fmt: skip
_QUOTED = re.compile(QUOTED)
_STRING = re.compile(r"'((?:[^']|'')*+)'")


def decoded(data: bytes) -> tuple[str, list[str]]:
    """Decode a text by its likely encoding. Return it, and a note if the encoding is not UTF-8."""
    with suppress(UnicodeDecodeError):
        return data.decode("utf-8"), []
    beyond = len(data.translate(None, bytes(range(128))))
    for name, (encoding, common) in _COMMON.items():
        if 2 * sum(map(len, re.findall(common, data))) >= beyond:
            with suppress(UnicodeDecodeError):
                note = f"its text is not UTF-8, and was read as {name}: names may have other letters"
                return data.decode(encoding), [note]
    raise AssertionError("every byte is a letter of Latin-1")


class Record(NamedTuple):
    """A record of the file and its number."""

    own: str  # "#12"
    kind: str  # "PRODUCT", or "" for a complex record
    arguments: str  # text in which strings and comments are blank
    references: list[str]
    strings: list[str]


class StepText:
    """The text of a STEP file."""

    def __init__(self, text: str) -> None:
        self.text = text

    @cached_property
    def blank(self) -> str:
        """Text in which strings and comments are blank, so that each semicolon ends a record."""
        return _QUOTED.sub(lambda match: " " * len(match[0]), self.text)

    def records(self, *kinds: str) -> Iterator[Record]:
        """Yield the records of the given kinds in the order of the file.

        The kinds are regular expressions.
        """
        pattern = rf"(#\d++)\s*+=\s*+({'|'.join(kinds)})\s*+\(([^;]*+)"
        for match in re.finditer(pattern, self.blank):
            strings = _STRING.findall(self.text[match.start(3) : match.end(3)])
            references = REFERENCE.findall(match[3])
            plain = [string.replace("''", "'") for string in strings]
            yield Record(match[1], match[2], match[3], references, plain)
