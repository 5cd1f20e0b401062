"""A signed distance field: distances on a grid around a part, saved as .npz, and checked.

Start it with your part and the distance between grid points in millimetres, or without both for
the sample bracket and 1 mm:

    python examples/distance_field.py
    python examples/distance_field.py part.step 0.5

It writes field.npz into the folder in which it is started: `origin` (3,) and `spacing` in metres, and
`distance` (X, Y, Z) as float32 in metres, negative inside the part. It prints the size of the grid and the
elapsed time. Then it reads the file again and compares it with exact distances at 10000 random points. It
prints the number of errors above the bound of the grid, which must be 0, and the median and largest error.
"""

import sys
import time
from pathlib import Path

import numpy as np
from scipy.interpolate import RegularGridInterpolator

import proximity

BRACKET = Path(__file__).resolve().parent.parent / "meshes" / "bracket.stl"
BORDER = 0.010  # m, of the grid around the part


def sample(scene, spacing):
    """Return the corner of the grid, (3,) in metres, and the signed distance at each of its points."""
    lower, upper = scene.bounds
    origin = lower - BORDER
    counts = np.ceil((upper + BORDER - origin) / spacing).astype(int) + 1
    axes = [origin[k] + spacing * np.arange(counts[k]) for k in range(3)]
    # A grid of points (X, Y, Z, 3) gives a grid of distances (X, Y, Z).
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return origin, scene.signed_distance(points, workers=-1)


def check(scene, path, count=10_000):
    """Compare the file with exact distances at random points: all errors and the largest allowed, m."""
    field = np.load(path)
    origin, spacing, distance = field["origin"], float(field["spacing"]), field["distance"]
    axes = [origin[k] + spacing * np.arange(distance.shape[k]) for k in range(3)]
    upper = [axis[-1] for axis in axes]
    points = np.random.default_rng(7).uniform(origin, upper, (count, 3))
    errors = np.abs(RegularGridInterpolator(axes, distance)(points) - scene.signed_distance(points))
    # A distance changes by no more than the displacement of its point. The error between grid points is
    # therefore at most the root of 3/4 of the spacing, plus the rounding to float32.
    return errors, np.sqrt(0.75) * spacing + 1e-7 * np.abs(distance).max()


def main():
    scene = proximity.load(sys.argv[1] if len(sys.argv) > 1 else BRACKET)
    spacing = 1e-3 * float(sys.argv[2] if len(sys.argv) > 2 else 1.0)

    started = time.perf_counter()
    origin, distance = sample(scene, spacing)
    took = time.perf_counter() - started
    np.savez_compressed("field.npz", origin=origin, spacing=spacing, distance=distance.astype(np.float32))
    print(f"{distance.shape} grid points, {distance.size} distances in {took:.2f} s: wrote field.npz")

    errors, allowed = check(scene, "field.npz")
    print(f"{np.sum(errors > allowed)} of {len(errors)} points are off by more than {1e3 * allowed:.3f} mm")
    print(f"median error {1e3 * np.median(errors):.4f} mm, largest {1e3 * errors.max():.3f} mm")


if __name__ == "__main__":
    main()
