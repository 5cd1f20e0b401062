"""The library in C as a folder that compilers and CMake find things in: header, library, examples."""

import os
from pathlib import Path

import proximity
from proximity.errors import ProximityError
from proximity.message.c_header import header_text
from proximity.message.clients import write_client, write_sources
from proximity.system.library_in_c import library_path

HERE = Path(__file__).parent / "c"
ANDROID = "android-aarch64/libproximity.so"
"""Beside the library of this system, where it was built, see `tools/kernel_build/targets.py`."""
PLACES = {
    "proximity.h": "include",
    "proximity_tracker.h": "include",
    "proximity.hpp": "include",
    "decaff_mailbox.h": "include",
    "package/proximity-config.cmake": "lib/cmake/proximity",
    "package/proximity.pc": "lib/pkgconfig",
    "examples/distances.c": "examples",
    "examples/moving.c": "examples",
    "examples/mailbox_receiver.c": "examples",
}
"""Files beside this one, and the folders that they are written to."""


def write_library(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write header, library, CMake package, pkg-config file and examples into a folder.

    Returned: by the files' paths, whether they were written: an example that is there already is left alone.
    """
    library = library_path()
    contents: dict[str, str | bytes] = {
        f"lib/{library.name}": library.read_bytes(),
        "include/decaff_message.h": header_text(),
    }
    import_library = library.with_suffix(".lib")
    if import_library.is_file():
        contents[f"lib/{import_library.name}"] = import_library.read_bytes()
    for name, place in PLACES.items():
        text = (HERE / name).read_text(encoding="utf-8")
        text = text.replace("@LIBRARY@", library.name).replace("@VERSION@", proximity.__version__)
        contents[f"{place}/{Path(name).name}"] = text
    return write_sources(contents, folder, [name for name in contents if name.startswith("examples/")])


def write_unity_package(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write the client in C# as `write_client` does, and the library where it was compiled."""
    written = write_client("csharp", folder)
    try:
        library = library_path()
    except ProximityError:  # sources are of use without it, and with one of another system
        return written
    plugins = {library.name: library, "Android/arm64-v8a/libproximity.so": library.parent / ANDROID}
    contents = {name: path.read_bytes() for name, path in plugins.items() if path.is_file()}
    return written | write_sources(
        {f"Runtime/Plugins/{name}": data for name, data in contents.items()}, folder
    )
