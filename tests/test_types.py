"""What a type checker knows of answers."""

import subprocess
import sys

SNIPPET = """
import numpy as np
import numpy.typing as npt
import proximity

Reals = npt.NDArray[np.float64]
scene = proximity.load("part.stl")
points, ways = np.zeros((5, 3)), [[0, 0, 1]]

hits = scene.closest(points, max_distance=[0.1])
near: Reals = hits.point[hits.signed_distance < 0.01]
depth: float = float(scene.closest((0.0, 0.0, 0.0)).signed_distance)
reals: list[Reals] = [hits.signed_distance, hits.gradient, hits.barycentric]
reals += [scene.signed_distance(points), scene.distance(points), scene.cast_distance(points, ways)]
reals += [scene.cast(points, ways).normal, scene.closest_to_segments(points, ways).fraction]
faces: npt.NDArray[np.int32] = hits.face_id
flags: npt.NDArray[np.bool_] = hits.is_signed
held: npt.NDArray[np.bool_] = scene.contains(points)

wrong_face: Reals = hits.face_id
wrong_point: str = hits.point
wrong_flag: Reals = hits.is_signed
wrong_distance: Reals = scene.contains(points)
wrong_hit: npt.NDArray[np.int32] = scene.cast(points, ways).distance
scene.closest(points, max_distance=object())
"""


def test_types_of_answers_are_known(tmp_path):
    """Where a type were not known, what is wrong would pass."""
    user = tmp_path / "user.py"
    user.write_text(SNIPPET)

    checked = [sys.executable, "-m", "mypy", "--strict", "--config-file=", f"--cache-dir={tmp_path}/cache"]
    done = subprocess.run([*checked, str(user)], capture_output=True, text=True)

    wrong = [k for k, line in enumerate(SNIPPET.splitlines(), 1) if "wrong_" in line or "object()" in line]
    found = [line for line in done.stdout.splitlines() if ": error: " in line and "user.py" in line]
    assert [int(line.split("user.py:")[1].split(":")[0]) for line in found] == wrong, done.stdout
