"""Work cells for tracker trials: parts of many kinds that move, appear and disappear, and their history.

A `Cell` updates two scenes identically: one for the tracker, one for reference distances. A `History` records
all poses per tick; it computes signed distances at a tick, or some seconds later at constant velocity, part
by part in their own frames and without a scene.
"""

from functools import cache

import numpy as np
import shapes
from project import MESHES, SHARED_DATA

import proximity
from proximity.pose import Pose
from proximity.scene.scene import Part, Scene
from proximity.scene.solid import Solid

FILES = ("bracket.stl", "gear.stl", "hollow_box.stl", "plate.stl", "sphere.stl", "torus.ply", "assembly.glb")
CAD = ("busted.STL", "featuretype.STL", "octagonal_pocket.stl", "cycloidal.ply")
MAX_DEFORMED = 5000  # faces
TOO_MANY = 150  # bodies of a file; a cell uses all of them


def _crossed_cubes():
    """A closed but self-intersecting mesh, whose sign comes from winding numbers."""
    return shapes.join(shapes.cube(1.0, (0.0, 0.0, 0.0)), shapes.cube(1.0, (0.4, 0.3, 0.2)))


def _holed_ball(face_count):
    """A ball without some faces at its top, whose inside can be entered without crossing the surface."""
    vertices, faces = shapes.sphere(0.5, 3)
    heights = vertices[faces].mean(axis=1)[:, 2]
    return vertices, faces[np.argsort(heights)[:-face_count]]


def _voxels():
    return shapes.voxels(np.random.default_rng(5).random((3, 3, 3)) < 0.5)


CLOSED = {
    "tetrahedron": shapes.tetrahedron,
    "cube": shapes.cube,
    "slab": lambda: shapes.box((-1.0, -1.0, -0.01), (1.0, 1.0, 0.01)),
    "octahedron": shapes.octahedron,
    "hollow cube": shapes.hollow_cube,
    "shells": lambda: shapes.join(shapes.hollow_cube(), shapes.hollow_cube(0.6, 0.3)),
    "torus": shapes.torus,
    "ball": lambda: shapes.sphere(0.5, 3),
    "hollow ball": lambda: shapes.join(shapes.sphere(0.5, 3), shapes.inside_out(shapes.sphere(0.4, 3))),
    "crossed cubes": _crossed_cubes,
    "leaky ball": lambda: _holed_ball(3),
    "holed ball": lambda: _holed_ball(40),
    "voxels": _voxels,
}
OPEN = {
    "sheet": shapes.grid,
    "open box": shapes.open_box,
    "band": shapes.strip,
    "moebius": lambda: shapes.strip(12, half_turns=1),
}
KINDS = CLOSED | OPEN
HEAVY = {
    "fine ball": lambda: shapes.sphere(0.5, 5),
    "finer ball": lambda: shapes.sphere(0.5, 6),
    "finest cavity": lambda: shapes.join(
        shapes.cube(1.2, (0, 0, 0)), shapes.inside_out(shapes.sphere(0.5, 6))
    ),
}
SIZES = (0.01, 0.03, 0.1, 0.3)  # m
ALL_SIZES = (*SIZES, *SIZES, 1e-4, 20.0)


@cache
def solid_of(kind, size):
    vertices, faces = (KINDS | HEAVY)[kind]()
    extent = (vertices.max(axis=0) - vertices.min(axis=0)).max()
    return Solid(vertices * (size / extent), faces, name=kind)


@cache
def middle_of_hole(solid):
    """Mean of the open edges' vertices, where the inside can be entered; None without such edges."""
    if solid.is_watertight or not solid.has_inside:
        return None
    faces = solid.mesh.faces
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    pairs, counts = np.unique(edges, axis=0, return_counts=True)
    return solid.mesh.vertices[pairs[counts == 1].ravel()].mean(axis=0) if (counts == 1).any() else None


@cache
def solids_of_file(path, size):
    """Solids of all parts of a file, in its frame; scaled to *size* if given."""
    scene = proximity.load(path)
    lower, upper = scene.bounds
    factor = 1.0 if size is None else size / float((upper - lower).max())
    placed = [part.pose.point(part.solid.mesh.vertices) * factor for part in scene.parts]
    return [Solid(each, part.solid.mesh.faces) for each, part in zip(placed, scene.parts, strict=True)]


def rotations_of(quaternions):
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def turned(quaternions, spins):
    """Rotate unit quaternions by *spins* (..., 3), radians in the outer frame."""
    half = 0.5 * np.linalg.norm(spins, axis=-1, keepdims=True)
    sw, sv = np.cos(half), 0.5 * np.sinc(half / np.pi) * spins
    w, v = quaternions[..., :1], quaternions[..., 1:]
    product = np.concatenate(
        [sw * w - (sv * v).sum(axis=-1, keepdims=True), sw * v + w * sv + np.cross(sv, v)], axis=-1
    )
    return product / np.linalg.norm(product, axis=-1, keepdims=True)


class Cell:
    """Parts with poses and velocities, and two scenes of them."""

    def __init__(self, solids, quaternions, translations, *, absent=()):
        self.solids = list(solids)
        count = len(self.solids)
        self.first_solids = list(solids)
        self.names = [f"part {number}" for number in range(count)]
        self.quaternions = np.array(quaternions, dtype=np.float64)
        self.translations = np.array(translations, dtype=np.float64)
        self.velocities, self.spins = np.zeros((2, count, 3))
        self.is_hidden = np.zeros(count, bool)
        self.order = [number for number in range(count) if number not in set(absent)]
        self.homes = self.translations.copy()
        boxes = np.array([solid.bounds for solid in self.solids])
        self.middles = boxes.mean(axis=1)
        self.reaches = 0.5 * np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1)
        self.before_change = lambda: None
        self.scene, self.twin = (Scene([self._part(number) for number in self.order]) for _ in range(2))

    def _part(self, number):
        solid = self.solids[number]
        rows = np.arange(solid.mesh.face_count, dtype=np.int32)
        return Part(
            self.names[number],
            solid,
            Pose(rotations_of(self.quaternions[number]), self.translations[number]),
            rows,
            velocity=self.velocities[number],
            angular_velocity=self.spins[number],
            is_hidden=bool(self.is_hidden[number]),
        )

    def move(self, numbers):
        """Update the poses and velocities of some parts in both scenes."""
        numbers = [number for number in numbers if number in self.order]
        if not numbers:
            return
        self.before_change()
        poses = np.tile(np.eye(4), (len(numbers), 1, 1))
        poses[:, :3, :3] = rotations_of(self.quaternions[numbers])
        poses[:, :3, 3] = self.translations[numbers]
        for scene in (self.scene, self.twin):
            names = [self.names[number] for number in numbers]
            if len(numbers) == 1:
                velocity, spin = self.velocities[numbers[0]], self.spins[numbers[0]]
                scene.move(names[0], poses[0], velocity=velocity, angular_velocity=spin)
            else:
                scene.move_many(names, poses, self.velocities[numbers], self.spins[numbers])

    def coast(self, numbers, seconds):
        """Advance some parts at their velocities."""
        self.translations[numbers] += seconds * self.velocities[numbers]
        self.quaternions[numbers] = turned(self.quaternions[numbers], seconds * self.spins[numbers])

    def toggle(self, number):
        """Toggle the visibility of a part."""
        if number in self.order:
            self.before_change()
            self.is_hidden[number] = not self.is_hidden[number]
            for scene in (self.scene, self.twin):
                (scene.hide if self.is_hidden[number] else scene.show)(self.names[number])

    def swap(self, number):
        """Remove a part if present, else add it."""
        self.before_change()
        if number not in self.order:
            self.order.append(number)
            for scene in (self.scene, self.twin):
                scene.add(self._part(number))
        elif len(self.order) > 1:
            self.order.remove(number)
            for scene in (self.scene, self.twin):
                scene.remove(self.names[number])

    def deform(self, number, rng):
        """Deform a part slightly from its initial shape; the reference scene gets a new tree."""
        if number not in self.order or self.solids[number].mesh.face_count > MAX_DEFORMED:
            return
        self.before_change()
        vertices = self.first_solids[number].mesh.vertices
        wave = rng.normal(size=3) / self.reaches[number]
        bulge = 0.2 * rng.uniform() * self.reaches[number] * rng.normal(size=3) / (1.0 + np.abs(wave).sum())
        vertices = vertices * rng.uniform(0.8, 1.2, 3) + np.sin(vertices @ wave)[:, None] * bulge
        self.solids[number] = Solid(vertices, self.solids[number].mesh.faces)
        for scene in (self.scene, self.twin):
            scene.deform(self.names[number], vertices)

    def places(self, rng, count):
        """Choose critical points (count, 3): on, near, in, between and far from the parts."""
        found = np.empty((count, 3))
        for row in range(count):
            number = int(rng.choice(self.order))
            solid, reach = self.solids[number], self.reaches[number]
            way, hole = rng.integers(7), middle_of_hole(solid)
            if hole is not None and rng.random() < 0.3:
                own = hole + rng.normal(size=3) * reach * rng.choice([0.0, 1e-3, 0.05])
            elif way < 3:
                corners = solid.mesh.vertices[solid.mesh.faces[rng.integers(solid.mesh.face_count)]]
                own = rng.dirichlet(np.ones(3)) @ corners
                own = own + rng.normal(size=3) * reach * rng.choice([0.0, 1e-9, 1e-4, 0.02, 0.3])
            elif way == 3:
                own = self.middles[number] + rng.normal(size=3) * reach * rng.choice([0.0, 1e-12, 1e-3, 0.1])
            elif way == 4:
                own = self.middles[number] + rng.uniform(-1.0, 1.0, 3) * reach
            elif way == 5:
                own = solid.mesh.vertices[rng.integers(len(solid.mesh.vertices))]
            else:
                own = self.middles[number] + rng.normal(size=3) * reach * rng.choice([2.0, 20.0])
            found[row] = rotations_of(self.quaternions[number]) @ own + self.translations[number]
        return found


def cell_at(rng, solids, spread, **values):
    """A cell of solids at random poses."""
    quaternions = rng.normal(size=(len(solids), 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    return Cell(solids, quaternions, rng.uniform(-spread, spread, (len(solids), 3)), **values)


def one_part(rng):
    return cell_at(rng, [solid_of(str(rng.choice(list(KINDS))), float(rng.choice(ALL_SIZES)))], 0.1)


def several_parts(rng):
    """Two to twelve parts of all kinds and sizes; many overlap."""
    count = int(rng.integers(2, 13))
    solids = [solid_of(str(rng.choice(list(KINDS))), float(rng.choice(ALL_SIZES))) for _ in range(count)]
    return cell_at(
        rng, solids, float(rng.choice([0.03, 0.15, 0.5])), absent=[1] if rng.random() < 0.3 else []
    )


def many_parts(rng):
    count = int(rng.integers(20, 61))
    solids = [solid_of(str(rng.choice(list(KINDS))), float(rng.choice(SIZES[:3]))) for _ in range(count)]
    return cell_at(rng, solids, 0.2, absent=[2, 5])


def stacked_parts(rng):
    """Axis-aligned cubes in contact, face to face."""
    size = float(rng.choice(SIZES))
    places = np.array([[x, y, 0.0] for x in range(3) for y in range(3)]) * size
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (9, 1))
    return Cell([solid_of("cube", size)] * 9, upright, places)


def nested_parts(rng):
    """Solids nested in each other's cavities."""
    solids = [solid_of("hollow cube", size) for size in (0.3, 0.09, 0.02)] + [solid_of("hollow ball", 0.25)]
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (4, 1))
    return Cell(solids, quaternions, rng.normal(size=(4, 3)) * 1e-3)


def heavy_part(rng):
    """A ball of tens of thousands of faces: a traversal from its centre opens all nodes."""
    return cell_at(rng, [solid_of(str(rng.choice(list(HEAVY))), float(rng.choice([0.1, 0.4])))], 0.1)


def part_from_file(rng):
    path = MESHES / str(rng.choice(FILES))
    return _cell_of_file(rng, path)


def real_part(rng):
    """A real CAD part, or a file of the project if there is none."""
    paths = [SHARED_DATA / "cad" / name for name in CAD if (SHARED_DATA / "cad" / name).is_file()]
    return _cell_of_file(rng, paths[rng.integers(len(paths))]) if paths else part_from_file(rng)


def _cell_of_file(rng, path):
    size = None if rng.random() < 0.5 else 0.2
    solids = solids_of_file(path, size)[:TOO_MANY]
    upright = np.tile([1.0, 0.0, 0.0, 0.0], (len(solids), 1))
    return Cell(solids, upright, np.tile(rng.uniform(-0.1, 0.1, 3), (len(solids), 1)))


LIGHT_CELLS = (one_part, several_parts, many_parts, stacked_parts, nested_parts, part_from_file)
HEAVY_CELLS = (*LIGHT_CELLS, heavy_part, real_part)


def span_of(solid):
    """Largest distance of a solid's box from its origin, m."""
    return float(np.linalg.norm(np.abs(solid.bounds).max(axis=0)))


class History:
    """Pose and shape of each part of a cell at each tick."""

    def __init__(self, cell, tick_count):
        count = len(cell.solids)
        self.cell = cell
        self.quaternions = np.empty((tick_count, count, 4))
        self.translations, self.velocities, self.spins = np.empty((3, tick_count, count, 3))
        self.is_seen = np.zeros((tick_count, count), bool)
        self.numbers = np.full((tick_count, count), -1)  # of the part at each index of scene.parts
        self.shapes = np.empty((tick_count, count), np.int64)  # rows of the following
        self.solids, self.spans = [], np.empty(0)
        self.has_inside, self.has_holes = np.empty((2, 0), bool)
        self.extent = 0.0  # m, the largest coordinate of any part at any tick
        self.row_of_solid = {}

    def _row(self, solid):
        if id(solid) not in self.row_of_solid:
            self.row_of_solid[id(solid)] = len(self.solids)
            self.solids.append(solid)
            self.spans = np.append(self.spans, span_of(solid))
            self.has_inside = np.append(self.has_inside, solid.has_inside)
            self.has_holes = np.append(self.has_holes, solid.has_inside and not solid.is_watertight)
        return self.row_of_solid[id(solid)]

    def note(self, tick):
        """Record the cell's state."""
        cell = self.cell
        self.quaternions[tick], self.translations[tick] = cell.quaternions, cell.translations
        self.velocities[tick], self.spins[tick] = cell.velocities, cell.spins
        self.is_seen[tick, cell.order] = ~cell.is_hidden[cell.order]
        self.numbers[tick, : len(cell.order)] = cell.order
        self.shapes[tick] = [self._row(solid) for solid in cell.solids]
        reach = np.abs(cell.translations).max(axis=1) + self.spans[self.shapes[tick]]
        self.extent = max(self.extent, float(reach.max()))

    def fastest(self, ticks):
        """Upper bound of the speed of all points of all parts, m/s."""
        speeds = np.linalg.norm(self.velocities[ticks], axis=2)
        speeds = speeds + np.linalg.norm(self.spins[ticks], axis=2) * self.spans[self.shapes[ticks]]
        return np.where(self.is_seen[ticks], speeds, 0.0).max(axis=1, initial=0.0)

    def own_points(self, number, points, ticks, seconds):
        """Points in the frame of a part, *seconds* after the ticks at constant velocity."""
        quaternions = self.quaternions[ticks, number]
        spins = seconds[:, None] * self.spins[ticks, number]
        if spins.any():
            quaternions = turned(quaternions, spins)
        origins = self.translations[ticks, number] + seconds[:, None] * self.velocities[ticks, number]
        return np.einsum("nji,nj->ni", rotations_of(quaternions), points - origins)

    def signed_distance(self, points, ticks, seconds=0.0, *, to_touch=False):
        """Smallest signed distance over the visible parts; inf without any.

        *to_touch*: use unsigned distances for parts with holes, which can be entered without contact.
        """
        seconds = np.broadcast_to(np.asarray(seconds, dtype=np.float64), (len(points),))
        best = np.full(len(points), np.inf)
        seen = np.flatnonzero(self.is_seen[ticks].any(axis=0)) if len(points) else []
        for number in seen:
            rows = np.flatnonzero(self.is_seen[ticks, number])
            if len(seen) > 1:
                origins = self.translations[ticks[rows], number]
                away = np.linalg.norm(points[rows] - origins, axis=1)
                away -= self.spans[self.shapes[ticks[rows], number]]
                away -= seconds[rows] * np.linalg.norm(self.velocities[ticks[rows], number], axis=1)
                rows = rows[away - 1e-9 * (1.0 + np.abs(away)) < best[rows]]
            own = self.own_points(number, points[rows], ticks[rows], seconds[rows])
            for shape in np.unique(self.shapes[ticks[rows], number]):
                at = np.flatnonzero(self.shapes[ticks[rows], number] == shape)
                solid = self.solids[shape]
                ask = solid.distance if to_touch and self.has_holes[shape] else solid.signed_distance
                best[rows[at]] = np.minimum(best[rows[at]], ask(own[at]))
        return best
