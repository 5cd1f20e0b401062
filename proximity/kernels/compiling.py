"""How kernels are compiled, and where the compiled code is kept.

numba keeps a function's code as long as its own file is unchanged, even when a function that was compiled
into it has changed elsewhere. So the code is kept in a folder named after all sources together: whoever
edits or updates them gets new code throughout, and the old folder is removed.
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
_PREFIX = "proximity-kernels-"


def _sources() -> list[Path]:
    return sorted(path for folder in ("kernels", "simd") for path in (_PACKAGE / folder).glob("*.py"))


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@cache
def cache_folder() -> Path:
    """Return the folder of compiled kernels: as NUMBA_CACHE_DIR says, beside the sources, or the user's."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in _sources():
        digest.update(source.name.encode() + source.read_bytes())
    name = _PREFIX + digest.hexdigest()[:16]
    if numba.config.CACHE_DIR:
        return Path(numba.config.CACHE_DIR) / name
    user = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "proximity"
    beside = _PACKAGE / "kernels" / "__pycache__"
    parent = next((folder for folder in (beside, user) if _is_writable(folder)), Path(tempfile.gettempdir()))
    folder = parent / name
    if not folder.exists():
        for old in parent.glob(_PREFIX + "*"):
            shutil.rmtree(old, ignore_errors=True)
    return folder


def _compile(function: Callable[..., Any], **options: Any) -> Any:
    """What numba makes of *function*; its cache is in `cache_folder`."""
    before = numba.config.CACHE_DIR
    folder = str(cache_folder())
    numba.config.CACHE_DIR = folder
    try:
        return numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    finally:
        numba.config.CACHE_DIR = before


def kernel(function: Callable[..., Any]) -> Any:
    """Compile *function* when first called, and keep it on disk; it runs without the interpreter lock."""
    return _compile(function)


def inlined(function: Callable[..., Any]) -> Any:
    """Compile an innermost formula: always put into its caller."""
    return _compile(function, forceinline=True)
