"""Pairs of parts with exactly known distance and relation, in all sizes, places and orders."""

from typing import NamedTuple

import numpy as np
import pytest
import shapes
from shapes import Mesh

from proximity import ConnectionFlag, PartTracker, Pose, Scene, Solid

APART, TOUCHING, CROSSING = "apart", "touching", "crossing"
FIRST, SECOND = "first inside second", "second inside first"
BACK = {FIRST: SECOND, SECOND: FIRST}
NM = 2.0**-30


def box(*corners: float) -> Mesh:
    """An axis-aligned box: lower x, y, z, upper x, y, z."""
    return shapes.box(corners[:3], corners[3:])


def triangle(*corners: tuple[float, float, float]) -> Mesh:
    """An open part of one face."""
    return np.array(corners, dtype=float), np.array([[0, 1, 2]])


def solid(*corners: tuple[float, float, float]) -> Mesh:
    """A tetrahedron of any corners."""
    vertices, faces = np.array(corners, dtype=float), shapes.tetrahedron()[1]
    return (vertices, faces) if shapes.volume(vertices, faces) > 0.0 else shapes.inside_out((vertices, faces))


def sheet(z: float, size: float = 4.0) -> Mesh:
    """A square with a corner above the origin, at height *z*."""
    return size * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]) + [0.0, 0.0, z], np.array(
        [[0, 1, 2], [0, 2, 3]]
    )


def with_faces(mesh: Mesh, *faces: tuple[int, int, int]) -> Mesh:
    """Add faces between the vertices of a mesh."""
    return mesh[0], np.concatenate([mesh[1], np.array(faces)])


def with_vertex(mesh: Mesh, *vertex: float) -> Mesh:
    """Add an unused vertex to a mesh."""
    return np.concatenate([mesh[0], [vertex]]), mesh[1]


BOX = box(0, 0, 0, 4, 4, 4)
FAR_BOX = box(9, 9, 9, 10, 10, 10)
FLAT = triangle((0, 0, 0), (4, 0, 0), (0, 4, 0))
WALL = sheet(0)[0][:, [2, 0, 1]], sheet(0)[1]
"""The square in x = 0."""
T_JUNCTION = np.concatenate([sheet(0)[0], [[2, 0, 0]]]), np.array([[0, 4, 3], [4, 1, 2], [4, 2, 3]])
T_BOX = (
    np.concatenate([BOX[0], [[2, 2, 4]]]),
    np.concatenate([np.delete(BOX[1], 2, axis=0), [[4, 5, 8], [5, 7, 8]]]),
)
"""A diagonal of its top has a T-junction on one side only."""
HOLLOW, THIN = shapes.hollow_cube(12, 8), shapes.hollow_cube(12, 10)
SHELLS = shapes.join(shapes.hollow_cube(48, 40), shapes.hollow_cube(16, 8))
TRAY = 4.0 * shapes.open_box()[0], shapes.open_box()[1]
PLATE = box(0, 0, -1, 2**13, 2**13, 0)

TRIANGLES = {
    "corner, corner": (((-2, -3, 6), (-6, -3, 6), (-2, -7, 8)), 7, APART),
    "corner, edge": (((2, -3, 4), (2, -7, 8), (3, -7, 8)), 5, APART),
    "corner, face": (((1, 1, 3), (1, 2, 5), (2, 1, 5)), 3, APART),
    "edge, edge, skew": (((2, -7, 1), (2, 1, 7), (2, -6, 8)), 5, APART),
    "edge, edge, parallel": (((1, -3, 4), (3, -3, 4), (2, -7, 8)), 5, APART),
    "edge, edge, parallel, ends apart": (((7, -4, 12), (9, -4, 12), (8, -8, 18)), 13, APART),
    "edge, face": (((1, 1, 2), (2, 1, 2), (1, 1, 6)), 2, APART),
    "face, face": (((0, 0, 3), (4, 0, 3), (0, 4, 3)), 3, APART),
    "face, face, turned": (((1, 1, -2), (0, 3, -2), (5, 5, -2)), 2, APART),
    "in one plane, corner, corner": (((-3, -4, 0), (-7, -4, 0), (-3, -8, 0)), 5, APART),
    "in one plane, corner, edge": (((1, -2, 0), (0, -4, 0), (2, -4, 0)), 2, APART),
    "in one plane, edge, edge": (((0, -2, 0), (4, -2, 0), (2, -5, 0)), 2, APART),
    "through the plane, beside": (((2, -3, -1), (2, -3, 1), (2, -5, 0)), 3, APART),
    "corner at corner": (((0, 0, 0), (-2, 0, 3), (0, -2, 3)), 0, TOUCHING),
    "corner on edge": (((2, 0, 0), (2, -2, 3), (3, -2, 3)), 0, TOUCHING),
    "corner on the long edge": (((2, 2, 0), (4, 4, 3), (4, 5, 3)), 0, TOUCHING),
    "corner on face": (((1, 1, 0), (1, 2, 3), (2, 1, 3)), 0, TOUCHING),
    "corner on face, in its plane beyond": (((1, 1, 0), (-3, -3, 0), (1, 1, 3)), 0, TOUCHING),
    "edge across edge": (((2, -1, -1), (2, 1, 1), (2, -3, 3)), 0, TOUCHING),
    "edge through corner": (((0, 0, -1), (0, 0, 1), (-3, -3, 0)), 0, TOUCHING),
    "edge along edge": (((1, 0, 0), (3, 0, 0), (2, -2, 2)), 0, TOUCHING),
    "edge along edge, longer": (((-1, 0, 0), (9, 0, 0), (2, -2, 2)), 0, TOUCHING),
    "edge in common": (((0, 0, 0), (4, 0, 0), (2, -2, 2)), 0, TOUCHING),
    "edge on face": (((1, 1, 0), (2, 1, 0), (1, 1, 3)), 0, TOUCHING),
    "edge on face, from edge to edge": (((0, 1, 0), (3, 1, 0), (1, 1, 3)), 0, TOUCHING),
    "faces overlap in part": (((1, 1, 0), (5, 1, 0), (1, 5, 0)), 0, TOUCHING),
    "face in face": (((1, 1, 0), (2, 1, 0), (1, 2, 0)), 0, TOUCHING),
    "face around face": (((-1, -1, 0), (9, -1, 0), (-1, 9, 0)), 0, TOUCHING),
    "faces side by side": (((0, 0, 0), (4, 0, 0), (0, -4, 0)), 0, TOUCHING),
    "same face": (((0, 0, 0), (4, 0, 0), (0, 4, 0)), 0, TOUCHING),
    "same face, turned over": (((0, 0, 0), (0, 4, 0), (4, 0, 0)), 0, TOUCHING),
    "through the face": (((1, 1, -1), (1, 1, 1), (2, 2, 1)), 0, CROSSING),
    "each through the other": (((1, -1, -2), (1, 2, 1), (1, -1, 1)), 0, CROSSING),
    "cut in two": (((-2, 1, -9), (9, 1, -9), (2, 1, 9)), 0, CROSSING),
    "a point over the face": (((1, 1, 2), (1, 1, 2), (1, 1, 2)), 2, APART),
    "a point on the face": (((1, 1, 0), (1, 1, 0), (1, 1, 0)), 0, TOUCHING),
    "1 nm over the long edge": (((2, 2, NM), (2, 2, 4), (4, 4, 4)), NM, APART),
    "corner, corner, in the plane through both": (((-3, -4, -1), (-3, -4, 1), (-7, -8, 0)), 5, APART),
    "a line over the face": (((-1, 1, 2), (5, 1, 2), (5, 1, 2)), 2, APART),
    "a line beside an edge": (((1, -3, 4), (3, -3, 4), (2, -3, 4)), 5, APART),
}
OTHERS = {
    "boxes, face, face": (BOX, box(7, 0, 0, 9, 4, 4), 3, APART),
    "boxes, edge, edge": (BOX, box(7, 8, 0, 9, 9, 4), 5, APART),
    "boxes, corner, corner": (BOX, box(6, 7, 10, 9, 9, 12), 7, APART),
    "solids, corner, face": (BOX, solid((2, 2, 6), (1, 1, 9), (3, 1, 9), (2, 3, 9)), 2, APART),
    "solids, corner, edge": (BOX, solid((7, 8, 2), (9, 9, 1), (9, 10, 2), (9, 9, 3)), 5, APART),
    "solids, corner, corner": (BOX, solid((6, 7, 10), (8, 8, 12), (9, 8, 12), (8, 9, 13)), 7, APART),
    "solids, edge, edge": (BOX, solid((3, 11, 2), (11, 5, 2), (13, 16, 1), (13, 16, 3)), 5, APART),
    "solids, edge, face": (BOX, solid((1, 1, 6), (3, 3, 6), (1, 2, 9), (2, 1, 9)), 2, APART),
    "faces that touch": (BOX, box(4, 1, 1, 6, 2, 2), 0, TOUCHING),
    "faces that coincide": (BOX, box(4, 0, 0, 6, 4, 4), 0, TOUCHING),
    "faces that overlap in part": (BOX, box(4, 2, 2, 8, 6, 6), 0, TOUCHING),
    "edges that touch": (BOX, box(4, 4, 0, 6, 6, 4), 0, TOUCHING),
    "edges that touch in part": (BOX, box(4, 4, 2, 6, 6, 8), 0, TOUCHING),
    "edges that touch across": (BOX, solid((3, 5, 2), (5, 3, 2), (8, 8, 1), (8, 8, 3)), 0, TOUCHING),
    "corners that touch": (BOX, box(4, 4, 4, 6, 6, 6), 0, TOUCHING),
    "a corner on a face": (BOX, solid((2, 2, 4), (1, 1, 9), (3, 1, 9), (2, 3, 9)), 0, TOUCHING),
    "a corner on an edge": (BOX, solid((4, 4, 2), (9, 9, 1), (9, 10, 2), (9, 9, 3)), 0, TOUCHING),
    "an edge on a face": (BOX, solid((1, 1, 4), (3, 2, 4), (1, 2, 9), (2, 1, 9)), 0, TOUCHING),
    "the same box": (BOX, BOX, 0, CROSSING),
    "boxes with sides in common planes": (BOX, box(2, 0, 0, 6, 4, 4), 0, CROSSING),
    "boxes that cross": (BOX, box(3, 3, 3, 6, 6, 6), 0, CROSSING),
    "a bar through a box": (BOX, box(1, 1, -2, 3, 3, 6), 0, CROSSING),
    "a corner in a box": (BOX, solid((2, 2, 3), (1, 1, 9), (3, 1, 9), (2, 3, 9)), 0, CROSSING),
    "a box in another": (BOX, box(1, 1, 1, 2, 2, 2), 0, SECOND),
    "a box in another, at its face": (BOX, box(1, 1, 0, 2, 2, 1), 0, CROSSING),
    "a box in another, at its corner": (BOX, box(0, 0, 0, 1, 1, 1), 0, CROSSING),
    "one of two bodies inside": (BOX, shapes.join(FAR_BOX, box(1, 1, 1, 3, 3, 3)), 0, SECOND),
    "the other of two bodies inside": (
        BOX, shapes.join(box(1, 1, 1, 3, 3, 3), FAR_BOX), 0, SECOND
    ),
    "inside one of two bodies": (shapes.join(FAR_BOX, BOX), box(1, 1, 1, 3, 3, 3), 0, SECOND),
    "a box in a hollow one": (HOLLOW, box(-1, -1, -1, 1, 1, 1), 3, APART),
    "a box in a cavity, at its wall": (HOLLOW, box(2, -1, -1, 4, 1, 1), 0, TOUCHING),
    "a box that fills a cavity": (HOLLOW, box(-4, -4, -4, 4, 4, 4), 0, TOUCHING),
    "a box through a cavity's wall": (HOLLOW, box(2, -1, -1, 5, 1, 1), 0, CROSSING),
    "a box in the wall of a hollow one": (HOLLOW, box(4.5, 0, 0, 5.5, 1, 1), 0, SECOND),
    "a hollow box in a solid one": (box(-9, -9, -9, 9, 9, 9), HOLLOW, 0, SECOND),
    "a shell in a shell": (THIN, shapes.hollow_cube(6, 4), 2, APART),
    "a shell in the wall of another": (THIN, shapes.hollow_cube(11, 10.5), 0, SECOND),
    "between two shells": (SHELLS, box(10, -1, -1, 17, 1, 1), 2, APART),
    "in the inner of two shells": (SHELLS, box(-1, -1, -1, 1, 1, 1), 3, APART),
    "in the wall of the inner of two shells": (SHELLS, box(5, -1, -1, 7, 1, 1), 0, SECOND),
    "sheets above each other": (sheet(0), sheet(2), 2, APART),
    "sheets side by side": (sheet(0), shapes.moved(sheet(0), (6, 0, 0)), 2, APART),
    "sheets that cross": (sheet(0), shapes.moved(WALL, (2, 1, -1)), 0, CROSSING),
    "sheets in a T": (sheet(0), shapes.moved(WALL, (2, 0, 0)), 0, TOUCHING),
    "sheets in an L": (sheet(0), WALL, 0, TOUCHING),
    "a sheet over a box": (BOX, sheet(6), 2, APART),
    "a sheet through a box": (BOX, shapes.moved(sheet(2), (2, 2, 0)), 0, CROSSING),
    "a sheet that cuts a box": (BOX, shapes.moved(sheet(2, 8), (-1, -1, 0)), 0, CROSSING),
    "a sheet in a box": (box(-1, -1, -1, 5, 5, 5), sheet(0), 0, SECOND),
    "a sheet in a cavity": (shapes.hollow_cube(24, 16), sheet(2), 4, APART),
    "a sheet on a box": (BOX, sheet(4), 0, TOUCHING),
    "a larger sheet on a box": (BOX, shapes.moved(sheet(4, 8), (-1, -1, 0)), 0, TOUCHING),
    "a sheet that stands on a box": (BOX, shapes.moved(WALL, (2, 0, 4)), 0, TOUCHING),
    "a sheet under an overhang": (shapes.join(box(0, 0, 5, 4, 4, 6), BOX), sheet(4.5), 0.5, APART),
    "a box in a tray": (TRAY, box(1, 1, 1, 3, 3, 3), 1, APART),
    "a box on the tray's bottom": (TRAY, box(1, 1, 0, 3, 3, 3), 0, TOUCHING),
    "a box around a tray": (TRAY, box(-1, -1, -1, 5, 5, 5), 0, FIRST),
    "a box above a T-junction": (T_JUNCTION, box(1, 1, 3, 3, 3, 5), 3, APART),
    "a box on a T-junction": (T_JUNCTION, box(1, 0, 0, 3, 2, 2), 0, TOUCHING),
    "a box beside a T-junction": (T_JUNCTION, box(1, -6, 0, 3, -3, 2), 3, APART),
    "a corner over a T-junction": (T_BOX, solid((2, 2, 6), (1, 1, 9), (3, 1, 9), (2, 3, 9)), 2, APART),
    "a corner on a T-junction": (T_BOX, solid((2, 2, 4), (1, 1, 9), (3, 1, 9), (2, 3, 9)), 0, TOUCHING),
    "duplicate faces": (with_faces(BOX, *BOX[1][:4]), box(7, 0, 0, 9, 4, 4), 3, APART),
    "duplicate faces that touch": (shapes.join(BOX, BOX), box(4, 1, 1, 6, 2, 2), 0, TOUCHING),
    "duplicate faces that cross": (shapes.join(BOX, BOX), box(3, 1, 1, 6, 2, 2), 0, CROSSING),
    "faces without area": (with_faces(BOX, (0, 1, 1), (2, 2, 2)), box(1, 1, 6, 2, 2, 8), 2, APART),
    "a face without area that touches": (with_faces(BOX, (1, 7, 7)), box(4, 0, 0, 6, 4, 4), 0, TOUCHING),
    "an unused vertex inside": (BOX, with_vertex(box(7, 0, 0, 9, 4, 4), 1, 1, 1), 3, APART),
    "an unused vertex far off": (with_vertex(BOX, 999, 0, 0), box(7, 0, 0, 9, 4, 4), 3, APART),
    "an unused vertex outside": (BOX, with_vertex(box(1, 1, 1, 3, 3, 3), 9, 9, 9), 0, SECOND),
    "1 nm apart": (BOX, box(4 + NM, 1, 1, 6, 2, 2), NM, APART),
    "1 nm across": (BOX, box(4 - NM, 1, 1, 6, 2, 2), 0, CROSSING),
    "1 nm inside": (BOX, box(NM, NM, NM, 1, 1, 1), 0, SECOND),
    "1 nm thick": (BOX, box(1, 1, 6, 2, 2, 6 + NM), 2, APART),
    "1 nm thick, 1 nm apart": (BOX, box(1, 1, 4 + NM, 2, 2, 4 + 2 * NM), NM, APART),
    "1 nm thick, in the middle": (BOX, box(1, 1, 2, 2, 2, 2 + NM), 0, SECOND),
    "1 nm large, over the middle": (BOX, box(2, 2, 5, 2 + NM, 2 + NM, 5 + NM), 1, APART),
    "1 nm large, on the face": (BOX, box(2, 2, 4, 2 + NM, 2 + NM, 4 + NM), 0, TOUCHING),
    "1 nm large, across the face": (BOX, box(2, 2, 4 - NM, 2 + NM, 2 + NM, 4 + NM), 0, CROSSING),
    "1 nm large, inside": (BOX, box(2, 2, 2, 2 + NM, 2 + NM, 2 + NM), 0, SECOND),
    "a small box over a large plate": (PLATE, box(2000, 3000, 2, 2001, 3001, 3), 2, APART),
    "a small box beside a large plate": (PLATE, box(-5, 3000, 0, -3, 3001, 1), 3, APART),
    "a small box on a large plate": (PLATE, box(2000, 3000, 0, 2001, 3001, 1), 0, TOUCHING),
    "a small box across a large plate's face": (PLATE, box(2000, 3000, -0.5, 2001, 3001, 1), 0, CROSSING),
    "a small box in a large plate": (PLATE, box(2000, 3000, -0.75, 2001, 3001, -0.25), 0, SECOND),
}  # fmt: skip
PAIRS = {name: (FLAT, triangle(*there), *known) for name, (there, *known) in TRIANGLES.items()} | OTHERS


class Place(NamedTuple):
    """Placement of a pair: an angle-preserving matrix, an offset, a pose, and a scale of all of these."""

    matrix: np.ndarray = np.eye(3)
    factor: int = 1  # scale factor of the matrix
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pose: Pose = Pose()
    size: float = 0.0  # of the added coordinates
    scale: float = 1.0

    def scene(self, one: Mesh, other: Mesh) -> Scene:
        """A scene of both parts, named a and b."""
        solids = []
        for name, mesh in zip("ab", (one, other), strict=True):
            vertices = self.scale * (mesh[0] @ self.matrix.T + self.offset)
            faces = mesh[1] if np.linalg.det(self.matrix) > 0.0 else mesh[1][:, ::-1]
            solids.append(Solid(vertices, faces, name=name))
        scene, pose = Scene(solids), Pose(self.pose.rotation, self.scale * self.pose.translation)
        scene.move_many(["a", "b"], [pose, pose])
        return scene

    def room(self, *meshes: Mesh) -> float:
        """Allowed distance error, m."""
        largest = max(np.abs(vertices[faces]).max() for vertices, faces in meshes)
        return 1e-14 * self.scale * (self.factor * largest + self.size)

    def is_rounding(self, name: str) -> bool:
        """Test whether the pair may be reported as touching, with a gap below 1e-13 of the size."""
        return name.startswith("1 nm") and self.size >= 2**20


TURNED = Pose(np.eye(3)[[2, 0, 1]], [3.0, -5.0, 1000.0])
PLACES = {
    "as it is": Place(),
    "small": Place(scale=2.0**-20),
    "large": Place(scale=2.0**13),
    "turned by 90 degrees": Place(pose=TURNED, size=1000.0),
    "turned by 3-4-5": Place(np.array([[3, -4, 0], [4, 3, 0], [0, 0, 5]]), 5),
    "mirrored": Place(np.diag([-1, 1, 1]), scale=2.0**-10),
    "mirrored and turned by 1-2-2": Place(np.array([[1, 2, 2], [2, 1, -2], [2, -2, 1]]), 3),
    "far off": Place(offset=(2**20, -(2**19), 2**10), size=2**20),
    "in a far pose": Place(pose=Pose(None, [-(2**20), 2**18, 2**10]), size=2**20),
}
ANYWHERE = Place(pose=Pose(shapes.rotation(5), [1e3, -2e3, 5e2]), size=3e3)


THROUGH_DIAGONALS = ("boxes that cross", "a sheet through a box")


def distance_to(scene: Scene, name: str, point: np.ndarray) -> float:
    """Distance from a point of the scene to the surface of a part."""
    part = scene.part(name)
    return float(part.solid.distance(part.pose.inverse.point(point)))


def assert_is_on(scene: Scene, name: str, point: np.ndarray, room: float) -> None:
    """Check that a point of the scene is on the surface of a part."""
    assert distance_to(scene, name, point) <= room


@pytest.mark.parametrize("where", PLACES)
@pytest.mark.parametrize("name", PAIRS)
def test_distance_and_relation_are_known(name, where):
    one, other, distance, relation = PAIRS[name]
    place = PLACES[where]
    scene, room = place.scene(one, other), place.room(one, other)
    expected = place.scale * place.factor * distance

    found, back = scene.clearance("a", "b"), scene.clearance("b", "a")

    assert found.distance == pytest.approx(expected, abs=room)
    assert found.relation == relation or (found.relation == TOUCHING and place.is_rounding(name))
    assert (back.distance, back.relation) == (found.distance, BACK.get(found.relation, found.relation))
    assert found.lower == (0.0 if relation == TOUCHING else found.distance)
    apart = np.linalg.norm(found.point_on_first - found.point_on_second)
    assert apart == pytest.approx(found.distance, abs=room)
    if found.relation not in BACK:
        assert_is_on(scene, "a", found.point_on_first, room)
        assert_is_on(scene, "b", found.point_on_second, room)


@pytest.mark.parametrize("where", PLACES)
@pytest.mark.parametrize("name", PAIRS)
def test_a_tracker_knows_them_from_nothing_and_from_what_it_kept(name, where):
    one, other, distance, relation = PAIRS[name]
    place = PLACES[where]
    scene, room = place.scene(one, other), place.room(one, other)
    expected = place.scale * place.factor * distance
    tracker, pose = PartTracker(scene, "b"), scene.part("b").pose
    for tick, step in enumerate((0.0, 1e-3, -2e-3, 1e-9, 0.0, 0.5, 0.0)):
        aside = place.scale * place.factor * step * np.array([1.0, 0.5, 0.25])
        now = 10**12 + tick * 10**9
        record = tracker.tick(Pose(pose.rotation, pose.translation + aside), now, now)[0]
        if step:
            continue
        assert record["lower"] <= expected + room
        assert record["upper"] == record["distance"] == pytest.approx(expected, abs=room)
        assert bool(record["flags"] & ConnectionFlag.CROSSING) == (relation == CROSSING)
        if relation != TOUCHING and not place.is_rounding(
            name
        ):  # parts that touch within rounding may be inside as well
            assert bool(record["flags"] & ConnectionFlag.INSIDE) == (relation in BACK)
        if relation != FIRST:  # otherwise it is on the inner surface
            assert_is_on(scene, "b", record["point_on_own"], room)
        if relation != SECOND:
            assert_is_on(scene, "a", record["point_on_part"], room)
        if record["flags"] & ConnectionFlag.INSIDE:
            assert record["point_on_own"].tolist() == record["point_on_part"].tolist()
            there = distance_to(scene, "a", record["point_on_own"])
            here = distance_to(scene, "a", scene.clearance("a", "b").point_on_first)
            assert there == pytest.approx(here, abs=room)


@pytest.mark.parametrize("name", PAIRS)
def test_distance_is_the_same_anywhere(name):
    """The rotation is inexact in floating point, so that the relation of touching parts depends on rounding.

    The same holds for parts that cross only where edges meet edges.
    """
    one, other, distance, relation = PAIRS[name]

    found = ANYWHERE.scene(one, other).clearance("a", "b")

    assert found.distance == pytest.approx(distance, abs=ANYWHERE.room(one, other))
    if relation != TOUCHING and name not in THROUGH_DIAGONALS and not name.startswith("1 nm"):
        assert found.relation == relation
