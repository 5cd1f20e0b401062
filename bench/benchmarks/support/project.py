"""Locations of the project's files and modules for scripts and other processes."""

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

PROJECT = Path(__file__).resolve().parents[3]
BENCH = PROJECT / "bench"
MESHES = PROJECT / "meshes"
SHARED_DATA = PROJECT.parent / "shared" / "data"
"""Real parts and recordings next to the project; absent on most machines."""
SHARED_PARTS = SHARED_DATA / "cad"
SHARED_HANDS = SHARED_DATA / "hands"
TEMPORARY_PREFIX = "proximity_bench_"


def project_module(folder: str, name: str) -> ModuleType:
    """Return the module *name* in *folder* of the project, outside the package.

    Modules of the tests import one another: their helpers are found as well.
    """
    for needed in (folder, "tests/support"):
        if str(PROJECT / needed) not in sys.path:
            sys.path.append(str(PROJECT / needed))
    return importlib.import_module(name)


def environment() -> dict[str, str]:
    """Environment variables of a new process that imports the package from this project."""
    folders = [str(PROJECT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
