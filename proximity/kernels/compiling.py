"""How kernels are compiled, and where the compiled code is kept.

numba keeps a function's code as long as its own file is unchanged, even when a function that was compiled
into it has changed elsewhere. So the code is kept in a folder named after all sources together: whoever
edits or updates them gets new code throughout, and the old folder is removed. The engine's kernels and those
of the simulations have a folder each, so that an edit of one costs no compiling of the other.
"""

import hashlib
import os
import shutil
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba

_PACKAGE = Path(__file__).resolve().parent.parent
# What the code of a unit is made of.
_SOURCES = {
    "kernels": ("kernels/*.py", "simd/*.py"),
    "decaff": ("kernels/compiling.py", "decaff/*_kernels.py"),
}


def _sources(unit: str) -> list[Path]:
    return sorted(path for pattern in _SOURCES[unit] for path in _PACKAGE.glob(pattern))


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@cache
def cache_folder(unit: str = "kernels") -> Path:
    """Return the folder of compiled kernels: as NUMBA_CACHE_DIR says, beside the sources, or the user's."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in _sources(unit):
        digest.update(source.name.encode() + source.read_bytes())
    prefix = f"proximity-{unit}-"
    name = prefix + digest.hexdigest()[:16]
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR) / name
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "proximity"
    beside = _PACKAGE / unit / "__pycache__"
    parent = next((folder for folder in (beside, user) if _is_writable(folder)), Path(tempfile.gettempdir()))
    folder = parent / name
    if not folder.exists():
        for old in parent.glob(prefix + "*"):
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    """What numba makes of *function*; its cache is in the `cache_folder` of its unit."""
    before = numba.config.CACHE_DIR
    folder = str(cache_folder("decaff" if function.__module__.startswith("proximity.decaff.") else "kernels"))
    numba.config.CACHE_DIR = folder
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    finally:
        numba.config.CACHE_DIR = before


def kernel(function: Callable[..., Any]) -> Any:
    """Compile *function* when first called, and keep it on disk; it runs without the interpreter lock.

    It makes no arrays, and so counts no references: they would be a fifth of a tick. What it needs for itself
    is on the stack: see ``reals_here`` in `memory`.
    """
    return _compile(function, _nrt=False)


def maker(function: Callable[..., Any]) -> Any:
    """Compile a kernel that makes arrays."""
    return _compile(function)


class Settled:
    """A kernel that, after its first call, takes no other types than it was called with then.

    numba tells the types of arguments 0.3 µs sooner than Python can, and does so in any case.
    """

    __slots__ = ("_kernel", "quick")

    def __init__(self, kernel: Callable[..., Any]) -> None:
        self._kernel = kernel
        self.quick: Callable[..., Any] = _refuse
        """The kernel itself; raises TypeError for arguments of other types, and before the first `call`."""

    def call(self, *arguments: Any) -> Any:
        """Call the kernel with arguments of the right types."""
        result = self._kernel(*arguments)
        if hasattr(self._kernel, "disable_compile"):  # a plain function, uncompiled, would take anything
            self._kernel.disable_compile()
            self.quick = self._kernel
        return result


def _refuse(*_: Any) -> Any:
    raise TypeError("not called yet")


def inlined(function: Callable[..., Any]) -> Any:
    """Compile an innermost formula: always put into its caller."""
    return _compile(function, forceinline=True, _nrt=False)
