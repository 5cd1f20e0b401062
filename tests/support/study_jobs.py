"""Jobs of studies in tests: what they do is counted in a file, and some fail or take their worker along."""

import os
import time
from pathlib import Path

from proximity.errors import ServiceError
from proximity.lab.sweep.design import Factor, Job, Kind, Measure
from proximity.lab.sweep.study_file import read_study
from proximity.service.config.table_fields import Range

FACTORS = {
    "number": Factor(Kind.WHOLE, accepted=Range("", 0, 10**6)),
    "speed": Factor(Kind.NUMBER, 1.0, Range("m/s", 0.0, 10.0)),
    "wall": Factor(Kind.WORD, "hard", words=("hard", "soft")),
    "stiffness": Factor(Kind.NUMBER, None, Range("N/m", 0.0, 1e6), absent="rigid", only={"wall": ("soft",)}),
    "position": Factor(Kind.POINT, (0.0, 0.0, 0.0), Range("m")),
}
MEASURES = {"square": Measure("m²"), "cube": Measure()}
FAILS, LEAVES = 13, 666
"""Numbers for which a job fails, and for which it ends its process."""
HELD = "STUDY_HELD"
"""Environment variable: on a node that has it, a job makes this file and waits to be killed."""
HELD_SECONDS = 120.0


def run(values, files):
    """Note that a condition was done, and return its measures."""
    number = values["number"]
    done = Path(files.out, "done.txt")
    with open(done, "a") as stream:
        stream.write(f"{files.key}\n")
    if number == FAILS:
        raise ServiceError("13 is an unlucky number")
    if number == LEAVES:
        os._exit(1)
    if held := os.environ.get(HELD):
        Path(held).touch()
        time.sleep(HELD_SECONDS)
    time.sleep(float(os.environ.get("STUDY_PAUSE", "0")))
    return {"square": float(number) ** 2, "cube": float(number) ** 3 * values["speed"]}


COUNT = Job("count", FACTORS, MEASURES, run)
DRAW = Job("draw", {"scene": Factor(Kind.FILE), "colour": Factor(Kind.WHOLE, 0)}, MEASURES, run)
JOBS = {"count": COUNT, "draw": DRAW}


def study_of(folder, factors, *, head="", tail="", job="count"):
    """The study of a file with some factors, which is written to a folder."""
    path = Path(folder, "some.toml")
    path.write_text(f'[study]\njob = "{job}"\n{head}\n[factors]\n{factors}\n{tail}\n')
    return read_study(path, JOBS)


def done(out):
    """How often each condition was done, by its key."""
    lines = Path(out, "done.txt").read_text().splitlines()
    return {key: lines.count(key) for key in set(lines)}
