"""All crossings of rays: against whole numbers, brute force, `cast` and `contains`."""

from fractions import Fraction

import numpy as np
import pytest
import shapes
from project import MESHES
from query_rows import CLOSED, solid_of, some_rays, some_scene

from proximity.errors import ArgumentError
from proximity.scene.loader import load
from proximity.scene.queries import crossings as tables
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

L_SHAPE = np.array([[[1, 1], [1, 0]], [[1, 1], [0, 0]]], dtype=bool)
WHOLE = {  # coordinates are whole numbers from 0 to 4
    "cube": lambda: shapes.box((0, 0, 0), (4, 4, 4)),
    "tetrahedron": lambda: (4.0 * shapes.tetrahedron()[0], shapes.tetrahedron()[1]),
    "octahedron": lambda: (2.0 * shapes.octahedron()[0] + 2.0, shapes.octahedron()[1]),
    "L-shape": lambda: (2.0 * shapes.voxels(L_SHAPE)[0], shapes.voxels(L_SHAPE)[1]),
    "hollow cube": lambda: shapes.hollow_cube(4.0, 2.0, (2.0, 2.0, 2.0)),
    "flush cubes": lambda: shapes.join(shapes.box((0, 0, 0), (2, 4, 4)), shapes.box((2, 0, 0), (4, 4, 4))),
}
STEPS = 8
"""Whole steps of a unit: coordinates of origins and targets."""


def grazing_rays(name, count, seed, *, largest=4):
    """Rays from and through corners, edges, faces and lattice points, in whole steps; largest component 4."""
    vertices, faces = WHOLE[name]()
    rng = np.random.default_rng(seed)
    corners = np.rint(vertices).astype(np.int64)[faces[rng.integers(len(faces), size=count)]]
    # Weights of eighths: corners, middles of edges, points of edges and faces.
    weights = np.array([[8, 0, 0], [4, 4, 0], [2, 6, 0], [4, 2, 2], [2, 2, 4]])[rng.integers(5, size=count)]
    targets = (corners * rng.permuted(weights, axis=1)[:, :, None]).sum(axis=1)
    directions = rng.integers(-largest, largest + 1, (count, 3)) * (rng.random((count, 3)) < 0.7)
    # Half of them along an edge or in a plane of a face.
    along = corners[:, 1] - corners[:, 0]
    directions = np.where((rng.random(count) < 0.5)[:, None], directions, along)
    if largest == 4:
        directions[np.arange(count), rng.integers(3, size=count)] = rng.choice([-4, 4], count)
    directions[~directions.any(axis=1), 0] = 4
    # Near enough that a start is not rounded: a ray from afar is started anew.
    back = rng.integers(4 if largest == 4 else 16, size=(count, 1))
    return targets - 2 * back * directions, directions


def exact_hits(name, origins, directions):
    """For every ray (parameter, sense, face, is within the face) of the faces that its line meets.

    And which rays run in the plane of a face that they meet. Origins in eighths, all in whole numbers; a
    parameter is a fraction, the sense of a face that the shifted line does not cross is 0.
    """
    vertices, faces = WHOLE[name]()
    corners = STEPS * np.rint(vertices).astype(np.int64)[faces]
    found, is_within = [], np.zeros(len(origins), dtype=bool)
    for row, (origin, way) in enumerate(zip(origins, directions, strict=True)):
        size = np.abs(way)
        z = 2 if max(size[0], size[1]) < size[2] else 0 if size[0] >= size[1] else 1
        x, y = (z + 1) % 3, (z + 2) % 3
        at = corners - origin
        px, py = way[z] * at[..., x] - way[x] * at[..., z], way[z] * at[..., y] - way[y] * at[..., z]
        if way[z] < 0:
            px, py = -px, -py
        sides, shifted = [], []
        for j, k in ((1, 2), (2, 0), (0, 1)):
            side = px[:, j] * py[:, k] - py[:, j] * px[:, k]
            rise, run = py[:, j] - py[:, k], px[:, k] - px[:, j]
            sides.append(side)
            shifted.append(np.sign(np.where(side != 0, side, np.where(rise != 0, rise, run))))
        sides, shifted = np.array(sides), np.array(shifted)
        total = sides.sum(axis=0)
        is_hit = ((sides >= 0).all(axis=0) | (sides <= 0).all(axis=0)) & (total != 0)
        is_crossed = (np.abs(shifted.sum(axis=0)) == 3) & is_hit
        height = (sides * at[..., z].T).sum(axis=0)
        hits = []
        for face in np.flatnonzero(is_hit):
            parameter = Fraction(int(height[face]), int(total[face] * way[z]))
            sense = (1 if (total[face] < 0) == (way[z] > 0) else -1) if is_crossed[face] else 0
            hits.append((parameter, sense, int(face), bool((sides[:, face] != 0).all())))
        found.append(sorted(hits))
        is_within[row] = (sides == 0).all(axis=0).any()
    return found, is_within


def exact_crossings(hits):
    """Parameter and sense of every place where the line changes its side, from the start on."""
    nets = {}
    for parameter, sense, _, _ in hits:
        if parameter >= 0:
            nets[parameter] = nets.get(parameter, 0) + sense
    return [(parameter, net > 0) for parameter, net in sorted(nets.items()) if net]


@pytest.mark.parametrize("name", sorted(WHOLE))
def test_grazing_rays_cross_as_in_whole_numbers(name):
    origins, directions = grazing_rays(name, 3000, 5)
    found = Solid(*WHOLE[name]()).cast_all(origins / STEPS, directions)
    lengths = np.linalg.norm(directions, axis=1)

    for row, hits in enumerate(exact_hits(name, origins, directions)[0]):
        expected, one = exact_crossings(hits), found[row]
        assert one.is_entering.tolist() == [is_entering for _, is_entering in expected], row
        distances = [float(parameter / STEPS) * lengths[row] for parameter, _ in expected]
        np.testing.assert_allclose(one.distance, distances, rtol=1e-14, atol=1e-14)
        # Each is on a face that the exact ray crosses in that sense.
        faces = {(round(float(t) * 1e9), face) for t, sense, face, _ in hits if sense}
        at = np.rint(one.distance / lengths[row] * STEPS * 1e9).astype(np.int64)
        assert set(zip(at.tolist(), one.face_id.tolist(), strict=True)) <= faces


@pytest.mark.parametrize("name", sorted({*WHOLE} - {"flush cubes"}))
def test_rays_that_rounding_moves_alternate_and_miss_nothing(name):
    """Directions such as (3, 1, 2) lean by thirds: rounding decides on which side of an edge they pass."""
    solid = Solid(*WHOLE[name]())
    origins, directions = grazing_rays(name, 2000, 6, largest=7)
    found = solid.cast_all(origins / STEPS, directions)
    signed = solid.signed_distance(origins / STEPS)
    is_clear, is_inside = np.abs(signed) > 1e-9, signed < 0.0
    lengths = np.linalg.norm(directions, axis=1) / STEPS

    assert is_clear.sum() > 1000
    assert (found.count % 2 == is_inside)[is_clear].all()
    hits_of_rays, is_within = exact_hits(name, origins, directions)
    for row, hits in enumerate(hits_of_rays):
        one = found[row]
        if is_clear[row]:
            assert_alternates(one, is_inside[row])
        exact = np.array([float(t) for t, _, _, _ in hits if t >= 0]) * lengths[row]
        inner = np.array([float(t) for t, _, _, is_inner in hits if t >= 0 and is_inner]) * lengths[row]
        # In the plane of a face, rounding decides where the ray passes through it.
        if not is_within[row]:
            assert (np.abs(one.distance[:, None] - exact).min(axis=1, initial=9.0) < 1e-12).all()
        assert (np.abs(inner[:, None] - one.distance).min(axis=1, initial=9.0) < 1e-12).all()


def assert_alternates(one, is_inside):
    """In and out by turns, the first against the side of the origin; distances grow."""
    expected = (np.arange(len(one.distance)) + is_inside) % 2 == 0
    assert (one.is_entering == expected).all()
    assert (np.diff(one.distance) > 0.0).all()


def brute_force(vertices, faces, origins, directions):
    """Ray, distance, face and sense of all crossings; and which rays come near an edge or start at a face."""
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    normals = np.cross(b - a, c - a)
    scale = np.ptp(vertices, axis=0).max()
    size = max(1, 2_000_000 // len(faces))
    rows, is_near_edge = [], np.zeros(len(origins), dtype=bool)
    for first in range(0, len(origins), size):
        o, d = origins[first : first + size, None], directions[first : first + size]
        moments = np.cross(o[:, 0], d)
        # The side of an edge p q on which a line passes: its Plücker coordinates.
        sides = [d @ np.cross(p, q).T + moments @ (q - p).T for p, q in ((b, c), (c, a), (a, b))]
        lengths = [np.linalg.norm(q - p, axis=1) for p, q in ((b, c), (c, a), (a, b))]
        slack = [1e-11 * scale * length for length in lengths]
        low, high = (np.minimum, np.maximum)
        is_hit = (low(low(sides[0], sides[1]), sides[2]) > 0) | (high(high(sides[0], sides[1]), sides[2]) < 0)
        is_close = [np.abs(side) < room for side, room in zip(sides, slack, strict=True)]
        near = np.zeros_like(is_hit)
        for k in range(3):
            j, i = (k + 1) % 3, (k + 2) % 3
            same = (sides[j] * sides[i] >= 0) | is_close[j] | is_close[i]
            near |= is_close[k] & same
        is_near_edge[first : first + size] = near.any(axis=1)
        ray, face = np.nonzero(is_hit)
        pace = (d[ray] * normals[face]).sum(axis=1)
        distance = ((a[face] - o[ray, 0]) * normals[face]).sum(axis=1) / pace
        is_near_edge[first + ray[np.abs(distance) < 1e-11 * scale]] = True
        ahead = distance >= 0.0
        rows.append((first + ray[ahead], distance[ahead], face[ahead], (pace < 0.0)[ahead]))
    ray, distance, face, is_entering = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = np.lexsort((distance, ray))
    return ray[order], distance[order], face[order], is_entering[order], is_near_edge


def wrong_rays(solid, count, seed):
    """Number of rays with another answer than brute force gives, and of those that are compared."""
    vertices, faces = solid.mesh.vertices, solid.mesh.faces
    rng = np.random.default_rng(seed)
    lower, upper = solid.bounds
    origins = rng.uniform(lower - 0.3 * (upper - lower), upper + 0.3 * (upper - lower), (count, 3))
    directions = rng.uniform(lower, upper, (count, 3)) - origins
    ray, distance, face, is_entering, is_near = brute_force(vertices, faces, origins, directions)
    found = solid.cast_all(origins, directions)
    is_wrong = found.count != np.bincount(ray, minlength=count)
    kept, own = ~(is_wrong | is_near)[ray], ~(is_wrong | is_near)[found.ray]
    rooms = 1e-9 * np.ptp(vertices, axis=0).max()
    differs = np.abs(found.distance[own] - distance[kept]) > rooms
    differs |= (found.is_entering[own] != is_entering[kept]) | (found.face_id[own] != face[kept])
    is_wrong[ray[kept][differs]] = True
    return int((is_wrong & ~is_near).sum()), int((~is_near).sum())


@pytest.mark.parametrize("name", ["bracket.stl", "torus", "rod", "overlapping cubes"])
def test_random_rays_agree_with_brute_force(name):
    path = MESHES / name
    solid = load(path).parts[0].solid if path.suffix else solid_of(name)

    wrong, compared = wrong_rays(solid, 5000, 3)

    assert wrong == 0
    assert compared > 4900


@pytest.mark.parametrize("name", sorted(CLOSED))
def test_crossings_alternate_and_tell_inside(name):
    solid = solid_of(name)
    origins, directions = some_rays(name, 2000)
    is_clear, is_inside = np.abs(solid.signed_distance(origins)) > 1e-9, solid.contains(origins)

    found = solid.cast_all(origins, directions)

    for row in np.flatnonzero(is_clear):
        assert_alternates(found[row], is_inside[row])
        assert len(found[row].distance) % 2 == is_inside[row]


@pytest.mark.parametrize("asked", ["torus", "hollow cube", "scene"])
def test_crossings_are_those_of_casting_again_and_again(asked):
    solid = some_scene(12) if asked == "scene" else solid_of(asked)
    rng = np.random.default_rng(4)
    origins, directions = rng.uniform(-4.0, 4.0, (2, 3000, 3))
    found = solid.cast_all(origins, directions)

    beyond, rows = np.zeros(len(origins)), [[] for _ in origins]
    for _ in range(found.count.max() + 1):
        hit = solid.cast(origins, directions, min_distance=beyond)
        for row in np.flatnonzero(hit.distance < np.inf):
            rows[row].append((hit.distance[row], hit.part[row], hit.face_id[row]))
        beyond = np.where(hit.distance < np.inf, np.nextafter(hit.distance, np.inf), np.inf)

    assert (hit.distance == np.inf).all()
    assert found.count.max() >= 4
    for row, expected in enumerate(rows):
        one = found[row]
        columns = one.distance.tolist(), one.part.tolist(), one.face_id.tolist()
        assert list(zip(*columns, strict=True)) == expected


def test_min_distance_of_nothing_changes_no_bit():
    for asked in (solid_of("cube"), solid_of("torus"), some_scene(12)):
        origins, directions = some_rays("torus", 2000)
        limits = np.linspace(0.0, 3.0, len(origins))
        fast = asked.cast(origins, directions, max_distance=limits)
        slow = asked.cast(origins, directions, max_distance=limits, min_distance=np.zeros(len(origins)))
        assert fast._table.tobytes() == slow._table.tobytes()


def test_crossings_of_a_scene_are_those_of_its_parts_in_order():
    scene = some_scene(12)
    rng = np.random.default_rng(8)
    origins, directions = rng.uniform(-5.0, 5.0, (2, 2000, 3))
    found = scene.cast_all(origins, directions)
    expected = []
    for row, part in enumerate(scene.parts):
        pose = part.pose.inverse
        own = part.solid.cast_all(pose.point(origins), pose.direction(directions))
        values = zip(own.ray.tolist(), own.distance.round(9).tolist(), own.face_id.tolist(), strict=True)
        expected += [(ray, distance, row, face) for ray, distance, face in values]

    columns = found.ray, found.distance.round(9), found.part, found.face_id
    assert list(zip(*(each.tolist() for each in columns), strict=True)) == sorted(expected)


def test_hidden_parts_are_not_crossed():
    cubes = [Solid(*shapes.cube(1.0, (3.0 * row, 0, 0)), name=str(row)) for row in range(3)]
    scene = Scene(cubes)
    scene.hide("1")

    assert scene.cast_all((-5, 0, 0), (1, 0, 0)).part.tolist() == [0, 0, 2, 2]


def test_ignored_parts_are_not_crossed():
    """As without them, for parts in the frame of the scene and turned ones."""
    rng = np.random.default_rng(6)
    for is_turned in (False, True):
        scene, others = (some_scene(6, is_turned=is_turned) for _ in range(2))
        # From each part through the next one.
        middles = np.array([part.pose.translation for part in scene.parts])
        origins, targets = middles[:, None] + rng.uniform(-0.2, 0.2, (2, 6, 2, 3))
        directions = np.roll(targets, -1, axis=0) - origins
        others.hide("part 2")
        others.hide("part 4")
        found = scene.cast_all(origins, directions, ignore=["part 2", 4])
        expected = others.cast_all(origins, directions)
        assert len(expected.distance) > 5
        assert found.part.tolist() == expected.part.tolist()
        np.testing.assert_allclose(found.distance, expected.distance, rtol=1e-12)
        first, beyond = (
            asked.cast(origins, directions, min_distance=2.0, **ignored).distance
            for asked, ignored in ((scene, {"ignore": ["part 2", 4]}), (others, {}))
        )
        np.testing.assert_allclose(first, beyond, rtol=1e-12)


def test_flush_parts_are_both_reported_in_the_order_of_parts():
    boxes = ((0, 0, 0), (1, 1, 1)), ((1, 0, 0), (2, 1, 1))
    scene = Scene([Solid(*shapes.box(*box), name=str(row)) for row, box in enumerate(boxes)])

    found = scene.cast_all((-1, 0.25, 0.5), (1, 0, 0))

    assert found.distance.tolist() == [1.0, 2.0, 2.0, 3.0]
    assert (found.part.tolist(), found.is_entering.tolist()) == ([0, 0, 1, 1], [True, False, True, False])


def test_edge_that_is_only_touched_is_a_hit_but_no_crossing():
    cube = Solid(*shapes.cube(2.0, (0, 0, 0)))
    ray = (-1.0, 3.0, 0.25), (1.0, -1.0, 0.0)

    assert cube.cast(*ray).distance == pytest.approx(8**0.5)
    assert len(cube.cast_all(*ray).distance) == 0
    # Through opposite edges it changes sides twice.
    assert cube.cast_all((-2.0, -2.0, 0.25), (1, 1, 0)).point.tolist() == [[-1, -1, 0.25], [1, 1, 0.25]]


def test_sheet_is_crossed_once_at_its_inner_edges_and_corners():
    vertices, faces = shapes.grid(4, 4)
    flat = vertices[:, :2]
    inner = vertices[((flat > flat.min(axis=0)) & (flat < flat.max(axis=0))).all(axis=1)]

    found = Solid(vertices, faces).cast_all(inner + np.array([0.0, 0.0, 1.0]), (0, 0, -1))

    assert len(inner) >= 4
    assert found.count.tolist() == [1] * len(inner)
    assert found.is_entering.all()


def test_ray_from_the_surface_crosses_at_once_and_a_min_distance_skips_that():
    cube = solid_of("cube")

    assert cube.cast_all((0.0, 0.25, 0.5), (1, 0, 0)).distance.tolist() == [0.0, 1.0]
    assert cube.cast_all((0.0, 0.25, 0.5), (1, 0, 0), min_distance=1e-9).distance.tolist() == [1.0]
    assert cube.cast((0.0, 0.25, 0.5), (1, 0, 0), min_distance=1e-9).distance == 1.0
    assert cube.cast((0.0, 0.25, 0.5), (1, 0, 0), min_distance=1.5).distance == np.inf
    at_two = cube.cast_all((-1.0, 0.25, 0.5), (2, 0, 0), min_distance=2.0, max_distance=2.0)
    assert at_two.distance.tolist() == [2.0]


@pytest.mark.parametrize("workers", [1, 2])
def test_small_tables_and_threads_change_no_bit(monkeypatch, workers):
    scene = some_scene(12)
    origins, directions = np.random.default_rng(2).uniform(-4.0, 4.0, (2, 5000, 3))
    expected = scene.cast_all(origins, directions)
    monkeypatch.setattr(tables, "MIN_ROWS", 1)
    monkeypatch.setattr(tables, "CROSSINGS_PER_RAY", 0)

    found = scene.cast_all(origins, directions, workers=workers)

    assert found._table[:, :11].tobytes() == expected._table[:, :11].tobytes()
    assert found.offsets.tolist() == expected.offsets.tolist()


def test_rays_from_outside_of_everything_or_not_finite_have_none():
    for asked in (solid_of("cube"), some_scene(3)):
        found = asked.cast_all(
            [[90, 90, 90], [np.nan, 0, 0], [0, 0, 0], [1e300, 0, 0]],
            [[1, 0, 0], [1, 0, 0], [np.inf, 0, 0], [-1, 0, 0]],
        )
        assert found.count.tolist() == [0, 0, 0, 0]
        assert found.is_valid.tolist() == [True, False, False, False]
        assert asked.cast_all(np.empty((0, 3)), (1, 0, 0)).offsets.tolist() == [0]


@pytest.mark.parametrize("far", [1e3, 1e6, 1e9])
def test_ray_from_afar_enters_and_leaves(far):
    for asked in (solid_of("cube"), Scene([solid_of("cube"), Solid(*shapes.cube(1.0, (9, 9, 9)), name="b")])):
        found = asked.cast_all(np.array([0.5, 0.5, 0.5]) - far * np.array([3.0, -2.0, 1.0]), (3, -2, 1))
        assert found.is_entering.tolist() == [True, False]


def test_shapes_of_rays_and_of_one_ray():
    solid = solid_of("cube")
    origins = np.full((2, 1, 3), 0.5)
    found = solid.cast_all(origins, np.eye(3), max_distance=[[0.4], [9.0]], min_distance=[0.0, 0.5, 0.6])

    assert found.count.tolist() == [[0, 0, 0], [1, 1, 0]]
    assert len(found) == 2
    assert found[1, 1].distance.tolist() == [0.5]
    assert found.offsets.tolist() == [0, 0, 0, 0, 1, 2, 2]
    with pytest.raises(IndexError, match="one ray"):
        found[1]
    with pytest.raises(IndexError):
        found[2, 0]
    one = solid.cast_all((0.5, 0.5, 0.5), (0, 0, 1))
    assert one.count == 1
    assert "distance=[0.5]" in repr(one)
    with pytest.raises(ValueError, match="read-only"):
        one.distance[0] = 3.0


def test_wrong_arguments_are_named():
    solid = solid_of("cube")
    for ask in (solid.cast, solid.cast_all):
        with pytest.raises(ArgumentError, match="direction 1 is zero"):
            ask(np.zeros((2, 3)), [[1, 0, 0], [0, 0, 0]], min_distance=1.0)
        with pytest.raises(ArgumentError, match=r"min_distance is -1\.0"):
            ask((0, 0, 0), (1, 0, 0), min_distance=-1.0)
        with pytest.raises(ArgumentError, match=r"min_distance\[1\] is nan"):
            ask(np.zeros((2, 3)), (1, 0, 0), min_distance=[1.0, np.nan])
        with pytest.raises(ArgumentError, match="workers"):
            ask((0, 0, 0), (1, 0, 0), min_distance=1.0, workers=0)
