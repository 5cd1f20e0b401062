"""What builds of kernels keep in ``build/kernels`` for later ones: LLVM code, and objects of equal code.

Making the code takes about a quarter of a build for every set of instructions, the objects nearly all of the
rest.
"""

import hashlib
import zlib
from contextlib import suppress
from pathlib import Path

from core_tables import ENTRIES
from kernel_build.state import ROOT, sources_digest
from kernel_build.targets import Instructions, Target

FOLDER = ROOT / "build" / "kernels"
TAB = "\t"


def read(groups: tuple[int, ...]) -> tuple[list[str], str] | None:
    """Return the entry points and the kept code of groups for these sources, if any."""
    with suppress(OSError, zlib.error, UnicodeDecodeError):
        head, _, code = zlib.decompress(_path(groups).read_bytes()).decode("ascii").partition("\n")
        return head.split(TAB), code
    return None


def write(groups: tuple[int, ...], entries: list[str], code: str) -> None:
    """Store the code of groups, and remove all files of other sources."""
    _write(_path(groups), zlib.compress(f"{TAB.join(entries)}\n{code}".encode("ascii"), 1))


def read_object(code: str, target: Target, instructions: Instructions) -> bytes | None:
    """Return the kept object of this code for a set of instructions, if any."""
    with suppress(OSError):
        return _object_path(code, target, instructions).read_bytes()
    return None


def write_object(code: str, target: Target, instructions: Instructions, content: bytes) -> None:
    """Store the object of this code for a set of instructions."""
    _write(_object_path(code, target, instructions), content)


def _write(path: Path, content: bytes) -> None:
    with suppress(OSError):  # a read-only folder keeps none
        FOLDER.mkdir(parents=True, exist_ok=True)
        for old in FOLDER.iterdir():
            if old.name.split("-")[0] != path.name.split("-")[0]:
                old.unlink(missing_ok=True)
        unfinished = path.with_suffix(".unfinished")
        unfinished.write_bytes(content)
        unfinished.replace(path)


def _path(groups: tuple[int, ...]) -> Path:
    """Return the file of groups."""
    return FOLDER / f"{_digest()}-{'-'.join(map(str, groups))}.z"


def _object_path(code: str, target: Target, instructions: Instructions) -> Path:
    """Return the file of an object, named after what it is made of."""
    content = f"{sorted(ENTRIES)} {code}"
    name = f"{target.name}-{instructions.name}-{hashlib.sha256(content.encode('ascii')).hexdigest()[:32]}"
    return FOLDER / f"{_digest()}-{name}.o"


def _digest() -> str:
    """Return the digest of the sources of kernels and of their build, and of the version of numba."""
    from numba import __version__

    return hashlib.sha256(f"{sources_digest()} {__version__}".encode()).hexdigest()[:16]
