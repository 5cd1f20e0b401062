"""The winding number along a ray: an integer, equal to the rounded expansion."""

import numpy as np
import pytest
import shapes
from models import welded_model_of
from test_winding import CLOSED, points_about

import oracle
from proximity.kernels.sign.winding_along_ray import _turns_ahead, winding_along_ray
from proximity.kernels.sign.winding_number import winding_number

pytestmark = pytest.mark.internals


@pytest.fixture
def rng():
    return np.random.default_rng(29)


DIRECTIONS = [(axis, sign) for axis in range(3) for sign in (1.0, -1.0)]


def asked(mesh, points):
    """Winding numbers at points in the mesh's frame: rounded expansion, best ray, and all six rays."""
    model = welded_model_of(*mesh)
    scale, centre = model.frames["scale"][0], model.frames["centre"][0]
    root, moments = int(model.parts["root"][0]), int(model.parts["moments"][0])
    arrays = model.reals, model.words, root
    for point in (np.asarray(points, float) - centre) * scale:
        expected = round(winding_number(*arrays, moments, *point))
        best, _ = winding_along_ray(*arrays, *point)
        yield expected, best, [_turns_ahead(*arrays, *way, *point)[0] for way in DIRECTIONS]


@pytest.mark.parametrize("name", CLOSED)
def test_every_ray_tells_the_winding_number(rng, name):
    for expected, best, of_rays in asked(CLOSED[name], points_about(rng, CLOSED[name], 60)):
        assert [best, *of_rays] == [expected] * 7


@pytest.mark.parametrize("name", ["sphere", "torus", "onion", "two that overlap"])
def test_rays_along_edges_and_through_corners_slip_through_nowhere(rng, name):
    vertices, _ = CLOSED[name]
    rows = rng.integers(0, len(vertices), (120, 3))
    points = np.stack([vertices[rows[:, axis], axis] for axis in range(3)], axis=1)
    is_off = oracle.closest(*CLOSED[name], points).distance > 1e-9
    assert is_off.sum() > 60
    for expected, best, of_rays in asked(CLOSED[name], points[is_off]):
        assert [best, *of_rays] == [expected] * 7


def fans(count=256):
    """A thin plate with a round hole; top and bottom are four fans of long thin triangles each."""
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + np.pi / 4.0
    ring = np.stack([0.1 * np.cos(angles), 0.1 * np.sin(angles)], axis=1)
    square = np.array([(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)])
    flat = np.concatenate([ring, square])
    vertices = np.concatenate([np.column_stack([flat, np.full(len(flat), z)]) for z in (0.0, 0.01)])
    faces, size = [], len(flat)
    for k in range(count):
        after, corner = (k + 1) % count, count + 4 * k // count
        faces += [(k, corner, after)]
        if 4 * (k + 1) // count % 4 != corner - count:
            faces += [(after, corner, count + (corner - count + 1) % 4)]
    top = [(a + size, b + size, c + size) for a, b, c in faces]
    bottom = [(c, b, a) for a, b, c in faces]
    walls = []
    for row, is_hole in ((range(count), True), (range(count, count + 4), False)):
        for a, b in zip(row, [*row[1:], row[0]], strict=True):
            a, b = (b, a) if is_hole else (a, b)
            walls += [(a, b, b + size), (a, b + size, a + size)]
    return vertices, np.array(top + bottom + walls)


def test_fans_of_thin_triangles_take_a_fraction_of_the_steps(rng):
    """These are the steps that a query takes after its budget is spent."""
    mesh = fans()
    assert shapes.volume(*mesh) == pytest.approx(0.01 * (4.0 - 128 * 0.01 * np.sin(2.0 * np.pi / 256)))
    model = welded_model_of(*mesh)
    root, moments = int(model.parts["root"][0]), int(model.parts["moments"][0])
    scale, centre = model.frames["scale"][0], model.frames["centre"][0]
    points = rng.uniform((-1.0, -1.0, -0.0001), (1.0, 1.0, 0.0099), (200, 3))
    points = points[np.hypot(points[:, 0], points[:, 1]) > 0.11]
    steps = []
    for point in points:
        turns, taken = winding_along_ray(model.reals, model.words, root, *(point - centre) * scale)
        assert turns == (0.0 < point[2] < 0.01)
        assert turns == round(
            winding_number(model.reals, model.words, root, moments, *(point - centre) * scale)
        )
        steps.append(taken)
    assert np.mean(steps) < 0.2 * (model.parts["node_count"][0] + model.parts["block_count"][0])
