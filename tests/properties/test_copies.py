"""Copies of solids, parts and scenes, in memory or sent to another process, are independent."""

import copy
import gc
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest
import shapes

from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

COPIES = {
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
}
copied_by = pytest.mark.parametrize("copied", COPIES.values(), ids=COPIES)


def two_parts():
    parts = [
        Part("ball", Solid(*shapes.sphere(0.1, 3)), Pose(), np.arange(1280, dtype=np.int32)),
        Part("cube", Solid(*shapes.cube(0.1, (0.3, 0.0, 0.0))), Pose(), np.arange(12, dtype=np.int32)),
    ]
    return Scene(parts)


def places(count=300):
    return np.random.default_rng(3).uniform(-0.4, 0.4, (count, 3))


def litter():
    """Reuse freed memory."""
    gc.collect()
    return [Solid(*shapes.sphere(1.0 + k, 3)) for k in range(20)]


@copied_by
@pytest.mark.parametrize("is_of_scene", [False, True])
def test_a_solid_outlives_what_it_is_a_copy_of(copied, is_of_scene):
    scene = two_parts()
    solid = scene.parts[0].solid if is_of_scene else Solid(*shapes.sphere(0.1, 3))
    expected = solid.closest(places())
    other = copied(solid)
    del scene, solid
    rubbish = litter()
    found = other.closest(places())

    assert len(rubbish) == 20
    assert found._table.tobytes() == expected._table.tobytes()
    assert (other.name, other.sign_method.value, other.is_watertight) == ("solid", "pseudo-normal", True)
    assert not other.mesh.vertices.flags.writeable and not other.mesh.faces.flags.writeable


def test_a_copy_of_a_solid_does_not_hold_the_scene_that_it_is_in():
    large = Scene([Solid(*shapes.sphere(0.1, 5), name="large"), Solid(*shapes.cube(0.1), name="small")])

    assert len(pickle.dumps(large.parts[1].solid)) < 30_000 < len(pickle.dumps(large.parts[0].solid))


def test_a_solid_that_a_scene_has_deformed_is_copied_with_the_shape_it_has():
    scene = two_parts()
    before = scene.parts[0].solid
    scene.deform("ball", 1.5 * before.mesh.vertices)
    for solid in (before, scene.parts[0].solid):
        expected = solid.signed_distance(places())
        assert (copy.deepcopy(solid).signed_distance(places()) == expected).all()


@copied_by
def test_a_part_outlives_what_it_is_a_copy_of(copied):
    part = two_parts().part("cube")
    expected = part.solid.signed_distance(places())
    other = copied(part)
    del part
    rubbish = litter()

    assert len(rubbish) == 20
    assert (other.solid.signed_distance(places()) == expected).all()
    assert Scene([other]).parts[0].name == "cube"
    with pytest.raises(ValueError, match="read-only"):
        other.pose.translation[0] = 1.0


@copied_by
def test_what_happens_to_a_copy_of_a_scene_does_not_happen_to_the_scene(copied):
    scene = two_parts()
    scene.move("ball", Pose(translation=(0.0, 0.0, 0.2)), velocity=(0.0, 0.0, 1.0))
    scene.hide("cube")
    expected = scene.closest(places())
    other = copied(scene)
    found = other.closest(places())

    np.testing.assert_allclose(found.signed_distance, expected.signed_distance, rtol=0.0, atol=1e-15)
    assert [part.name for part in other.parts] == ["ball", "cube"] and other.epoch == scene.epoch
    assert other.part("ball").velocity.tolist() == [0.0, 0.0, 1.0] and other.part("cube").is_hidden
    other.move("ball", Pose())
    other.show("cube")
    other.remove("ball")
    assert scene.closest(places())._table.tobytes() == expected._table.tobytes()
    assert [part.name for part in scene.parts] == ["ball", "cube"] and scene.part("cube").is_hidden


def distance_of(solid, point):
    """Return a distance in the other process."""
    return float(solid.distance(point))


def test_a_solid_is_asked_in_another_process():
    solid = two_parts().parts[1].solid
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        found = pool.submit(distance_of, solid, [1.0, 0.0, 0.0]).result()

    assert found == solid.distance([1.0, 0.0, 0.0])
