"""Arrays as a file gives them, made into bodies."""

import numpy as np
import pytest
import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from project import SHARED_DATA
from scipy.ndimage import label

from proximity.errors import MeshError
from proximity.mesh.body_split import Repairs, split_bodies
from proximity.mesh.topology import build_topology
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.mesh.vertex_weld import open_edges

CAD = SHARED_DATA / "cad"

ASSEMBLY = shapes.join(
    shapes.torus(n=8, m=6),
    shapes.moved(shapes.hollow_cube(), (9, 0, 0)),
    shapes.moved(shapes.cube(3.0, (0, 0, 0)), (12, 0, 0)),  # shares a side with the hollow cube
    shapes.moved(shapes.open_box(), (0, 9, 0)),
)


def volume_of(body):
    return shapes.volume(body.mesh.vertices, body.mesh.faces)


def volumes_of(bodies):
    return [round(volume_of(body), 9) for body in bodies]


def is_watertight(body):
    return build_topology(body.mesh).is_watertight


def with_faces(mesh, *more):
    """The mesh with faces added."""
    return mesh[0], np.concatenate([mesh[1], more])


def rows_of(bodies):
    return [body.source_faces.tolist() for body in bodies]


# One body


def with_corner_on_an_edge(mesh, *more):
    """The cube with a corner 8 in the middle of its edge 0-1, and faces added."""
    return np.concatenate([mesh[0], [[0.5, 0.0, 0.0]]]), np.concatenate([mesh[1], more])


def junction():
    """Corner 8 is on the edge 0-1 for the side below only; the face 0 1 8 has no area and fills the slit.

    ::

        2--------3
        |  side  |
        0---8----1      <- 0 1 8 in between
         \\  |   /
          below
    """
    vertices, faces = with_corner_on_an_edge(shapes.cube(), [8, 1, 5], [0, 1, 8])
    faces[(faces == [0, 1, 5]).all(axis=1)] = [0, 8, 5]
    return vertices, faces


def projective_plane():
    """Of six vertices: every edge has two faces, and no inside comes of it."""
    ring = [[0, k, k % 5 + 1] for k in range(1, 6)]
    faces = np.array([*ring, [1, 2, 4], [2, 3, 5], [3, 4, 1], [4, 5, 2], [5, 1, 3]])
    return np.random.default_rng(7).random((6, 3)), faces


def partly_turned():
    vertices, faces = shapes.sphere(subdivisions=1)
    return vertices, np.where(TURNED[:, None], faces[:, ::-1], faces)


CUBE, SHEET, BALL = shapes.cube(), shapes.grid(1, 1), shapes.sphere(subdivisions=2)
TURNED = np.random.default_rng(7).random(80) < 0.3
MERGED = 3 * len(BALL[1]) - len(BALL[0])
ONE_BODY = {  # a mesh; what was repaired; how many faces are left, as they were where all are; its volume
    "cube": (CUBE, Repairs(), 12, 1.0),
    "torus": (shapes.torus(), Repairs(), None, shapes.volume(*shapes.torus())),
    "sheet": (shapes.grid(), Repairs(), None, None),
    "Moebius strip": (shapes.strip(half_turns=1), Repairs(), None, None),
    "closed surface without two sides": (projective_plane(), Repairs(), 10, None),
    "faces back to back": ((SHEET[0], np.concatenate([SHEET[1], SHEET[1][:, ::-1]])), Repairs(), 4, None),
    "line that closes a junction": (junction(), Repairs(), 14, 1.0),
    "soup": (shapes.soup(*BALL), Repairs(merged_vertex_count=MERGED), None, shapes.volume(*BALL)),
    "corners twice": (with_faces(CUBE, [0, 0, 1], [3, 5, 3], [7, 7, 7]),
                      Repairs(dropped_sliver_count=3), 12, 1.0),
    "line on an edge": (with_corner_on_an_edge(CUBE, [0, 8, 1]), Repairs(dropped_sliver_count=1), 12, 1.0),
    "faces twice": (with_faces(CUBE, CUBE[1][3], CUBE[1][3][[1, 2, 0]], CUBE[1][9]),
                    Repairs(dropped_duplicate_count=3), 12, 1.0),
    "faces turned": (partly_turned(), Repairs(turned_face_count=int(TURNED.sum())), None,
                     shapes.volume(*shapes.sphere(subdivisions=1))),
    "inside out": (shapes.inside_out(CUBE), Repairs(is_turned_inside_out=True), 12, 1.0),
}  # fmt: skip


@pytest.mark.parametrize("name", ONE_BODY)
def test_one_body_is_repaired_as_far_as_it_needs_and_that_is_counted(name):
    (vertices, faces), repairs, count, volume = ONE_BODY[name]

    (body,) = split_bodies(vertices, faces)

    assert body.repairs == repairs
    assert rows_of([body]) == [list(range(count or len(faces)))]
    if repairs == Repairs():
        np.testing.assert_array_equal(body.mesh.vertices, vertices)
        np.testing.assert_array_equal(body.mesh.faces, faces)
    assert is_watertight(body) == (volume is not None)
    if volume is not None:
        assert volume_of(body) == pytest.approx(volume)


def test_each_body_has_only_its_own_vertices_and_names_of_faces():
    vertices, faces = shapes.join(shapes.cube(), shapes.moved(shapes.tetrahedron(), (5, 0, 0)))
    order = np.random.default_rng(7).permutation(len(faces))
    names = 100 + np.arange(len(faces))
    bodies = split_bodies(vertices, faces[order], names)

    for body in bodies:
        np.testing.assert_array_equal(
            body.mesh.vertices[body.mesh.faces], vertices[faces[order[body.source_faces - 100]]]
        )
    assert sorted(body.mesh.vertex_count for body in bodies) == [4, 8]
    assert bodies[0].source_faces[0] == 100
    assert all((np.diff(body.source_faces) > 0).all() for body in bodies)


# Bodies that touch


@pytest.mark.parametrize("offset", [(1, 0, 0), (1, 1, 0), (1, 1, 1)], ids=["side", "edge", "corner"])
@pytest.mark.parametrize("spin", [0, 1], ids=["straight", "rotated"])
def test_cubes_that_touch_come_apart(offset, spin):
    vertices, faces = shapes.join(shapes.cube(), shapes.moved(shapes.cube(), offset))
    vertices = vertices @ shapes.rotation(5) if spin else vertices

    for mesh in ((vertices, faces), shapes.soup(vertices, faces)):
        bodies = split_bodies(*mesh)
        assert rows_of(bodies) == [list(range(12)), list(range(12, 24))]
        assert all(is_watertight(body) for body in bodies)
        assert volumes_of(bodies) == [1.0, 1.0]


@pytest.mark.parametrize("offset", [(1, 0, 0), (1, 1, 0), (1, 1, 1)], ids=["side", "edge", "corner"])
@pytest.mark.parametrize("seed", range(2))
def test_cubes_that_touch_come_apart_though_they_are_inside_out(offset, seed):
    vertices, faces = shapes.join(shapes.cube(), shapes.moved(shapes.cube(), offset))
    order = np.random.default_rng(seed).permutation(len(faces)) if seed else np.arange(len(faces))
    vertices = vertices @ shapes.rotation(seed) if seed else vertices
    bodies = split_bodies(*shapes.inside_out(shapes.soup(vertices, faces[order])), source_faces=order)

    assert sorted(sorted(rows) for rows in rows_of(bodies)) == [list(range(12)), list(range(12, 24))]
    assert volumes_of(bodies) == [1.0, 1.0]
    assert all(body.repairs.is_turned_inside_out for body in bodies)


def test_cavities_that_touch_are_cavities_of_one_body():
    cavities = shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 0, 0)))
    mesh = shapes.join(shapes.box((-1, -1, -1), (3, 2, 2)), shapes.inside_out(cavities))
    (body,) = split_bodies(*shapes.soup(*mesh))

    assert volume_of(body) == pytest.approx(4 * 3 * 3 - 2)


@given(seed=st.integers(0, 10_000), is_rotated=st.booleans(), label_count=st.integers(1, 4))
@settings(deadline=None, max_examples=40)
def test_blocks_of_cells_come_apart_whatever_touches(seed, is_rotated, label_count):
    """Random cells of a grid, those of one label that share a side being one body; coordinates in float32."""
    rng = np.random.default_rng(seed)
    cells = rng.integers(0, label_count + 1, rng.integers(2, 5, 3))
    cells[0, 0, 0] = 1
    expected = [part == k for part, count in _parts(cells, label_count) for k in range(1, count + 1)]
    vertices, faces = shapes.join(*[shapes.voxels(part) for part in expected])
    if is_rotated:
        vertices = (vertices @ shapes.rotation(seed)).astype(np.float32).astype(np.float64)
    bodies = split_bodies(vertices, rng.permutation(faces))

    np.testing.assert_allclose(
        sorted(volume_of(body) for body in bodies), sorted(part.sum() for part in expected), rtol=1e-5
    )
    assert {body.repairs.turned_face_count for body in bodies} == {0}
    assert {body.repairs.dropped_duplicate_count for body in bodies} == {0}
    assert not any(body.repairs.is_turned_inside_out for body in bodies)


def _parts(cells, label_count):
    return [label(cells == k) for k in range(1, label_count + 1)]


def test_sides_that_touch_with_other_diagonals_come_apart():
    mirrored = shapes.cube()[0] * [-1, 1, 1], shapes.cube()[1][:, ::-1]
    vertices, faces = mirrored
    faces = faces.copy()
    corners = [1, 3, 7, 5]  # of the cube's side x = 1, the mirrored one's x = -1
    turned_side = np.array([[corners[1], corners[3], corners[2]], [corners[1], corners[0], corners[3]]])
    faces[10:] = turned_side
    bodies = split_bodies(
        *shapes.soup(*shapes.join(shapes.cube(), shapes.moved((vertices, faces), (2, 0, 0))))
    )

    assert volumes_of(bodies) == [1.0, 1.0]
    assert all(is_watertight(body) for body in bodies)


def test_overlapping_bodies_stay_whole():
    """A slab that shares an edge with a cube and lies in its material."""
    slab = shapes.box((0, 0, 0), (0.5, 1, 0.5))
    bodies = split_bodies(*shapes.soup(*shapes.join(shapes.cube(), slab)))

    assert volumes_of(bodies) == [1.0, 0.25]


def test_closed_bodies_that_vertex_numbers_keep_apart_stay_apart():
    """A cube and half of it in the same place: by positions alone, no one can say whose which side is."""
    vertices, faces = shapes.join(shapes.cube(), shapes.box((0, 0, 0), (1, 1, 0.5)))
    bodies = split_bodies(vertices, np.random.default_rng(7).permutation(faces))

    assert sorted(volumes_of(bodies)) == [0.5, 1.0]
    assert all(is_watertight(body) for body in bodies)


def test_patches_that_share_only_vertices_with_a_closed_body_are_bodies_of_their_own():
    flag = np.array([[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [2.0, 2.0, 1.0]]), np.array([[0, 1, 2]])
    bodies = split_bodies(*shapes.join(shapes.cube(), flag))

    assert rows_of(bodies) == [list(range(12)), [12]]
    assert is_watertight(bodies[0])


# Faces that add nothing


def test_face_that_two_overlapping_bodies_share_is_not_a_duplicate():
    """Both cubes have a side in z = 0 with the same corners, running the same way."""
    bodies = split_bodies(*shapes.soup(*shapes.join(shapes.cube(), shapes.box((0, 0, 0), (1, 1, 0.5)))))

    assert volumes_of(bodies) == [1.0, 0.5]
    assert all(is_watertight(body) for body in bodies)


def test_faces_lost_are_counted_at_the_body_that_had_them_though_others_touch_it():
    """A cube that occurs twice, a sheet at four of its corners, and a body at one."""
    sheet = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, -1, 0]]), np.array([[0, 1, 2]])
    corner = shapes.moved(shapes.tetrahedron(), (1, 1, 1))
    mesh = with_faces(shapes.join(shapes.cube(), shapes.cube(), sheet, corner), [16, 16, 0], [16, 0, 1])
    bodies = split_bodies(*mesh)

    assert [body.mesh.face_count for body in bodies] == [12, 1, 4]
    assert [body.repairs.dropped_duplicate_count for body in bodies] == [12, 0, 0]
    assert [body.repairs.dropped_sliver_count for body in bodies] == [2, 0, 0]


# Near vertices


@pytest.mark.parametrize("scale", [1e-9, 1e60])
def test_near_vertices_are_pulled_together_where_that_closes_the_body(scale):
    vertices, faces = shapes.soup(*shapes.torus())
    vertices = scale * (vertices + np.random.default_rng(7).uniform(-1e-9, 1e-9, vertices.shape))
    (body,) = split_bodies(vertices, faces)

    assert is_watertight(body)
    assert body.repairs.merged_vertex_count == 0
    assert body.repairs.welded_vertex_count == len(vertices) - len(shapes.torus()[0])
    assert 1e-10 * scale < body.repairs.weld_distance < 4e-9 * scale


def test_face_that_a_weld_collapses_is_counted():
    vertices, faces = shapes.cube()
    vertices = np.concatenate([vertices, vertices[[7]] + 1e-9])
    needle = np.array([[3, 8, 7]])  # along the edge 3-7, whose other side ends at 8
    faces = np.where((faces == [1, 3, 7]).all(axis=1)[:, None], [1, 3, 8], faces)
    faces = np.where((faces == [1, 7, 5]).all(axis=1)[:, None], [1, 8, 5], faces)
    (body,) = split_bodies(vertices, np.concatenate([faces, needle]))

    assert is_watertight(body)
    assert body.repairs.welded_vertex_count == 1
    assert body.repairs.dropped_sliver_count == 1
    assert body.repairs.weld_distance == pytest.approx(1e-9 * 3**0.5, rel=1e-6)


def test_near_vertices_stay_where_the_body_stays_open():
    vertices, faces = shapes.soup(*shapes.open_box())
    vertices = vertices + np.random.default_rng(7).uniform(-1e-9, 1e-9, vertices.shape)
    bodies = split_bodies(vertices, faces)

    assert sum(body.mesh.vertex_count for body in bodies) == len(vertices)
    assert {body.repairs.welded_vertex_count for body in bodies} == {0}


def test_small_body_beside_a_large_one_is_welded_by_its_own_measure():
    """A millionth of the assembly is as large as the small cube's holes, and wider than it may bridge."""
    small_vertices, small_faces = shapes.soup(*shapes.cube(1e-4, center=(0, 0, 0)))
    small_vertices[0] += 1e-6
    wide_open = shapes.moved(shapes.open_box(), (1, 0, 0))
    bodies = split_bodies(*shapes.join((small_vertices, small_faces), wide_open))

    assert {body.repairs.welded_vertex_count for body in bodies} == {0}


# Direction of faces


def test_open_sheet_with_a_turned_face_runs_one_way():
    vertices, faces = shapes.grid(3, 3)
    faces[5] = faces[5, ::-1]
    (body,) = split_bodies(vertices, faces)

    assert build_topology(body.mesh).misoriented_edge_count == 0
    assert body.repairs.turned_face_count == 1


def test_turned_side_between_touching_cubes_does_not_join_them():
    vertices, faces = shapes.soup(*shapes.join(shapes.cube(), shapes.moved(shapes.cube(), (1, 1, 0))))
    faces[3] = faces[3, ::-1]
    bodies = split_bodies(vertices, faces)

    assert volumes_of(bodies) == [1.0, 1.0]
    assert [body.repairs.turned_face_count for body in bodies] == [1, 0]


# Cavities


def test_cavity_belongs_to_the_body_around_it():
    (body,) = split_bodies(*shapes.soup(*shapes.hollow_cube()))

    assert volume_of(body) == pytest.approx(26.0)
    assert body.mesh.face_count == 24
    assert is_watertight(body)


def test_solid_within_a_cavity_is_a_body_of_its_own():
    """Nested like dolls: each body takes the cavity next within it."""
    shells = [shapes.cube(size, center=(0, 0, 0)) for size in (5.0, 4.0, 3.0, 2.0, 1.0)]
    shells = [shapes.inside_out(shell) if k % 2 else shell for k, shell in enumerate(shells)]
    bodies = split_bodies(*shapes.join(*shells[::-1]))

    assert volumes_of(bodies) == [1.0, 27.0 - 8.0, 125.0 - 64.0]


def test_inside_out_solid_within_a_cavity_is_turned():
    hollow = shapes.hollow_cube(5.0, 3.0)
    bodies = split_bodies(*shapes.join(hollow, shapes.inside_out(shapes.cube(1.0, (0, 0, 0)))))

    assert volumes_of(bodies) == [98.0, 1.0]
    assert [body.repairs.is_turned_inside_out for body in bodies] == [False, True]


def test_insert_that_faces_outwards_stays_a_body():
    assert volumes_of(split_bodies(*shapes.join(shapes.cube(3, (0, 0, 0)), shapes.cube(1, (0, 0, 0))))) == [
        27,
        1,
    ]


def test_cavity_that_touches_the_outside_belongs_to_its_body():
    """Its corner, its edge or its whole side lies on the outer surface."""
    for lower, upper in [((0, 0, 0), (1, 1, 1)), ((0, 0, 0.5), (1, 1, 1)), ((0, 0.5, 0.5), (1, 1, 1))]:
        cavity = shapes.inside_out(shapes.box(lower, upper))
        (body,) = split_bodies(*shapes.join(shapes.box((0, 0, 0), (3, 3, 3)), cavity))
        size = np.prod(np.subtract(upper, lower))
        assert volume_of(body) == pytest.approx(27 - size)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("is_float32", [False, True])
def test_cavity_that_lies_on_most_sides_of_its_body_belongs_to_it(seed, is_float32):
    """A cut through the body, and one at its corner; turned, so that sides lie on each other to rounding."""
    for lower, upper in [((0, 0.5, 0), (3, 1, 3)), ((0, 0, 0), (1, 1, 1))]:
        cavity = shapes.inside_out(shapes.box(lower, upper))
        vertices, faces = shapes.join(shapes.box((0, 0, 0), (3, 3, 3)), cavity)
        vertices = vertices @ shapes.rotation(seed)
        vertices = vertices.astype(np.float32).astype(np.float64) if is_float32 else vertices
        (body,) = split_bodies(vertices, faces)
        assert volume_of(body) == pytest.approx(27 - np.prod(np.subtract(upper, lower)), rel=1e-5)


def sides_meshed_apart(mesh):
    """The cube with four sides cut finer than the others, as a soup: no edge between the two fits."""
    vertices, faces = mesh
    return shapes.soup(*shapes.join(shapes.quartered(vertices, faces[:4]), (vertices, faces[4:])))


def without_a_face(mesh):
    return mesh[0], mesh[1][1:]


SMALL_HOLES = {
    "a face is missing": (without_a_face, shapes.sphere(2.0, 3), shapes.inside_out(shapes.sphere(1.0, 2))),
    "sides were meshed apart": (
        sides_meshed_apart, shapes.cube(3.0, (0, 0, 0)), shapes.inside_out(shapes.cube(1.0, (0, 0, 0))),
    ),
}  # fmt: skip


@pytest.mark.parametrize("hole", SMALL_HOLES)
@pytest.mark.parametrize("where", ["outside", "cavity", "both"])
@pytest.mark.parametrize("is_turned", [False, True], ids=["", "inside out"])
def test_cavity_belongs_to_its_body_though_either_has_small_holes(hole, where, is_turned):
    pierced, outside, cavity = SMALL_HOLES[hole]
    outside = pierced(outside) if where != "cavity" else outside
    cavity = pierced(cavity) if where != "outside" else cavity
    mesh = shapes.join(cavity, outside)
    (body,) = split_bodies(*(shapes.inside_out(mesh) if is_turned else mesh))

    assert body.mesh.face_count == len(mesh[1])
    assert 0.9 * shapes.volume(*mesh) < volume_of(body) < 1.1 * shapes.volume(*mesh)
    assert body.repairs.is_turned_inside_out == is_turned


def test_box_without_its_lid_has_no_cavities():
    """What lies in it inside out is a body: a sheet bounds no material."""
    small = shapes.inside_out(shapes.cube(0.2, (0.4, 0.5, 0.3)))
    for sheet in (shapes.open_box(), shapes.inside_out(shapes.open_box())):
        bodies = split_bodies(*shapes.join(sheet, small))

        assert [body.mesh.face_count for body in bodies] == [10, 12]
        assert [body.repairs.is_turned_inside_out for body in bodies] == [False, True]


def test_cavity_goes_to_the_smallest_body_around_it_whatever_the_boxes_say():
    """By its box the cavity might lie in the torus; it lies in the ball within the hole of the torus."""
    torus = shapes.torus(major_radius=4.0)
    ball = shapes.sphere(2.0, subdivisions=2)
    cavity = shapes.inside_out(shapes.cube(0.2, (0.1, 0.2, 0.05)))
    bodies = split_bodies(*shapes.join(cavity, torus, ball))

    assert sorted(len(rows) for rows in rows_of(bodies)) == [len(ball[1]) + 12, len(torus[1])]


def test_flat_double_sheet_is_neither_turned_nor_a_cavity():
    vertices, faces = shapes.grid(2, 2)
    sheet = vertices @ shapes.rotation(3) * 0.1, np.concatenate([faces, faces[:, ::-1]])
    bodies = split_bodies(*shapes.join(shapes.cube(3.0, (0, 0, 0)), sheet))

    assert len(bodies) == 2
    assert bodies[1].repairs == Repairs()


# Open pieces


def test_sides_that_were_meshed_apart_are_one_body():
    """A cube whose lid has one vertex more along an edge than the wall below: a T-junction."""
    vertices, faces = shapes.cube()
    vertices = np.concatenate([vertices, [[0.5, 0.0, 0.0]]])
    faces = [row for row in faces.tolist() if row != [0, 1, 5]] + [[0, 8, 5], [8, 1, 5]]
    (body,) = split_bodies(*shapes.soup(vertices, np.array(faces)))

    assert body.mesh.face_count == 13
    assert build_topology(body.mesh).boundary_edge_count == 3


def test_a_hole_is_counted_without_the_seams_that_a_weld_would_close():
    """A cube that lacks a face stays open, so a corner of another face that is 1e-9 off is not welded."""
    vertices, faces = shapes.soup(*shapes.cube())
    vertices[faces[11, 2]] += [1e-9, 0.0, 0.0]
    (body,) = split_bodies(vertices, faces[1:])

    assert body.repairs.welded_vertex_count == 0
    assert build_topology(body.mesh).boundary_edge_count == 3 + 4
    middles = open_edges(body.mesh.vertices, body.mesh.faces)
    assert sorted(np.round(middles, 6).tolist()) == [[0.0, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, 1.0, 0.0]]


def test_a_closed_body_has_no_open_edge():
    for mesh in (shapes.cube(), shapes.soup(*shapes.torus(n=8, m=6))):
        assert open_edges(*mesh).shape == (0, 3)


# The same whatever the file does


@given(seed=st.integers(0, 1000), is_soup=st.booleans(), is_moved=st.booleans())
@settings(deadline=None, max_examples=30)
def test_order_of_faces_and_numbers_of_vertices_change_no_body(seed, is_soup, is_moved):
    vertices, faces = ASSEMBLY
    expected = {frozenset(rows) for rows in rows_of(split_bodies(vertices, faces))}
    order = np.random.default_rng(seed).permutation(len(faces))
    if is_moved:
        vertices = vertices @ shapes.rotation(seed) + [3.0, 4.0, 5.0]
    mesh = shapes.soup(vertices, faces[order]) if is_soup else (vertices, faces[order])
    bodies = split_bodies(*mesh, source_faces=order)

    assert {frozenset(rows) for rows in rows_of(bodies)} == expected
    assert sum(is_watertight(body) for body in bodies) == 3


@pytest.mark.parametrize("scale", [1e-100, 1e150])
def test_scale_changes_no_body(scale):
    vertices, faces = ASSEMBLY

    assert rows_of(split_bodies(vertices * scale, faces)) == rows_of(split_bodies(vertices, faces))


def test_arrays_of_the_caller_are_not_changed_and_not_kept():
    vertices, faces = shapes.inside_out(shapes.cube())
    before = vertices.copy(), faces.copy()
    (body,) = split_bodies(vertices, faces)

    np.testing.assert_array_equal(vertices, before[0])
    np.testing.assert_array_equal(faces, before[1])
    assert not np.shares_memory(body.mesh.vertices, vertices)


# What cannot be used


def test_faces_without_any_area_are_refused():
    with pytest.raises(MeshError, match="none of the 2 faces has an area, expected at least one that has"):
        split_bodies([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2], [0, 0, 1]])


def test_arrays_that_make_no_mesh_are_refused():
    with pytest.raises(MeshError, match="face 0 refers to vertex 3, but the mesh has 3 vertices"):
        split_bodies(np.zeros((3, 3)), [[0, 1, 3]])


@pytest.mark.parametrize(("names", "seen"), [([1, 2], r"shape \(2,\)"), (np.zeros(12), "dtype float64")])
def test_names_of_faces_that_do_not_fit_are_refused(names, seen):
    with pytest.raises(MeshError, match=rf"source_faces have .*{seen}.*expected integers of shape \(12,\)"):
        split_bodies(*shapes.cube(), source_faces=names)


# Sentences


def test_repairs_are_described_in_one_sentence():
    one = Repairs(1, 1, 2.5e-9, 1, 1, 1, False)
    many = Repairs(2, 3, 0.001, 4, 5, 6, True)

    assert one.describe() == (
        "Merged 1 equal vertex, welded 1 near vertex at most 2.5e-09 m apart to close the body, "
        "dropped 1 face without area, dropped 1 duplicate face, turned 1 face to match the "
        "orientation of the others."
    )
    assert many.describe() == (
        "Merged 2 equal vertices, welded 3 near vertices at most 0.001 m apart to close the body, "
        "dropped 4 faces without area, dropped 5 duplicate faces, "
        "turned 6 faces to match the orientation of the others, flipped the body, which was inside out."
    )


# Files that nobody on this project made


def _file(name):
    path = CAD / name
    if not path.exists():
        pytest.skip("shared data is not here")
    trimesh = pytest.importorskip("trimesh")
    loaded = trimesh.load(path, process=False)
    return np.array(loaded.vertices), np.array(loaded.faces)


@pytest.mark.parametrize("is_soup", [False, True], ids=["as given", "soup"])
def test_cycloidal_drive_comes_apart_into_closed_bodies(is_soup):
    """Cut at every edge of four faces it falls into 119 pieces, of which two are open: a pin without
    its end, and the flat end. The material round that rim makes them one, as the pin beside it is.
    """
    vertices, faces = _file("cycloidal.ply")
    bodies = split_bodies(*(shapes.soup(vertices, faces) if is_soup else (vertices, faces)))

    assert len(bodies) == 118
    assert all(is_watertight(body) for body in bodies)
    assert all(volume_of(body) > 0 for body in bodies)
    assert sum(body.mesh.face_count for body in bodies) == len(faces)


@pytest.mark.parametrize("name", ["featuretype.STL", "octagonal_pocket.stl", "busted.STL"])
def test_machined_parts_are_one_closed_body(name):
    (body,) = split_bodies(*_file(name))

    assert is_watertight(body)
    assert isinstance(body.mesh, TriangleMesh)
