"""Draw two balls of a STEP file, their triangles, and the bounds of their clearance, for the documentation.

Run in a checkout; it writes docs/pictures/deviation.svg and prints the lengths.
"""

import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import proximity

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / "tests" / "support"))

RADIUS, GAP = 10.0, 1.0  # mm
TOLERANCE = 0.5  # mm, coarse enough to be seen


def measure() -> tuple[proximity.Scene, proximity.Clearance, proximity.Clearance]:
    """Return two balls, turned so that faces are opposite, and both clearances."""
    from step_text import ball_step

    with TemporaryDirectory() as folder:
        path = Path(folder) / "ball.step"
        path.write_text(ball_step(RADIUS))
        part = proximity.load(path, step_tolerance=1e-3 * TOLERANCE).parts[0]
    turn = proximity.Pose.from_quaternion(np.array([np.cos(0.1), 0.0, 0.0, np.sin(0.1)]), [0, 0, 0])
    ahead = replace(part, pose=turn)
    other = replace(part, name="other", pose=proximity.Pose(turn.rotation, [1e-3 * (2 * RADIUS + GAP), 0, 0]))
    scene = proximity.Scene([ahead, other])
    return scene, scene.clearance("ball", "other"), scene.clearance("ball", "other", surface="cad")


def section(part: proximity.Part) -> np.ndarray:
    """Return the segments, (N, 2, 2) mm, in which a plane cuts a part."""
    found = []
    height = 1e-6
    for triangle in part.solid.mesh.vertices[part.solid.mesh.faces]:
        points = triangle @ part.pose.rotation.T + part.pose.translation
        ends = []
        for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
            if (a[2] - height) * (b[2] - height) < 0.0:
                share = (height - a[2]) / (b[2] - a[2])
                ends.append((a + share * (b - a))[:2])
        if len(ends) == 2:
            found.append(ends)
    return 1e3 * np.array(found)


def main() -> None:
    """Write the drawing."""
    from matplotlib import pyplot
    from matplotlib.collections import LineCollection

    pyplot.rcParams.update({"svg.hashsalt": "deviation", "svg.fonttype": "none"})
    scene, triangles, cad = measure()
    figure, axes = pyplot.subplots(figsize=(7, 3.4))
    for part, middle in zip(scene.parts, (0.0, 2 * RADIUS + GAP), strict=True):
        axes.add_patch(pyplot.Circle((middle, 0), RADIUS, fill=False, color="tab:blue", label="CAD surface"))
        axes.add_collection(LineCollection(section(part), color="0.4", label="triangles"))
    rows = (
        (1.1, 0.0, GAP, "tab:blue", f"true distance {GAP:.2f} mm"),
        (0.0, 0.0, 1e3 * triangles.distance, "0.4", f"triangles {1e3 * triangles.distance:.2f} mm"),
        (-1.1, 1e3 * cad.lower, 1e3 * cad.distance, "tab:red",
         f"bounds {1e3 * cad.lower:.2f} to {1e3 * cad.distance:.2f} mm"),
    )  # fmt: skip
    start = RADIUS
    for height, low, high, color, words in rows:
        axes.plot([start, start + low], [height, height], color=color, lw=1)
        axes.plot([start + low, start + high], [height, height], color=color, lw=3, solid_capstyle="butt")
        axes.text(start + 1.9, height, words, color=color, va="center")
        print(words)
    axes.set(xlim=(9.0, 15.5), ylim=(-1.8, 1.8), aspect="equal")
    axes.axis("off")
    figure.savefig(ROOT / "docs" / "pictures" / "deviation.svg", metadata={"Date": None}, bbox_inches="tight")


if __name__ == "__main__":
    main()
