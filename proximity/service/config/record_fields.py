"""Declare the fields of a dataclass as keys of a TOML table, with their readers and defaults.

``rate_hz: float = number(Range("Hz", 1.0, 1e5), 1000.0)`` declares key, type, range and default in one place.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, field, fields
from typing import Any

from proximity.service.config.table_fields import REQUIRED, Range, Table
from proximity.service.config.toml_document import Document, Path


def key(read: Callable[[Table, str, Any], Any], default: Any = REQUIRED) -> Any:
    """Declare a field that *read* reads from a table, given its key and its default."""
    known = MISSING if default is REQUIRED else default
    return field(default=known, metadata={"read": lambda table, name: read(table, name, default)})


def number(accepted: Range, default: Any = REQUIRED) -> Any:
    """Declare a setting that is a number within a range."""
    return key(lambda table, name, default: table.number(name, default, accepted), default)


def numbers(accepted: Range, count: int, default: Any = REQUIRED) -> Any:
    """Declare a setting that is a list of *count* numbers within a range."""
    return key(lambda table, name, default: table.numbers(name, default, count, accepted), default)


def whole(accepted: Range, default: Any = REQUIRED) -> Any:
    """Declare a setting that is a whole number within a range."""
    return key(lambda table, name, default: table.whole(name, default, accepted), default)


def truth(default: bool = False) -> Any:
    """Declare a setting that is true or false."""
    return key(lambda table, name, default: table.truth(name, default), default)


def text(meaning: str, default: Any = REQUIRED) -> Any:
    """Declare a setting that is a non-empty text. Error messages name *meaning* as the expected value."""
    return key(lambda table, name, default: table.text(name, default, meaning=meaning), default)


def texts(meaning: str, default: Any = REQUIRED) -> Any:
    """Declare a setting that is one text or a list of texts."""
    return key(lambda table, name, default: table.texts(name, default, meaning=meaning), default)


def word(words: Sequence[str], default: Any = REQUIRED) -> Any:
    """Declare a setting that is one of the given words."""
    return key(lambda table, name, default: table.one_of(name, default, words), default)


def keys_of(*records: Any) -> tuple[str, ...]:
    """Return the keys that a table of these records may contain."""
    return tuple(one.name for record in records for one in fields(record) if one.metadata)


def read_fields(record: Any, table: Table) -> dict[str, Any]:
    """Read the fields of a record from a table. Return their values by name."""
    return {one.name: one.metadata["read"](table, one.name) for one in fields(record) if one.metadata}


def read_table(record: Any, document: Document, name: str) -> Any:
    """Read a record from a table of the document. A missing table gives the defaults."""
    content = document.data.get(name, {})
    return record(**read_fields(record, Table(document, (name,), content, keys_of(record))))


def read_tables(
    record: Any, document: Document, name: str, *, is_needed: bool = False
) -> Iterator[tuple[Table, Any]]:
    """Yield each table of a list together with the record read from it."""
    listed: Any = document.data.get(name, [])
    if not isinstance(listed, list):
        verb = "are" if name.endswith("s") else "is"
        document.complain((name,), f"{name} {verb} not a list of tables, expected [[{name}]] above each")
        return
    if is_needed and not listed:
        document.complain((), f"[[{name}]] is missing, expected at least one")
    for index, content in enumerate(listed):
        path: Path = (name, index)
        table = Table(document, path, content, keys_of(record))
        yield table, record(**read_fields(record, table))
