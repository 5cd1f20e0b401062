"""Rays through the public API: first hits of solids and scenes, against the oracle and embreex."""

import judging
import numpy as np
import pytest
import shapes
from query_rows import CLOSED, FAR, mesh_of, solid_of, some_rays, some_scene

from proximity.errors import ArgumentError
from proximity.scene.loader import load
from proximity.scene.queries import queries
from proximity.scene.queries.results import NO_FACE, NO_PART
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid


@pytest.mark.parametrize("name", ["cube", "sphere", "torus", "featuretype.STL"])
def test_first_hits_agree_with_embreex(name, request):
    scenes = pytest.importorskip("embreex.rtcore_scene")
    meshes = pytest.importorskip("embreex.mesh_construction")
    if name in CLOSED:
        vertices, faces = mesh_of(name)
    else:
        part = load(request.getfixturevalue("shared_data") / "cad" / name).parts[0].solid
        lower, upper = part.bounds
        vertices, faces = 3.0 * (part.mesh.vertices - lower) / (upper - lower).max() - 1.5, part.mesh.faces
    rng = np.random.default_rng(8)
    origins = rng.uniform(-3.0, 3.0, (4000, 3)).astype(np.float32)
    directions = (rng.uniform(-2.0, 2.0, (4000, 3)) - origins).astype(np.float32)
    scene = scenes.EmbreeScene()
    meshes.TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))

    theirs = scene.run(origins, directions, output=True)
    hit = Solid(vertices.astype(np.float32), faces).cast(origins, directions)

    missed = theirs["primID"] < 0
    # In float32 one ray in a thousand may differ at the rim.
    assert (missed != (hit.face_id == NO_FACE)).sum() <= 4
    both = ~missed & (hit.face_id != NO_FACE)
    length = np.linalg.norm(directions, axis=1)
    off = np.abs(theirs["tfar"] * length - hit.distance)[both]
    assert both.sum() > 200
    assert np.median(off) <= 1e-6
    assert np.quantile(off, 0.99) <= 1e-4


@pytest.mark.parametrize("name", [*CLOSED, "needles"])
@pytest.mark.parametrize("offset", [np.zeros(3), FAR], ids=["here", "far"])
def test_no_ray_escapes_from_inside(name, offset):
    """Aimed at every corner, the midpoint of every edge, and in random directions."""
    vertices, faces = mesh_of(name)
    solid = Solid(vertices + offset, faces)
    vertices = solid.mesh.vertices
    rng = np.random.default_rng(9)
    origins = rng.uniform(*solid.bounds, (4000, 3))
    origins = origins[solid.signed_distance(origins) < -1e-3][:12]
    edges = 0.5 * (vertices[faces] + vertices[np.roll(faces, 1, axis=1)]).reshape(-1, 3)
    aims = np.concatenate([vertices, edges, origins[0] + rng.normal(size=(500, 3))])

    hit = solid.cast(origins[:, None], aims - origins[:, None])

    assert (hit.face_id != NO_FACE).all()
    assert np.isfinite(hit.distance).all()
    # No hit is nearer than the surface.
    assert (hit.distance >= np.abs(solid.signed_distance(origins))[:, None] * (1.0 - 1e-9)).all()


@pytest.mark.parametrize("name", sorted(CLOSED))
def test_stepping_through_the_hit_changes_the_side(name):
    solid = solid_of(name)
    origins, directions = some_rays(name, 300)
    hit = solid.cast(origins, directions)
    rows = np.flatnonzero(hit.face_id != NO_FACE)
    inner = hit.barycentric[rows].min(axis=1) > 1e-3
    point, step = hit.point[rows][inner], 1e-9 * hit.normal[rows][inner]

    assert inner.sum() > 20
    assert not solid.contains(point + step).any()
    assert solid.contains(point - step).all()


def test_ray_through_a_shared_corner_of_a_sphere_hits_once_and_at_the_corner():
    vertices, faces = mesh_of("sphere")

    hit = solid_of("sphere").cast((0.0, 0.0, 0.0), vertices)

    assert np.abs(hit.distance - 1.0).max() <= 4.0 * judging.ROUNDING
    assert np.abs(hit.point - vertices).max() <= 4.0 * judging.ROUNDING
    assert (faces[hit.face_id] == np.arange(len(vertices))[:, None]).any(axis=1).all()


@pytest.mark.parametrize("scale", [2.0**-300, 1e-9, 3.7])
def test_length_of_the_direction_does_not_matter(scale):
    origins, directions = some_rays("torus", 100)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)

    hit, scaled = (solid_of("torus").cast(origins, each) for each in (directions, directions * scale))

    if np.frexp(scale)[0] == 0.5:
        assert judging.same_bits(hit, scaled)
    room = np.nan_to_num(1e-11 * judging.slant(hit, directions))
    is_inner = ~(hit.barycentric.min(axis=1) < 1e-9)
    assert judging.is_near(hit.distance, scaled.distance, room)[is_inner].all()


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("limit", [np.inf, 1.2])
@pytest.mark.parametrize("count", [0, 5, 5001])
def test_distances_alone_are_those_of_the_hits(count, limit, workers):
    origins, directions = some_rays("torus", count)
    if count > 4:
        origins[count // 2], directions[1] = np.nan, np.inf

    for asked in (solid_of("torus"), SCENE):
        found = asked.cast_distance(origins, directions, max_distance=limit, workers=workers)
        hits = asked.cast(origins, directions, max_distance=limit, workers=workers)
        assert judging.same_bits(found, hits.distance)
        assert found.flags.writeable, "nobody else has it"


def test_distances_alone_have_the_shape_of_the_rays():
    solid = solid_of("cube")

    assert solid.cast_distance((0.25, 0.5, 3.0), (0, 0, -1)) == 2.0
    assert isinstance(solid.cast_distance((0.25, 0.5, 3.0), (0, 0, -1)), np.float64)
    assert solid.cast_distance(np.full((2, 1, 3), 0.5), np.eye(3)).tolist() == [[0.5] * 3] * 2
    assert solid.cast_distance((9.0, 9.0, 9.0), (0, 0, 1)) == np.inf


SCENE = some_scene(12)


def test_ray_from_the_surface_hits_at_once():
    for way in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (1.0, 1.0, 1.0)):
        assert solid_of("cube").cast((1.0, 0.25, 0.5), way).distance == 0.0


def test_ray_away_from_everything_misses():
    hit = solid_of("cube").cast((2.0, 0.5, 0.5), (1.0, 0.0, 0.0))

    assert (hit.distance, hit.face_id, hit.part) == (np.inf, NO_FACE, NO_PART)


def test_ray_within_a_side_hits_the_side_that_crosses_it():
    """A face parallel to the ray is not hit; the next one is."""
    hit = solid_of("cube").cast((-1.0, 0.25, 1.0), (1.0, 0.0, 0.0))

    assert hit.distance == 1.0
    assert hit.normal.tolist() == [-1.0, 0.0, 0.0]


@pytest.mark.parametrize("far", [1e3, 1e6, 1e9])
def test_ray_from_afar_hits_what_it_aims_at(far):
    way = np.array([3.0, -2.0, 1.0])
    origin = np.array([0.5, 0.5, 0.5]) - far * way

    for asked in (solid_of("cube"), Scene([solid_of("cube"), Solid(*shapes.cube(1.0, (9, 9, 9)), name="b")])):
        hit = asked.cast(origin, way)
        assert abs(hit.distance - (far - 1.0 / 6.0) * np.linalg.norm(way)) <= 1e-15 * 16.0 * far * 4.0
        assert hit.normal.tolist() == [-1.0, 0.0, 0.0]


@pytest.mark.parametrize("far", [1e17, 1e60, 1e99])
@pytest.mark.parametrize("count", [1, 2])
def test_ray_from_any_distance_is_answered(far, count):
    """An axis-aligned ray hits; an oblique one may, at such a distance."""
    scene = Scene([Solid(*shapes.cube(2.0, (9.0 * row, 0, 0)), name=str(row)) for row in range(count)])

    distances = scene.cast_distance(
        [[0.25, 0.5, far], [0.25, -far, 0.5], [0.25, 0.5, far], [far, far, far], [-far, far, 0.0]],
        [[0, 0, -1], [0, 3, 0], [0, 0, 1], [-1, -1, -1], [1, -1, 0]],
    )

    np.testing.assert_allclose(distances[:2], far - 1.0, rtol=1e-15)
    assert distances[2] == np.inf
    is_hit = abs(distances[3:] / far - [3**0.5, 2**0.5]) < 1e-9
    assert (is_hit | (distances[3:] == np.inf)).all()


@pytest.mark.parametrize("far", [1e104, 1e200, 1.7e308])
@pytest.mark.parametrize("count", [1, 2])
def test_ray_from_farther_than_can_be_computed_with_answers_nan_and_the_others_go_on(far, count):
    """Except rays that point away from all parts."""
    scene = Scene([Solid(*shapes.cube(2.0, (9.0 * row, 0, 0)), name=str(row)) for row in range(count)])

    hits = scene.cast(
        [[0.0, 0.0, 3.0], [0.0, 0.0, far], [-far, far, far], [0.0, 0.0, far]],
        [[0, 0, -1], [0, 0, -1], [1, -1, -1], [0, 0, 1]],
    )

    np.testing.assert_array_equal(hits.distance, [2.0, np.nan, np.nan, np.inf])
    assert hits.face_id.tolist()[1:] == 3 * [NO_FACE]


def test_sorted_rays_answer_as_they_do_one_by_one(monkeypatch):
    """Batches for large models are sorted; here the limits are lowered for a small one."""
    monkeypatch.setattr(queries, "SORT_RAYS_FROM", 0)
    monkeypatch.setattr(queries, "SORT_RAYS_IN", 0)
    solid = Solid(*shapes.sphere(3))
    rng = np.random.default_rng(4)
    origins, directions = rng.normal(size=(500, 3)), rng.normal(size=(500, 3))
    origins[:3] = [(np.nan, 0, 0), (1e30, 0, 0), (0, 0, 0)]
    directions[3:6] = [(np.inf, 0, 0), (0, 0, 1e-300), (1, 0, 0)]

    for workers in (1, 2):
        together = solid.cast(origins, directions, workers=workers)
        for row in range(len(origins)):
            alone = solid.cast(origins[row], directions[row])
            assert np.array_equal(together.distance[row], alone.distance, equal_nan=True), row
            assert together.face_id[row] == alone.face_id

    directions[[7, 400]] = 0.0
    with pytest.raises(ArgumentError, match="direction 7 is zero"):
        solid.cast(origins, directions)
