"""Jobs of studies in tests: each logs its conditions to a file; some fail or end their worker."""

import os
import time
from pathlib import Path

from proximity.errors import ServiceError
from proximity.lab.study.study_file import read_study

FAILS, LEAVES = 13, 666
"""Numbers at which a job fails, and at which it ends its process."""


def count(*, number: int, speed: float = 1.0, wall: str = "hard", stiffness: float | None = None) -> dict:
    """Log a condition and return its measures."""
    with Path(os.environ["STUDY_DONE"]).open("a") as stream:
        stream.write(f"{number}\n")
    if number == FAILS:
        raise ServiceError("13 is an unlucky number")
    if number == LEAVES:
        os._exit(1)
    time.sleep(float(os.environ.get("STUDY_PAUSE", "0")))
    return {"square": float(number) ** 2, "cube": float(number) ** 3 * speed, "word": "=1"}


def measured(*, scene: Path, scale: float = 1.0) -> dict:
    """Return the size of a file."""
    return {"size": scale * scene.stat().st_size}


JOBS = {"count": count, "measured": measured}


def study_of(folder, factors, *, tail="", job="count"):
    """Write a study with some factors to a folder and read it."""
    path = Path(folder, "some.toml")
    path.write_text(f'[study]\njob = "{job}"\n\n[factors]\n{factors}\n{tail}\n')
    return read_study(path, JOBS)
