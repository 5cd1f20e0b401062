"""Segments through the public API: shortest connections of solids and scenes, against the oracle."""

import judging
import numpy as np
import pytest
import shapes
from query_rows import MESHES, solid_of, some_scene, some_segments

import oracle
from proximity.scene.queries.results import NO_FACE
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid


@pytest.mark.parametrize("name", sorted(MESHES))
def test_segment_is_never_farther_than_its_points(name):
    starts, ends = some_segments(name, 200)
    solid = solid_of(name)
    shares = np.linspace(0.0, 1.0, 21)[:, None, None]

    along = solid.distance(starts + shares * (ends - starts))

    hit = solid.closest_to_segments(starts, ends)
    room = judging.allowance(along.max(), starts, ends)
    assert (hit.distance <= along.min(axis=0) + room).all()
    own = solid.distance(hit.point_on_segment)
    assert (np.abs(own - hit.distance) <= room).all()


@pytest.mark.parametrize("name", sorted(MESHES))
def test_segment_turned_round_is_as_far(name):
    starts, ends = some_segments(name, 200)

    there = solid_of(name).closest_to_segments(starts, ends).distance
    back = solid_of(name).closest_to_segments(ends, starts).distance

    assert (np.abs(there - back) <= judging.allowance(there, starts, ends)).all()


@pytest.mark.parametrize("name", sorted(MESHES))
def test_segment_without_length_answers_as_its_point(name):
    points, _ = some_segments(name, 200)
    solid = solid_of(name)

    segment, hit = solid.closest_to_segments(points, points), solid.closest(points)

    assert np.array_equal(segment.distance, np.abs(hit.signed_distance))
    assert np.array_equal(segment.point_on_solid, hit.point)
    assert np.array_equal(segment.face_id, hit.face_id)
    assert np.array_equal(segment.barycentric, hit.barycentric)
    assert np.array_equal(segment.point_on_segment, points)
    assert (segment.fraction == 0.0).all()


TWO_FACES = np.arange(6).reshape(2, 3)


def beside_a_needle(aspect, rng):
    """A needle, another face, and a segment in the needle's plane, off its short side.

    The start's distance off the short side is lost in the rounding of the needle's length. The other face is
    closer than the needle, but farther than the needle's plane.
    """
    tip, along = rng.uniform(-1.0, 1.0, (2, 3))
    needle = np.stack([tip, tip + along, tip + along + aspect * rng.normal(size=3)])
    along, across = needle[1] - needle[0], needle[2] - needle[1]
    normal = np.cross(along, across)
    along, normal = along / np.linalg.norm(along), normal / np.linalg.norm(normal)
    height = min(10.0 ** rng.uniform(-19.0, -16.0) / aspect, 0.01)
    start = needle[1] + rng.random() * across + height * (3.0 * along + normal)
    end = start + 0.1 * height * (along + 0.5 * rng.normal(size=3))
    corner = start + 2.0 * height * normal
    others = corner + 0.3 * (normal + 0.5 * rng.normal(size=(2, 3)))
    needle = np.roll(needle, rng.integers(3), axis=0)  # with any corner first
    return np.stack([*needle, corner, *others]), start, end


@pytest.mark.parametrize("aspect", [1e-6, 1e-10, 1e-14])
def test_segment_beside_a_needle_is_as_far_as_the_oracle_says(aspect):
    rng = np.random.default_rng(3)
    for _ in range(60):
        vertices, start, end = beside_a_needle(aspect, rng)

        hit = Solid(vertices, TWO_FACES).closest_to_segments(start, end)

        expected = oracle.segment_distance(vertices, TWO_FACES, start, end).distance
        assert abs(hit.distance - expected) <= judging.allowance(expected, vertices, start, end)


def test_needle_does_not_win_by_its_plane():
    # Regression: returned the needle, at twice the distance.
    vertices = [
        (0.07849448522167557, 0.2692870904853205, 0.1246227581057423),
        (-0.17192060773986734, -0.6243003491327406, 0.49717311574065326),
        (-0.17192060773989878, -0.6243003491327156, 0.49717311574069195),
        (-0.17191025586671688, -0.6246666867616484, 0.4971814798406081),
        (-0.015238583529701583, -0.8035717565690849, 0.3075846362900912),
        (0.025541092814949762, -0.7134870008501135, 0.2826496250753605),
    ]
    start = (-0.17201092403385107, -0.6246226360402185, 0.497307482113007)
    end = (-0.17200271346167076, -0.6245933372304477, 0.4972952669882476)

    hit = Solid(vertices, TWO_FACES).closest_to_segments(start, end)

    assert hit.face_id == 1
    assert hit.distance == pytest.approx(1.639392435e-4, rel=1e-9)


@pytest.mark.parametrize("name", ["cube", "torus", "hollow cube"])
def test_segment_that_crosses_tells_the_crossing_nearest_to_its_start(name):
    solid = solid_of(name)
    rng = np.random.default_rng(11)
    starts = rng.uniform(-3.0, 3.0, (300, 3))
    ends = rng.uniform(-3.0, 3.0, (300, 3))

    hit, ray = solid.closest_to_segments(starts, ends), solid.cast(starts, ends - starts)

    length = np.linalg.norm(ends - starts, axis=1)
    crosses = ray.distance <= length
    assert crosses.sum() > 20
    assert (hit.distance[crosses] == 0.0).all()
    assert (hit.distance[~crosses] > 0.0).all()
    first = ray.distance[crosses] / length[crosses]
    assert np.abs(hit.fraction[crosses] - first).max() <= 1e-12
    assert np.abs(hit.point_on_solid[crosses] - ray.point[crosses]).max() <= 1e-12


@pytest.mark.parametrize(
    "start, end", [((1.0, 0.5, 0.5), (2.0, 0.5, 0.5)), ((1.0, 1.0, 1.0), (2.0, 3.0, 4.0))]
)
def test_segment_that_touches_has_distance_zero(start, end):
    hit = solid_of("cube").closest_to_segments(start, end)

    assert (hit.distance, hit.fraction) == (0.0, 0.0)
    assert solid_of("cube").closest_to_segments(end, start).distance == 0.0


@pytest.mark.parametrize("far", [1e3, 1e9, 1e20])
def test_segment_that_ends_far_away_is_as_exact_near_the_part(far):
    """Its error is the rounding of its own coordinates."""
    for asked in (solid_of("cube"), Scene([solid_of("cube"), Solid(*shapes.cube(1.0, (9, 9, 9)), name="b")])):
        beside = asked.closest_to_segments((-far, 0.5, 3.0), (far, 0.5, 3.0))
        away = asked.closest_to_segments((2.0, 0.5, 0.5), (far, 0.5, 0.5))
        through = asked.closest_to_segments((-far, 0.5, 0.25), (far, 0.5, 0.25))

        assert beside.distance == pytest.approx(2.0, rel=1e-15 * far + 1e-12) or far > 1e15
        assert away.distance == 1.0
        assert through.distance == 0.0


@pytest.mark.parametrize("asked", [solid_of("torus"), some_scene(3)], ids=["solid", "scene"])
@pytest.mark.parametrize("count", [1, 100])
def test_segment_with_an_end_that_cannot_be_computed_with_has_no_distance(asked, count):
    """Regression: clamping each coordinate of the ends gave 1e100, or 0 instead of half a metre."""
    near, far = [-1.0, -0.5, 0.1], [1e200, 1e150, 0.1]
    for start, end in ((near, far), (far, near), (far, far), ([1e200, 0.0, 0.0], [1e200, 1.0, 0.0])):
        hit = asked.closest_to_segments([start] * count, [end] * count)

        assert np.isnan(hit.distance).all() and np.isnan(hit.point_on_solid).all()
        assert (hit.face_id == NO_FACE).all()
