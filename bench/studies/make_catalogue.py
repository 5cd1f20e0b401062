"""Make a catalogue of machine parts by constructive geometry: random, the same on every run, of many sizes.

    python bench/studies/make_catalogue.py --count 1000

A part is a plate, a block or a shaft with bosses, balls and holes, 20 to 200 mm long; the number of segments
of its curves gives it between 10³ and 10⁶ faces, evenly in the logarithm.
"""

import argparse
import math
from pathlib import Path

import manifold3d
import numpy as np

FEWEST, MOST = 1e3, 1e6  # faces
SIZES = (20.0, 200.0)  # mm
ROUNDS = 3  # of adjusting the segments
MAX_SEGMENTS = 1024  # a ball has a million faces then; inside others, flat faces are divided instead
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def part(seed: int, segments: int) -> manifold3d.Manifold:
    """Return the part of a seed; circles have *segments* segments."""
    rng = np.random.default_rng(seed)
    length = rng.uniform(*SIZES)
    width, height = length * rng.uniform(0.2, 1.0, 2)
    solid = manifold3d.Manifold.cube((length, width, height), True)
    if rng.random() < 0.3:
        solid = manifold3d.Manifold.cylinder(length, 0.5 * height, -1.0, segments, True)
    for _ in range(rng.integers(1, 5)):
        radius = min(width, height) * rng.uniform(0.1, 0.4)
        at = rng.uniform(-0.5, 0.5, 3) * (length, width, height)
        ball = manifold3d.Manifold.sphere(radius, segments).translate(at)
        solid = solid + ball if rng.random() < 0.6 else solid - ball
    for _ in range(rng.integers(1, 7)):
        radius = min(length, width) * rng.uniform(0.03, 0.15)
        hole = manifold3d.Manifold.cylinder(3.0 * length, radius, -1.0, segments, True)
        turn = rng.choice([0.0, 90.0], 2)
        at = rng.uniform(-0.4, 0.4, 3) * (length, width, height)
        solid = solid - hole.rotate((turn[0], turn[1], 0.0)).translate(at)
    return solid


def sized(seed: int, faces: float) -> manifold3d.Manifold:
    """Return the part of a seed with about *faces* faces; those of balls grow quadratically."""
    segments = 64
    solid = part(seed, segments)
    for _ in range(ROUNDS):
        segments = min(max(8, round(segments * math.sqrt(faces / solid.num_tri()))), MAX_SEGMENTS)
        solid = part(seed, segments)
    divided = round(math.sqrt(faces / solid.num_tri()))
    return solid.refine(divided) if divided > 1 else solid


def write_stl(path: Path, solid: manifold3d.Manifold) -> None:
    """Write a binary STL in millimetres."""
    mesh = solid.to_mesh()
    facets = np.zeros(len(mesh.tri_verts), FACET)
    facets["corners"] = mesh.vert_properties[:, :3][mesh.tri_verts]
    path.write_bytes(bytes(80) + np.uint32(len(facets)).tobytes() + facets.tobytes())


def main() -> None:
    """Make the catalogue."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--folder", type=Path, default=Path(__file__).with_name("catalogue"))
    parser.add_argument("--first", type=int, default=0, help="number of the first part that is made")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    for number, faces in list(enumerate(np.geomspace(FEWEST, MOST, asked.count)))[asked.first :]:
        solid = sized(number, float(faces))
        write_stl(asked.folder / f"part-{number:04d}.stl", solid)
        print(f"part-{number:04d}: {solid.num_tri()} faces", flush=True)


if __name__ == "__main__":
    main()
