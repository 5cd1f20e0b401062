"""The tables that notebooks show of a scene, a part and answers."""

from xml.etree import ElementTree

import numpy as np
import pytest
import shapes
from project import MESHES
from scene_parts import part_of

import proximity
from proximity.scene.queries.html_table import MAX_ROWS


def cells(shown):
    """The rows of a table, as text; it is well formed."""
    table = ElementTree.fromstring(shown._repr_html_())
    return [["".join(cell.itertext()) for cell in row] for row in table.iter("tr")]


@pytest.fixture(scope="module")
def scene():
    return proximity.Scene([part_of(shapes.cube(), name="<b>&"), part_of(shapes.torus(), name="ring")])


def test_scene_has_a_row_for_each_part(scene):
    head, *rows = cells(scene)

    assert head[:2] == ["name", "faces"]
    assert [row[0] for row in rows] == ["<b>&", "ring"]
    assert cells(scene["ring"]) == [head, rows[1]]
    assert rows[0][1] == str(scene[0].solid.mesh.face_count)


def test_closed_scene_has_no_rows():
    scene = proximity.Scene([part_of(shapes.cube(), name="cube")])
    scene.close()

    assert len(cells(scene)) == 1


@pytest.mark.parametrize("shape", [(), (3,), (2, 4), (0,), (MAX_ROWS + 5,)])
def test_answers_have_a_row_each_up_to_a_limit(scene, shape):
    hit = scene.closest(np.full((*shape, 3), 0.2))

    head, *rows = cells(hit)

    count = int(np.prod(shape))
    assert head[1] == "signed_distance"
    assert len(rows) == min(count, MAX_ROWS) + (count > MAX_ROWS)
    if shape == ():
        assert rows[0][1] == f"{hit.signed_distance:.9g}"
    if count > MAX_ROWS:
        assert "5 more" in rows[-1][0]


def test_rays_segments_pairs_and_overlaps_are_shown(scene):
    answers = [
        scene.cast([[5.0, 0.0, 0.0]], [[-1.0, 0.0, 0.0]]),
        scene.closest_to_segments([[5.0, 0.0, 0.0]], [[5.0, 1.0, 0.0]]),
        scene.clearance(0, 1),
        proximity.Overlap(1.0, np.zeros(3), np.ones(3)),
        scene.gap(0, 1, [1.0, 0.0, 0.0]),
        scene.clearance_along(0, proximity.Motion.slide([1.0, 0.0, 0.0], 0.0, 0.1)),
    ]

    assert [len(cells(answer)) for answer in answers] == [2] * len(answers)


def test_verification_has_a_row_for_each_requirement(tmp_path):
    file = tmp_path / "fit.toml"
    model = (MESHES / "assembly.glb").as_posix()
    file.write_text(
        f'model = "{model}"\n'
        '[[require]]\nname = "apart"\nbetween = ["pin_left", "pin_right"]\ngap = { least = 40 }\n'
        '[[require]]\nname = "free"\nclash = { deepest = 0.05 }\n'
    )

    head, *rows = cells(proximity.verify(file))

    assert head[:3] == ["name", "kind", "verdict"]
    assert [row[0] for row in rows] == ["apart", "free"]
