"""Kernels compiled by numba at their first call, and cached on disk.

numba considers cached code valid while the file of the function is unchanged, even if a function inlined from
another file has changed. The cache folder is therefore named after the digest of all sources: editing one
source recompiles all kernels and removes the old folder.
"""

import atexit
import os
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import types
from numba.core.caching import FunctionCache

from proximity.native.signature import DTYPES, Array, Bundle, Scalar, Signature, dtype_of
from proximity.native.sources import PACKAGE, sources_digest

try:
    import fcntl
except ImportError:  # not a POSIX system
    fcntl = None  # type: ignore[assignment]

_PREFIX = "proximity-"
_TYPES = {name: numba.from_dtype(np.dtype(name)) for name in DTYPES} | {
    "int": types.int64,
    "float": types.float64,
}
is_kept = True
"""Whether code is cached on disk. Builds of object files do not cache."""


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Return the function compiled by numba at its first call."""
    dispatcher = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if is_kept and function.__closure__ is None:  # each process would cache another copy of a closure
        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(cache_folder())
        try:
            dispatcher._cache = _SharedCache(function)
        finally:
            numba.config.CACHE_DIR = before
    return dispatcher


def argument_types(signature: Signature) -> tuple[types.Type, ...]:
    """Return the numba types of an entry point's arguments."""
    return tuple(map(numba_type, signature.arguments))


def numba_type(value: Array | Scalar | Bundle) -> types.Type:
    """Return the numba type for a type in a signature."""
    if isinstance(value, Scalar):
        return _TYPES[value.kind]
    if isinstance(value, Array):
        item = _TYPES.get(value.dtype) or numba.from_dtype(dtype_of(value.dtype))
        return types.Array(item, len(value.lengths), "C")
    kinds = [numba_type(array) for array in value.arrays]
    if len(set(kinds)) == 1:
        return types.NamedUniTuple(kinds[0], len(kinds), value.kind)
    return types.NamedTuple(kinds, value.kind)


@cache
def cache_folder() -> Path:
    """Return the folder for cached code.

    It is the configured folder if there is one. Otherwise it is next to the sources, in the user's cache, or
    temporary: the first of these that only this user can write to.
    """
    name = f"{_PREFIX}{sources_digest()[:16]}-{numba.__version__}"
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR) / name
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "proximity"
    beside = PACKAGE / "kernels" / "__pycache__"
    parent = next((folder for folder in (beside, user) if _is_ours(folder)), None)
    if parent is None:  # cached code is executed: no other user may have written it
        parent = Path(tempfile.mkdtemp(prefix=_PREFIX))
        atexit.register(shutil.rmtree, parent, ignore_errors=True)
    folder = parent / name
    if not folder.exists():
        for old in parent.glob(_PREFIX + "*"):
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _is_ours(folder: Path) -> bool:
    """Create a folder if necessary, and test whether only this user owns it and can write to it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            status = folder.stat()
    except OSError:
        return False
    return os.name == "nt" or (status.st_uid == os.geteuid() and not status.st_mode & stat.S_IWOTH)


class _SharedCache(FunctionCache):
    """A cache of numba that is safe for processes that compile concurrently.

    To add a version of a function, numba reads the list of cached versions, then writes the extended list and
    the code. With two concurrent processes, the list written by one could refer to code written by the other
    for different argument types.
    """

    def save_overload(self, sig: Any, data: Any) -> None:
        folder = Path(self.cache_path).parent
        try:
            with _locked(folder):
                super().save_overload(sig, data)
        except OSError as reason:
            print(f"proximity: compiled kernels cannot be kept in {folder} ({reason})", file=sys.stderr)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Lock a folder against other processes, if the file system supports locks."""
    if fcntl is None:
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("ab") as lock:
        with suppress(OSError):  # on a file system without locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
