"""How kernels are compiled, and where the compiled code is kept.

numba keeps a function's code as long as its own file is unchanged, even when a function that was compiled
into it has changed elsewhere. So the code is kept in a folder named after all sources together: whoever
edits or updates them gets new code throughout, and the old folder is removed. The kernels of the engine, of
the drum and of the studies have a folder each, so that an edit of one costs no compiling of the others.
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

from proximity.kernels.code_cache import SharedCache
from proximity.kernels.interruptible import interruptible

_PACKAGE = Path(__file__).resolve().parent.parent
# What the code of a unit is made of.
_SOURCES = {
    "kernels": ("kernels/**/*.py", "simd/*.py"),
    "service": ("kernels/**/*.py", "simd/*.py", "service/*_kernels.py"),
    "decaff": ("kernels/code_cache.py", "kernels/compiler.py", "decaff/**/*_kernels.py"),
    "studies": ("kernels/code_cache.py", "kernels/compiler.py", "*/**/*_kernels.py"),
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
    compiled = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if numba.config.DISABLE_JIT:
        return compiled
    before = numba.config.CACHE_DIR
    unit = function.__module__.split(".")[1:2]
    folder = cache_folder(unit[0] if unit and unit[0] in _SOURCES else "kernels")
    numba.config.CACHE_DIR = str(folder)
    try:
        compiled._cache = SharedCache(function)
    finally:
        numba.config.CACHE_DIR = before
    compiled.compile = interruptible(compiled.compile)
    return compiled


def kernel(function: Callable[..., Any]) -> Any:
    """Compile *function* when first called, and keep it on disk; it runs without the interpreter lock.

    It makes no arrays, and so counts no references: they would be a fifth of a tick. What it needs for itself
    is on the stack: see ``reals_here`` in `memory`. Whether it is put into its callers is LLVM's to say.
    numba would have it always put into them where the first of them to be compiled is `inlined`.
    """
    return _compile(function, forceinline=False, _nrt=False)


def maker(function: Callable[..., Any]) -> Any:
    """Compile a kernel that makes arrays."""
    return _compile(function, forceinline=False)


class CompiledCall:
    """A kernel for arguments of certain types, called past numba's look at what they are: 0.1 µs less.

    Parameters
    ----------
    kernel : compiled function
        As `kernel` gives it.
    types : tuple
        Of its arguments, as numba names them.
    """

    __slots__ = ("_kernel", "_types", "call")

    def __init__(self, kernel: Any, types: tuple[Any, ...]) -> None:
        self._kernel, self._types = kernel, types
        self.call: Callable[..., Any] = self._settle_and_call
        """The function. Whoever calls it has looked at dtypes and at the number of axes of arrays, which
        nobody checks any more, and that whole numbers are whole. Given rows may be anything: see `given`."""

    def settle(self) -> None:
        """Compile the function, or load it, before it is called."""
        is_compiled = hasattr(self._kernel, "compile")
        self.call = self._kernel.compile(self._types) if is_compiled else self._kernel

    def _settle_and_call(self, *arguments: Any) -> Any:
        self.settle()
        return self.call(*arguments)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile what is always put into its callers: formulas, and what is less than the call of it."""
    return _compile(function, forceinline=True, _nrt=False)
