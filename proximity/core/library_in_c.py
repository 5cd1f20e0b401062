"""Compiled C code for Python: handles of the library, and functions of the message receiver."""

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

from proximity.errors import ProximityError
from proximity.native.declaration import function_in_c
from proximity.native.sources import TOOLS, core_digest
from proximity.system.extras import needed_in_c

NATIVE = Path(__file__).parent.parent / "native"
LIBRARIES = ("libproximity.so", "libproximity.dylib", "proximity.dll")
_RECEIVER = {
    "is_old": "uint8[:], uint8[:], int, int, int -> bool",
    "accept": "uint8[:], uint8[:], int, int, int",
    "content_flaw": "uint8[:], int -> int",
    "widen": "uint8[:], int, float, float",
    "forget": "uint8[:]",
}


def library_path() -> Path:
    """Return the library compiled for this system; raise a `ProximityError` if there is none."""
    for name in LIBRARIES:
        if (NATIVE / name).is_file():
            return NATIVE / name
    raise ProximityError(
        "the library in C has not been compiled for this system; wheels have it, and so has a checkout "
        "after `python -m pip install -e .`, which fetches the compiler (ziglang)"
    )


def interface() -> int:
    """Return the version of the library's interface, from its header."""
    header = (Path(__file__).parent / "library" / "proximity.h").read_text(encoding="utf-8")
    return int(header.partition("#define PROXIMITY_INTERFACE ")[2].split()[0])


@cache
def libraries() -> tuple[ctypes.CDLL, ctypes.PyDLL]:
    """Return the library twice: for calls that release the interpreter lock, and for short ones.

    `ProximityError` if it is missing, is from other sources, or cannot be loaded.
    """
    path = library_path()
    if TOOLS.is_dir() and f"in C {core_digest()}\0".encode() not in path.read_bytes():
        raise ProximityError(
            f"{path} is older than the sources in proximity/core: run `python tools/build_kernels.py` in the "
            "checkout"
        )
    try:
        return ctypes.CDLL(str(path), use_errno=True), ctypes.PyDLL(str(path), use_errno=True)
    except OSError as failure:
        raise ProximityError(f"{path} cannot be loaded ({failure})") from failure


@cache
def receiver_in_c(name: str) -> Any:
    """Return a function of the receiver; `ArgumentError` if it was not compiled, or from other sources."""
    with needed_in_c("messages cannot be received, which is written in C"):
        return function_in_c(f"receiver_{name}", _RECEIVER[name])
