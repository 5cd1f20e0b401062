"""Drum hits on a finger: ``python bench/drum_hits.py [--presses N] [--seed N] [--before COMMIT]``.

The controller in C, around a plant, runs seeded presses with faults in mid-flight; the known hazards are
tested with it and with that of an earlier commit.
"""

import argparse
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), *(str(ROOT / "tests" / "support" / name) for name in ("", "messages"))]

from drum_in_plant import POWERED, UNPOWERED, built, hazards, hits, said

from proximity.decaff.drum.drum_model import GEARS

BOUNDS = [0.0, 1e-3, 0.01, 0.03, 0.1, 0.3, 1.0, 1.25, 3.0, 10.0, 100.0, 1000.0]  # mJ
HAZARDS = {
    "parked": "H1 retracted drum, from where it should be, mm",
    "approach": "H1 hit of the next approach, mJ",
    "late": "H2 hit after a late sample, mJ",
    "sprung": "H2 hit of an unpowered drum, pushed to its stop, mJ",
    "unyielding": "H5 hit of a finger that does not yield, mJ",
    "heat": "H6 share of the continuous torque that heat allows",
}
STARTS = {(-1, -1): "H3 motor and encoder reversed", (-1, 1): "H4 motor reversed"}


def main() -> None:
    """Print the table of hazards, and the number of hits by energy."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--presses", type=int, default=10_000, help="of all gears together")
    options.add_argument("--seed", type=int, default=1, help="of the presses")
    options.add_argument("--before", default="73b12d75", help="commit of the earlier controller")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder, old = Path(scratch), Path(scratch, "before")
        old.mkdir()
        archive = subprocess.run(
            ["git", "archive", given.before, "proximity"], cwd=ROOT, check=True, capture_output=True
        )
        subprocess.run(["tar", "-x", "-C", old], input=archive.stdout, check=True)
        programs = {
            (name, gear): built(folder / f"{name} {gear}", gear, root)
            for name, root in (("before", old), ("after", ROOT))
            for gear in GEARS
        }
        _print_hazards(programs)
        count = -(-given.presses // len(GEARS))
        with ThreadPoolExecutor() as pool:
            found = dict(
                zip(
                    programs,
                    pool.map(lambda each: hits(each, given.seed, count), programs.values()),
                    strict=True,
                )
            )
    _print_hits(found, count)


def _print_hazards(programs: dict[tuple[str, str], Path]) -> None:
    found = {key: hazards(program) for key, program in programs.items()}
    print(f"{'':52}" + "".join(f"{gear:>18}" for gear in GEARS) + "   before, after")
    for name, words in HAZARDS.items():
        cells = [f"{found['before', gear][name]:.2f}, {found['after', gear][name]:.2f}" for gear in GEARS]
        print(f"{words:52}" + "".join(f"{cell:>18}" for cell in cells))
    for signs, words in STARTS.items():
        cells = []
        for gear in GEARS:
            came = [
                1e3 * float(said(programs[name, gear], "start", *signs, 1.0, "nan", 0.7, 1.9)[0][2])
                for name in ("before", "after")
            ]
            cells.append(f"{came[0]:.1f}, {came[1]:.1f}")
        print(f"{words + ', mm nearer to the finger':52}" + "".join(f"{cell:>18}" for cell in cells))


def _print_hits(found: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]], count: int) -> None:
    print(f"\nhits of {count} presses with each gear, by their energy")
    for what, row, most in (("with power", 0, POWERED), ("without", 1, UNPOWERED)):
        energies = {
            name: np.concatenate([found[name, gear][row] for gear in GEARS]) for name in ("before", "after")
        }
        counts = {name: np.histogram(each, BOUNDS)[0] for name, each in energies.items()}
        print(f"{what:>22} {'before':>9} {'after':>9}")
        for i, (low, high) in enumerate(pairwise(BOUNDS)):
            print(f"{f'{low:g} to {high:g} mJ':>22} {counts['before'][i]:9d} {counts['after'][i]:9d}")
        print(f"{'most, mJ':>22} {energies['before'].max():9.2f} {energies['after'].max():9.2f}")
        print(
            f"{f'above {most:g} mJ':>22}"
            + "".join(f" {(each > most).sum():9d}" for each in energies.values())
        )


if __name__ == "__main__":
    main()
