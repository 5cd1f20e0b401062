"""Real parts: distances against brute force, and correct signs of each body at any distance."""

from functools import cache

import judging
import numpy as np
import pytest
from project import SHARED_DATA

import oracle
from proximity.scene.loader import load
from proximity.scene.sign import SignMethod

pytestmark = pytest.mark.skipif(
    not SHARED_DATA.is_dir(), reason="the real parts (shared/data beside the project) are not here"
)
STEP = pytest.param("box_sides.STEP", marks=pytest.mark.processes)  # converted by a process
FILES = ["featuretype.STL", "cycloidal.ply", STEP, "octagonal_pocket.stl", "busted.STL"]
OFFSETS = (1e-9, 1e-6, 1e-3, 1e-2)  # of the diagonal
PAIRS = 700_000  # query and face pairs for the oracle, per file


@cache
def scene_of(name):
    return load(SHARED_DATA / "cad" / name)


def on_surface(solid, count, seed):
    """Points of faces, some of them on edges and corners, and the normal of each face."""
    rng = np.random.default_rng(seed)
    corners = solid.mesh.vertices[solid.mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    faces = rng.choice(np.flatnonzero(areas > 0.0), count)
    weights = rng.dirichlet((1.0, 1.0, 1.0), count)
    weights[rng.random(count) < 0.15] = (0.5, 0.5, 0.0)
    weights[rng.random(count) < 0.15] = (1.0, 0.0, 0.0)
    return (corners[faces] * weights[:, :, None]).sum(axis=1), normals[faces] / areas[faces, None]


def diagonal(solid):
    lower, upper = solid.bounds
    return float(np.linalg.norm(upper - lower))


def around(solid, count, seed):
    """Points on both sides of the surface, at each of the offsets and farther away."""
    base, normals = on_surface(solid, count, seed)
    rng = np.random.default_rng(seed)
    offset = rng.choice([*OFFSETS, 0.1, 1.0], (count, 1)) * rng.choice([-1.0, 1.0], (count, 1))
    return base + diagonal(solid) * offset * normals


def budget(scene, part):
    """Number of queries for one part: each file takes its share of time, and each part a few."""
    face_count = part.solid.mesh.face_count
    return int(np.clip(PAIRS / len(scene.parts) / face_count, 6, 400))


@pytest.mark.parametrize("name", FILES)
def test_distance_of_real_parts_agrees_with_brute_force(name):
    scene = scene_of(name)

    for row, part in enumerate(scene.parts):
        points = around(part.solid, budget(scene, part), row)
        mesh = part.solid.mesh
        hit = part.solid.closest(points)
        judging.assert_distance_is_right(hit.signed_distance, mesh.vertices, mesh.faces, points)
        judging.assert_distance_is_right(part.solid.distance(points), mesh.vertices, mesh.faces, points)
        judging.assert_answer_holds_together(hit, mesh.vertices, mesh.faces, points)


@pytest.mark.parametrize("name", FILES)
def test_sign_of_real_parts_agrees_with_the_winding_number(name):
    """For closed bodies the winding number is an integer, which makes the sign unambiguous."""
    scene = scene_of(name)
    asked = 0

    for row, part in enumerate(scene.parts):
        solid = part.solid
        if not solid.topology.is_balanced or not solid.has_inside:
            continue
        count = -(-budget(scene, part) // (2 * len(OFFSETS)))
        base, normals = on_surface(solid, count, 100 + row)
        for offset in OFFSETS:
            for side in (-1.0, 1.0):
                points = base + side * offset * diagonal(solid) * normals
                turns = oracle.winding_number(solid.mesh.vertices, solid.mesh.faces, points)
                # Rounding of coordinates may move a point onto a neighbour of its face.
                is_off = np.abs(turns - np.rint(turns)) < 0.25
                signed, inside = solid.signed_distance(points), solid.contains(points)
                is_off &= np.abs(signed) > 1e-12 * diagonal(solid)
                expected = turns > 0.5
                assert np.array_equal((signed < 0.0)[is_off], expected[is_off]), (part.name, offset, side)
                assert np.array_equal(inside[is_off], expected[is_off]), (part.name, offset, side)
                asked += int(is_off.sum())
    assert asked > 0 or name == "busted.STL"


def test_cycloidal_is_bodies_with_an_inside_and_no_more_than_a_sheet_without():
    """The division into bodies is tested with `bodies`; here, only open ones have no sign."""
    scene = scene_of("cycloidal.ply")

    unsigned = [part.solid for part in scene.parts if not part.solid.has_inside]

    assert len(scene.parts) >= 118
    assert len(unsigned) <= 1
    assert all(not solid.is_watertight and solid.sign_method is SignMethod.NONE for solid in unsigned)


def test_scene_of_many_bodies_is_the_min_of_its_parts():
    scene = scene_of("cycloidal.ply")
    rng = np.random.default_rng(3)
    lower, upper = scene.bounds
    points = rng.uniform(lower - 0.1 * (upper - lower), upper + 0.1 * (upper - lower), (2000, 3))
    each = np.array([part.solid.signed_distance(part.pose.inverse.point(points)) for part in scene.parts])

    hit = scene.closest(points)

    room = judging.allowance(each.min(axis=0), upper)
    assert (np.abs(hit.signed_distance - each.min(axis=0)) <= room).all()
    assert (np.abs(scene.distance(points) - np.abs(each).min(axis=0)) <= room).all()
    assert np.array_equal(scene.contains(points), (each < 0.0).any(axis=0))
