"""Deformed parts give the same results as new parts of the same vertices; copies of them do not change."""

import re

import judging
import numpy as np
import pytest
import shapes
from part_arrays import part_arrays

import oracle
from proximity.errors import ArgumentError, MeshError, SceneError
from proximity.kernels.mesh.faces import add_corner_normals
from proximity.mesh.bvh import build_bvh
from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.sign import SignMethod
from proximity.scene.solid import Solid

MESHES = {
    "torus": shapes.torus(), "hollow cube": shapes.hollow_cube(), "sphere": shapes.sphere(1.0, 2),
    "soup": shapes.soup(*shapes.octahedron()), "turned": shapes.inside_out(shapes.tetrahedron()),
    "overlapping": shapes.join(shapes.tetrahedron(), shapes.moved(shapes.tetrahedron(), (0.2, 0.1, 0.0))),
    "sheet": shapes.grid(3, 4),
    "far": shapes.moved(shapes.torus(n=12, m=6), (1e4, -2e4, 3e3)),
}  # fmt: skip


def about_middle(vertices, matrix):
    middle = 0.5 * vertices.min(axis=0) + 0.5 * vertices.max(axis=0)
    return (vertices - middle) @ np.asarray(matrix) + middle


CHANGES = {
    "the same": lambda v: v.copy(),
    "a wobble": lambda v: v + 0.05 * np.sin(2.0 * v + 1.0),
    "a stretch": lambda v: about_middle(v, np.diag([1.5, 0.8, 0.3])),
    "a shear": lambda v: about_middle(v, [[1.0, 0.2, 0.0], [0.0, 1.0, 0.4], [0.0, 0.0, 1.0]]),
    "a turn": lambda v: about_middle(v, shapes.rotation(5)),
    "a hundredfold": lambda v: about_middle(v, 100.0 * np.eye(3)),
    "a thousandth": lambda v: about_middle(v, 1e-3 * np.eye(3)),
    "a size of atoms": lambda v: about_middle(v, 1e-9 * np.eye(3)) - v.mean(axis=0),
    "a step aside": lambda v: v + np.array([0.3, -0.1, 0.2]),
    "a long way": lambda v: v + np.array([1e4, -3e3, 2.5e3]),
    "home": lambda v: v - v.mean(axis=0),
}


def assert_tree_holds_together(scene, row, vertices, *, has_normals=True):
    """Check that the tree has exactly these vertices, in a frame that contains them, and tight boxes."""
    piece = part_arrays(scene.snapshot(), row)
    mesh = scene.parts[row].solid.mesh
    assert mesh.vertices.tobytes() == np.asarray(vertices, float).tobytes()
    local = piece.frame.of(mesh.vertices)
    assert np.array_equal(piece.corners[piece.faces], local[mesh.faces])
    back = piece.corners / piece.frame.scale + piece.frame.centre
    assert np.array_equal(back[piece.faces], mesh.vertices[mesh.faces]), "nothing is rounded on the way"
    assert np.abs(local[mesh.faces]).max() <= 1.0
    piece.bvh.check(piece.corners, piece.faces)
    slots = np.flatnonzero(piece.bvh.slot_faces >= 0)
    held = piece.bvh.blocks.reshape(-1, 9, 8)[slots // 8, :, slots % 8].reshape(-1, 3, 3)
    assert np.array_equal(held, piece.corners[piece.faces[piece.bvh.slot_faces[slots]]])
    assert np.array_equal(piece.lower, mesh.vertices[mesh.faces].min(axis=(0, 1)))
    assert np.array_equal(piece.upper, mesh.vertices[mesh.faces].max(axis=(0, 1)))
    root, anew = piece.bvh.nodes[:64], build_bvh(piece.corners, piece.faces).nodes[:64]
    for side in (slice(0, 8), slice(8, 16), slice(16, 24)):
        assert abs(root[side].min() - anew[side].min()) <= 4e-7
    normals = np.zeros_like(piece.normals)
    add_corner_normals(piece.corners, piece.faces, normals)
    assert not has_normals or np.abs(piece.normals - normals).max() <= 1e-12


def points_about(solid, count=60, seed=3):
    """Points around the part, near its surface, and nearer."""
    rng = np.random.default_rng(seed)
    vertices, faces = solid.mesh.vertices, solid.mesh.faces
    lower, upper = solid.bounds
    size = (upper - lower).max()
    around = rng.uniform(lower - 0.3 * size, upper + 0.3 * size, (count, 3))
    corners = vertices[faces[rng.integers(len(faces), size=count)]]
    on = (corners * rng.dirichlet((1.0, 1.0, 1.0), count)[:, :, None]).sum(axis=1)
    return np.concatenate(
        [around, on + size * 10.0 ** rng.uniform(-5, -1, (count, 1)) * rng.normal(size=(count, 3))]
    )


def assert_answers_as(found, expected, points):
    """Compare all queries of two objects of the same shape: distances to 1e-12, equal signs."""
    room = judging.allowance(expected.distance(points), points)
    assert (np.abs(found.distance(points) - expected.distance(points)) <= room).all()
    signed, other = found.signed_distance(points), expected.signed_distance(points)
    assert (np.abs(signed - other) <= room).all()
    clear = np.abs(other) > room
    assert np.array_equal(np.sign(signed[clear]), np.sign(other[clear]))
    hit, anew = found.closest(points), expected.closest(points)
    assert judging.same_bits(hit.signed_distance, signed)
    assert np.array_equal(hit.part, anew.part)
    assert np.array_equal(hit.is_signed, anew.is_signed)
    if anew.is_signed.any():
        assert np.array_equal(found.contains(points)[clear], expected.contains(points)[clear])
    ways = np.roll(points, 1, axis=0) - points
    ray, other_ray = found.cast(points, ways), expected.cast(points, ways)
    assert np.array_equal(np.isinf(ray.distance), np.isinf(other_ray.distance))
    met = np.isfinite(other_ray.distance)
    away = np.abs(ray.distance[met] - other_ray.distance[met])
    assert (away <= 1e-9 * np.abs(points).max()).all()
    ends = 0.5 * points + 0.5 * np.roll(points, 1, axis=0)
    along, other_along = found.closest_to_segments(points, ends), expected.closest_to_segments(points, ends)
    room = judging.allowance(other_along.distance, points)
    assert (np.abs(along.distance - other_along.distance) <= room).all()


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", MESHES)
def test_deformed_part_answers_as_one_made_anew(name, change):
    vertices, faces = MESHES[name]
    scene = Scene([Solid(vertices, faces, name=name)])
    changed = CHANGES[change](vertices)

    scene.deform(name, changed)

    anew = Solid(changed, faces)
    points = points_about(anew)
    assert_tree_holds_together(scene, 0, changed)
    assert_answers_as(scene, Scene([anew]), points)
    assert_answers_as(scene.part(name).solid, anew, points)
    judging.assert_answer_holds_together(
        scene.closest(points[:60]), changed, scene.part(name).solid.mesh.faces, points[:60]
    )
    assert [corner.tolist() for corner in scene.bounds] == [corner.tolist() for corner in anew.bounds]


def test_normals_of_needles_are_weighted_by_their_angles():
    """Random triangles, including needles and caps with angles from almost 0 to almost half a turn."""
    rng = np.random.default_rng(11)
    vertices = rng.normal(size=(200, 3))
    faces = np.array([rng.permutation(200)[:3] for _ in range(400)])
    scene = Scene([Solid(vertices, faces, name="soup")])
    for power in (0.0, -3.0, -6.0):
        changed = vertices * [1.0, 10.0**power, 1.0] + [0.0, 0.0, 0.01]

        scene.deform("soup", changed)

        piece = part_arrays(scene.snapshot(), 0)
        normals = np.zeros_like(piece.normals)
        add_corner_normals(piece.corners, piece.faces, normals)
        assert np.abs(piece.normals - normals).max() <= 1e-11
        assert_tree_holds_together(scene, 0, changed)


def test_point_on_the_deformed_surface_is_not_inside():
    scene = Scene([Solid(*shapes.cube(), name="cube")])

    scene.deform("cube", 2.0 * shapes.cube()[0])

    assert scene.contains([[2.0, 1.0, 1.0], [1.0, 0.0, 0.5], [1.0, 1.0, 1.0]]).tolist() == [
        False,
        False,
        True,
    ]
    assert scene.signed_distance([[2.0, 1.0, 1.0], [1.0, 1.0, 1.5]]).tolist() == [0.0, -0.5]


def test_part_that_comes_near_the_origin_in_a_frame_far_from_it_is_not_rounded():
    """The common frame of the file's parts is centred at 6 m, where coordinates of 1 mm would be rounded."""
    vertices, faces = shapes.octahedron(0.1)
    scene = Scene.from_mesh(
        *shapes.join(*(shapes.moved((vertices, faces), (x, 2.4, 0.0)) for x in (5.0, 5.3, 5.9)))
    )
    name = scene.parts[0].name
    assert scene.snapshot().frames["centre"][0, 0] != 0.0
    changed = (vertices + 0.1 / 3.0) * 0.5

    scene.deform(name, changed)

    assert_tree_holds_together(scene, 0, changed)
    points = points_about(scene.part(name).solid)
    expected = oracle.closest(changed, faces, points).distance
    assert (np.abs(scene.distance(points) - expected) <= judging.allowance(expected, changed)).all()


def test_faces_may_lose_their_area_and_win_it_back():
    vertices, faces = shapes.torus()
    scene, points = (
        Scene([Solid(vertices, faces, name="torus")]),
        np.random.default_rng(1).normal(size=(50, 3)),
    )

    for flat in ([1.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]):
        scene.deform("torus", vertices * flat)
        # The normals of the faces above and below cancel up to rounding.
        assert_tree_holds_together(scene, 0, vertices * flat, has_normals=False)
        expected = oracle.closest(vertices * flat, faces, points).distance
        assert (np.abs(scene.distance(points) - expected) <= judging.allowance(expected, vertices)).all()
    scene.deform("torus", vertices)

    assert_answers_as(scene, Scene([Solid(vertices, faces)]), points)


def test_unused_vertices_may_be_anything():
    vertices, faces = shapes.cube()
    extra = np.concatenate([[[np.nan, 0.0, 0.0]], vertices, [[np.inf, 1e300, 0.0]]])
    scene = Scene([Solid(extra, faces + 1, name="cube")])
    extra[1:-1] *= 3.0

    scene.deform("cube", extra)

    assert scene.signed_distance((1.0, 1.5, 1.5)) == -1.0


def test_vertices_that_meet_stay_corners_of_their_own():
    """They may separate later; only vertices that coincide in the original part are merged."""
    vertices, faces = shapes.octahedron()
    scene, pinched = Scene([Solid(vertices, faces, name="part")]), vertices.copy()
    pinched[0] = pinched[1]

    scene.deform("part", pinched)
    scene.deform("part", vertices)

    assert scene.signed_distance((0.0, 0.0, 0.0)) == pytest.approx(-1.0 / np.sqrt(3.0), rel=1e-14)


@pytest.mark.parametrize("name", ["torus", "soup", "sheet"])
def test_solid_that_was_there_before_keeps_its_shape(name):
    vertices, faces = MESHES[name]
    solid = Solid(vertices, faces, name=name)
    scene = Scene([solid])
    points = points_about(solid)
    before, bounds = solid.closest(points), solid.bounds

    scene.deform(name, CHANGES["a wobble"](vertices))
    between = scene.part(name).solid
    wobbled = between.closest(points)
    scene.deform(name, 3.0 * vertices)

    assert judging.same_bits(solid.closest(points), before)
    assert np.array_equal(solid.bounds, bounds)
    assert np.array_equal(solid.mesh.vertices, vertices)
    again = between.closest(points)
    assert np.array_equal(np.sign(again.signed_distance), np.sign(wobbled.signed_distance))
    room = judging.allowance(wobbled.signed_distance, points)
    assert (np.abs(again.signed_distance - wobbled.signed_distance) <= room).all()


@pytest.mark.parametrize("row", [0, 1])
def test_one_solid_in_two_places_is_deformed_in_one(row):
    solid, rows = Solid(*shapes.cube(), name="cube"), np.arange(12, dtype=np.int32)
    scene = Scene([Part(f"{x}", solid, Pose(translation=(x, 0.0, 0.0)), rows) for x in (0.0, 10.0)])
    before = scene.parts

    scene.deform(f"{10.0 * row}", 2.0 * shapes.cube()[0])

    assert solid.signed_distance((0.5, 0.5, 0.5)) == -0.5
    centres = np.array([[0.5, 0.5, 0.5], [10.5, 0.5, 0.5]])
    centres[row] += 0.5
    assert scene.signed_distance(centres).tolist() == [-1.0 if k == row else -0.5 for k in range(2)]
    assert scene.parts[1 - row].solid is before[1 - row].solid


def test_scenes_that_share_a_solid_are_deformed_apart():
    solid = Solid(*shapes.cube(), name="cube")
    first, second = Scene([solid]), Scene([solid])

    first.deform("cube", 2.0 * shapes.cube()[0])

    assert first.signed_distance((1.0, 1.0, 1.0)) == -1.0
    assert second.signed_distance((0.5, 0.5, 0.5)) == solid.signed_distance((0.5, 0.5, 0.5)) == -0.5
    third = Scene([first.part("cube").solid, Solid(*shapes.octahedron(), name="other")])
    first.deform("cube", 3.0 * shapes.cube()[0])
    assert third.part("cube").solid.signed_distance((1.0, 1.0, 1.0)) == -1.0
    assert third.contains((1.9, 1.9, 1.9))
    assert first.signed_distance((1.5, 1.5, 1.5)) == -1.5


def test_callers_array_is_copied_and_may_be_of_any_kind():
    vertices, faces = shapes.cube()
    scene = Scene([Solid(vertices, faces, name="cube")])
    for kind in (
        2.0 * vertices,
        (2.0 * vertices).astype(np.float32),
        np.asfortranarray(2.0 * vertices),
        (2 * vertices).astype(int).tolist(),
        scene.part("cube").solid.mesh.vertices * 2.0,
    ):
        scene.deform("cube", kind)
        if isinstance(kind, np.ndarray):
            kind[:] = 7.0
        assert scene.signed_distance((1.0, 1.0, 1.0)) == -1.0
    assert not scene.part("cube").solid.mesh.vertices.flags.writeable


def test_deformed_solid_tells_what_it_is():
    scene = Scene([Solid(*shapes.inside_out(shapes.cube()), name="lid")])
    told = scene.part("lid").solid.sign_reason

    for factor in (2.0, 3.0):
        scene.deform("lid", factor * shapes.cube()[0])

    solid = scene.part("lid").solid
    suffix = "; decided before the part was deformed, and not checked since"
    assert solid.sign_reason == told + suffix
    assert solid.sign_method is SignMethod.PSEUDONORMAL
    assert solid.has_inside and solid.is_watertight and solid.topology.is_watertight
    assert solid.diagnosis.volume == pytest.approx(27.0, rel=1e-15)
    assert repr(solid) == "Solid('lid', 12 faces, sign by pseudo-normal)"
    assert solid.bvh.check(part_arrays(scene.snapshot(), 0).corners, solid.mesh.faces) == 1


def spoilt(row, values):
    vertices = shapes.soup(*shapes.cube())[0]
    vertices[row] = values
    return vertices


@pytest.mark.parametrize(
    ("vertices", "message"),
    [
        (np.zeros((35, 3)), r"vertices of part 'cube' have shape \(35, 3\), expected \(36, 3\), as its mesh"),
        ([[0.0, 1.0], [2.0]],
         r"vertices of part 'cube' have rows of different lengths, expected numbers of shape \(36, 3\)"),
        ("far", r"vertices of part 'cube' have dtype <U3, expected numbers of shape \(36, 3\)"),
        (spoilt(7, (1.0, np.nan, 0.5)),
         r"vertex 7 of part 'cube' would be at \(1, nan, 0.5\), expected finite coordinates"),
        (
            spoilt(3, (0.0, -1e150, 0.0)),
            r"vertex 3 of part 'cube' would be at \(0, -1e\+150, 0\), "
            r"expected coordinates up to 2.5e\+149 m",
        ),
        (
            spoilt(3, (0.0, 0.25, 0.0)),
            r"vertices 0 and 3 of part 'cube' are one corner, but would be at \(0, 0, 0\) and "
            r"\(0, 0.25, 0\): that tears the surface, expected one position for both",
        ),
        (1e-151 * spoilt(3, (0.0, 0.0, 0.0)),
         r"part 'cube' would be 1e-151 m long, expected 0 or from 1e-150 m"),
        (-50.0 * spoilt(3, (0.0, 0.0, 0.0)),
         "part 'cube' would be turned inside out: its faces would enclose a negative volume"),
    ],
)  # fmt: skip
def test_vertices_that_cannot_be_used_are_refused_and_nothing_changes(vertices, message):
    scene = Scene(
        [Solid(*shapes.soup(*shapes.cube()), name="cube"), Solid(*shapes.octahedron(), name="other")]
    )
    points = np.random.default_rng(4).uniform(-1.0, 2.0, (60, 3))
    before, solid = scene.signed_distance(points), scene.part("cube").solid

    with pytest.raises((ArgumentError, MeshError), match=f"^{message}$"):
        scene.deform("cube", vertices)

    assert scene.part("cube").solid is solid
    assert judging.same_bits(scene.signed_distance(points), before)
    assert_tree_holds_together(scene, 0, solid.mesh.vertices)
    scene.deform("cube", 2.0 * solid.mesh.vertices)
    assert scene.signed_distance((1.0, 1.0, 1.25)) == -0.75


def test_unknown_part_is_refused_with_the_names():
    scene = Scene([Solid(*shapes.cube(), name="cube")])

    with pytest.raises(SceneError, match=re.escape("no part is named 'lid'; the scene has 'cube'")):
        scene.deform("lid", shapes.cube()[0])


def test_sheet_may_be_turned_over():
    """It has no inside that could be turned out."""
    vertices, faces = shapes.grid(2, 2)
    scene = Scene([Solid(vertices, faces, name="sheet")])

    scene.deform("sheet", vertices * [-1.0, 1.0, 1.0] + [0.0, 0.0, 1.0])

    assert scene.distance((-0.5, 0.5, 3.0)) == 2.0
