"""Scene file as parsed TOML, with the line number of every value.

tomllib reports line numbers only for syntax errors. So the file is parsed a second time, statement by
statement: lines are joined until they are valid TOML.
"""

import os
import re
import tomllib
from functools import cached_property
from typing import Any

from proximity.errors import ServiceError
from proximity.system.regular_file import open_regular

MAX_FILE_BYTES = 1 << 20
"""Maximum size of a scene file. A scene of thousands of parts is smaller."""
MAX_LINES = 200
"""Maximum number of lines of a statement. In a longer one, errors name only the line where it begins."""
MAX_LINES_NAMED = 8
"""Maximum number of further mistakes in one message."""
MAX_DOTS = 32
"""Maximum number of dots in a key. No known key has more than two."""
_WORD = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
LONG_KEY = re.compile(rf"(?:^|[{{,])[ \t\[]*(?:{_WORD}[ \t]*\.[ \t]*){{{MAX_DOTS + 1}}}", re.MULTILINE)
"""Pattern of a key with too many dots, at the begin of a line, after brackets or in an inline table."""
POSITION_IN_MESSAGE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")

Path = tuple[str | int, ...]
"""Keys and indices that lead to a value, such as ("parts", 1, "position")."""


class Document:
    """A parsed TOML file and the errors found in its content.

    *name*: name of the file for messages, or "" if the text is not from a file.
    """

    name: str
    text: str
    data: dict[str, Any]

    def __init__(self, text: str, name: str) -> None:
        self.name, self.text = name, text
        self._text_lines = text.replace("\r\n", "\n").split("\n")
        self._complaints: list[tuple[int, str]] = []
        if long_key := LONG_KEY.search(text):  # tomllib takes gigabytes for thousands of dots
            line = text.count("\n", 0, long_key.end()) + 1
            raise ServiceError(f"{self._prefix(line)}a key has more than {MAX_DOTS} dots, expected fewer")
        try:
            self.data = tomllib.loads(text)
        except RecursionError as deep:
            raise ServiceError(f"{name}:1: brackets are nested too deeply") from deep
        except ValueError as unfit:  # tomllib.TOMLDecodeError, or a number of thousands of digits
            raise self._no_toml(str(unfit)) from unfit

    @property
    def folder(self) -> str:
        """Folder of the file, or the working directory if the text is not from a file."""
        return os.path.dirname(os.path.abspath(self.name)) if self.name else os.getcwd()

    def line_of(self, path: Path) -> int:
        """Return the line number of a value. For a missing value it is the line of its table."""
        while path not in self._lines:
            path = path[:-1]
        return self._lines[path]

    def error(self, path: Path, sentence: str) -> ServiceError:
        """Return an error about a value. Its message names the file and the line."""
        return ServiceError(f"{self._prefix(self.line_of(path))}{sentence}")

    def complain(self, path: Path, sentence: str) -> None:
        """Collect an error about a value without raising it."""
        complaint = self.line_of(path), sentence
        if complaint not in self._complaints:  # a value may be read on behalf of another
            self._complaints.append(complaint)

    def raise_complaints(self) -> None:
        """Raise the collected error that is first in the file. Without errors, do nothing."""
        if not self._complaints:
            return
        (line, sentence), *more = sorted(self._complaints, key=lambda complaint: complaint[0])
        also = f" (and {_other_mistakes([number for number, _ in more])})" if more else ""
        raise ServiceError(f"{self._prefix(line)}{sentence}{also}")

    @cached_property
    def _lines(self) -> dict[Path, int]:
        """Line numbers at which values and tables begin."""
        lines: dict[Path, int] = {(): 1}
        newest: dict[Path, int] = {}  # index of the last table in each array of tables
        table: Path = ()
        statement: list[str] = []
        for number, line in enumerate(self._text_lines, start=1):
            statement.append(line)
            content = _loaded("\n".join(statement))
            if content is not None:
                begins = number - len(statement) + 1
                if statement[0].lstrip().startswith("["):
                    table = _enter(content, newest, lines, begins)
                else:
                    _note(content, table, lines, begins)
                statement = []
            elif len(statement) > MAX_LINES:
                break
        return lines

    def _prefix(self, line: int) -> str:
        return f"{self.name}:{line}: " if self.name else ""

    def _no_toml(self, message: str) -> ServiceError:
        position = POSITION_IN_MESSAGE.search(message)
        if position is None:
            return ServiceError(f"{self.name}:1: {message}, expected TOML")
        what = message[: position.start()]
        if position[1] is None:
            last = max(number for number, line in enumerate(self._text_lines, start=1) if line.strip())
            return ServiceError(f"{self.name}:{last}: the file ends too early: {what}")
        return ServiceError(f"{self.name}:{position[1]}: invalid TOML at column {position[2]}: {what}")


def _other_mistakes(numbers: list[int]) -> str:
    """Return the number and the lines of further errors, such as ``2 more mistakes, on lines 4 and 9``."""
    *lines, last = dict.fromkeys(map(str, numbers))
    if len(lines) >= MAX_LINES_NAMED:
        lines, last = lines[:MAX_LINES_NAMED], "others"
    where = f"lines {', '.join(lines)} and {last}" if lines else f"line {last}"
    return f"{len(numbers)} more {'mistake' if len(numbers) == 1 else 'mistakes'}, on {where}"


def read_document(path: str | os.PathLike[str], what: str = "a scene file") -> Document:
    """Read a TOML file and return it as a document."""
    name = os.fsdecode(path)
    try:
        with open_regular(path) as file:
            content = file.read(MAX_FILE_BYTES + 1)
    except (OSError, ValueError) as failed:  # ValueError: the path contains a null character
        raise ServiceError(f"{name}: cannot be read ({getattr(failed, 'strerror', failed)})") from failed
    if len(content) > MAX_FILE_BYTES:
        raise ServiceError(f"{name}: larger than {MAX_FILE_BYTES >> 20} MiB, expected {what} in TOML")
    try:
        text = content.decode("utf-8-sig")  # some editors write a byte order mark
    except UnicodeDecodeError as unfit:
        line = content.count(b"\n", 0, unfit.start) + 1
        raise ServiceError(f"{name}:{line}: not UTF-8, expected {what} in TOML") from unfit
    if not text.strip():
        raise ServiceError(f"{name}:1: the file is empty, expected {what} in TOML")
    return Document(text, name)


def spelled(path: Path) -> str:
    """Return a path in TOML notation, such as ``parts[1].position``."""
    words = "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in path)
    return words.removeprefix(".")


def _loaded(text: str) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except ValueError:
        return None


def _enter(header: Any, newest: dict[Path, int], lines: dict[Path, int], begins: int) -> Path:
    """Record the lines of the table that a header begins, and return its path."""
    path: Path = ()
    while header:
        ((key, header),) = header.items()
        path = (*path, key)
        lines.setdefault(path, begins)
        if isinstance(header, list):  # [[key]] begins another table of an array
            newest[path] = newest.get(path, -1) + 1
            header = {}
        if path in newest:
            path = (*path, newest[path])
            lines.setdefault(path, begins)
    return path


def _note(content: Any, path: Path, lines: dict[Path, int], begins: int) -> None:
    """Record the lines of the values in a statement."""
    items: Any = ()
    if isinstance(content, dict):
        items = content.items()
    elif isinstance(content, list):
        items = enumerate(content)
    for key, value in items:
        lines.setdefault((*path, key), begins)
        _note(value, (*path, key), lines, begins)
