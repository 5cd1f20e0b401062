"""The presses of presses.toml in bare processes and as a study, in turns: conditions a second of both.

python bench/studies/bare_presses.py --cores 2
"""

import argparse
import statistics
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from proximity.lab.sweep.press_job import PRESS
from proximity.lab.sweep.study_file import Study, read_study
from proximity.lab.sweep.study_run import run_study


def study() -> Study:
    """The study beside this file."""
    return read_study(Path(__file__).with_name("presses.toml"), {PRESS.name: PRESS})


def share(first: int, step: int) -> float:
    """Do every *step*-th press, and return the seconds that it took, once everything is imported."""
    conditions = list(study().conditions)[first::step]
    PRESS.run(conditions[0].values, None)
    started = time.perf_counter()
    for condition in conditions:
        PRESS.run(condition.values, None)
    return time.perf_counter() - started


def main() -> None:
    """Compare them."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    ratios = []
    for _ in range(asked.rounds):
        with ProcessPoolExecutor(asked.cores) as pool:
            bare_s = max(pool.map(share, range(asked.cores), [asked.cores] * asked.cores))
        with tempfile.TemporaryDirectory() as folder:
            ended = run_study(study(), Path(folder), cores=asked.cores)
        bare = ended.done / bare_s
        ratios.append(ended.rate / bare)
        print(f"bare {bare:.0f} a second, study {ended.rate:.0f}: {ratios[-1]:.2f}", flush=True)
    print(f"median {statistics.median(ratios):.2f}")


if __name__ == "__main__":
    main()
