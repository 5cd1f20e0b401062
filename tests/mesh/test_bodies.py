"""Splitting arrays as read from a file into bodies."""

import numpy as np
import pytest
import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from project import SHARED_DATA
from scipy.ndimage import label

from proximity.errors import MeshError
from proximity.mesh.body_split import Repairs, split_bodies
from proximity.mesh.topology import build_topology, open_edges
from proximity.mesh.triangle_mesh import TriangleMesh

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
    """Return the mesh with faces added."""
    return mesh[0], np.concatenate([mesh[1], more])


def rows_of(bodies):
    return [body.source_faces.tolist() for body in bodies]


def both_sides(vertices, faces):
    return vertices, np.concatenate([faces, faces[:, ::-1]])


def with_corner_on_an_edge(mesh, *more):
    """Return the cube with a vertex 8 in the middle of its edge 0-1, and faces added."""
    return np.concatenate([mesh[0], [[0.5, 0.0, 0.0]]]), np.concatenate([mesh[1], more])


def junction():
    """Return a cube with vertex 8 on the edge 0-1 of one side only; the degenerate face 0 1 8 fills the slit.

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
    """Return six vertices with two faces at every edge that do not enclose an inside."""
    ring = [[0, k, k % 5 + 1] for k in range(1, 6)]
    faces = np.array([*ring, [1, 2, 4], [2, 3, 5], [3, 4, 1], [4, 5, 2], [5, 1, 3]])
    return np.random.default_rng(7).random((6, 3)), faces


def partly_turned():
    vertices, faces = shapes.sphere(subdivisions=1)
    return vertices, np.where(TURNED[:, None], faces[:, ::-1], faces)


CUBE, SHEET, BALL = shapes.cube(), shapes.grid(1, 1), shapes.sphere(subdivisions=2)
TURNED = np.random.default_rng(7).random(80) < 0.3
MERGED = 3 * len(BALL[1]) - len(BALL[0])
ONE_BODY = {  # a mesh; repairs; number of remaining faces, or all unchanged; its volume
    "cube": (CUBE, Repairs(), 12, 1.0),
    "torus": (shapes.torus(), Repairs(), None, shapes.volume(*shapes.torus())),
    "sheet": (shapes.grid(), Repairs(), None, None),
    "Moebius strip": (shapes.strip(half_turns=1), Repairs(), None, None),
    "closed surface without two sides": (projective_plane(), Repairs(), 10, None),
    "faces back to back": (both_sides(*SHEET), Repairs(), 4, None),
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


@given(seed=st.integers(0, 10_000), is_rotated=st.booleans(), label_count=st.integers(1, 4))
@settings(deadline=None, max_examples=40)
def test_blocks_of_cells_come_apart_whatever_touches(seed, is_rotated, label_count):
    """Random cells of a grid; cells of one label that share a side are a body; coordinates in float32."""
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


@pytest.mark.parametrize("scale", [1e-9, 1e60])
def test_near_vertices_are_pulled_together_where_that_closes_the_body(scale):
    vertices, faces = shapes.soup(*shapes.torus())
    vertices = scale * (vertices + np.random.default_rng(7).uniform(-1e-9, 1e-9, vertices.shape))
    (body,) = split_bodies(vertices, faces)
    assert is_watertight(body)
    assert body.repairs.merged_vertex_count == 0
    assert body.repairs.welded_vertex_count == len(vertices) - len(shapes.torus()[0])
    assert 1e-10 * scale < body.repairs.weld_distance < 4e-9 * scale


def test_thousands_of_vertices_at_one_tip_are_pulled_together():
    """A double cone as triangles without shared vertices: each face has its own vertex at a tip."""
    ring = np.arange(2000)
    angle = 2.0 * np.pi * ring / len(ring)
    vertices = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    vertices = np.concatenate([vertices, [[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    after = np.roll(ring, -1)
    below, above = (
        np.stack([*pair, 0 * ring + tip], axis=1)
        for pair, tip in (((after, ring), 2000), ((ring, after), 2001))
    )
    loosened, faces = shapes.soup(vertices, np.concatenate([below, above]))
    loosened = loosened + np.random.default_rng(7).uniform(-1e-9, 1e-9, loosened.shape)
    (body,) = split_bodies(loosened, faces)
    assert is_watertight(body)
    assert body.repairs.welded_vertex_count == len(loosened) - len(vertices)


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


def with_other_diagonals():
    """Return the mirrored cube, with its side x = -1 cut along the other diagonal."""
    faces = CUBE[1][:, ::-1].copy()
    faces[10:] = [[3, 5, 7], [3, 1, 5]]
    return CUBE[0] * [-1, 1, 1], faces


def with_a_turned_face(mesh, row):
    mesh[1][row] = mesh[1][row, ::-1]
    return mesh


def with_a_wider_hole(mesh):
    mesh[0][0] += 1e-6
    return mesh


def nested(*sizes):
    """Return nested cubes, every second one inside out, the smallest first."""
    shells = [shapes.cube(size, center=(0, 0, 0)) for size in sizes]
    return [shapes.inside_out(shell) if k % 2 else shell for k, shell in enumerate(shells)][::-1]


def with_a_t_junction():
    """Return a cube whose lid has one more vertex along an edge than the wall below."""
    faces = [row for row in CUBE[1].tolist() if row != [0, 1, 5]] + [[0, 8, 5], [8, 1, 5]]
    return np.concatenate([CUBE[0], [[0.5, 0.0, 0.0]]]), np.array(faces)


def in_other_order(mesh):
    return mesh[0], np.random.default_rng(7).permutation(mesh[1])


def touching_cubes(offset):
    return shapes.join(CUBE, shapes.moved(CUBE, offset))


def loose(*meshes):
    """Return meshes as triangles without shared vertices."""
    return shapes.soup(*shapes.join(*meshes))


HALF = shapes.box((0, 0, 0), (1, 1, 0.5))
FLAG = np.array([[1.0, 1.0, 1.0], [2.0, 1.0, 1.0], [2.0, 2.0, 1.0]]), np.array([[0, 1, 2]])
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, -1, 0]]), np.array([[0, 1, 2]])
SMALL, DOLLS, BLOCK = shapes.inside_out(shapes.cube(0.2, (0.4, 0.5, 0.3))), (5, 4, 3, 2, 1), (3, 3, 3)
RING, BIG_BALL = shapes.torus(major_radius=4.0), shapes.sphere(2.0, subdivisions=2)
CAVITY = shapes.cube(0.2, (0.1, 0.2, 0.05))
LEAF = both_sides(shapes.grid(2, 2)[0] @ shapes.rotation(3) * 0.1, shapes.grid(2, 2)[1])
APART = {"rows": [[*range(12)], [*range(12, 24)]], "volumes": [1, 1], "is_watertight": [True, True]}
BODIES = {  # a mesh; then its bodies: volumes, counts or rows of faces, whether closed, repairs
    **{f"cubes that touch at a {place}, {how}": (make(touching_cubes(offset)), APART)
       for place, offset in {"side": (1, 0, 0), "edge": (1, 1, 0), "corner": (1, 1, 1)}.items()
       for how, make in {
           "as given": lambda mesh: mesh, "soup": lambda mesh: shapes.soup(*mesh),
           "rotated": lambda mesh: (mesh[0] @ shapes.rotation(5), mesh[1]),
           "rotated soup": lambda mesh: shapes.soup(mesh[0] @ shapes.rotation(5), mesh[1]),
       }.items()},
    "cavities that touch are cavities of one body": (
        loose(shapes.box((-1, -1, -1), (3, 2, 2)), shapes.inside_out(touching_cubes((1, 0, 0)))),
        {"volumes": [4 * 3 * 3 - 2]}),
    "sides that touch with other diagonals come apart": (
        loose(CUBE, shapes.moved(with_other_diagonals(), (2, 0, 0))),
        {"volumes": [1, 1], "is_watertight": [True, True]}),
    "a slab that shares an edge with a cube and lies in its material stays whole": (
        loose(CUBE, shapes.box((0, 0, 0), (0.5, 1, 0.5))), {"volumes": [1, 0.25]}),
    # By positions alone, the sides could belong to either.
    "closed bodies that vertex numbers keep apart stay apart": (
        in_other_order(shapes.join(CUBE, HALF)), {"sorted volumes": [0.5, 1], "is_watertight": [True, True]}),
    "a patch that shares only vertices with a closed body is a body of its own": (
        shapes.join(CUBE, FLAG), {"rows": [[*range(12)], [12]], "is_watertight": [True, False]}),
    # Both cubes have a side in z = 0 with the same corners and the same orientation.
    "a face that two overlapping bodies share is not a duplicate": (
        loose(CUBE, HALF), {"volumes": [1, 0.5], "is_watertight": [True, True]}),
    # A cube that occurs twice, a sheet at four of its corners, and a body at one.
    "faces lost are counted at the body that had them": (
        with_faces(shapes.join(CUBE, CUBE, CORNERS, shapes.moved(shapes.tetrahedron(), (1, 1, 1))),
                   [16, 16, 0], [16, 0, 1]),
        {"face_count": [12, 1, 4], "dropped_duplicate_count": [12, 0, 0], "dropped_sliver_count": [2, 0, 0]}),
    # A millionth of the assembly is as large as the small cube's holes, and above its welding tolerance.
    "a small body beside a large one is welded by its own measure": (
        shapes.join(with_a_wider_hole(loose(shapes.cube(1e-4, center=(0, 0, 0)))),
                    shapes.moved(shapes.open_box(), (1, 0, 0))),
        {"all of welded_vertex_count": {0}}),
    "an open sheet with a turned face runs one way": (
        with_a_turned_face(shapes.grid(3, 3), 5), {"misoriented_edge_count": [0], "turned_face_count": [1]}),
    "a turned side between touching cubes does not join them": (
        with_a_turned_face(loose(touching_cubes((1, 1, 0))), 3),
        {"volumes": [1, 1], "turned_face_count": [1, 0]}),
    "a cavity belongs to the body around it": (
        loose(shapes.hollow_cube()), {"volumes": [26], "face_count": [24], "is_watertight": [True]}),
    # Nested alternately: each body has the cavity next inside it.
    "a solid within a cavity is a body of its own": (
        shapes.join(*nested(*DOLLS)), {"volumes": [1, 27 - 8, 125 - 64]}),
    "an inside-out solid within a cavity is turned": (
        shapes.join(shapes.hollow_cube(5.0, 3.0), shapes.inside_out(shapes.cube(1.0, (0, 0, 0)))),
        {"volumes": [98, 1], "is_turned_inside_out": [False, True]}),
    "an insert that faces outwards stays a body": (
        shapes.join(shapes.cube(3, (0, 0, 0)), shapes.cube(1, (0, 0, 0))), {"volumes": [27, 1]}),
    **{f"a cavity whose {place} lies on the outer surface belongs to its body": (
           shapes.join(shapes.box((0, 0, 0), BLOCK), shapes.inside_out(shapes.box(lower, (1, 1, 1)))),
           {"volumes": [27 - np.prod(np.subtract(1, lower))]})
       for place, lower in {"corner": (0, 0, 0), "edge": (0, 0, 0.5), "side": (0, 0.5, 0.5)}.items()},
    # An inverted mesh in it is a body: a sheet does not bound material.
    **{f"a box without its lid has no cavities, {how}": (
           shapes.join(sheet, SMALL), {"face_count": [10, 12], "is_turned_inside_out": [False, True]})
       for how, sheet in {"up": shapes.open_box(), "turned": shapes.inside_out(shapes.open_box())}.items()},
    # By its box the cavity might be in the torus; it is in the ball within the torus's hole.
    "a cavity goes to the smallest body around it whatever the boxes say": (
        shapes.join(shapes.inside_out(CAVITY), RING, BIG_BALL),
        {"sorted face_count": [len(BIG_BALL[1]) + 12, len(RING[1])]}),
    "a flat double sheet is neither turned nor a cavity": (
        shapes.join(shapes.cube(3.0, (0, 0, 0)), LEAF), {"repairs": [Repairs(), Repairs()]}),
    "sides that were meshed apart are one body": (
        shapes.soup(*with_a_t_junction()), {"face_count": [13], "boundary_edge_count": [3]}),
}  # fmt: skip


def read_of(body, name):
    """Return the value named in a table's row for a body."""
    known = {"volumes": lambda: round(volume_of(body), 9), "rows": body.source_faces.tolist}
    if name in known:
        return known[name]()
    owners = (body, body.mesh, body.repairs, build_topology(body.mesh))
    return next(getattr(owner, name) for owner in owners if hasattr(owner, name))


@pytest.mark.parametrize("name", BODIES)
def test_faces_come_apart_into_bodies(name):
    mesh, expected = BODIES[name]
    bodies = split_bodies(*mesh)
    for field, values in expected.items():
        found = [read_of(body, field.split()[-1]) for body in bodies]
        assert {"sorted": sorted, "all": set}.get(field.split()[0], list)(found) == values, field


@pytest.mark.parametrize("offset", [(1, 0, 0), (1, 1, 0), (1, 1, 1)], ids=["side", "edge", "corner"])
@pytest.mark.parametrize("seed", range(2))
def test_cubes_that_touch_come_apart_though_they_are_inside_out(offset, seed):
    vertices, faces = touching_cubes(offset)
    order = np.random.default_rng(seed).permutation(len(faces)) if seed else np.arange(len(faces))
    vertices = vertices @ shapes.rotation(seed) if seed else vertices
    bodies = split_bodies(*shapes.inside_out(shapes.soup(vertices, faces[order])), source_faces=order)
    assert sorted(sorted(rows) for rows in rows_of(bodies)) == APART["rows"]
    assert volumes_of(bodies) == APART["volumes"]
    assert all(body.repairs.is_turned_inside_out for body in bodies)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("is_float32", [False, True])
def test_cavity_that_lies_on_max_sides_of_its_body_belongs_to_it(seed, is_float32):
    """A slot through the body, and one at its corner; rotated, so that sides coincide within rounding."""
    for lower, upper in [((0, 0.5, 0), (3, 1, 3)), ((0, 0, 0), (1, 1, 1))]:
        cavity = shapes.inside_out(shapes.box(lower, upper))
        vertices, faces = shapes.join(shapes.box((0, 0, 0), (3, 3, 3)), cavity)
        vertices = vertices @ shapes.rotation(seed)
        vertices = vertices.astype(np.float32).astype(np.float64) if is_float32 else vertices
        (body,) = split_bodies(vertices, faces)
        assert volume_of(body) == pytest.approx(27 - np.prod(np.subtract(upper, lower)), rel=1e-5)


def sides_meshed_apart(mesh):
    """Return a soup of the cube with four sides cut finer than the others: no edges between them match."""
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


def test_a_hole_is_counted_without_the_seams_that_a_weld_would_close():
    """Without a face the cube stays open, so a corner of another face, 1e-9 off, is not welded."""
    vertices, faces = shapes.soup(*shapes.cube())
    vertices[faces[11, 2]] += [1e-9, 0.0, 0.0]
    (body,) = split_bodies(vertices, faces[1:])
    assert body.repairs.welded_vertex_count == 0
    assert build_topology(body.mesh).boundary_edge_count == 3 + 4
    middles = open_edges(body.mesh)
    assert sorted(np.round(middles, 6).tolist()) == [[0.0, 0.5, 0.0], [0.5, 0.5, 0.0], [0.5, 1.0, 0.0]]


def test_a_closed_body_has_no_open_edge():
    for mesh in (shapes.cube(), shapes.soup(*shapes.torus(n=8, m=6))):
        assert open_edges(TriangleMesh(*mesh)).shape == (0, 3)


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


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        (([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2], [0, 0, 1]]),
         "none of the 2 faces has an area, expected at least one that has"),
        ((np.zeros((3, 3)), [[0, 1, 3]]), "face 0 refers to vertex 3, but the mesh has 3 vertices"),
        ((*CUBE, [1, 2]), r"source_faces have .*shape \(2,\).*expected integers of shape \(12,\)"),
        ((*CUBE, np.zeros(12)), r"source_faces have .*dtype float64.*expected integers of shape \(12,\)"),
    ],
)  # fmt: skip
def test_arrays_that_make_no_mesh_are_refused(arrays, words):
    with pytest.raises(MeshError, match=words):
        split_bodies(*arrays)


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


def _file(name):
    path = CAD / name
    if not path.exists():
        pytest.skip("shared data is not here")
    trimesh = pytest.importorskip("trimesh")
    loaded = trimesh.load(path, process=False)
    return np.array(loaded.vertices), np.array(loaded.faces)


@pytest.mark.parametrize("is_soup", [False, True], ids=["as given", "soup"])
def test_cycloidal_drive_comes_apart_into_closed_bodies(is_soup):
    """Cut at edges of four faces it has 119 pieces; a pin without its end, and that end, are open.

    Material around that rim makes them one, as for the neighbouring pin.
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
