"""Triangulation of polygons: number, total area and orientation of the triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from proximity.formats import polygons


def cut(points):
    """Return the triangles of one polygon of all vertices in order."""
    points = np.asarray(points, dtype=np.float64)
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    faces, rows = polygons.triangulate(points, np.arange(len(points)), np.array([len(points)]))
    assert len(faces) == len(points) - 2 and not rows.any()
    return points, faces


def areas(points, faces):
    """Return each triangle's signed area along Newell's normal of the polygon, and the polygon's area."""
    normal = np.cross(points, np.roll(points, -1, axis=0)).sum(axis=0)
    a, b, c = points[faces].transpose(1, 0, 2)
    return np.cross(b - a, c - a) @ (normal / np.linalg.norm(normal)) / 2.0, np.linalg.norm(normal) / 2.0


@pytest.mark.parametrize(
    "points",
    [
        [(0, 0), (4, 0), (4, 3), (0, 3)], [(0, 0), (4, 0), (1, 1), (0, 4)], [(4, 0), (1, 1), (0, 4), (0, 0)],
        [(0, 0), (2, 0), (3, 1), (2, 2), (0, 2)], [(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)],
        [(0, 0), (1, 0), (2, 0), (2, 2), (0, 2)], [(0, 0), (1, 0), (2, 0), (1, 1), (0, 2), (0, 1)],
        [(0, 0), (3, 0), (3, 1), (1, 1), (1, 2), (3, 2), (3, 3), (0, 3)],
        [(0, 0), (9, 0), (9, 9), (0, 9), (0, 0), (3, 3), (3, 6), (6, 6), (6, 3), (3, 3)],
    ],
    ids=[
        "square", "dart", "dart turned", "pentagon", "M", "mid-side", "mid-sides", "C", "hole with a bridge",
    ],
)  # fmt: skip
def test_polygon_is_covered_once_by_triangles_that_turn_its_way(points):
    parts, whole = areas(*cut(points))
    assert (parts > 0.0).all(), "no triangle may be without area: it would be dropped later and leave a hole"
    assert parts.sum() == pytest.approx(whole, rel=1e-14)


@pytest.mark.parametrize("sign", [1, -1])
def test_polygon_of_any_sense_keeps_it(sign):
    points, triangles = cut([(0, 3), (0, 0), (4, 0), (4, 4), (2, 1)][::sign])
    a, b, c = points[triangles].transpose(1, 0, 2)
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    assert (turn * sign > 0).all()


@settings(max_examples=60, derandomize=True)
@given(
    heights=st.lists(st.integers(1, 9), min_size=2, max_size=12),
    pieces=st.integers(1, 4),
    turn=st.floats(0.0, 6.3),
)
def test_corners_along_straight_sides_leave_no_triangle_without_area(heights, pieces, turn):
    steps = [(x + dx, height) for x, height in enumerate(heights) for dx in (0, 1)]
    outline = np.array([(0, 0), (len(heights), 0), *steps[::-1]], dtype=np.float64)
    sides = np.roll(outline, -1, axis=0) - outline
    is_side = sides.any(axis=1)  # vertices of equal height share a corner
    places = np.arange(pieces)[:, None] / pieces
    points = (outline[is_side, None] + places * sides[is_side, None]).reshape(-1, 2)
    points = points @ [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    parts, whole = areas(*cut(points))
    assert parts.min() > 1e-6
    assert parts.sum() == pytest.approx(whole, rel=1e-12)


@settings(max_examples=60, derandomize=True)
@given(
    radii=st.lists(st.floats(0.2, 1.0), min_size=5, max_size=24),
    seed=st.integers(0, 1000),
    scale=st.sampled_from([1e-60, 1.0, 1e60]),
)
def test_any_star_shaped_polygon_anywhere_in_space_is_covered_once(radii, seed, scale):
    angles = 2.0 * np.pi * np.arange(len(radii)) / len(radii)
    flat = np.column_stack([np.cos(angles) * radii, np.sin(angles) * radii, np.zeros(len(radii))])
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    points = flat @ turn.T
    scaled, faces = cut(points * scale)
    parts, whole = areas(scaled / scale, faces)
    assert parts.sum() == pytest.approx(whole, rel=1e-12)
    assert (parts > -1e-12).all()


@pytest.mark.parametrize(
    "points",
    [
        [(np.cos(t), np.sin(t)) for t in 4.0 * np.pi * np.arange(5) / 5.0],
        [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4)],
        [(0, 0)] * 6,
        [(0, 0), (1, 0), (np.nan, 1), (0, 1), (0, 0.5)],
        [(0, 0), (np.inf, 0), (1, 1), (0, 1)],
    ],
    ids=["pentagram", "line", "point", "nan", "infinite"],
)
def test_senseless_polygon_still_gives_two_triangles_less_than_corners(points):
    _, faces = cut(points)
    assert set(faces.ravel()) <= set(range(len(points)))


def test_polygons_of_all_sizes_stay_in_order():
    square = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (-1, 0.5, 0)], dtype=np.float64)
    corners = np.array([0, 1, 2, 3, 4, 0, 1, 2, 3, 0, 1, 2])
    faces, rows = polygons.triangulate(square, corners, np.array([5, 4, 3]))
    assert rows.tolist() == [0, 0, 0, 1, 1, 2] and rows.dtype == np.int32
    assert faces[5].tolist() == [0, 1, 2] and faces.dtype == np.int64
