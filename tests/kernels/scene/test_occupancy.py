"""Lists of parts that may contain a point: complete and short."""

import numpy as np
import pytest
import shapes
from models import arrays_of
from scene_parts import some_pose

from proximity.kernels.geometry.frames import to_local
from proximity.kernels.layout import CELL_OUTSIDE
from proximity.kernels.scene.inside.containment import state_in_part
from proximity.kernels.scene.inside.part_grid import dynamic_turn_count, list_of
from proximity.kernels.scene.parts.assembly import CELLS_PER_PART
from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

FAR = np.array([1e4, -7e3, 3e3])


def placed(name, solid, pose=None):
    return Part(name, solid, pose or Pose(), np.arange(solid.mesh.face_count, dtype=np.int32))


def listed(model, point):
    """The parts listed for a point, in their order."""
    first, last = list_of(model.words, model.frames, model.parts, *map(float, point))
    return model.words[first:last].view(np.int32).tolist()


def holders(model, point):
    """The parts whose box contains a point and whose own query does not exclude it."""
    arrays = arrays_of(model)
    found = []
    for part in range(len(model.parts) - 1):
        box = model.frames["box_lower"][part], model.frames["box_upper"][part]
        if (point < box[0]).any() or (point > box[1]).any():
            continue
        local = to_local(model.frames, model.parts, part, *map(float, point))
        if state_in_part(arrays, part, local) != CELL_OUTSIDE:
            found.append(part)
    return found


def scene_of(rng, count, *, spread=2.0, offset=0.0, is_turned=True):
    meshes = [shapes.cube(), shapes.sphere(0.6, 2), shapes.torus(0.7, 0.2), shapes.hollow_cube(1.2, 0.7)]
    solids = [Solid(*mesh) for mesh in meshes]
    poses = [
        some_pose(rng, spread) if is_turned else Pose(translation=rng.normal(size=3)) for _ in range(count)
    ]
    poses = [Pose(pose.rotation, pose.translation + offset) for pose in poses]
    return Scene([placed(f"part {k}", solids[k % 4], pose) for k, pose in enumerate(poses)])


def points_around(scene, rng, count):
    """Points within and slightly beyond the scene's box, on the surfaces, and very near them."""
    lower, upper = scene.bounds
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    anywhere = middle + 1.1 * half * rng.uniform(-1.0, 1.0, (count, 3))
    surface = scene.closest(anywhere).point
    return np.concatenate([anywhere, surface, surface + 1e-9 * rng.normal(size=(count, 3))])


def corners_of_cells(model, rng, count):
    """Corners of the grid's cells, and the floating point numbers next to them."""
    row, frame = model.parts[-1], model.frames[-1]
    counts = np.array([row["grid_x"], row["grid_y"], row["grid_z"]])
    lower = frame["grid_lower"]
    corners = lower + rng.integers(0, counts + 1, (count, 3)) / frame["grid_rate"]
    return np.concatenate([corners, np.nextafter(corners, np.inf), np.nextafter(corners, -np.inf)])


@pytest.mark.internals
@pytest.mark.parametrize("offset", [0.0, FAR], ids=["here", "10 km off"])
@pytest.mark.parametrize("is_turned", [False, True], ids=["shifted", "turned"])
@pytest.mark.parametrize("count", [2, 9, 40])
def test_no_part_that_may_hold_a_point_is_left_out(count, is_turned, offset):
    rng = np.random.default_rng(count)
    scene = scene_of(rng, count, offset=offset, is_turned=is_turned)
    model = scene.snapshot()

    some = 0
    for point in [*points_around(scene, rng, 150), *corners_of_cells(model, rng, 50)]:
        expected, found = holders(model, point), listed(model, point)
        assert set(expected) <= set(found)
        assert found == sorted(found)
        some += len(expected)
    assert some > 100


@pytest.mark.internals
def test_lists_name_few_parts():
    rng = np.random.default_rng(3)
    scene = scene_of(rng, 40, spread=4.0)
    points = points_around(scene, rng, 500)[:500]

    found = sum(len(listed(scene.snapshot(), point)) for point in points)

    assert found < 0.02 * 40 * len(points)


@pytest.mark.internals
@pytest.mark.parametrize("size", [1e-9, 1e60])
def test_scenes_of_any_size_have_their_lists(size):
    rng = np.random.default_rng(5)
    vertices, faces = shapes.sphere(0.6, 2)
    solid = Solid(size * vertices, faces)
    poses = [Pose(translation=size * rng.normal(size=3)) for _ in range(12)]
    scene = Scene([placed(f"part {k}", solid, pose) for k, pose in enumerate(poses)])
    model = scene.snapshot()

    for point in points_around(scene, rng, 60)[:120]:
        assert set(holders(model, point)) <= set(listed(model, point))


@pytest.mark.internals
def test_parts_in_one_place_have_fewer_cells_instead_of_longer_tables():
    count = 300
    solid = Solid(*shapes.cube())
    scene = Scene([placed(f"part {k}", solid, Pose(translation=(1e-3 * k, 0, 0))) for k in range(count)])
    row = scene.snapshot().parts[-1]

    cells = int(row["grid_x"] * row["grid_y"] * row["grid_z"])

    assert cells < CELLS_PER_PART * count / 8
    assert listed(scene.snapshot(), (0.65, 0.5, 0.5)) == list(range(count))
    assert scene.signed_distance((0.65, 0.5, 0.5)) == pytest.approx(-0.5)


@pytest.mark.internals
def test_a_part_without_an_inside_is_not_listed():
    sheet, ball = Solid(*shapes.grid(8, 8)), Solid(*shapes.sphere(0.3, 2))
    assert not sheet.has_inside
    scene = Scene([placed("sheet", sheet), placed("ball", ball, Pose(translation=(0.5, 0.5, 0.0)))])
    points = np.append(points_around(scene, np.random.default_rng(1), 100), [(0.5, 0.5, 0.1)], axis=0)

    assert {part for point in points for part in listed(scene.snapshot(), point)} == {1}


def test_a_scene_of_sheets_alone_has_no_cells():
    scene = Scene(
        [placed(f"sheet {k}", Solid(*shapes.grid()), Pose(translation=(0, 0, k))) for k in range(3)]
    )

    assert scene.snapshot().parts["grid_x"][-1] == 0
    assert scene.signed_distance((0.5, 0.5, 0.25)) == 0.25


@pytest.mark.internals
def test_a_part_asked_alone_is_listed_nowhere_though_its_scene_has_lists():
    scene = scene_of(np.random.default_rng(6), 4)
    solid = scene.parts[1].solid
    model = solid.snapshot()
    assert model.parts["grid_x"][1] > 0  # the part's own sign grid

    assert list_of(model.words, model.frames, model.parts, 0.1, 0.1, 0.1) == (0, 0)
    assert solid.contains((0.1, 0.1, 0.1))


@pytest.mark.internals
@pytest.mark.parametrize("loose", [1, 7, 8, 9, 30])
def test_parts_that_have_moved_are_found_where_they_are_and_nowhere_else(loose):
    rng = np.random.default_rng(loose)
    scene = scene_of(rng, 30)
    before = points_around(scene, rng, 100)
    names = [f"part {k}" for k in range(loose)]
    poses = [some_pose(rng, 2.0).matrix for _ in names]
    scene.move_many(names, poses)
    assert dynamic_turn_count(scene.snapshot().parts) == -(-loose // 8)

    anew = Scene(scene.parts)
    points = np.concatenate([before, points_around(scene, rng, 100)])

    assert np.array_equal(scene.contains(points), anew.contains(points))
    assert np.array_equal(scene.signed_distance(points), anew.signed_distance(points))
    assert scene.contains(points).any()


def test_of_equal_depths_the_lowest_part_counts_though_it_has_moved():
    cube = Solid(*shapes.cube(2.0, (0.0, 0.0, 0.0)))
    near, deep = Solid(*shapes.cube(0.5, (0.0, 0.0, 0.0))), Pose()
    scene = Scene(
        [
            placed("moved", cube, Pose(translation=(9, 0, 0))),
            placed("still", cube, deep),
            placed("near", near),
        ]
    )
    scene.move("moved", Pose())

    hit = scene.closest((0.0, 0.0, 0.0))

    assert (hit.part, hit.signed_distance) == (0, -1.0)
