"""Every kernel also runs as plain Python, with bitwise equal results."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import shapes
from budgeted import UNLIMITED, walk
from models import model_of
from part_arrays import part_arrays
from project import IMPORT_PATHS

from proximity.kernels.part import sign_samples
from proximity.kernels.sign import inside_grid
from proximity.native import IS_AHEAD
from proximity.native.mode import INTERPRETED, MODE
from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

HERE = Path(__file__).resolve().parent
WALKED = (shapes.sphere(0.7, 2), shapes.grid(5, 4))
WALKED_POSE = Pose(shapes.rotation(3), (0.4, -0.2, 0.6))
RAY_FIELDS = ("distance", "point", "normal", "part", "face_id", "barycentric")
CROSSING_FIELDS = (*RAY_FIELDS, "is_entering", "offsets")
LINE_FIELDS = (
    "distance", "fraction", "point_on_segment", "point_on_solid", "part", "face_id", "barycentric"
)  # fmt: skip
FIELDS = ("signed_distance", "point", "gradient", "part", "face_id", "barycentric", "feature", "is_signed")


def things():
    """Solids with each method of sign, and a scene of two parts, one of them rotated."""
    cube, ball = Solid(*shapes.cube(), name="cube"), Solid(*shapes.sphere(0.7, 0), name="ball")
    deformed = Scene([ball, Solid(*shapes.torus(n=6, m=4), name="torus")])
    deformed.deform("torus", 1.5 * shapes.torus(n=6, m=4)[0] + 0.25)
    turned = Part("cube", cube, Pose(shapes.rotation(3), (0.4, -0.2, 0.6)), np.arange(12, dtype=np.int32))
    return {
        "cube": cube,
        "ball": ball,
        "overlapping": Solid(
            *shapes.join(shapes.tetrahedron(), shapes.moved(shapes.tetrahedron(), (0.2, 0.1, 0)))
        ),
        "sheet": Solid(*shapes.grid(2, 2)),
        "needle": Solid(*shapes.box((0, 0, 0), (1, 1e-9, 1e-12))),
        "far away": Solid(*shapes.moved(shapes.tetrahedron(), (1e4, -1e4, 1e4))),
        "scene": Scene([turned, ball]),
        "moved scene": moved_scene(cube, ball),
        "deformed": deformed,
    }


def moved_scene(cube, ball):
    """Parts that are static, moved or hidden, after repeated changes."""
    scene = Scene([cube, ball, Solid(*shapes.tetrahedron(), name="still")])
    scene.add(Solid(*shapes.tetrahedron(), name="hidden"))
    scene.hide("hidden")
    for step in range(2):
        scene.move("cube", Pose(shapes.rotation(step), (0.3, 0.1 * step, 0.5)))
        scene.closest((0.0, 0.0, 0.0))
    scene.move_many(["ball"], [Pose(translation=(-0.5, 0.2, 0.1))])
    return scene


def points_for(name):
    rng = np.random.default_rng(7)
    points = rng.uniform(-0.5, 1.5, (12, 3))
    special = [
        [0, 0, 0], [0.5, 0.5, 0.5], [1, 1, 1], [0.5, 0, 0.25], [np.nan, 0, 0], [np.inf, 0, 0], [1e9, 3, -1e8],
    ]  # fmt: skip
    return np.concatenate([points, special]) + ([1e4, -1e4, 1e4] if name == "far away" else 0.0)


def ticks():
    """Records of three fingers, one lost for a tick, among moving parts; with and without paths."""
    parts = [Solid(*shapes.cube(0.1, (0, 0, 0)), name="cube"), Solid(*shapes.sphere(0.05, 1), name="ball")]
    scene = Scene([*parts, Solid(*shapes.moved(shapes.grid(1, 1), (-0.5, -0.5, -0.2)), name="sheet")])
    scene.move(
        "ball", Pose(shapes.rotation(2), (0.2, 0, 0)), velocity=(-0.1, 0, 0), angular_velocity=(0, 1, 0)
    )
    tracker = Tracker(scene, fingers=3, budget=40)
    records = []
    for k in range(5):
        tips = np.array([(0.01, 0.02, 0.08 - 0.001 * k), (0.13, 0.0, 0.002 * k), (0.0, 0.3 - 0.01 * k, 0.3)])
        tips[2] = np.nan if k == 3 else tips[2]
        paths = np.stack([tips, 0.5 * tips, -tips], axis=1)
        given = {"paths": paths, "velocities": -tips} if k == 4 else {"paths": paths} if k == 2 else {}
        records.append(tracker.tick(tips, k * 1_000_000, k * 1_000_000 + 5_000, **given).copy())
        scene.move("cube", Pose(translation=(0, 0, 0.001 * k)), velocity=(0, 0, 1.0))
    return np.stack(records)


def answers(monkeypatch):
    """All results as one dictionary of arrays."""
    monkeypatch.setattr(sign_samples, "POINT_SAMPLE_COUNT", 2)  # interpreted, each costs a tenth of a second
    monkeypatch.setattr(inside_grid, "CELLS_PER_FACE", 1)
    found = {}
    with np.errstate(all="ignore"):
        for name, thing in things().items():
            points = points_for(name)
            hit = thing.closest(points)
            found |= {f"{name}, {field}": np.asarray(getattr(hit, field)) for field in FIELDS}
            found[f"{name}, within a limit"] = thing.closest(points, max_distance=0.3).signed_distance
            found[f"{name}, signed"] = thing.signed_distance(points)
            found[f"{name}, distance"] = thing.distance(points)
            if isinstance(thing, Scene):
                several = thing.closest_parts(points, most=2)
                found |= {f"{name}, several {field}": getattr(several, field) for field in FIELDS}
            if name != "sheet":
                found[f"{name}, contains"] = thing.contains(points)
            ends = np.roll(points, 1, axis=0)
            rays, lines = thing.cast(points, ends - points), thing.closest_to_segments(points, ends)
            found |= {f"{name}, ray {field}": np.asarray(getattr(rays, field)) for field in RAY_FIELDS}
            crossings = thing.cast_all(points, ends - points)
            found |= {f"{name}, crossing {field}": getattr(crossings, field) for field in CROSSING_FIELDS}
            beyond = thing.cast(points, ends - points, min_distance=0.5)
            found[f"{name}, ray beyond"] = beyond.distance
            found |= {f"{name}, segment {field}": np.asarray(getattr(lines, field)) for field in LINE_FIELDS}
        records = ticks()
        found |= {f"tick, {field}": records[field] for field in records.dtype.names}
        model = model_of(*WALKED, poses=[WALKED_POSE, Pose()])
        found["slabs"] = part_arrays(model, 0).moments
        if not IS_AHEAD:  # not an entry point
            found |= walks(model)
    return found


def walks(model):
    """Results of traversals with budgets."""
    found = {}
    for budget in (3, 40, UNLIMITED):
        points = [(0.4, -0.2, 0.6), (0.5, 0.5, 0.25), (2.0, 1.0, 0.0), (40.0, 3.0, -1.0)]
        found[f"with {budget} steps"] = np.array([walk(model, point, budget) for point in points])
    return found


@pytest.fixture(scope="module")
def interpreted(tmp_path_factory):
    """The results of a process with numba disabled."""
    path = tmp_path_factory.mktemp("answers") / "answers.npz"
    program = f"""
import sys
sys.path[:0] = [{str(HERE)!r}, *{IMPORT_PATHS!r}]
import numpy as np
import test_kernels_uncompiled
import pytest
np.savez({str(path)!r}, **test_kernels_uncompiled.answers(pytest.MonkeyPatch()))
"""
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    with np.load(path) as file:
        return dict(file)


@pytest.mark.skipif(MODE == INTERPRETED, reason="there is nothing compiled to compare with")
def test_interpreted_kernels_give_the_same_bits(interpreted, monkeypatch):
    compiled = answers(monkeypatch)

    assert interpreted.keys() >= compiled.keys()
    for name, expected in compiled.items():
        found = interpreted[name]
        assert found.dtype == expected.dtype, name
        np.testing.assert_array_equal(found, expected, err_msg=name)


def test_numbers_here_are_not_all_nothing(monkeypatch):
    found = answers(monkeypatch)

    assert (found["cube, signed"] < 0.0).any() and (found["cube, signed"] > 0.0).any()
    assert found["scene, contains"].any() and not found["scene, contains"].all()
    assert set(found["scene, part"].tolist()) == {-1, 0, 1}
    assert IS_AHEAD or (found["with 40 steps"][:, 2] < found[f"with {UNLIMITED} steps"][:, 2]).any()
    assert set(found["cube, feature"].tolist()) == {-1, 0, 1, 2}
    assert (
        np.isfinite(found["tick, contact_bend"]).any() and np.isfinite(found["tick, time_to_contact"]).any()
    )
    assert set(found["tick, part"].ravel().tolist()) == {-1, 0, 1}
