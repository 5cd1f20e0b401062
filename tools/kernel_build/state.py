"""What has been compiled, and whether it is as the sources are. Needs nothing but Python."""

import importlib.util
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


def digest_in_c() -> str:
    """Return the digest of what is written in C beside kernels."""
    return str(sources().digest_in_c())


def is_current(target: Target, folder: Path) -> bool:
    """Return whether a folder holds the extension module of a target as the sources are now."""
    extension = extension_path(target, folder)
    content = extension.read_bytes() if extension.is_file() else b""
    return all(digest.encode() in content for digest in (sources_digest(), digest_in_c()))
