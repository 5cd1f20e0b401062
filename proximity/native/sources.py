"""Source files of compiled kernels, and the digests that identify the sources of compiled code."""

import hashlib
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent
TOOLS = PACKAGE.parent / "tools" / "kernel_build"
"""Folder of the kernel compiler. It exists in a checkout but not in an installed package."""
_PATTERNS = ("native/*.py", "native/simd/*.py", "kernels/**/*.py", "*/**/*_kernels.py", "core/cpython/*.[ch]")


def kernel_sources() -> list[Path]:
    """Return the source files of kernels and of the code that declares and compiles them."""
    files = {path for pattern in _PATTERNS for path in PACKAGE.glob(pattern)}
    if TOOLS.is_dir():
        files |= {path for path in TOOLS.rglob("*") if path.suffix in {".py", ".h"}}
    return sorted(files)


def entry_modules(name: str = "") -> list[str]:
    """Return the modules of the engine that declare entry points.

    With *name*, return only those that define it.
    """
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.glob("kernels/**/*.py"))}
    found = (path for path, text in texts.items() if "\n@entry(" in text and f"\ndef {name}" in text)
    return [".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts) for path in found]


def sources_in_c() -> list[Path]:
    """Return the C sources of the extension, except those of kernels."""
    controller = ("decaff/controller/*.c", "decaff/controller/*.in", "decaff/controller/records.py")
    patterns = (*controller, "core/receiver/*", "core/receiver_state.py")
    return sorted(path for pattern in patterns for path in PACKAGE.glob(pattern))


def core_sources() -> list[Path]:
    """Return the C sources of `proximity.core`, and the records that they share with Python."""
    core = PACKAGE / "core"
    in_c = (path for path in core.rglob("*") if path.suffix in {".c", ".h", ".in"})
    return sorted([*in_c, core / "loop_records.py", core / "receiver_state.py"])


@cache
def sources_digest() -> str:
    """Return the digest of all sources of kernels."""
    return _digest_of(kernel_sources())


@cache
def digest_in_c() -> str:
    """Return the digest of `sources_in_c`."""
    return _digest_of(sources_in_c())


@cache
def core_digest() -> str:
    """Return the digest of `core_sources`."""
    return _digest_of(core_sources())


def _digest_of(sources: list[Path]) -> str:
    digest = hashlib.sha256()
    for source in sources:
        content = source.read_bytes()
        digest.update(f"{source.name} {len(content)} ".encode() + content)
    return digest.hexdigest()[:32]
