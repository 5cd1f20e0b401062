"""Declarations of settings that name files, folders, addresses and units in a scene file.

Paths are relative to the folder of the scene file.
"""

import os
from typing import Any

from proximity.errors import MeshError, PublishError
from proximity.formats import metres_per_unit
from proximity.service.config.record_fields import key
from proximity.service.config.table_fields import REQUIRED, Table
from proximity.transport.address import parse
from proximity.transport.link import TRANSPORTS

ADDRESS = "an address such as shm://NAME"


def address(default: Any = REQUIRED) -> Any:
    """Declare a setting that is the address of a transport."""
    return key(_read_address, default)


def addresses(default: Any = REQUIRED) -> Any:
    """Declare a setting that is one address or a list of different addresses."""
    return key(_read_addresses, default)


def file(meaning: str) -> Any:
    """Declare a setting that is the path of an existing file."""
    return key(lambda table, name, default: read_file(table, name, meaning))


def files(meaning: str) -> Any:
    """Declare a setting that is the path of an existing file or a list of such paths."""
    return key(lambda table, name, default: _read_files(table, name, meaning))


def new_file(meaning: str) -> Any:
    """Declare a setting that is the path of a file to write."""
    return key(lambda table, name, default: _from_here(table, table.text(name, None, meaning=meaning)), None)


def folders(meaning: str) -> Any:
    """Declare a setting that is the path of an existing folder or a list of such paths."""
    return key(lambda table, name, default: _read_folders(table, name, meaning), ())


def unit(default: str) -> Any:
    """Declare a setting that is a unit of length."""
    return key(_read_unit, default)


def read_file(table: Table, name: str, meaning: str) -> str:
    """Return the path of an existing file, or "" if the key is missing."""
    named = table.text(name, REQUIRED, meaning=meaning)
    return "" if named is REQUIRED else _existing(table, name, named, meaning)


def _read_address(table: Table, name: str, default: Any) -> str | None:
    text = table.text(name, default, meaning=ADDRESS)
    return _checked(table, name, text) if isinstance(text, str) else None


def _read_addresses(table: Table, name: str, default: Any) -> tuple[str, ...]:
    listed = tuple(_checked(table, name, each) for each in table.texts(name, default, meaning=ADDRESS))
    if len(set(listed)) < len(listed):
        table.complain(name, "has an address twice, expected different addresses")
    return listed


def _checked(table: Table, name: str, text: str) -> str:
    try:
        parsed = parse(text)
    except PublishError as invalid:
        table.complain(name, f"cannot be used: {invalid}")
        return text
    if parsed.scheme not in TRANSPORTS:
        schemes = ", ".join(TRANSPORTS)
        table.complain(name, f"is {text}, but no transport is called {parsed.scheme!r}: expected {schemes}")
    return parsed.with_files_in(table.folder)


def _read_files(table: Table, name: str, meaning: str) -> tuple[str, ...]:
    named = table.texts(name, REQUIRED, meaning=meaning)
    return tuple(_existing(table, name, each, meaning) for each in named)


def _existing(table: Table, name: str, named: str, meaning: str) -> str:
    path = str(_from_here(table, named))
    if not os.path.isfile(path):
        what = "is a folder" if os.path.isdir(path) else "is not there"
        table.complain(name, f"is {named!r}, but {path} {what}, expected {meaning}")
    return path


def _read_folders(table: Table, name: str, meaning: str) -> tuple[str, ...]:
    named = table.texts(name, (), meaning=meaning)
    paths = tuple(str(_from_here(table, each)) for each in named)
    for each, path in zip(named, paths, strict=True):
        if not os.path.isdir(path):
            what = "is a file" if os.path.exists(path) else "is not there"
            table.complain(name, f"is {each!r}, but {path} {what}, expected a folder")
    return paths


def _read_unit(table: Table, name: str, default: str) -> str:
    named: str = table.text(name, default, meaning="a unit such as mm")
    try:
        metres_per_unit(named)
    except MeshError as unknown:
        table.complain(name, f"cannot be used: {unknown}")
    return named


def _from_here(table: Table, path: str | None) -> str | None:
    return None if path is None else os.path.join(table.folder, path)
