"""Plots of parts that move while a finger rests on them: ``python bench/studies/moving_parts.py FOLDER``."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path[:0] = [str(ROOT / "tests" / "support" / name) for name in ("", "messages")]

from moving_parts import SITUATIONS, WALL, shown


def main(folder: Path) -> None:
    """Draw positions of part, drum and finger, and the force, one picture for each situation."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, situation in SITUATIONS.items():
        rows = shown(situation)
        rows = rows[rows.time > 0.4]
        figure, (places, forces) = plt.subplots(2, 1, sharex=True, figsize=(7.0, 5.0))
        for what, style in (("part", "k-"), ("drum", "C0-"), ("finger", "C1--")):
            places.plot(rows.time, 1e3 * (rows[what] - WALL), style, label=what)
        places.set(ylabel="on the finger's path (mm)", title=f"a part that {name}, 3 ms late, gear51")
        places.legend()
        forces.plot(rows.time, rows.force, "C3-")
        forces.set(xlabel="s", ylabel="force on the finger (N)", ylim=(0.0, None))
        figure.savefig(folder / f"{name}.png", dpi=90)
        plt.close(figure)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
