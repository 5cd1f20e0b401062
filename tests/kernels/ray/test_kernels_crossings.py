"""Faces that cross others: exactly these are found, and no sign near them is wrong."""

import numpy as np
import pytest
import shapes
from models import folded_faces_of
from part_arrays import part_arrays
from project import ROOT

import oracle
import proximity
from proximity import ContactFlag
from proximity.kernels.ray import edge_contact, self_intersections
from proximity.scene.scene import Scene
from proximity.scene.sign import SignMethod
from proximity.scene.solid import Solid
from proximity.tracker.tracker import Tracker

ACROSS = np.array([[1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 2.0**0.5]]) / 2.0**0.5
"""Rotates a cube so that one of its edges reaches farthest along x."""


def edge_to_edge(depth, finer=0):
    """Two crossing beams, an edge of each at *depth* in the other; no corner is near the other beam."""
    beam = np.array([0.6, 0.6, 2.0])
    vertices, faces = shapes.cube(1.0, (0.0, 0.0, 0.0))
    for _ in range(finer):
        vertices, faces = shapes.quartered(vertices, faces)
    one = (vertices * beam) @ ACROSS.T
    other = one[:, [0, 2, 1]] * (1.0, 1.0, -1.0) + (2.0 * one[:, 0].max() - depth, 0.07, 0.05)
    return shapes.join((one, faces), (other, faces))


def ball_in_ball(depth):
    """Two balls that overlap by *depth*."""
    return shapes.join(
        shapes.sphere(1.0, 4), shapes.moved(shapes.sphere(0.5, 3), (1.5 - depth, 0.003, 0.002))
    )


def corner_in_side(depth):
    """A cube with a corner at *depth* in the side of another."""
    vertices, faces = shapes.cube(0.4, (0.0, 0.0, 0.0))
    turned = vertices @ shapes.rotation(5).T
    lowest = turned[turned[:, 2].argmin()]
    return shapes.join(shapes.box((-1, -1, -1), (1, 1, 0)), (turned - lowest + (0.11, 0.07, -depth), faces))


def ball_deep_inside():
    """A tiny ball, facing outward too, in a body of many small faces."""
    torus = shapes.torus(n=96, m=48)
    return shapes.join(torus, shapes.moved(shapes.sphere(1e-3, 1), (2.2, 0.1, 0.05)))


def finer(mesh, times):
    for _ in range(times):
        mesh = shapes.quartered(*mesh)
    return mesh


def flush_boss(place, size, times=4):
    """A small boss flush on a plate of small faces, with balls that attract the sign samples."""
    plate = finer(shapes.box((0, 0, 0), (1, 1, 0.2)), times)
    low, high = (*place, 0.2), (place[0] + size, place[1] + size, 0.2 + size)
    balls = [shapes.moved(shapes.sphere(0.03, 2), (x, y, 0.5)) for x in (0.2, 0.5, 0.8) for y in (0.2, 0.8)]
    return shapes.join(plate, finer(shapes.box(low, high), 1), *balls)


def flush_beams(overlap):
    """Two beams, one extending into the end of the other, with all sides coplanar."""
    one, other = shapes.box((0, 0, 0), (1, 0.2, 0.2)), shapes.box((1 - overlap, 0, 0), (2, 0.2, 0.2))
    return shapes.join(finer(one, 3), finer(other, 2))


MEETINGS = {
    "boss on a plate": flush_boss((0.503, 0.504), 0.02),
    "tiny boss on a plate": flush_boss((0.503, 0.504), 1e-3),
    "boss at the rim of a plate": flush_boss((0.0, 0.31), 0.02),
    "boss at the corner of a plate": flush_boss((0.0, 0.0), 0.02),
    "large boss at the corner of a plate": flush_boss((0.0, 0.0), 0.3),
    "boss on a plate of two faces": flush_boss((0.503, 0.504), 0.02, 0),
    **{f"beams, flush, {overlap:g} deep": flush_beams(overlap) for overlap in (0.05, 3e-3, 1e-5)},
    **{f"edges, {depth:g} deep": edge_to_edge(depth) for depth in (0.03, 0.01, 1e-3, 1e-6, 1e-8)},
    **{f"edges of small faces, {depth:g} deep": edge_to_edge(depth, 3) for depth in (0.03, 1e-3, 1e-5)},
    **{f"balls, {depth:g} deep": ball_in_ball(depth) for depth in (1e-2, 4e-3)},
    **{f"corner, {depth:g} deep": corner_in_side(depth) for depth in (3e-3, 1e-5)},
    "ball deep inside": ball_deep_inside(),
}


def faces_that_pass(vertices, faces):
    """Faces that cross others, by brute force for a mesh in general position."""
    pairs = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, of_half_edge = np.unique(pairs, axis=0, return_inverse=True)
    a, b, c = (vertices[faces[:, k]] for k in range(3))

    def side(p, q, r, s):
        """Sign of the volume of a tetrahedron; 0 if flat, as for coplanar faces of a cube's side."""
        volumes = np.einsum("...i,...i", np.cross(q - p, r - p), s - p)
        return np.where(np.abs(volumes) > 1e-12, np.sign(volumes), 0.0)

    passed = np.zeros(len(faces), bool)
    is_passing = np.zeros(len(edges), bool)
    for row, (start, end) in enumerate(edges):
        p, q = vertices[start], vertices[end]
        around = [side(p, q, a, b), side(p, q, b, c), side(p, q, c, a)]
        meets = np.abs(sum(around)) == 3
        meets &= side(a, b, c, p) * side(a, b, c, q) < 0
        meets &= ~np.isin(faces, (start, end)).any(axis=1)
        passed |= meets
        is_passing[row] = meets.any()
    return passed | is_passing[of_half_edge.reshape(-1)].reshape(-1, 3).any(axis=1)


def bare_marks(solid):
    """Marks of the kernel, before neighbours and faces with a wrong sign are added."""
    piece = part_arrays(solid.snapshot(), 0)
    model = solid.snapshot()
    marks = np.zeros(len(piece.faces), bool)
    stacks = np.zeros(self_intersections.STACKS_SIZE, np.float32)
    tree, candidates = (model.reals, model.words, 0), np.zeros(len(piece.faces), np.uint8)
    self_intersections.note_candidates(
        piece.corners, piece.faces, piece.neighbors, piece.bvh.slot_faces, *tree, 1e-12, candidates
    )
    for are_flat in (False, True):
        self_intersections._mark_meeting(
            piece.corners, piece.faces, piece.neighbors, piece.bvh.slot_faces, tree, candidates,
            1e-12, 10**6, are_flat, stacks, marks,
        )  # fmt: skip
    return marks


@pytest.mark.internals
@pytest.mark.parametrize("seed", range(6))
def test_faces_that_pass_are_those_of_brute_force(seed):
    rng = np.random.default_rng(seed)
    shells = [shapes.sphere(1.0, 2), shapes.torus(0.9, 0.3, 12, 7), shapes.quartered(*shapes.cube(1.2))]
    turned = [(vertices @ shapes.rotation(seed + k).T, faces) for k, (vertices, faces) in enumerate(shells)]
    vertices, faces = shapes.join(*(shapes.moved(shell, rng.normal(0.0, 0.6, 3)) for shell in turned))
    solid = Solid(vertices, faces)
    expected = faces_that_pass(solid.mesh.vertices, solid.mesh.faces)
    assert expected.any() and not expected.all()
    np.testing.assert_array_equal(bare_marks(solid), expected)


@pytest.mark.parametrize("name", MEETINGS)
def test_side_is_right_wherever_a_body_meets_itself(name):
    vertices, faces = MEETINGS[name]
    solid = Solid(vertices, faces)
    marked = folded_faces_of(solid)
    rng = np.random.default_rng(len(name))
    assert solid.is_watertight
    if solid.sign_method is SignMethod.PSEUDONORMAL:
        assert f"; {len(marked)} faces are folded over, or pass through others" in solid.sign_reason

    rows = rng.choice(marked, 1000) if len(marked) else rng.integers(0, len(faces), 1000)
    on = (rng.dirichlet((1.0, 1.0, 1.0), 1000)[:, :, None] * vertices[faces[rows]]).sum(axis=1)
    points = on + rng.normal(size=(1000, 3)) * 10.0 ** rng.uniform(-8, -1, (1000, 1))
    inside = oracle.winding_number(vertices, faces, points) > 0.5
    fingers = points[:300]
    contacts = Tracker(Scene([solid]), fingers=len(fingers), radius=0.0).tick(fingers, 10**6, 10**6)

    is_off = np.abs(solid.distance(points)) > 1e-9
    np.testing.assert_array_equal((solid.signed_distance(points) < 0.0)[is_off], inside[is_off])
    np.testing.assert_array_equal(solid.contains(points)[is_off], inside[is_off])
    told = contacts["flags"] & ContactFlag.INSIDE != 0
    np.testing.assert_array_equal(told[is_off[:300]], inside[:300][is_off[:300]])


@pytest.mark.parametrize("depth", [0.03, 0.01, 1e-3])
def test_beams_that_cross_mid_edge_keep_their_normals_elsewhere(depth):
    """The samples miss so small an overlap: without the marks these signs would be wrong."""
    solid = Solid(*edge_to_edge(depth))
    assert solid.sign_method is SignMethod.PSEUDONORMAL
    assert 0 < len(folded_faces_of(solid)) < len(solid.mesh.faces)


def test_marks_outlast_a_scene_that_gives_the_part_another_shape():
    """Earlier solids keep their shape; after rebuilding they have the same signs."""
    vertices, faces = edge_to_edge(0.03, 2)
    first = Solid(vertices, faces, name="beams")
    marked = folded_faces_of(first)
    scene = Scene([first])
    scene.deform("beams", 2.0 * vertices)
    second = scene.part("beams").solid
    scene.deform("beams", 3.0 * vertices)
    rng = np.random.default_rng(3)
    on = (rng.dirichlet((1.0, 1.0, 1.0), 4000)[:, :, None] * vertices[faces[rng.choice(marked, 4000)]]).sum(1)
    points = on + rng.normal(size=on.shape) * 10.0 ** rng.uniform(-4, -2, (4000, 1))
    inside = oracle.winding_number(vertices, faces, points) > 0.5

    assert len(marked)
    for size, solid in ((1.0, first), (2.0, second), (3.0, scene.part("beams").solid)):
        np.testing.assert_array_equal(solid.signed_distance(size * points) < 0.0, inside)
        np.testing.assert_array_equal(folded_faces_of(solid), marked)


@pytest.mark.parametrize("make", ["bracket.stl", "gear.stl", "plate.stl", "hollow_box.stl", "torus.ply"])
def test_usual_parts_have_no_marks(make):
    for part in proximity.load(ROOT / "meshes" / make).parts:
        assert len(folded_faces_of(part.solid)) == 0, part.solid.sign_reason


def test_lid_that_is_a_fan_of_slivers_has_no_marks():
    """Its long edges nearly meet one another, but lie between coplanar faces."""
    count = 6000
    turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros(count)], axis=1)
    vertices = np.vstack([rim, rim + np.array([0, 0, 0.1]), [[0, 0, 0], [0, 0, 0.1]]])
    this, after = np.arange(count), np.roll(np.arange(count), -1)
    low, high = np.full(count, 2 * count), np.full(count, 2 * count + 1)
    faces = np.vstack(
        [
            np.stack(corners, axis=1)
            for corners in (
                (low, after, this),
                (high, this + count, after + count),
                (this, after, after + count),
                (this, after + count, this + count),
            )
        ]
    )

    solid = Solid(vertices, faces)

    assert solid.is_watertight
    assert len(folded_faces_of(solid)) == 0


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9])
def test_bodies_that_do_not_pass_through_have_no_marks(gap):
    solid = Solid(*edge_to_edge(-gap))
    assert len(folded_faces_of(solid)) == 0, solid.sign_reason
    assert "folded" not in solid.sign_reason


@pytest.mark.internals
def test_faces_without_area_are_no_faces_to_pass_through():
    """Tessellation leaves needles of zero width along edges, with heights of rounding only."""
    corners = np.array(
        [[0, 0, 0], [0.1, 0.3, 0.2], [0.3, 0.9, 0.6 + 2e-16], [0, 0.3, 0.5], [0.2, 0.3, -0.1], [0.1, -1, 0]]
    )
    faces = np.array([[0, 1, 2], [0, 2, 5]])
    assert edge_contact.reaches_through(corners, faces, 1, 3, 4, 1e-10)
    assert not edge_contact.reaches_through(corners, faces, 0, 3, 4, 1e-10)


def test_faces_of_a_tangle_all_count_as_passing_through():
    """All rods cross at their centres: testing every pair would take too long."""
    rod = shapes.box((-1.0, -1e-4, -1e-4), (1.0, 1e-4, 1e-4))
    rods = [(rod[0] @ shapes.rotation(seed).T, rod[1]) for seed in range(600)]
    solid = Solid(*shapes.join(*rods))
    model, piece = solid.snapshot(), part_arrays(solid.snapshot(), 0)
    marked = self_intersections.passing_faces(
        piece.corners, piece.faces, piece.neighbors, piece.bvh.slot_faces,
        model.reals, model.words, 0, int(model.parts["moments"][0]),
    )  # fmt: skip
    assert np.unpackbits(marked).sum() == len(solid.mesh.faces)
