"""Folders of files written together: sources of programs, packages."""

import os
from collections.abc import Collection, Mapping
from pathlib import Path

from proximity.errors import ProximityError
from proximity.system.whole_file import whole_file


def write_files(
    contents: Mapping[str, str | bytes], folder: str | os.PathLike[str], kept: Collection[str] = ()
) -> dict[str, bool]:
    """Write files into a folder, created if needed.

    *kept*: existing files that are left unchanged. A package of Python is not such a folder: they would be
    imported with it.
    """
    if Path(folder, "__init__.py").is_file():
        raise ProximityError(f"{folder}: is a package of Python, expected another folder, such as engine")
    written = {}
    for name, content in contents.items():
        path = Path(folder) / name
        is_kept = name in kept and path.exists()
        written[str(path)] = not is_kept
        if not is_kept:
            _make_folder(path.parent)
            with whole_file(path, takes_devices=False) as stream:
                stream.write(content.encode() if isinstance(content, str) else content)
    return written


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise ProximityError(f"{folder}: is not a folder and cannot be created ({reason})") from failure
