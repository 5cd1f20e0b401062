"""State of the compiled files: whether they match the sources. Needs only Python."""

import hashlib
import importlib.util
import os
from functools import cache
from pathlib import Path
from types import ModuleType

from kernel_build.targets import Target, made_files

ROOT = Path(__file__).resolve().parent.parent.parent


@cache
def sources() -> ModuleType:
    """Return ``proximity.native.sources``, loaded without its package, which needs NumPy."""
    path = ROOT / "proximity" / "native" / "sources.py"
    spec = importlib.util.spec_from_file_location("kernel_sources", path)
    assert spec is not None and spec.loader is not None, f"{path} can be loaded"
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def sources_digest() -> str:
    """Return the digest of all sources of kernels."""
    return str(sources().sources_digest())


def every_set_is_wanted() -> bool:
    """Return whether the environment requests every set of instructions."""
    return os.environ.get("PROXIMITY_INSTRUCTIONS") == "all"


def digest_in_c() -> str:
    """Return the digest of the C code next to kernels."""
    return str(sources().digest_in_c())


def library_digest() -> str:
    """Return the digest of the library in C: of kernels, its own files, and generated code."""
    patterns = (
        "core/*/*.c", "core/*/*.h", "core/*/*.in", "core/*.py", "scene/**/*.py",
        "__init__.py", "tracker/*.py", "message/*.py", "../tools/core_tables.py",
    )  # fmt: skip
    package = ROOT / "proximity"
    files = sorted(path for pattern in patterns for path in package.glob(pattern))
    content = b"".join(path.read_bytes() for path in files)
    return hashlib.sha256(sources_digest().encode() + content).hexdigest()[:32]


def core_digest() -> str:
    """Return the digest of the C sources of `proximity.core`, as `library_in_c` compares it."""
    return str(sources().core_digest())


def is_current(target: Target, folder: Path, *, every_set: bool) -> bool:
    """Return whether the extension module and library of a target in a folder match the sources."""
    files = made_files(target, folder, every_set=every_set)
    sets = [f"for {each.name}" for each in target.sets if every_set]
    words = [[library_digest(), *([] if target.is_web else sets)]] * len(files)
    if target.extension:
        words = [[sources_digest(), digest_in_c(), *sets], [library_digest(), *sets]]
        words += [[library_digest(), *sets]] if target.static_library else [[]]  # no import library's
    wanted = dict(zip(files, words, strict=False))
    contents = {path: path.read_bytes() if path.is_file() else b"" for path in wanted}
    return all(word.encode() + b"\0" in contents[path] for path in wanted for word in wanted[path])
