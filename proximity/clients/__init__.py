"""Clients in C++, JavaScript and C# that receive frames and send poses: sources to be written out.

What is the same for all messages, their layout, is generated from the fields; the rest lies beside this file.
The layouts are those of one version: whoever installs another one writes them out again.
"""

import os
from collections.abc import Callable
from importlib.metadata import distribution
from pathlib import Path

import proximity
from proximity.message.c_header import header_text
from proximity.message.csharp_layout import csharp_layout
from proximity.message.javascript_layout import layout_module
from proximity.system.written_files import write_files

LAYOUTS: dict[str, tuple[str, Callable[[], str]]] = {
    "csharp": ("Runtime/ProximityMessages.cs", csharp_layout),
    "javascript": ("layout.mjs", layout_module),
    "cpp": ("proximity_message.h", header_text),
}
"""Generated file of each language, and its generator."""
EXAMPLES = {
    *(f"Runtime/{name}.cs" for name in ("Example", "ProximityHand", "ProximityDistance")),
    "example.mjs",
    "example.cpp",
}
"""Files to be edited: existing ones are left unchanged."""
EXAMPLE_RECEIVER = Path(__file__).parent / "c" / "examples" / "receiver.c"
"""Example of a controller that receives frames over UDP, in C."""


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
    return {name: layout(), "LICENSE": license_text(), **texts}


def license_text() -> str:
    """Return the licence, from the checkout or the installed distribution."""
    path = Path(proximity.__file__).parent.parent / "LICENSE"
    if path.is_file() and (path.parent / "pyproject.toml").is_file():
        return path.read_text(encoding="utf-8")
    return distribution("cad-proximity").read_text("licenses/LICENSE") or ""


def write_client(language: str, folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write the files of a client into a folder, created if needed.

    Returned: by the files' paths, whether they were written: existing examples are left unchanged.
    """
    return write_files(client_files(language), folder, EXAMPLES)
