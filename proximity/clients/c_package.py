"""The C library as a folder for compilers and CMake: header, library, examples."""

import os
from pathlib import Path

import proximity
from proximity.clients import license_text, write_client
from proximity.core import CORE
from proximity.core.library_in_c import library_path
from proximity.errors import ProximityError
from proximity.message.c_header import header_text
from proximity.system.written_files import write_files

HERE = Path(__file__).parent / "c"
ANDROID = "android-aarch64/libproximity.so"
"""Next to the library of this system, if it was built, see `tools/kernel_build/targets.py`."""
PLACES = {
    CORE / "library" / "proximity.h": "include",
    CORE / "library" / "proximity_tracker.h": "include",
    CORE / "mailbox" / "proximity_mailbox.h": "include",
    HERE / "proximity.hpp": "include",
    HERE / "package" / "proximity-config.cmake": "lib/cmake/proximity",
    HERE / "package" / "proximity-config-version.cmake": "lib/cmake/proximity",
    HERE / "package" / "proximity.pc": "lib/pkgconfig",
    HERE / "examples" / "distances.c": "examples",
    HERE / "examples" / "moving.c": "examples",
    HERE / "examples" / "mailbox_receiver.c": "examples",
}
"""Files, and the folders that they are written to."""


def write_library(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write header, library, CMake package, pkg-config file and examples into a folder.

    Returned: by the files' paths, whether they were written: an example that is there already is left alone.
    """
    library = library_path()
    contents: dict[str, str | bytes] = {
        f"lib/{library.name}": library.read_bytes(),
        "include/proximity_message.h": header_text(),
        "LICENSE": license_text(),
    }
    import_library = library.with_suffix(".lib")
    if import_library.is_file():
        contents[f"lib/{import_library.name}"] = import_library.read_bytes()
    for path, place in PLACES.items():
        text = path.read_text(encoding="utf-8")
        text = text.replace("@LIBRARY@", library.name).replace("@VERSION@", proximity.__version__)
        contents[f"{place}/{path.name}"] = text
    return write_files(contents, folder, [name for name in contents if name.startswith("examples/")])


def write_unity_package(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write the client in C# as `write_client` does, and the library where it was compiled."""
    written = write_client("csharp", folder)
    try:
        library = library_path()
    except ProximityError:  # sources are useful without it, and with one of another system
        return written
    plugins = {library.name: library, "Android/arm64-v8a/libproximity.so": library.parent / ANDROID}
    contents = {name: path.read_bytes() for name, path in plugins.items() if path.is_file()}
    return written | write_files({f"Runtime/Plugins/{name}": data for name, data in contents.items()}, folder)
