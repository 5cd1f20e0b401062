"""The C library as a folder for compilers and CMake: header, library, examples."""

import os
from pathlib import Path

import proximity
from proximity.clients import EXAMPLES, client_files, license_text
from proximity.core import CORE
from proximity.core.library_in_c import interface, library_path
from proximity.errors import ProximityError
from proximity.message.c_header import header_text
from proximity.system.whole_file import write_files

HERE = Path(__file__).parent / "c"
ANDROID = "android-aarch64/libproximity.so"
"""Next to the library of this system, if it was built, see `tools/kernel_build/targets.py`."""
PLACES = {
    CORE / "library" / "proximity.h": "include",
    CORE / "library" / "proximity_tracker.h": "include",
    HERE / "proximity.hpp": "include",
    HERE / "package" / "proximity-config.cmake": "lib/cmake/proximity",
    HERE / "package" / "proximity-config-version.cmake": "lib/cmake/proximity",
    HERE / "package" / "proximity.pc": "lib/pkgconfig",
    HERE / "examples" / "distances.c": "examples",
    HERE / "examples" / "moving.c": "examples",
    HERE / "examples" / "imported.cpp": "examples",
}
"""Files, and their destination folders."""


def write_library(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write header, library, CMake package, pkg-config file and examples into a folder.

    Returns, by path, whether a file was written: existing examples are left unchanged.
    """
    library = library_path()
    name = f"{library.name}.{interface()}" if library.suffix == ".so" else library.name
    contents: dict[str, str | bytes] = {
        f"lib/{name}": library.read_bytes(),
        "include/proximity_message.h": header_text(),
        "LICENSE": license_text(),
    }
    for beside in (library.with_suffix(".lib"), library.with_suffix(".a")):
        if beside.is_file():
            contents[f"lib/{beside.name}"] = beside.read_bytes()
    for path, place in PLACES.items():
        text = path.read_text(encoding="utf-8")
        text = text.replace("@LIBRARY@", name).replace("@VERSION@", proximity.__version__)
        contents[f"{place}/{path.name}"] = text
    written = write_files(contents, folder, [path for path in contents if path.startswith("examples/")])
    if name != library.name:
        link = Path(folder, "lib", library.name)
        link.unlink(missing_ok=True)
        link.symlink_to(name)
        written[str(link)] = True
    return written


def write_csharp_library(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write the engine for Unity and .NET: its binding, and the library if it was compiled."""
    written = write_files(client_files("csharp", "client"), folder, EXAMPLES)
    try:
        library = library_path()
    except ProximityError:  # the sources are useful without it, and with one for another system
        return written
    plugins = {library.name: library, "Android/arm64-v8a/libproximity.so": library.parent / ANDROID}
    contents = {name: path.read_bytes() for name, path in plugins.items() if path.is_file()}
    return written | write_files({f"Runtime/Plugins/{name}": data for name, data in contents.items()}, folder)
