"""Clearances in an assembly: how far each part is from each other part, as a table.

Start it with a STEP, glTF or 3MF file of your own, or without one for the sample assembly:

    python examples/clearances.py
    python examples/clearances.py gearbox.step

It prints one line for each pair of parts, the narrowest gap first: the shortest distance in millimetres,
and the two points between which it is found. Parts that touch or overlap have the
distance 0, or some 1e-6 mm where a STEP file is rounded to single precision.
"""

import sys
from itertools import combinations
from pathlib import Path

import proximity

SAMPLE = Path(__file__).resolve().parent.parent / "meshes" / "assembly.step"


def millimetres(point):
    """Return a point in metres as text in millimetres."""
    return "(" + ", ".join(f"{1e3 * coordinate + 0.0:5.1f}" for coordinate in point) + ")"


def main():
    scene = proximity.load(sys.argv[1] if len(sys.argv) > 1 else SAMPLE)
    names = [part.name for part in scene.parts]

    # Every pair of parts once. The result has the distance and its two end points, in metres.
    found = [(proximity.clearance(scene, *pair), *pair) for pair in combinations(names, 2)]
    found.sort(key=lambda row: row[0].distance)

    width = max(map(len, [*names, "second"]))
    print(f"{'first':<{width}} {'second':<{width}} {'mm':>7}  from, mm -> to, mm")
    for gap, first, second in found:
        ends = f"{millimetres(gap.point_on_first)} -> {millimetres(gap.point_on_second)}"
        print(f"{first:<{width}} {second:<{width}} {1e3 * gap.distance:7.3f}  {ends}")


if __name__ == "__main__":
    main()
