"""What holds of every query, whatever it asks for: scaling, limits, and sizes of parts."""

from collections.abc import Callable
from typing import NamedTuple

import judging
import numpy as np
import pytest
import shapes
from hypothesis import given
from hypothesis import strategies as st
from query_rows import MESHES, mesh_of, solid_of, some_points, some_rays, some_scene, some_segments

from proximity.scene.queries.results import NO_FACE, NO_PART
from proximity.scene.solid import Solid


class Query(NamedTuple):
    """A query, rows to ask, and the fields of its answer."""

    rows: Callable
    distance: str
    points: tuple[str, ...]  # lengths, which scale, and are nan where there is no answer
    others: tuple[str, ...]

    def ask(self, name, asked, rows, **limit):
        return getattr(asked, name)(*rows, **limit)


QUERIES = {
    "closest": Query(
        lambda *given: (some_points(*given),),
        "signed_distance",
        ("point",),
        ("gradient", "barycentric", "face_id", "feature"),
    ),
    "cast": Query(some_rays, "distance", ("point",), ("normal", "barycentric", "face_id")),
    "closest_to_segments": Query(
        some_segments,
        "distance",
        ("point_on_segment", "point_on_solid"),
        ("fraction", "barycentric", "face_id"),
    ),
}
SCENE = some_scene(12)
NAMES = st.sampled_from(sorted(MESHES))
SEEDS = st.integers(0, 1000)
EACH_QUERY = pytest.mark.parametrize("name", QUERIES)


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
def test_the_very_distance_as_limit_still_finds(name, mesh):
    query = QUERIES[name]
    rows = query.rows(mesh, 200, 7)
    free = query.ask(name, solid_of(mesh), rows)

    hit = query.ask(name, solid_of(mesh), rows, max_distance=np.abs(getattr(free, query.distance)))

    assert judging.same_bits(hit, free)


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
