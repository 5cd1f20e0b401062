"""Commands of the package, each run as a whole process from start to end."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

from benchmarks.support.project import environment, project_module

TORUS = {"ring_count": 250, "tube_count": 100}  # 50,000 faces
POINT = ("30", "10", "5")


def command_runs(folder: str) -> dict[str, Callable[[], None]]:
    """Return calls by name, each running one command to its end."""
    make = project_module("meshes", "make")
    path = Path(folder) / "torus.stl"
    path.write_bytes(make.stl_bytes(make.torus(**TORUS)))
    arguments = {
        "proximity --version": ("--version",),
        "proximity --help": ("--help",),
        "proximity query, 50,000 faces": ("query", str(path), *POINT),
    }
    return {name: _command(words) for name, words in arguments.items()}


def _command(words):
    script = Path(sys.executable).with_name("proximity")
    start = [str(script)] if script.is_file() else [sys.executable, "-m", "proximity"]
    variables = environment()
    variables.pop("PYTHONDONTWRITEBYTECODE", None)  # by default Python keeps compiled sources

    def run():
        done = subprocess.run([*start, *words], capture_output=True, text=True, env=variables, check=False)
        if done.returncode:
            raise RuntimeError(f"{' '.join(words)} ended with {done.returncode}: {done.stderr.strip()}")

    return run
