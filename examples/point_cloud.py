"""A point cloud against a part: deviations of scanned points from the CAD surface, as CSV and as a picture.

Start it with a part and the points of your scan (a CSV file of x, y, z in millimetres, one header line), or
without both for the sample bracket and a synthetic scan, with noise and a dent:

    python examples/point_cloud.py
    python examples/point_cloud.py part.step scan.csv

It writes deviations.csv (x, y, z, the signed deviation and the nearest surface point, all in millimetres)
and deviations.png into the folder in which it is started. It prints the mean and the largest deviation, and
the number of points farther than 0.1 mm from the surface. Deviations are positive (blue) outside the part and
negative (red) inside. It needs: pip install matplotlib
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import proximity

BRACKET = Path(__file__).resolve().parent.parent / "meshes" / "bracket.stl"
TOLERANCE = 1e-4  # m


def made_up_scan(scene, count=4000):
    """Return points on the surface of the scene's first part, with noise and a dent, (count, 3) in metres."""
    rng = np.random.default_rng(7)
    mesh = scene.parts[0].solid.mesh
    corners = mesh.vertices[mesh.faces]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    chosen = corners[rng.choice(len(corners), count, p=areas / areas.sum())]
    points = np.einsum("nk,nkd->nd", rng.dirichlet([1, 1, 1], count), chosen)
    points += rng.normal(0.0, 2e-5, points.shape)
    centre = [0.035, 0.020, 0.004]
    depth = 4e-4 * np.exp(-np.sum((points - centre) ** 2, axis=1) / 6e-3**2)
    return points - depth[:, None] * scene.closest(points).gradient


def main():
    if len(sys.argv) not in (1, 3):
        sys.exit("expected a part and a scan, or neither")
    scene = proximity.load(sys.argv[1] if len(sys.argv) > 1 else BRACKET)
    for note in scene.report.notes:  # such as an unlikely size
        print(f"note: {note}")
    if len(sys.argv) > 1:
        points = 1e-3 * np.loadtxt(sys.argv[2], delimiter=",", skiprows=1, usecols=(0, 1, 2), ndmin=2)
    else:
        points = made_up_scan(scene)

    # One call for all points, on all processor cores.
    hits = scene.closest(points, workers=-1)
    deviation = hits.signed_distance

    table = 1e3 * np.column_stack([points, deviation, hits.point])
    header = "x,y,z,deviation,surface_x,surface_y,surface_z"
    np.savetxt("deviations.csv", table, fmt="%.4f", delimiter=",", header=header, comments="")

    figure = plt.figure(figsize=(9, 4), layout="constrained")
    left = figure.add_subplot(1, 2, 1, projection="3d")
    limit = 1e3 * np.abs(deviation).max()
    drawn = left.scatter(*(1e3 * points).T, c=1e3 * deviation, s=5, cmap="RdBu", vmin=-limit, vmax=limit)
    left.set(xlabel="x [mm]", ylabel="y [mm]", zlabel="z [mm]", aspect="equal")
    figure.colorbar(drawn, label="deviation [mm]", shrink=0.7, pad=0.12)
    right = figure.add_subplot(1, 2, 2)
    right.hist(1e3 * deviation, bins=80, log=True)
    right.set(xlabel="deviation [mm]", ylabel="points")
    figure.savefig("deviations.png", dpi=120)

    print(f"{len(points)} points against {len(scene.parts)} part")
    print(f"mean of the deviations    {1e3 * deviation.mean():7.4f} mm")
    print(f"largest outside           {1e3 * deviation.max():7.4f} mm")
    print(f"largest inside            {1e3 * deviation.min():7.4f} mm")
    print(f"farther than {1e3 * TOLERANCE:g} mm       {np.sum(np.abs(deviation) > TOLERANCE):4d} points")
    print("wrote deviations.csv and deviations.png")


if __name__ == "__main__":
    main()
