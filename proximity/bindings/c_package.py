"""The library in C as a folder that compilers and CMake find things in: header, library, examples."""

import os
from pathlib import Path

import proximity
from proximity.errors import ProximityError
from proximity.message.c_header import header_text
from proximity.system.library_in_c import library_path
from proximity.system.whole_file import whole_file

HERE = Path(__file__).parent / "c"
PLACES = {
    "proximity.h": "include",
    "proximity_tracker.h": "include",
    "proximity.hpp": "include",
    "decaff_mailbox.h": "include",
    "package/proximity-config.cmake": "lib/cmake/proximity",
    "package/proximity.pc": "lib/pkgconfig",
    "examples/distances.c": "examples",
    "examples/moving.c": "examples",
}
"""Files beside this one, and the folders that they are written to."""


def write_library(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write header, library, CMake package, pkg-config file and examples into a folder.

    Returned: by the files' paths, whether they were written: an example that is there already is left alone.
    """
    library, target = library_path(), Path(folder)
    contents = {
        f"lib/{library.name}": library.read_bytes(),
        "include/decaff_message.h": header_text().encode(),
    }
    for name, place in PLACES.items():
        text = (HERE / name).read_text(encoding="utf-8")
        text = text.replace("@LIBRARY@", library.name).replace("@VERSION@", proximity.__version__)
        contents[f"{place}/{Path(name).name}"] = text.encode()
    written = {}
    for name, content in contents.items():
        path = target / name
        is_kept = name.startswith("examples/") and path.exists()
        written[str(path)] = not is_kept
        if not is_kept:
            _write(path, content)
    return written


def _write(path: Path, content: bytes) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or failure
        raise ProximityError(f"{path.parent}: is not a folder and cannot be created ({reason})") from failure
    with whole_file(path, takes_devices=False) as stream:
        stream.write(content)
