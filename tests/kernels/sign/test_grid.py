"""The sign grid: its inside and outside cells are correct, and cells touched by a face are crossed."""

import numba
import numpy as np
import pytest
import shapes
from models import welded_model_of
from part_arrays import part_arrays

import oracle
from proximity.kernels.layout import CELL_CROSSED, CELL_INSIDE, CELL_OUTSIDE, SIGN_PSEUDONORMAL
from proximity.kernels.part.sign_choice import restore_sign
from proximity.kernels.sign.inside_grid import (
    MAX_GRID,
    MAX_POINTS,
    build_grid,
    cell_state,
    uncertain_points,
)

pytestmark = pytest.mark.internals


@numba.njit
def states_at(words, lower, rate, counts, points, out):
    """State of the cell of each point."""
    for i in range(len(points)):
        out[i] = cell_state(words, 0, lower, rate, (counts[0], counts[1], counts[2]), points[i])


class Grid:
    """The grid of a mesh, in its local frame."""

    def __init__(self, vertices, faces, *, rate=None):
        model = welded_model_of(vertices, faces)
        restore_sign(model.packed, SIGN_PSEUDONORMAL, True, np.zeros(0, np.int32))
        piece = part_arrays(model, 0)
        self.corners, self.faces = piece.corners, piece.faces
        self.lower, self.rate = np.array(piece.grid_lower), piece.grid_rate
        self.counts, self.packed = np.array(piece.grid_counts), piece.grid
        if rate is not None:
            self._build_anew(model, rate)

    def _build_anew(self, model, rate):
        root, moments = int(model.parts["root"][0]), int(model.parts["moments"][0])
        extent = self.corners.max(axis=0) - self.lower
        self.rate, self.counts = rate, np.floor(extent * rate).astype(np.int64) + 1
        counts = (int(n) for n in self.counts)
        self.packed = build_grid(
            self.corners, self.faces, self.lower, rate, *counts, model.reals, model.words, root, moments
        )

    def states(self, points):
        out = np.empty(len(points), np.int64)
        states_at(self.packed.view(np.float32), self.lower, self.rate, self.counts, points, out)
        return out

    def uncertain_points(self):
        counts = (int(n) for n in self.counts)
        return uncertain_points(self.corners, self.faces, self.lower, self.rate, *counts, self.packed)

    def points_in_cells(self, rng, count):
        return self.lower + rng.random((count, 3)) * self.counts / self.rate


def fan(n=60, height=0.02):
    """A disc whose two sides are fans of needles, like those of CAD programs."""
    angle = 2 * np.pi * np.arange(n) / n
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
    k, here, there = np.arange(1, n - 1), np.arange(n), np.roll(np.arange(n), -1)
    zero = np.zeros_like(k)
    faces = [
        [zero, k + 1, k],
        [zero + n, n + k, n + k + 1],
        [here, there, n + there],
        [here, n + there, n + here],
    ]
    faces = np.concatenate([np.stack(each, axis=1) for each in faces])
    return np.concatenate([rim, rim + np.array([0.0, 0.0, height])]), faces


def turned(mesh, seed=3):
    return mesh[0] @ shapes.rotation(seed).T, mesh[1]


MESHES = {
    "tetrahedron": shapes.tetrahedron(),
    "cube": shapes.cube(),
    "turned cube": turned(shapes.cube()),
    "sphere": shapes.sphere(1.0, 2),
    "torus": turned(shapes.torus()),
    "cavity": shapes.hollow_cube(),
    "thin plate": shapes.box((0, 0, 0), (1, 1, 1e-4)),
    "turned plate": turned(shapes.box((0, 0, 0), (1, 1, 1e-3))),
    "rod": turned(shapes.box((0, 0, 0), (1, 1e-3, 1e-3))),
    "fan": fan(),
    "turned fan": turned(fan()),
    "hair": turned(shapes.box((0, 0, 0), (1, 1e-13, 1e-13))),
    "far away": shapes.moved(shapes.sphere(1.0, 1), (1e4, -1e4, 1e4)),
    "voxels": shapes.voxels(np.random.default_rng(1).random((4, 4, 4)) < 0.4),
    "two that overlap": shapes.join(shapes.cube(), shapes.cube(center=(1, 1, 1))),
}


@pytest.mark.parametrize("name", MESHES)
def test_no_cell_contradicts_the_winding_number(name):
    grid = Grid(*MESHES[name])
    points = grid.points_in_cells(np.random.default_rng(7), 1500)

    states = grid.states(points)

    turns = np.rint(oracle.winding_number(grid.corners, grid.faces, points))
    assert (turns[states == CELL_OUTSIDE] == 0).all()
    assert (turns[states == CELL_INSIDE] >= 1).all()
    assert set(states.tolist()) <= {CELL_OUTSIDE, CELL_INSIDE, CELL_CROSSED}


@pytest.mark.parametrize("name", MESHES)
def test_cell_that_a_face_touches_is_crossed(name):
    grid = Grid(*MESHES[name])
    rng = np.random.default_rng(7)
    corners = grid.corners[grid.faces[rng.integers(0, len(grid.faces), 1500)]]
    weights = rng.dirichlet((0.5, 0.5, 0.5), 1500)
    points = (corners * weights[:, :, None]).sum(axis=1)
    # Rounding may move them off their face, but not out of the grid.
    points = np.clip(points, grid.corners.min(axis=0), grid.corners.max(axis=0))

    assert (grid.states(points) == CELL_CROSSED).all()
    assert (grid.states(grid.corners) == CELL_CROSSED).all()


@pytest.mark.parametrize("name", ["cube", "sphere", "torus", "cavity", "fan"])
@pytest.mark.parametrize("rate", [1.0, 3.0, 8.0, 16.0])
def test_cells_of_any_size_tell_no_lie(name, rate):
    # Rates at which faces of the cube lie exactly on cell boundaries.
    grid = Grid(*MESHES[name], rate=rate)
    points = grid.points_in_cells(np.random.default_rng(7), 800)

    states = grid.states(points)

    turns = np.rint(oracle.winding_number(grid.corners, grid.faces, points))
    assert (turns[states == CELL_OUTSIDE] == 0).all()
    assert (turns[states == CELL_INSIDE] == 1).all()
    assert (grid.states(grid.corners) == CELL_CROSSED).all()


@pytest.mark.parametrize(("name", "least"), [("cube", 0.1), ("sphere", 0.1), ("torus", 0.3), ("cavity", 0.1)])
def test_many_points_are_told_by_one_look(name, least):
    grid = Grid(*MESHES[name])
    states = grid.states(grid.points_in_cells(np.random.default_rng(7), 4000))

    assert (states != CELL_CROSSED).mean() >= least


@pytest.mark.parametrize("name", ["cube", "turned cube", "sphere", "torus", "cavity"])
def test_faces_and_grid_agree_where_nothing_lies_between(name):
    places, is_inside, is_clear = Grid(*MESHES[name]).uncertain_points()

    assert len(places) == len(is_inside) == 0
    assert is_clear.shape == (len(MESHES[name][1]),)


def test_faces_and_grid_differ_on_faces_inside_the_body():
    grid = Grid(*shapes.join(shapes.sphere(2.0, 4), shapes.sphere(1.0, 3)))

    places, is_inside, is_clear = grid.uncertain_points()

    # Only above the inner ball, whose faces all have clear cells on both sides; more than the limit exist.
    distances = np.linalg.norm(places - 0.5 * (grid.corners.max(axis=0) + grid.corners.min(axis=0)), axis=1)
    assert MAX_POINTS // 2 <= len(places) <= MAX_POINTS
    assert is_inside.all() and is_clear.all()
    assert (distances < 0.3 * (grid.corners.max() - grid.corners.min())).all()
    assert (grid.states(places) == CELL_INSIDE).all()


def test_beyond_the_grid_is_outside():
    grid = Grid(*shapes.cube())
    upper = grid.lower + grid.counts / grid.rate
    points = [grid.lower - 1e-9, upper + 1e-9, [1e30, 0, 0], [0, -1e30, 0], [np.inf, 0, 0], [np.nan, 0, 0]]

    assert (grid.states(np.array(points)) == CELL_OUTSIDE).all()


@pytest.mark.parametrize("name", MESHES)
def test_grid_is_no_larger_than_its_limit(name):
    grid = Grid(*MESHES[name])

    assert (grid.counts >= 1).all()
    assert grid.counts.prod() <= 2 * MAX_GRID
    assert len(grid.packed) == -(-grid.counts.prod() // 16)
    assert (grid.lower + grid.counts / grid.rate >= grid.corners.max(axis=0)).all()


def test_cavity_is_outside_and_wall_is_inside():
    grid = Grid(*shapes.hollow_cube(), rate=16.0)
    middle = grid.corners.mean(axis=0, keepdims=True)
    wall = middle + 2.0 / 3.0 * (grid.corners.max(axis=0) - middle)  # the cavity ends at a third

    assert grid.states(middle)[0] == CELL_OUTSIDE
    assert grid.states(wall)[0] == CELL_INSIDE
