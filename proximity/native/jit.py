"""Kernels compiled by numba when they are first called, and kept on disk.

numba keeps a function's code as long as its own file is unchanged, even when a function that was compiled
into it has changed elsewhere. So the code is kept in a folder named after all sources together: whoever edits
one gets new code throughout, and the old folder is removed.
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
"""Whether code is kept on disk; the build of objects keeps none."""


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """Return the function as numba compiles it when it is called."""
    dispatcher = numba.njit(nogil=True, error_model="numpy", **options)(function)
    if is_kept and function.__closure__ is None:  # of a closure each process would keep another
        before, numba.config.CACHE_DIR = numba.config.CACHE_DIR, str(cache_folder())
        try:
            dispatcher._cache = _SharedCache(function)
        finally:
            numba.config.CACHE_DIR = before
    return dispatcher


def argument_types(signature: Signature) -> tuple[types.Type, ...]:
    """Return what numba calls the types of an entry point's arguments."""
    return tuple(map(numba_type, signature.arguments))


def numba_type(value: Array | Scalar | Bundle) -> types.Type:
    """Return what numba calls a type of a signature."""
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
    """Return the folder of compiled kernels: as set, beside the sources, the user's, or the process's."""
    name = f"{_PREFIX}{sources_digest()[:16]}-{numba.__version__}"
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR) / name
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "proximity"
    beside = PACKAGE / "kernels" / "__pycache__"
    parent = next((folder for folder in (beside, user) if _is_ours(folder)), None)
    if parent is None:  # what is read from there is run: nobody else may have made it
        parent = Path(tempfile.mkdtemp(prefix=_PREFIX))
        atexit.register(shutil.rmtree, parent, ignore_errors=True)
    folder = parent / name
    if not folder.exists():
        for old in parent.glob(_PREFIX + "*"):
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _is_ours(folder: Path) -> bool:
    """Whether this user may write to a folder, made if absent, and nobody else owns it or has the world's."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            status = folder.stat()
    except OSError:
        return False
    return os.name == "nt" or (status.st_uid == os.geteuid() and not status.st_mode & stat.S_IWOTH)


class _SharedCache(FunctionCache):
    """numba's cache, for processes that compile at the same time.

    To keep a version of a function numba reads the list of those that are kept, and then writes the list with
    one more and the code. Of two processes that did so at once, the list of one could lead to the code of the
    other, for arguments of other types.
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
    """Wait until no other process is in such a block for this folder, where the system can tell."""
    if fcntl is None:
        yield
        return
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "lock").open("ab") as lock:
        with suppress(OSError):  # of a file system that knows no locks
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield
