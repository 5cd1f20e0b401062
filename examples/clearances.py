"""Clearances in an assembly: the distances between all pairs of parts, and the overlaps.

Start it with your STEP, glTF or 3MF file, or without one for the sample assembly:

    python examples/clearances.py
    python examples/clearances.py gearbox.step

It prints one line for each pair of parts, the narrowest gap first: the shortest distance in millimetres, and
its two end points. Parts that touch or overlap have the distance 0, or about 1e-6 mm if a STEP file is
rounded to single precision. Below the table it lists the
overlapping pairs, with the common volume and the size of the box around it.
"""

import sys
from pathlib import Path

import proximity

SAMPLE = Path(__file__).resolve().parent.parent / "meshes" / "assembly.step"


def millimetres(point):
    """Return a point in metres as text in millimetres."""
    return "(" + ", ".join(f"{1e3 * coordinate + 0.0:5.1f}" for coordinate in point) + ")"


def main():
    scene = proximity.load(sys.argv[1] if len(sys.argv) > 1 else SAMPLE)

    # Every pair of parts once, the nearest first. A result has the distance and its two ends, in metres.
    found = scene.closest_pairs()

    width = max(map(len, [part.name for part in scene.parts] + ["second"]))
    print(f"{'first':<{width}} {'second':<{width}} {'mm':>7}  from, mm -> to, mm")
    for gap in found:
        ends = f"{millimetres(gap.point_on_first)} -> {millimetres(gap.point_on_second)}"
        print(f"{gap.first:<{width}} {gap.second:<{width}} {1e3 * gap.distance:7.3f}  {ends}")
    print()
    print_overlaps(scene, [(gap.first, gap.second) for gap in found if gap.distance == 0.0])


def print_overlaps(scene, pairs):
    """Print the pairs of parts that have a common volume."""
    count = 0
    for first, second in pairs:
        try:
            common = proximity.overlap(scene, first, second)
        except proximity.MeshError as error:  # an open part has no volume
            print(f"{first} and {second}: unknown, {error}")
            continue
        if common is not None:  # None: they only touch
            count += 1
            size = " x ".join(f"{1e3 * side:.3f}" for side in common.upper - common.lower)
            print(f"{first} and {second} overlap by {1e9 * common.volume:.3f} mm3, in a box of {size} mm")
    print(f"pairs that overlap: {count}")


if __name__ == "__main__":
    main()
