"""What has been compiled, and whether it is as the sources are. Needs nothing but Python."""

import importlib.util
import os
from functools import cache
from pathlib import Path
from types import ModuleType

from kernel_build.targets import Target, extension_path

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
    """Return whether the environment asks for every set of instructions."""
    return os.environ.get("PROXIMITY_INSTRUCTIONS") == "all"


def digest_in_c() -> str:
    """Return the digest of what is written in C beside kernels."""
    return str(sources().digest_in_c())


def is_current(target: Target, folder: Path, *, every_set: bool) -> bool:
    """Return whether a folder holds the extension module of a target as the sources are now."""
    extension = extension_path(target, folder)
    content = extension.read_bytes() if extension.is_file() else b""
    wanted = [sources_digest(), digest_in_c()] + [f"for {each.name}" for each in target.sets if every_set]
    return all(word.encode() + b"\0" in content for word in wanted)
