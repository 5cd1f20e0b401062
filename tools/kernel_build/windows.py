"""Windows: the import library of Python's stable interface for an extension."""

import struct
import subprocess
import sys
from pathlib import Path

IMPORTED = "__imp_"
"""Prefix of symbols imported from another library."""
_HEADER, _SYMBOL = struct.Struct("<8xII"), struct.Struct("<8sIhHBB")
_EXTERNAL = 2


def python_library(objects: list[Path], folder: Path) -> Path:
    """Make the import library of all Python symbols used by objects; return its path."""
    asked = {name.removeprefix(IMPORTED) for each in objects for name in undefined_symbols(each.read_bytes())}
    names = sorted(name for name in asked if name.startswith(("Py", "_Py")))
    definitions, library = folder / "python3.def", folder / "python3.lib"
    definitions.write_text(
        "\n".join(["LIBRARY python3.dll", "EXPORTS", *(f"  {name}" for name in names), ""])
    )
    command = [sys.executable, "-m", "ziglang", "dlltool", "-m", "i386:x86-64"]
    subprocess.run([*command, "-d", str(definitions), "-l", str(library)], check=True)
    return library


def undefined_symbols(content: bytes) -> list[str]:
    """Return the undefined symbols of an object file, COFF."""
    start, count = _HEADER.unpack_from(content)
    names = content[start + _SYMBOL.size * count :]
    found, at = [], 0
    while at < count:
        name, value, section, _, storage, more = _SYMBOL.unpack_from(content, start + _SYMBOL.size * at)
        at += 1 + more
        if section == 0 and value == 0 and storage == _EXTERNAL:
            offset = struct.unpack("<4xI", name)[0] if name[:4] == b"\0" * 4 else None
            whole = name if offset is None else names[offset:]
            found.append(whole.split(b"\0", 1)[0].decode())
    return found
