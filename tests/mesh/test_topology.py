"""Which faces meet at which edges, and what is wrong with a mesh, in numbers."""

import math

import numpy as np
import pytest
import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from proximity.kernels.mesh.edges import MANY_NEIGHBORS, NO_NEIGHBOR
from proximity.mesh import topology
from proximity.mesh.diagnosis import diagnose
from proximity.mesh.topology import build_topology, first_equal_rows
from proximity.mesh.triangle_mesh import TriangleMesh


def topology_of(mesh):
    return build_topology(TriangleMesh(*mesh))


@pytest.mark.parametrize(
    "mesh",
    [
        shapes.tetrahedron(),
        shapes.cube(),
        shapes.hollow_cube(),
        shapes.sphere(subdivisions=1),
        shapes.torus(),
    ],
    ids=["tetrahedron", "cube", "hollow cube", "sphere", "torus"],
)
def test_closed_mesh_is_watertight(mesh):
    result = topology_of(mesh)
    assert result.is_watertight
    assert result.is_balanced
    assert result.edge_count == 3 * len(mesh[1]) // 2
    assert result.boundary_edge_count == 0
    assert result.nonmanifold_edge_count == 0
    assert result.misoriented_edge_count == 0


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


def test_minus_zero_and_zero_are_one_position():
    vertices, faces = shapes.soup(*shapes.tetrahedron())
    vertices[::2] = np.where(vertices[::2] == 0.0, -0.0, vertices[::2])
    assert topology_of((vertices, faces)).is_watertight


def test_positions_that_differ_in_the_last_bit_stay_apart():
    vertices, faces = shapes.soup(*shapes.tetrahedron())
    vertices[vertices == 1.0] *= np.where(np.arange((vertices == 1.0).sum()) == 0, 1 + 2**-52, 1.0)
    assert topology_of((vertices, faces)).boundary_edge_count == 4


def test_open_box_has_boundary_edges_without_neighbor():
    result = topology_of(shapes.open_box())
    assert result.boundary_edge_count == 4
    assert (result.neighbors == NO_NEIGHBOR).sum() == 4
    assert not result.is_watertight
    assert not result.is_balanced


def test_turned_face_is_counted_along_its_edges():
    vertices, faces = shapes.cube()
    faces[4] = faces[4, ::-1]
    result = topology_of((vertices, faces))
    assert result.misoriented_edge_count == 3
    assert (result.neighbors == MANY_NEIGHBORS).sum() == 6
    assert not result.is_watertight
    assert not result.is_balanced


def test_cubes_that_share_an_edge_are_balanced_but_not_watertight():
    result = topology_of(shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 1, 0))))
    assert result.nonmanifold_edge_count == 1
    assert (result.neighbors == MANY_NEIGHBORS).sum() == 4
    assert not result.is_watertight
    assert result.is_balanced


def test_cubes_that_share_a_corner_are_watertight():
    assert topology_of(shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 1, 1)))).is_watertight


def test_moebius_strip_is_misoriented_at_its_seam():
    result = topology_of(shapes.strip(half_turns=1))
    assert result.misoriented_edge_count == 1
    assert topology_of(shapes.strip()).misoriented_edge_count == 0


def test_face_with_two_equal_corners_is_not_watertight_but_balanced():
    vertices, faces = shapes.tetrahedron()
    result = topology_of((vertices, np.concatenate([faces, [[0, 0, 1], [2, 2, 2]]])))
    assert not result.is_watertight
    assert result.is_balanced
    assert result.boundary_edge_count == 2  # corner 0 to itself, corner 2 to itself
    assert (result.neighbors == NO_NEIGHBOR).sum() == 4


@given(
    npst.arrays(
        np.float64, st.tuples(st.integers(1, 30), st.just(3)), elements=st.sampled_from([-0.0, 0.0, 1.0])
    )
)
@settings(deadline=None, max_examples=50)
def test_equal_rows_are_found_as_by_comparing_each_with_each(points):
    expected = [next(i for i, p in enumerate(points) if np.array_equal(p, q)) for q in points]
    np.testing.assert_array_equal(first_equal_rows(points), expected)


def test_rows_that_share_a_hash_are_told_apart(monkeypatch):
    """With factors of zero every row has the same hash."""
    monkeypatch.setattr(topology, "_HASH_FACTORS", np.zeros(3, dtype=np.uint64))
    points = np.random.default_rng(7).integers(0, 3, (200, 3)).astype(np.float64)
    expected = [next(i for i, p in enumerate(points) if np.array_equal(p, q)) for q in points]
    np.testing.assert_array_equal(first_equal_rows(points), expected)


def diagnosis_of(mesh):
    return diagnose(TriangleMesh(*mesh))


def test_cube_is_a_solid():
    result = diagnosis_of(shapes.cube(2.0, center=(1.0, 2.0, 3.0)))
    assert (result.vertex_count, result.face_count, result.shell_count) == (8, 12, 1)
    assert result.boundary_edge_count == result.nonmanifold_edge_count == result.misoriented_edge_count == 0
    assert result.is_watertight and result.is_oriented and result.is_solid_by_manifold
    assert result.manifold_status == "NoError"
    assert result.volume == 8.0
    assert result.area == 24.0
    assert (result.lower, result.upper) == ((0.0, 1.0, 2.0), (2.0, 3.0, 4.0))


def test_triangle_soup_of_a_solid_is_a_solid():
    assert diagnosis_of(shapes.soup(*shapes.torus())) == diagnosis_of(shapes.torus())


def test_cavity_is_a_shell_and_takes_volume():
    result = diagnosis_of(shapes.hollow_cube(size=3.0, cavity_size=1.0))
    assert result.shell_count == 2
    assert result.volume == pytest.approx(26.0, rel=1e-15)
    assert result.area == pytest.approx(60.0, rel=1e-15)
    assert result.is_solid_by_manifold


def test_open_box_has_no_volume_and_is_no_manifold():
    result = diagnosis_of(shapes.open_box())
    assert result.boundary_edge_count == 4
    assert not result.is_watertight
    assert result.is_oriented
    assert math.isnan(result.volume)
    assert result.area == 5.0
    assert not result.is_solid_by_manifold
    assert result.manifold_status == "NotManifold"


def test_inside_out_cube_has_negative_volume_and_is_no_solid():
    result = diagnosis_of(shapes.inside_out(shapes.cube()))
    assert result.volume == -1.0
    assert result.is_watertight
    assert result.manifold_status == "NoError"
    assert not result.is_solid_by_manifold


def test_turned_face_contradicts_its_neighbors():
    vertices, faces = shapes.cube()
    faces[5] = faces[5, ::-1]
    result = diagnosis_of((vertices, faces))
    assert result.misoriented_edge_count == 3
    assert not result.is_oriented
    assert math.isnan(result.volume)
    assert result.shell_count == 1


def test_moebius_strip_is_not_oriented():
    assert not diagnosis_of(shapes.strip(half_turns=1)).is_oriented
    assert diagnosis_of(shapes.strip()).is_oriented


def test_cubes_that_share_an_edge_have_a_volume_but_are_not_watertight():
    result = diagnosis_of(shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 1, 0))))
    assert result.nonmanifold_edge_count == 1
    assert result.shell_count == 2
    assert not result.is_watertight
    assert result.is_oriented
    assert result.volume == 2.0


def test_unused_vertices_do_not_count():
    vertices, faces = shapes.cube()
    padded = np.concatenate([vertices, [[100.0, 0.0, 0.0], [np.nan, 0.0, 0.0]]])
    assert diagnosis_of((padded, faces)) == diagnosis_of((vertices, faces))


def test_volume_ten_kilometres_away_is_that_of_the_coordinates():
    """One whole-number offset: the coordinates stay exact, so the volume must too."""
    assert diagnosis_of(shapes.moved(shapes.cube(0.5), (1e4, -1e4, 1e4))).volume == 0.125


@pytest.mark.parametrize("size", [2.0**-30, 2.0**200])
def test_volume_of_very_small_and_very_large_parts(size):
    result = diagnosis_of(shapes.cube(size, center=(0, 0, 0)))
    assert result.volume == size**3
    assert result.area == 6 * size**2
    assert result.is_solid_by_manifold


def test_volume_beyond_the_range_of_numbers_is_infinite():
    result = diagnosis_of(shapes.cube(2.0**400, center=(0, 0, 0)))
    assert result.volume == math.inf
    assert result.area == 6 * 2.0**800
    assert result.is_solid_by_manifold


def test_face_without_area_is_counted_as_a_boundary_and_keeps_the_volume():
    vertices, faces = shapes.cube()
    result = diagnosis_of((vertices, np.concatenate([faces, [[0, 0, 1]]])))
    assert not result.is_watertight
    assert result.boundary_edge_count == 1
    assert result.volume == 1.0


def test_single_point_as_a_face_is_diagnosed():
    result = diagnosis_of((np.ones((1, 3)), np.zeros((1, 3), dtype=int)))
    assert result.area == result.volume == 0.0
    assert not result.is_solid_by_manifold


def test_flat_double_sheet_is_no_solid():
    sheet = shapes.grid(2, 2)
    result = diagnosis_of(shapes.join(sheet, shapes.inside_out(sheet)))
    assert result.volume == 0.0
    assert not result.is_solid_by_manifold


def test_garbage_is_diagnosed_without_a_crash():
    """manifold3d 3.5 crashes on some of these when it is asked."""
    rng = np.random.default_rng(32)
    for _ in range(200):
        vertices = rng.integers(0, 3, (rng.integers(3, 9), 3)).astype(np.float64)
        result = diagnosis_of((vertices, rng.integers(0, len(vertices), (rng.integers(1, 25), 3))))
        assert result.is_watertight <= result.is_oriented
        assert math.isnan(result.volume) or result.manifold_status in ("NoError", "NotManifold")
