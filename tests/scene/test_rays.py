"""Rays through the public door: first hits of solids and scenes, against the oracle and against embreex."""

import judging
import numpy as np
import pytest
import shapes
from hypothesis import given
from hypothesis import strategies as st
from query_rows import CLOSED, FAR, MESHES, mesh_of, solid_of, some_rays, some_scene

import oracle
from proximity.errors import ArgumentError
from proximity.scene.queries import queries
from proximity.scene.queries.results import NO_FACE, NO_PART
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid


def slant(hit, directions):
    """One over the cosine between ray and normal: by that much a coordinate's rounding moves the hit."""
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return 1.0 / np.maximum(np.abs((unit * hit.normal).sum(axis=-1)), 1e-12)


def assert_hits_are_right(distance, room, ask, origins, directions):
    """Distances are those of *ask*, the oracle; or at a rim those of the same ray a rounding beside it.

    Where a ray passes an edge by less than coordinates are rounded it may hit and may miss, and the oracle
    itself says either, depending on which way the origin is nudged.
    """
    unsure = np.flatnonzero(~judging.is_near(distance, ask(origins, directions), room))
    nudge = 4e-15 * np.abs(origins).max()
    for way in np.random.default_rng(13).normal(size=(24, 3)):
        beside = ask(origins[unsure] + nudge * way, directions[unsure])
        unsure = unsure[~judging.is_near(distance[unsure], beside, room[unsure] + 10.0 * nudge)]
        if len(unsure) == 0:
            return
    raise AssertionError(f"ray {unsure[0]}: {origins[unsure[0]]!r} {directions[unsure[0]]!r}")


def assert_hits_hold_together(hit, vertices, faces, origins, directions):
    """Distance, point, face, barycentric and normal of hits on one mesh say the same."""
    is_hit = hit.face_id != NO_FACE
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    corners = vertices[faces[hit.face_id[is_hit]]]
    weights, point, normal = hit.barycentric[is_hit], hit.point[is_hit], hit.normal[is_hit]
    largest = max(np.abs(vertices).max(), np.abs(origins).max())
    room = 16.0 * judging.ROUNDING * largest
    assert (weights >= 0.0).all()
    assert np.abs(weights.sum(axis=1) - 1.0).max() <= 4.0 * judging.ROUNDING
    assert np.abs((weights[:, :, None] * corners).sum(axis=1) - point).max() <= room
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    cross /= np.linalg.norm(cross, axis=1, keepdims=True)
    assert np.abs(cross - normal).max() <= 1e-9
    assert np.abs(np.linalg.norm(normal, axis=1) - 1.0).max() <= 8.0 * judging.ROUNDING
    along = origins[is_hit] + hit.distance[is_hit, None] * unit[is_hit]
    off = np.linalg.norm(along - point, axis=1)
    assert (off <= room * slant(hit, directions)[is_hit]).all()
    assert (hit.distance[is_hit] >= 0.0).all()
    assert np.isinf(hit.distance[~is_hit]).all() and np.isnan(hit.point[~is_hit]).all()
    assert np.isnan(hit.normal[~is_hit]).all() and np.isnan(hit.barycentric[~is_hit]).all()
    assert (hit.part[~is_hit] == NO_PART).all()


# ------------------------------------------------------------------------------------ against the oracle


@pytest.mark.parametrize("name", sorted(MESHES))
def test_first_hits_agree_with_the_oracle(name):
    """The oracle decides in whole numbers, we to rounding of the coordinates."""
    solid, (vertices, faces) = solid_of(name), mesh_of(name)
    origins, directions = some_rays(name, 300)

    hit = solid.cast(origins, directions)

    is_hit = hit.face_id != NO_FACE
    room = np.where(is_hit, (1e-12 * hit.distance + 8e-15 * 3.0) * slant(hit, directions), 0.0)
    assert_hits_are_right(
        hit.distance, room, lambda *rays: oracle.ray(vertices, faces, *rays).distance, origins, directions
    )
    assert (hit.part[is_hit] == 0).all()
    assert_hits_hold_together(hit, solid.mesh.vertices, solid.mesh.faces, origins, directions)


@given(
    origin=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
    way=st.tuples(*[st.sampled_from([-1.0, 0.0, 1.0]) | st.floats(-1.0, 1.0)] * 3),
    name=st.sampled_from(sorted(MESHES)),
)
def test_a_ray_agrees_with_the_oracle(origin, way, name):
    if not any(way) or 0.0 < max(map(abs, way)) < 1e-100:
        way = (1.0, 0.0, 0.0)
    solid, (vertices, faces) = solid_of(name), mesh_of(name)
    origin, way = np.array(origin), np.array(way)

    hit = solid.cast(origin[None], way[None])

    if solid.distance(origin) < 1e-14:
        return  # whether it starts before or behind the face is a matter of rounding
    is_hit = hit.face_id != NO_FACE
    room = np.where(is_hit, (1e-12 * hit.distance + 8e-15 * 3.0) * slant(hit, way[None]), 0.0)
    assert_hits_are_right(
        hit.distance, room, lambda *rays: oracle.ray(vertices, faces, *rays).distance, origin[None], way[None]
    )


@pytest.mark.parametrize("name", ["cube", "sphere", "torus"])
def test_first_hits_agree_with_embreex(name):
    scenes = pytest.importorskip("embreex.rtcore_scene")
    meshes = pytest.importorskip("embreex.mesh_construction")
    vertices, faces = mesh_of(name)
    rng = np.random.default_rng(8)
    origins = rng.uniform(-3.0, 3.0, (4000, 3)).astype(np.float32)
    directions = (rng.uniform(-2.0, 2.0, (4000, 3)) - origins).astype(np.float32)
    scene = scenes.EmbreeScene()
    meshes.TriangleMesh(scene, vertices.astype(np.float32), faces.astype(np.int32))

    theirs = scene.run(origins, directions, output=True)
    hit = Solid(vertices.astype(np.float32), faces).cast(origins, directions)

    missed = theirs["primID"] < 0
    # In float32 they cannot tell at the rim: one ray in a thousand may differ.
    assert (missed != (hit.face_id == NO_FACE)).sum() <= 4
    both = ~missed & (hit.face_id != NO_FACE)
    length = np.linalg.norm(directions, axis=1)
    off = np.abs(theirs["tfar"] * length - hit.distance)[both]
    assert both.sum() > 200
    assert np.median(off) <= 1e-6
    assert np.quantile(off, 0.99) <= 1e-4


# -------------------------------------------------------------------------------------------- watertight


@pytest.mark.parametrize("name", sorted(CLOSED))
@pytest.mark.parametrize("offset", [np.zeros(3), FAR], ids=["here", "far"])
def test_no_ray_escapes_from_inside(name, offset):
    """Aimed at every corner, at the middle of every edge, and anywhere."""
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
    # Nothing is nearer than the surface.
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


# ------------------------------------------------------------------------------------- what changes nothing


@pytest.mark.parametrize("scale", [2.0**-300, 1e-9, 3.7])
def test_length_of_the_direction_does_not_matter(scale):
    origins, directions = some_rays("torus", 100)
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)

    hit, scaled = (solid_of("torus").cast(origins, each) for each in (directions, directions * scale))

    if np.frexp(scale)[0] == 0.5:
        assert judging.same_bits(hit, scaled)
    room = np.nan_to_num(1e-11 * slant(hit, directions))
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
    with pytest.raises(ArgumentError, match=r"^direction 1 is zero, expected a vector with a length$"):
        solid.cast_distance(np.zeros((2, 3)), [[0, 0, 1], [0, 0, 0]])
    with pytest.raises(ArgumentError, match=r"^direction 1 is zero, expected a vector with a length$"):
        solid.cast_distance(np.zeros((2, 3)), np.array([[0, 0, 1.0], [0, 0, 0]]))


# ------------------------------------------------------------------------------------------------ scenes


SCENE = some_scene(12)


@pytest.mark.parametrize("is_turned", [True, False], ids=["turned", "shifted"])
@pytest.mark.parametrize("offset", [np.zeros(3), FAR], ids=["here", "far"])
@pytest.mark.parametrize("count", [1, 9, 64])
def test_hit_of_a_scene_is_the_first_over_its_parts(count, offset, is_turned):
    """Each part asked alone by the oracle, in its own frame."""
    scene = some_scene(count, is_turned=is_turned, offset=offset)
    rng = np.random.default_rng(10)
    origins = offset + rng.uniform(-6.0, 6.0, (150, 3))
    directions = offset + rng.uniform(-3.0, 3.0, (150, 3)) - origins

    def ask_part(part, starts, ways):
        back, mesh = part.pose.inverse, part.solid.mesh
        return oracle.ray(mesh.vertices, mesh.faces, back.point(starts), back.direction(ways)).distance

    def ask(starts, ways):
        return np.min([ask_part(part, starts, ways) for part in scene.parts], axis=0)

    hit = scene.cast(origins, directions)

    is_hit = hit.part != NO_PART
    room = (1e-12 * hit.distance + 4e-15 * np.abs(origins).max()) * slant(hit, directions) * 4.0
    room = np.where(is_hit, room, 0.0)
    assert_hits_are_right(hit.distance, room, ask, origins, directions)
    for row, part in enumerate(scene.parts):
        of_part = hit.part == row
        alone = ask_part(part, origins[of_part], directions[of_part])
        assert judging.is_near(alone, hit.distance[of_part], room[of_part]).all()


# ------------------------------------------------------------------------------------------- special rays


def test_ray_from_the_surface_hits_at_once():
    for way in ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (1.0, 1.0, 1.0)):
        assert solid_of("cube").cast((1.0, 0.25, 0.5), way).distance == 0.0


def test_ray_away_from_everything_misses():
    hit = solid_of("cube").cast((2.0, 0.5, 0.5), (1.0, 0.0, 0.0))

    assert (hit.distance, hit.face_id, hit.part) == (np.inf, NO_FACE, NO_PART)


def test_ray_within_a_side_hits_the_side_that_crosses_it():
    """The face that it runs along is seen edge on, and not hit; the next is."""
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
    """Along an axis it hits; aslant, after so long a way, it may."""
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
    """Unless it goes away from everything."""
    scene = Scene([Solid(*shapes.cube(2.0, (9.0 * row, 0, 0)), name=str(row)) for row in range(count)])

    hits = scene.cast(
        [[0.0, 0.0, 3.0], [0.0, 0.0, far], [-far, far, far], [0.0, 0.0, far]],
        [[0, 0, -1], [0, 0, -1], [1, -1, -1], [0, 0, 1]],
    )

    np.testing.assert_array_equal(hits.distance, [2.0, np.nan, np.nan, np.inf])
    assert hits.face_id.tolist()[1:] == 3 * [NO_FACE]


def test_sorted_rays_answer_as_they_do_one_by_one(monkeypatch):
    """Large models have batches sorted; here a small one is made to count as large."""
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
