"""Output of ``query`` and ``check``, compared with ``texts``; PROXIMITY_UPDATE_TEXTS=1 writes them.

The scenes are analytic spheres of radius 10 mm, about the origin or in a row along x.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from fake_scene import RADIUS, FakeRepairs, FakeScene

import proximity
from proximity.pose import Pose


def balls(count):
    """Return equal balls, 30 mm apart along x and rotated by a quarter about x; their repairs differ."""
    scene = FakeScene()
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    ball, parts = vars(scene.parts[0]), []
    for number in range(count):
        repairs, samples = FakeRepairs(), 260 + number
        repairs.describe = lambda merged=4 + number % 3: f"Merged {merged} of 30 vertices."
        words = f"closed; agrees with the winding number at {samples} of {samples} sample points"
        solid = SimpleNamespace(**{**vars(ball["solid"]), "sign_reason": words})
        given = {"name": f"b{number}", "pose": Pose(turn, [0.030 * number, 0.0, 0.0]), "repairs": repairs}
        parts.append(SimpleNamespace(**{**ball, **given, "solid": solid}))
    scene.parts = tuple(parts)
    return scene


def too_far():
    """Return a scene whose distances cannot be computed."""
    scene = FakeScene()
    hits = scene.closest(np.array([[0.0, 0.0, np.nan]]))
    hits.distance, hits.normal = np.full(1, np.nan), np.full((1, 3), np.nan)
    scene.closest = scene.cast = lambda *_, **__: hits
    return scene


def in_inches():
    scene = FakeScene()
    scene.report.units = "in"
    scene.parts[0].pose = Pose(None, [RADIUS + 1e-17, 0.0, 0.0])
    return scene


POINTS = "name,x,y,z\nA,0,0,12.5\nB,1,2,nan\n=C,-4,0,0\n"
SCENES = {
    "ball": (
        FakeScene,
        """
        query ball.stl 0 0 12.5
        query ball.stl 4 0 0
        query ball.stl 10 0 0
        query ball.stl -6.9e-15 0 12
        query ball.stl -6.9e-15 0 12 --json
        query ball.stl 0 0 12 --units MM
        query ball.stl 0 0 12 --units inch
        query ball.stl 0 0 12 --units Inches
        query ball.stl --points - --json < 0.1 0.2 0.3;nan 0 0
        query ball.stl --points - --units mm < nan 0 -inf
        query ball.stl 0 0 50 --ray 0 0 -1
        query ball.stl 0 0 50 --ray 0 0 1
        query ball.stl 0 0 12 0 0 30 --segment
        query ball.stl 0 0 0 0 0 30 --segment
        query ball.stl --points - --segment < 0 0 nan;0 0 nan
        query ball.stl --points -
        query ball.stl --points - --csv -
        query ball.stl --points - --json
        query ball.stl 0 0 1.5 --units cm --json
        query ball.stl 1e308 0 0 --units km --json
        query ball.stl --json --units mm -0 -.6e1 -8
        query ball.stl 0 0 20 90 0 20 --ray 0 0 -1
        query ball.stl --ray 0 0 -1 -6 0 20 0 0 20 --json
        query ball.stl --ray 0 0 -1 -6 0 20 0 0 20 --csv -
        query ball.stl 0 0 20 90 0 20 0 0 20 90 0 20 --segment
        query ball.stl 0 0 12 0 0 30 0 15 0 0 40 0 --segment --json
        query ball.stl 0 0 12 0 0 30 0 15 0 0 40 0 --segment --csv -
        query ball.stl --points - < # none
        query ball.stl --points - --json < # none
        query ball.stl --points - --csv - < # none
        query ball.stl --points - --csv - < id,x,y,z,residual,part,side,note;7,0,0,11,-0.5,lid,left,=A1
        query ball.stl --points - --json < id,x,y,z,part,side;7,0,0,11,lid,left
        query ball.stl --points - --segment --csv - < id,x,y,z;7,0,0,11;8,0,0,12
        query ball.stl 1e5 123456.789 -1e12 0.00001 -0.00001 0
        query ball.stl --points - --json < 0 0 11;0 0 12;0 0 13;0 0;0 0 14
        query ball.stl --points - < 0 0 11;0 0 12;0 0 13;0 0;0 0 14
        query ball.stl --points - --segment --csv - < 0 0 12;0 0 30;0 0 12;0 0 30;0 0 40
        query ball.stl --points - --segment --csv - < name,x,y,z;A1,0,0,11;B2,0,0,12
        query ball.stl --points - --segment < name,x,y,z;A1,0,0,11;B2,0,0,12
        query ball.stl --points - < name,x,y,z;A1,0,0,11
        query ball.stl 0 0 50 --ray 0 0 -1 --csv - --units in
        query ball.stl --points - --csv - < 0 0 11;0 0 20009;0 0 20011;-3e6 4e6 10;nan 0 0
        query ball.stl --points - --units cm < x_mm,y_mm,z_mm;0,0,1
        check ball.stl
        check ball.stl --json
        check ball.stl --strict
        """,
    ),
    "sheet": (
        lambda: FakeScene(has_inside=False),
        """
        query sheet.stl 4 0 0
        query sheet.stl 4 0 0 0 0 10
        check sheet.stl
        check sheet.stl --strict --json
        """,
    ),
    "odd_name": (lambda: FakeScene(name="a\x1b[2Jb [red]"), "query odd.stl 4 0 0\ncheck odd.stl"),
    "far": (too_far, "query ball.stl 1e200 0 0\nquery ball.stl 1e200 0 0 --ray -1 0 0"),
    "inches": (in_inches, "check ball.stl --units in"),
    "balls": (lambda: balls(3), "check balls.stl --units cm\ncheck balls.stl --json"),
    "many_balls": (lambda: balls(23), "check balls.stl\ncheck balls.stl --all"),
}


@pytest.mark.parametrize("name", SCENES)
def test_what_is_printed_is_as_recorded(name, transcript, monkeypatch):
    make, commands = SCENES[name]
    replaced = {"load": lambda path, units, **options: make(), "kernels_are_cached": lambda: True}
    for what, by in replaced.items():
        monkeypatch.setitem(vars(proximity), what, by)

    transcript(name, commands, POINTS)
