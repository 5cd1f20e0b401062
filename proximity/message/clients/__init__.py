"""Clients in C++, JavaScript and C# that receive frames and send poses: sources to be written out.

What is the same for all messages, their layout, is generated from the fields; the rest lies beside this file.
The layouts are those of one version: whoever installs another one writes them out again.
"""

import os
from collections.abc import Callable, Collection, Mapping
from pathlib import Path

import proximity
from proximity.errors import ProximityError
from proximity.message.c_header import header_text
from proximity.message.csharp_layout import csharp_layout
from proximity.message.javascript_layout import layout_module
from proximity.system.whole_file import whole_file

LAYOUTS: dict[str, tuple[str, Callable[[], str]]] = {
    "csharp": ("Runtime/DecaffMessages.cs", csharp_layout),
    "javascript": ("layout.mjs", layout_module),
    "cpp": ("decaff_message.h", header_text),
}
"""By language: the file that is generated, and what makes it."""
EXAMPLES = {
    *(f"Runtime/{name}.cs" for name in ("Example", "DecaffHand", "ProximityDistance")),
    "example.mjs",
    "example.cpp",
}
"""Files that are there to be changed: once written they are left alone."""


def client_files(language: str) -> dict[str, str]:
    """Return the files of a client: their texts by their paths in its folder."""
    name, layout = LAYOUTS[language]
    folder = Path(__file__).parent / language
    texts = {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8").replace(
            "@VERSION@", proximity.__version__
        )
        for path in sorted(folder.rglob("*.*"))
    }
    return {name: layout(), **texts}


def write_client(language: str, folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write the files of a client into a folder, which is made where it is not there.

    Returned: by the files' paths, whether they were written: an example that is there already is left alone.
    """
    return write_sources(client_files(language), folder, EXAMPLES)


def write_sources(
    contents: Mapping[str, str | bytes], folder: str | os.PathLike[str], kept: Collection[str] = ()
) -> dict[str, bool]:
    """Write files into a folder, which is made where it is not there.

    *kept*: files that are left alone where they are there already.
    """
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
