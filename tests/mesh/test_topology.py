"""Faces at each edge, and the number of defects of a mesh."""

import math

import numpy as np
import pytest
import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from proximity.kernels.mesh.edges import MANY_NEIGHBORS, NO_NEIGHBOR
from proximity.kernels.mesh.positions import merged_faces
from proximity.mesh.diagnosis import diagnose
from proximity.mesh.topology import build_topology
from proximity.mesh.triangle_mesh import TriangleMesh


def topology_of(mesh):
    return build_topology(TriangleMesh(*mesh))


def diagnosis_of(mesh):
    return diagnose(TriangleMesh(*mesh))


def with_faces(mesh, *faces):
    return mesh[0], np.concatenate([mesh[1], faces])


def with_a_turned_face(mesh, row=4):
    mesh[1][row] = mesh[1][row, ::-1]
    return mesh


def with_minus_zeros(vertices, faces):
    vertices[::2] = np.where(vertices[::2] == 0.0, -0.0, vertices[::2])
    return vertices, faces


def with_another_last_bit(vertices, faces):
    vertices[vertices == 1.0] *= np.where(np.arange((vertices == 1.0).sum()) == 0, 1 + 2**-52, 1.0)
    return vertices, faces


NO_VOLUME = pytest.approx(math.nan, nan_ok=True)
WRONG_EDGES = ("boundary_edge_count", "nonmanifold_edge_count", "misoriented_edge_count")
SOLID = dict.fromkeys(WRONG_EDGES, 0) | {
    "is_watertight": True, "is_balanced": True, "is_oriented": True, "manifold_status": "NoError",
    "is_solid_by_manifold": True,
}  # fmt: skip
SHEET = shapes.grid(2, 2)
# Properties of a mesh, of its topology, diagnosis, or both; "lonely" and "contested" count edges of faces
# without a neighbour, and with several.
KNOWN = {
    **{f"closed: {len(mesh[1])} faces": (mesh, SOLID | {"edge_count": 3 * len(mesh[1]) // 2})
       for mesh in (shapes.tetrahedron(), shapes.cube(), shapes.hollow_cube(), shapes.sphere(subdivisions=1),
                    shapes.torus())},
    "cube": (
        shapes.cube(2.0, center=(1.0, 2.0, 3.0)),
        SOLID | {"vertex_count": 8, "face_count": 12, "shell_count": 1, "volume": 8.0, "area": 24.0,
                 "lower": (0.0, 1.0, 2.0), "upper": (2.0, 3.0, 4.0)}),
    "minus zero and zero": (with_minus_zeros(*shapes.soup(*shapes.tetrahedron())), SOLID),
    "positions that differ in the last bit": (
        with_another_last_bit(*shapes.soup(*shapes.tetrahedron())), {"boundary_edge_count": 4}),
    "open box": (
        shapes.open_box(),
        {"boundary_edge_count": 4, "lonely": 4, "is_watertight": False, "is_balanced": False,
         "is_oriented": True, "volume": NO_VOLUME, "area": 5.0, "is_solid_by_manifold": False,
         "manifold_status": "NotManifold"}),
    "turned face": (
        with_a_turned_face(shapes.cube()),
        {"misoriented_edge_count": 3, "contested": 6, "is_watertight": False, "is_balanced": False,
         "is_oriented": False, "volume": NO_VOLUME, "shell_count": 1}),
    "cubes that share an edge": (
        shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 1, 0))),
        {"nonmanifold_edge_count": 1, "contested": 4, "shell_count": 2, "is_watertight": False,
         "is_balanced": True, "is_oriented": True, "volume": 2.0}),
    "cubes that share a corner": (
        shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 1, 1))), {"is_watertight": True}),
    "Moebius strip": (shapes.strip(half_turns=1), {"misoriented_edge_count": 1, "is_oriented": False}),
    "strip": (shapes.strip(), {"misoriented_edge_count": 0, "is_oriented": True}),
    "faces with two equal corners, each to itself": (
        with_faces(shapes.tetrahedron(), [0, 0, 1], [2, 2, 2]),
        {"is_watertight": False, "is_balanced": True, "boundary_edge_count": 2, "lonely": 4}),
    "face without area": (
        with_faces(shapes.cube(), [0, 0, 1]),
        {"is_watertight": False, "boundary_edge_count": 1, "volume": 1.0}),
    "cavity": (
        shapes.hollow_cube(size=3.0, cavity_size=1.0),
        {"shell_count": 2, "volume": pytest.approx(26.0, rel=1e-15), "area": pytest.approx(60.0, rel=1e-15),
         "is_solid_by_manifold": True}),
    "inside out": (
        shapes.inside_out(shapes.cube()),
        {"volume": -1.0, "is_watertight": True, "manifold_status": "NoError", "is_solid_by_manifold": False}),
    # One integer offset: coordinates stay exact, so the volume must too.
    "ten kilometres away": (shapes.moved(shapes.cube(0.5), (1e4, -1e4, 1e4)), {"volume": 0.125}),
    **{f"cube of {size} m": (
           shapes.cube(size, center=(0, 0, 0)),
           {"volume": volume, "area": 6 * size**2, "is_solid_by_manifold": True})
       for size, volume in ((2.0**-30, 2.0**-90), (2.0**200, 2.0**600), (2.0**400, math.inf))},
    "single point": (
        (np.ones((1, 3)), np.zeros((1, 3), dtype=int)),
        {"area": 0.0, "volume": 0.0, "is_solid_by_manifold": False}),
    "flat double sheet": (
        shapes.join(SHEET, shapes.inside_out(SHEET)), {"volume": 0.0, "is_solid_by_manifold": False}),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN)
def test_topology_and_diagnosis_are_known(name):
    mesh, known = KNOWN[name]
    result, diagnosis = topology_of(mesh), diagnosis_of(mesh)
    counted = {"lonely": NO_NEIGHBOR, "contested": MANY_NEIGHBORS}
    for field, value in known.items():
        if field in counted:
            assert (result.neighbors == counted[field]).sum() == value
            continue
        owners = [owner for owner in (result, diagnosis) if hasattr(owner, field)]
        assert owners and all(getattr(owner, field) == value for owner in owners), field


@pytest.mark.parametrize("mesh", [shapes.cube(), shapes.sphere(subdivisions=2), shapes.open_box()])
def test_face_across_an_edge_has_the_same_edge_the_other_way(mesh):
    result = topology_of(mesh)
    for face, edge in np.argwhere(result.neighbors >= 0):
        start, end = result.corner_ids[face, edge], result.corner_ids[face, (edge + 1) % 3]
        neighbor = result.neighbors[face, edge]
        across = result.corner_ids[neighbor].tolist()
        assert across[(across.index(end) + 1) % 3] == start
        assert result.neighbors[neighbor, across.index(end)] == face


def test_triangle_soup_has_the_topology_of_the_mesh_it_came_from():
    mesh = shapes.torus()
    shared, apart = topology_of(mesh), topology_of(shapes.soup(*mesh))
    np.testing.assert_array_equal(shared.neighbors, apart.neighbors)
    assert apart.is_watertight
    assert apart.corner_ids.max() + 1 == len(mesh[0])


def test_corner_ids_have_no_gap_where_vertices_are_unused():
    vertices, faces = shapes.tetrahedron()
    padded = np.concatenate([np.full((3, 3), np.nan), vertices])
    np.testing.assert_array_equal(topology_of((padded, faces + 3)).corner_ids, faces)


@given(
    npst.arrays(
        np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.sampled_from([-0.0, 0.0, 1.0])
    )
)
@settings(deadline=None, max_examples=50)
def test_equal_rows_are_found_as_by_comparing_each_with_each(points):
    first = [next(i for i, p in enumerate(points) if np.array_equal(p, q)) for q in points]
    rows = np.arange(len(points), dtype=np.int32)
    ids, positions = merged_faces(points, np.stack([rows, rows, rows], axis=1))
    np.testing.assert_array_equal(ids[:, 0], np.unique(first, return_inverse=True)[1])
    np.testing.assert_array_equal(positions, points[np.unique(first)])


def test_triangle_soup_of_a_solid_is_a_solid():
    assert diagnosis_of(shapes.soup(*shapes.torus())) == diagnosis_of(shapes.torus())


def test_unused_vertices_do_not_count():
    vertices, faces = shapes.cube()
    padded = np.concatenate([vertices, [[100.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]])
    assert diagnosis_of((padded, faces)) == diagnosis_of((vertices, faces))


def test_garbage_is_diagnosed_without_a_crash():
    """manifold3d 3.5 crashes on some of these."""
    rng = np.random.default_rng(32)
    for _ in range(200):
        vertices = rng.integers(0, 3, (rng.integers(3, 9), 3)).astype(np.float64)
        result = diagnosis_of((vertices, rng.integers(0, len(vertices), (rng.integers(1, 25), 3))))
        assert result.is_watertight <= result.is_oriented
        assert math.isnan(result.volume) or result.manifold_status in ("NoError", "NotManifold")
