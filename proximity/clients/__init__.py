"""Source files of clients in C, C++, JavaScript and C# that receive frames and send poses.

The layout of messages is generated from their fields; all other files are in this folder. The files are for
one version: write them again after an update.
"""

import os
from collections.abc import Callable
from importlib.metadata import distribution
from pathlib import Path

import proximity
from proximity.core import CORE
from proximity.message.c_header import header_text
from proximity.message.csharp_layout import csharp_layout
from proximity.message.javascript_layout import layout_module
from proximity.system.whole_file import write_files

LAYOUTS: dict[str, tuple[str, Callable[[], str]]] = {
    "csharp": ("Runtime/ProximityMessages.cs", csharp_layout),
    "javascript": ("layout.mjs", layout_module),
    "cpp": ("proximity_message.h", header_text),
    "c": ("proximity_message.h", header_text),
}
"""The generated file and its generator, by language."""
CSHARP = {
    "client": ("ProximityClient.cs", "ProximityMailbox.cs", "ProximityHand.cs", "Example.cs"),
    "library": ("Proximity.cs", "ProximityDistance.cs", "Imported.cs"),
}
"""Files in C# of only one of the two; both may be written into one folder."""
EXAMPLES = {
    *(f"Runtime/{name}.cs" for name in ("Example", "ProximityHand", "ProximityDistance")),
    "Examples~/Imported.cs",
    "example.mjs",
    "example.cpp",
    "receiver.c",
    "mailbox_receiver.c",
}
"""Files for the user to edit: existing ones are not overwritten."""


def client_files(language: str, without: str = "library") -> dict[str, str]:
    """Return the files of a client, or in C# of the library: their texts by path in its folder."""
    name, layout = LAYOUTS[language]
    folder = Path(__file__).parent / ("c/receivers" if language == "c" else language)
    mailbox = {"proximity_mailbox.h": (CORE / "mailbox" / "proximity_mailbox.h").read_text(encoding="utf-8")}
    texts = {
        path.relative_to(folder).as_posix(): path.read_text(encoding="utf-8").replace(
            "@VERSION@", proximity.__version__
        )
        for path in sorted(folder.rglob("*.*"))
        if path.name not in CSHARP[without]
    }
    return {name: layout(), "LICENSE": license_text(), **texts, **(mailbox if language == "c" else {})}


def license_text() -> str:
    """Return the licence, from the checkout or the installed distribution."""
    path = Path(proximity.__file__).parent.parent / "LICENSE"
    if path.is_file() and (path.parent / "pyproject.toml").is_file():
        return path.read_text(encoding="utf-8")
    return distribution("cad-proximity").read_text("licenses/LICENSE") or ""


def write_client(language: str, folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write the files of a client into a folder, created if needed.

    Returns, by path, whether a file was written: existing examples are left unchanged.
    """
    return write_files(client_files(language), folder, EXAMPLES)
