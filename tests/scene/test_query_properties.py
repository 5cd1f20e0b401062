"""Properties of every query: agreement with the oracle, scaling, limits, and sizes of parts."""

from collections.abc import Callable
from typing import NamedTuple

import judging
import numpy as np
import pytest
import shapes
from hypothesis import given
from hypothesis import strategies as st
from query_rows import FAR, MESHES, mesh_of, solid_of, some_points, some_rays, some_scene, some_segments

import oracle
from proximity.scene.queries.results import NO_FACE, NO_PART
from proximity.scene.solid import Solid


def assert_hits_are_right(hit, ask, origins, directions):
    """Check that distances are those of *ask*, the oracle; near a rim, of the same ray displaced by rounding.

    A ray that passes an edge within coordinate rounding may hit or miss: the oracle's own result depends on
    how the origin is displaced.
    """
    largest = max(np.abs(origins).max(), 3.0)
    room = (1e-12 * hit.distance + 1.6e-14 * largest) * judging.slant(hit, directions)
    room = np.where(hit.face_id != NO_FACE, room, 0.0)
    unsure = np.flatnonzero(~judging.is_near(hit.distance, ask(origins, directions), room))
    nudge = 4e-15 * largest
    for way in np.random.default_rng(13).normal(size=(24, 3)):
        beside = ask(origins[unsure] + nudge * way, directions[unsure])
        unsure = unsure[~judging.is_near(hit.distance[unsure], beside, room[unsure] + 10.0 * nudge)]
        if len(unsure) == 0:
            return
    raise AssertionError(f"ray {unsure[0]}: {origins[unsure[0]]!r} {directions[unsure[0]]!r}")


def assert_connections_are_right(hit, ask, *rows):
    """Check that distances of points or segments are those of *ask*, the oracle."""
    expected = ask(*rows)
    off = np.abs(np.abs(getattr(hit, hit._fields[0])) - expected)
    assert (off <= judging.allowance(expected, *(4.0 * each for each in rows), 4.0)).all(), off.max()


def assert_hits_hold_together(hit, vertices, faces, origins, directions):
    """Check that distance, point, face, barycentric and normal of hits on one mesh are consistent."""
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
    lengths = np.linalg.norm(cross, axis=1, keepdims=True)
    is_fat = lengths[:, 0] > 1e-6  # the normal of a needle is as uncertain as its width
    assert np.abs(cross / lengths - normal)[is_fat].max() <= 1e-9
    assert np.abs(np.linalg.norm(normal, axis=1) - 1.0).max() <= 8.0 * judging.ROUNDING
    along = origins[is_hit] + hit.distance[is_hit, None] * unit[is_hit]
    off = np.linalg.norm(along - point, axis=1)
    assert (off <= room * judging.slant(hit, directions)[is_hit]).all()
    assert (hit.distance[is_hit] >= 0.0).all()
    assert np.isinf(hit.distance[~is_hit]).all() and np.isnan(hit.point[~is_hit]).all()
    assert np.isnan(hit.normal[~is_hit]).all() and np.isnan(hit.barycentric[~is_hit]).all()
    assert (hit.part == np.where(is_hit, 0, NO_PART)).all()


def assert_segments_hold_together(hit, vertices, faces, starts, ends):
    """Check that distance, witness points, fraction, face and barycentric of one mesh are consistent."""
    largest = max(np.abs(vertices).max(), np.abs(starts).max(), np.abs(ends).max())
    room = 16.0 * judging.ROUNDING * largest
    gap = np.linalg.norm(hit.point_on_segment - hit.point_on_solid, axis=-1)
    assert np.abs(gap - hit.distance).max() <= room
    assert ((hit.fraction >= 0.0) & (hit.fraction <= 1.0)).all()
    there = starts + hit.fraction[:, None] * (ends - starts)
    assert np.abs(there - hit.point_on_segment).max() <= room
    weights, corners = hit.barycentric, vertices[faces[hit.face_id]]
    assert (weights >= 0.0).all()
    assert np.abs(weights.sum(axis=1) - 1.0).max() <= 4.0 * judging.ROUNDING
    assert np.abs((weights[:, :, None] * corners).sum(axis=1) - hit.point_on_solid).max() <= room
    assert (hit.part == 0).all()


class Query(NamedTuple):
    """A query, its arguments, and the fields of its result."""

    rows: Callable
    oracle: Callable
    is_right: Callable
    holds_together: Callable
    distance: str
    points: tuple[str, ...]  # lengths, which scale, and are nan without a result
    others: tuple[str, ...]

    def ask(self, name, asked, rows, **limit):
        return getattr(asked, name)(*rows, **limit)

    def truth(self, mesh):
        """A function for the oracle's distances of rows to a mesh."""
        return lambda *rows: self.oracle(*mesh, *rows).distance


QUERIES = {
    "closest": Query(
        lambda *given: (some_points(*given),), oracle.closest, assert_connections_are_right,
        judging.assert_answer_holds_together, "signed_distance", ("point",),
        ("gradient", "barycentric", "face_id", "feature"),
    ),
    "cast": Query(
        some_rays, oracle.ray, assert_hits_are_right, assert_hits_hold_together, "distance", ("point",),
        ("normal", "barycentric", "face_id"),
    ),
    "closest_to_segments": Query(
        some_segments, oracle.segment_distance, assert_connections_are_right, assert_segments_hold_together,
        "distance", ("point_on_segment", "point_on_solid"), ("fraction", "barycentric", "face_id"),
    ),
}  # fmt: skip
SCENE = some_scene(12)
NAMES = st.sampled_from(sorted(MESHES))
SEEDS = st.integers(0, 1000)
EACH_QUERY = pytest.mark.parametrize("name", QUERIES)


@EACH_QUERY
@pytest.mark.parametrize("mesh", sorted(MESHES))
def test_answers_of_a_mesh_are_the_oracles_and_hold_together(name, mesh):
    """The oracle decides rays exactly, the package to the rounding of coordinates."""
    query, solid = QUERIES[name], solid_of(mesh)
    rows = query.rows(mesh, 300, 7)

    hit = query.ask(name, solid, rows)

    query.is_right(hit, query.truth(mesh_of(mesh)), *rows)
    query.holds_together(hit, solid.mesh.vertices, solid.mesh.faces, *rows)


@pytest.mark.parametrize("name", ["cast", "closest_to_segments"])
@given(
    start=st.tuples(*[st.sampled_from([-1.0, 0.0, 0.5, 1.0, 2.0]) | st.floats(-3.0, 3.0)] * 3),
    way=st.tuples(*[st.sampled_from([-1.0, 0.0, 1.0]) | st.floats(-3.0, 3.0)] * 3),
    mesh=NAMES,
)
def test_any_ray_or_segment_is_answered_as_by_the_oracle(name, start, way, mesh):
    query, solid, start, way = QUERIES[name], solid_of(mesh), np.array([start]), np.array([way])
    if name == "cast" and (np.abs(way).max() < 1e-100 or solid.distance(start)[0] < 1e-14):
        return  # rounding decides whether it starts before or behind the face
    rows = start, way if name == "cast" else start + way

    query.is_right(query.ask(name, solid, rows), query.truth(mesh_of(mesh)), *rows)


@pytest.mark.parametrize("name", ["cast", "closest_to_segments"])
@pytest.mark.parametrize("is_turned", [True, False], ids=["turned", "shifted"])
@pytest.mark.parametrize("offset", [np.zeros(3), FAR], ids=["here", "far"])
@pytest.mark.parametrize("count", [1, 9, 64])
def test_answer_of_a_scene_is_the_min_over_its_parts(name, count, offset, is_turned):
    """Compare with the oracle for each part in its own frame; the reported part has the distance."""
    query, scene = QUERIES[name], some_scene(count, is_turned=is_turned, offset=offset)
    rng = np.random.default_rng(10)
    starts = offset + rng.uniform(-6.0, 6.0, (120, 3))
    if name == "cast":
        rows = starts, offset + rng.uniform(-3.0, 3.0, (120, 3)) - starts
    else:
        rows = starts, starts + rng.choice([1e-6, 0.3, 3.0], (120, 1)) * rng.normal(size=(120, 3))

    def of_part(part, starts, others):
        back, mesh = part.pose.inverse, part.solid.mesh
        others = back.direction(others) if name == "cast" else back.point(others)
        return query.oracle(mesh.vertices, mesh.faces, back.point(starts), others).distance

    hit = query.ask(name, scene, rows)

    query.is_right(hit, lambda *rows: np.min([of_part(part, *rows) for part in scene.parts], axis=0), *rows)
    chosen = np.flatnonzero(hit.part != NO_PART)
    named = np.array([of_part(scene.parts[hit.part[row]], *(each[row] for each in rows)) for row in chosen])
    room = 1e-9 + 1e-12 * np.abs(offset).max()
    assert (np.abs(named - hit.distance[chosen]) <= room).all()


@EACH_QUERY
@given(mesh=NAMES, exponent=st.integers(-100, 100), seed=SEEDS)
def test_scaling_by_a_power_of_two_scales_to_the_bit(name, mesh, exponent, seed):
    query, (vertices, faces), scale = QUERIES[name], mesh_of(mesh), 2.0**exponent
    rows = query.rows(mesh, 10, seed)

    hit = query.ask(name, solid_of(mesh), rows)
    scaled = query.ask(name, Solid(vertices * scale, faces), [row * scale for row in rows])

    for field in (query.distance, *query.points):
        assert np.array_equal(getattr(scaled, field), getattr(hit, field) * scale, equal_nan=True), field
    for field in query.others:
        assert judging.same_bits(getattr(scaled, field), getattr(hit, field)), field


@EACH_QUERY
@given(mesh=NAMES, seed=SEEDS, limit=st.floats(0.0, 6.0) | st.just(0.0))
def test_limit_never_changes_an_answer_within_it(name, mesh, seed, limit):
    query = QUERIES[name]
    rows = query.rows(mesh, 10, seed)
    for asked in (solid_of(mesh), SCENE):
        free = query.ask(name, asked, rows)

        hit = query.ask(name, asked, rows, max_distance=limit)

        within = np.abs(getattr(free, query.distance)) <= limit
        for field in hit._fields:
            assert judging.same_bits(getattr(hit, field)[within], getattr(free, field)[within]), field
        assert (getattr(hit, query.distance)[~within] == np.inf).all()
        assert (hit.face_id[~within] == NO_FACE).all() and (hit.part[~within] == NO_PART).all()
        for field in (*query.points, "barycentric"):
            assert np.isnan(getattr(hit, field)[~within]).all(), field


@EACH_QUERY
@pytest.mark.parametrize("mesh", sorted(MESHES))
def test_the_very_distance_as_limit_still_finds_and_the_next_below_does_not(name, mesh):
    query = QUERIES[name]
    rows = query.rows(mesh, 200, 7)
    free = query.ask(name, solid_of(mesh), rows)

    limits = np.abs(getattr(free, query.distance))
    hit = query.ask(name, solid_of(mesh), rows, max_distance=limits)
    nearer = query.ask(name, solid_of(mesh), rows, max_distance=np.nextafter(limits, 0.0))

    assert judging.same_bits(hit, free)
    assert (nearer.face_id[limits > 0.0] == NO_FACE).all()


@pytest.mark.parametrize("size", [1e-100, 1e-9, 1e60])
def test_parts_of_any_size_are_as_exact(size):
    solid = Solid(*shapes.cube(size, (0, 0, 0)))
    starts = size * np.array([[-3.0, 0.1, 0.2], [-2.0, 1.0, 0.2], [-2.0, 0.1, 0.2]])
    ends = size * np.array([[-2.5, 0.1, 0.2], [2.0, 1.0, 0.2], [2.0, 0.1, 0.2]])

    expected = size * np.array([2.0, 0.5, 0.0])
    assert solid.closest_to_segments(starts, ends).distance == pytest.approx(expected, rel=1e-15)
    assert solid.closest(starts[0]).signed_distance == pytest.approx(2.5 * size, rel=1e-15)
    assert solid.cast(starts[0], (1.0, 0.0, 0.0)).distance == pytest.approx(2.5 * size, rel=1e-15)
    assert solid.cast((-3.0 * size, 0.6 * size, 0.0), (1.0, 0.0, 0.0)).distance == np.inf
