"""Times of the command line as whole processes, from start to end, and the file that they are asked about."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import cases

TORUS = {"ring_count": 250, "tube_count": 100}  # 50,000 faces
POINT = ("30", "10", "5")


def command_runs(folder: str) -> dict[str, Callable[[], None]]:
    """Return calls by name, each of which runs one command to its end."""
    make = cases.project_module("meshes", "make")
    path = Path(folder) / "torus.stl"
    path.write_bytes(make.stl_bytes(make.torus(**TORUS)))
    arguments = {
        "proximity --version": ("--version",),
        "proximity --help": ("--help",),
        "proximity query, 50,000 faces": ("query", str(path), *POINT),
    }
    return {name: _command(words) for name, words in arguments.items()}


def temporary_folder() -> tempfile.TemporaryDirectory:
    """A folder that goes away with its context."""
    return tempfile.TemporaryDirectory(prefix="proximity_bench_")


def _command(words):
    environment = dict(os.environ)
    script = Path(sys.executable).with_name("proximity")
    start = [str(script)] if script.is_file() else [sys.executable, "-m", "proximity"]
    folders = [str(cases.PROJECT), *filter(None, [environment.get("PYTHONPATH")])]
    environment["PYTHONPATH"] = os.pathsep.join(folders)
    # As it is for whoever does not ask for something else: Python keeps what it has made of sources.
    environment.pop("PYTHONDONTWRITEBYTECODE", None)

    def run():
        done = subprocess.run([*start, *words], capture_output=True, text=True, env=environment, check=False)
        if done.returncode:
            raise RuntimeError(f"{' '.join(words)} ended with {done.returncode}: {done.stderr.strip()}")

    return run
