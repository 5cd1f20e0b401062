"""LLVM code of kernels, kept in ``build/kernels`` for the next target: making it takes most of a build."""

import hashlib
import zlib
from contextlib import suppress
from pathlib import Path

from kernel_build.state import ROOT, sources_digest

FOLDER = ROOT / "build" / "kernels"
TAB = "\t"


def read(groups: tuple[int, ...]) -> tuple[list[str], str] | None:
    """Return the entry points and the kept code of groups for these sources, if any."""
    with suppress(OSError, zlib.error, UnicodeDecodeError):
        head, _, code = zlib.decompress(_path(groups).read_bytes()).decode("ascii").partition("\n")
        return head.split(TAB), code
    return None


def write(groups: tuple[int, ...], entries: list[str], code: str) -> None:
    """Store the code of groups, and remove that of other sources."""
    path = _path(groups)
    with suppress(OSError):  # a read-only folder keeps none
        FOLDER.mkdir(parents=True, exist_ok=True)
        for old in FOLDER.glob("*.z"):
            if old.name.split("-")[0] != path.name.split("-")[0]:
                old.unlink(missing_ok=True)
        unfinished = path.with_suffix(".unfinished")
        unfinished.write_bytes(zlib.compress(f"{TAB.join(entries)}\n{code}".encode("ascii"), 1))
        unfinished.replace(path)


def remove() -> None:
    """Remove all kept code."""
    for path in FOLDER.glob("*.z"):
        path.unlink(missing_ok=True)


def _path(groups: tuple[int, ...]) -> Path:
    """Return the file of groups, named after the sources and this version of numba."""
    from numba import __version__

    digest = hashlib.sha256(f"{sources_digest()} {__version__}".encode()).hexdigest()[:16]
    return FOLDER / f"{digest}-{'-'.join(map(str, groups))}.z"
