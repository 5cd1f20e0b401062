"""Make the sample parts: ``python meshes/make.py``, and ``--large FOLDER`` for those too large to keep here.

Each shape is a function that gives (vertices (V, 3) float64 in metres, faces (F, 3) int64); tests and
benchmarks import them. The files are in millimetres, but for the GLB, which is in metres as its format
demands. The same versions of the libraries make the same bytes. The parts and their known distances, in mm:

box.stl
    [0, 40] × [0, 30] × [0, 20], 12 faces. (20, 15, 10) is 10 inside, (43, 34, 20) is 5 outside.
sphere.stl
    Radius 20 around the origin, 1,280 faces, all corners on the sphere. The flat faces lie up to 0.091 within
    it: signed distance is that of the sphere plus 0 to 0.091.
torus.ply
    Ring radius 30 around the z axis, tube radius 10, 2,304 faces, corners on the torus and written with every
    digit of double precision. Signed distance is that of the torus within 0.172.
hollow_box.stl
    [0, 60] × [0, 40] × [0, 30] with the cavity [10, 40] × [10, 25] × [5, 20]. The middle of the cavity
    (25, 17.5, 12.5) is 7.5 outside; (50, 20, 15) is 10 inside.
bracket.stl
    An angle of 60 × 40 × 50, 4 thick, with fillet, ribs, boss, slot and countersunk holes; 10,620 faces, many
    of them needles. (30, 10, 5) is 1 outside, nearest to (30, 10, 4) on its foot; (30, 10, 2) is 2 inside.
plate.stl
    80 × 80 × 5; of a grid of 8 × 8 places 10 apart the first 60 are holes of radius 3 with 16 sides. The
    middle of the first hole (5, 5, 2.5) is 3 cos(pi / 16) = 2.942356 outside.
gear.stl
    24 involute teeth of module 2, 8 wide, around the z axis; hub, bore of radius 5 with 64 sides and a
    keyway, six holes. (0, 0, 4) is 5 cos(pi / 64) = 4.993977 outside.
assembly.glb
    ``base``, ``lid``, ``pin_left`` and ``pin_right``, which touch along whole faces; each in its own frame,
    the lid turned upside down, the pins in a group ``pins``. Together they fill [0, 60] × [0, 40] × [0, 16]
    but for the pocket [16, 44] × [10, 30] × [3, 12]: (30, 20, 7.5) is 4.5 outside.
assembly.step
    Four parts of the same names, as prisms: see `step_file`.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import step_file
import trimesh
from manifold3d import CrossSection, Manifold

FOLDER = Path(__file__).resolve().parent
METRES_PER_MM = 1e-3
ROUND = 96  # sides of a circle, unless a smaller file matters more

Mesh = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, slots=True, eq=False)
class PlacedPart:
    """One part of an assembly: its mesh in its own frame, and where it stands."""

    name: str
    mesh: Mesh
    world_from_part: np.ndarray  # (4, 4), m


# ----------------------------------------------------------------------------------------- shapes by formula


def box(lower=(0.0, 0.0, 0.0), upper=(0.040, 0.030, 0.020)) -> Mesh:
    """An axis-aligned box of 12 faces; corners in metres."""
    bits = np.array([[k & 1, k >> 1 & 1, k >> 2] for k in range(8)])
    sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    faces = [[a, *rest] for a, b, c, d in sides for rest in ((b, c), (c, d))]
    return np.where(bits, upper, lower), np.array(faces)


def sphere(radius=0.020, subdivisions=3) -> Mesh:
    """An icosahedron whose faces are cut in four *subdivisions* times, all corners at *radius* (m)."""
    golden = (1 + 5**0.5) / 2
    short = [[s, t * golden] for s in (-1, 1) for t in (-1, 1)]
    vertices = np.array([np.roll([0, *pair], turn) for turn in range(3) for pair in short])
    faces = _hull_faces(vertices)
    for _ in range(subdivisions):
        vertices, faces = _cut_in_four(vertices, faces)
    return radius * vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def torus(ring_radius=0.030, tube_radius=0.010, ring_count=48, tube_count=24) -> Mesh:
    """A torus around the z axis, all corners on it; 2 · ring_count · tube_count faces."""
    i, j = np.meshgrid(np.arange(ring_count), np.arange(tube_count), indexing="ij")
    ring, tube = 2 * np.pi * i / ring_count, 2 * np.pi * j / tube_count
    reach = ring_radius + tube_radius * np.cos(tube)
    vertices = np.stack([reach * np.cos(ring), reach * np.sin(ring), tube_radius * np.sin(tube)], axis=-1)
    here, next_ring = i * tube_count, (i + 1) % ring_count * tube_count
    up = (j + 1) % tube_count
    quads = [here + j, next_ring + j, next_ring + up, here + up]
    return vertices.reshape(-1, 3), _triangles_of_quads(np.stack(quads, axis=-1).reshape(-1, 4))


def hollow_box() -> Mesh:
    """A box with a box-shaped cavity: one solid, two shells."""
    outer, outer_faces = box(upper=(0.060, 0.040, 0.030))
    inner, inner_faces = box(lower=(0.010, 0.010, 0.005), upper=(0.040, 0.025, 0.020))
    return np.concatenate([outer, inner]), np.concatenate([outer_faces, inner_faces[:, ::-1] + len(outer)])


# ------------------------------------------------------------------------------------ shapes by manifold3d


def bracket() -> Mesh:
    """An angle bracket: foot, upright, fillet between them, two ribs, a bored boss, a slot, screw holes."""
    foot = _prism([_rounded(60, 40, radius=6)], 4)
    upright = _prism([_rounded(50, 40, radius=6)], 4).rotate([0, -90, 0]).translate([4, 0, 0])
    square_ends = [_block([0, 0, 0], [12, 40, 4]), _block([0, 0, 0], [4, 40, 12])]
    outline = np.array([[4, 4], *(np.array([9, 9]) + 5 * _arc(270, 180, 33))])
    fillet = _upright_prism(outline, 0, 40)
    ribs = [_upright_prism(np.array([[2, 2], [30, 2], [30, 4], [4, 40], [2, 40]]), y, y + 3) for y in (3, 34)]
    boss = Manifold.revolve(CrossSection([_boss_profile()]), ROUND)
    solid = sum([upright, *square_ends, fillet, *ribs, _on_upright(boss, 20, 28)], foot)

    holes = [_countersunk().translate([x, y, 0]) for x in (36, 52) for y in (16, 30)]
    holes += [_on_upright(_cylinder(1.5, -5, 5), y, z) for y in (11, 29) for z in (44, 15)]
    holes += [_on_upright(_cylinder(6, -5, 20), 20, 28)]
    slot = Manifold.hull(
        _cylinder(2, -1, 5).translate([16, 20, 0]) + _cylinder(2, -1, 5).translate([26, 20, 0])
    )
    return _mesh_of(sum([*holes[1:], slot], holes[0]), cut_from=solid)


def plate(hole_count=60, segments=16) -> Mesh:
    """A square plate with a grid of holes; about 4 · segments faces a hole: plate(784, 96) has 304,204."""
    places = int(np.ceil(np.sqrt(hole_count)))
    columns, rows = np.arange(hole_count) % places, np.arange(hole_count) // places
    centers = 10.0 * np.stack([columns, rows], axis=1) + 5.0
    outline = 10.0 * places * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    holes = centers[:, None] + 3 * _circle(segments)[None, ::-1]
    return _mesh_of(_prism([outline, *holes], 5))


def gear() -> Mesh:
    """A spur gear with hub, keyed bore and lightening holes."""
    wheel = _prism([_gear_outline(tooth_count=24, module=2.0)], 8)
    solid = wheel + _cylinder(9, 0, 14)
    holes = [_cylinder(4, -1, 9, 48).translate([*(14 * way), 0]) for way in _circle(6)]
    cut = sum([_block([0, -1.5, -1], [6.5, 1.5, 15]), *holes], _cylinder(5, -1, 15, 64))
    return _mesh_of(cut, cut_from=solid)


def assembly() -> list[PlacedPart]:
    """A base with a pocket, a lid, two dowel pins that fill their holes: faces coincide, nothing overlaps."""
    outline = [_rounded(60, 40, radius=0)]
    pocket = _block([16, 10, 3], [44, 30, 13])
    base_holes = [_cylinder(3, 4, 13, 48).translate([x, 20, 0]) for x in (8, 52)]
    lid_holes = [_cylinder(3, -1, 5, 48).translate([x, 20, 0]) for x in (8, 52)]
    base = _mesh_of(sum(base_holes, pocket), cut_from=_prism(outline, 12))
    lid = _mesh_of(lid_holes[0] + lid_holes[1], cut_from=_prism(outline, 4))
    pin = _mesh_of(_cylinder(3, 0, 12, 48))
    return [
        PlacedPart("base", base, _pose()),
        PlacedPart("lid", lid, _pose([0, 40, 16], upside_down=True)),
        PlacedPart("pin_left", pin, _pose([8, 20, 4])),
        PlacedPart("pin_right", pin, _pose([52, 20, 4])),
    ]


# ------------------------------------------------------------------------------------------- pieces, in mm


def _circle(count):
    return _arc(0, 360 * (count - 1) / count, count)


def _arc(start, end, count):
    """Points of the unit circle from one angle to another, degrees."""
    angles = np.radians(np.linspace(start, end, count))
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def _prism(outlines, height):
    return Manifold.extrude(CrossSection(outlines), height)


def _upright_prism(outline, y_start, y_end):
    """A prism along y over an outline in x and z."""
    along_z = _prism([outline[::-1] * [1, -1]], y_end - y_start)
    return along_z.rotate([-90, 0, 0]).translate([0, y_start, 0])


def _block(lower, upper):
    return Manifold.cube(np.subtract(upper, lower)).translate(lower)


def _cylinder(radius, start, end, sides=ROUND):
    return Manifold.cylinder(end - start, radius, circular_segments=sides).translate([0, 0, start])


def _rounded(length, width, *, radius):
    """A rectangle from the origin, its corners rounded."""
    centers = [
        (length - radius, width - radius),
        (radius, width - radius),
        (radius, radius),
        (length - radius, radius),
    ]
    count = 25 if radius else 1
    return np.concatenate([c + radius * _arc(90 * k, 90 * k + 90, count) for k, c in enumerate(centers)])


def _countersunk():
    """The space of a countersunk screw through the foot."""
    return _cylinder(2, -1, 5) + Manifold.cylinder(3, 2, 5, ROUND).translate([0, 0, 2])


def _boss_profile():
    """Half a section of the boss: radius and height above the upright; fillet below, rounding above."""
    fillet = np.array([12, 3]) + 3 * _arc(270, 180, 13)
    rounding = np.array([7.5, 8.5]) + 1.5 * _arc(0, 90, 13)
    return np.concatenate([[[0, -2], [12, -2]], fillet, rounding, [[0, 10]]])


def _on_upright(piece, y, z):
    """Turn a piece along z so that it stands on the inner side of the upright."""
    return piece.rotate([0, 90, 0]).translate([4, y, z])


def _gear_outline(*, tooth_count, module, points=9):
    """Involute teeth of 20 degrees pressure angle; flanks go straight inwards below the base circle."""
    pitch = 0.5 * module * tooth_count
    base, tip, foot = pitch * np.cos(np.radians(20)), pitch + module, pitch - 1.25 * module
    rolls = np.linspace(0, np.sqrt((tip / base) ** 2 - 1), points)
    radii = np.concatenate([[foot], base * np.sqrt(1 + rolls**2)])
    lag = np.concatenate([[0], rolls - np.arctan(rolls)])  # how far the flank has turned away at that radius
    at_pitch = np.tan(np.radians(20)) - np.radians(20)
    half_widths = np.pi / (2 * tooth_count) + at_pitch - lag
    angles = np.concatenate([-half_widths, half_widths[::-1]])
    radii = np.concatenate([radii, radii[::-1]])
    turned = (angles + 2 * np.pi * np.arange(tooth_count)[:, None] / tooth_count).ravel()
    return np.tile(radii, tooth_count)[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1)


def _mesh_of(solid, *, cut_from=None) -> Mesh:
    """The triangles of a solid (or of what is left of another), in metres."""
    solid = solid if cut_from is None else cut_from - solid
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties[:, :3]) * METRES_PER_MM, np.array(mesh.tri_verts, dtype=np.int64)


def _pose(translation=(0, 0, 0), *, upside_down=False):
    pose = np.diag([1.0, -1.0, -1.0, 1.0]) if upside_down else np.eye(4)
    pose[:3, 3] = np.multiply(translation, METRES_PER_MM)
    return pose


def _hull_faces(vertices):
    """Faces of the icosahedron: all triples at edge length, turned outwards."""
    apart = np.linalg.norm(vertices[:, None] - vertices[None], axis=-1)
    near = np.isclose(apart, 2.0)
    count = range(len(vertices))
    triples = [
        (a, b, c)
        for a in count
        for b in count
        for c in count
        if a < b < c and near[a, b] & near[b, c] & near[a, c]
    ]
    return np.array([t if np.linalg.det(vertices[list(t)]) > 0 else (t[0], t[2], t[1]) for t in triples])


def _cut_in_four(vertices, faces):
    vertices = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    edges = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=-1).reshape(-1, 2)
    pairs, middle = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = (middle.reshape(-1, 3) + len(vertices)).T
    a, b, c = faces.T
    quarters = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return (
        np.concatenate([vertices, 0.5 * (vertices[pairs[:, 0]] + vertices[pairs[:, 1]])]),
        np.moveaxis(np.array(quarters), 2, 0).reshape(-1, 3),
    )


def _triangles_of_quads(quads):
    return quads[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


# -------------------------------------------------------------------------------------------------- files


def stl_bytes(mesh: Mesh) -> bytes:
    """Binary STL in millimetres, single precision as the format has it."""
    vertices, faces = mesh
    return trimesh.Trimesh(vertices / METRES_PER_MM, faces, process=False).export(file_type="stl")


def ply_bytes(mesh: Mesh) -> bytes:
    """ASCII PLY in millimetres, with every digit of double precision."""
    vertices, faces = mesh
    head = ["ply", "format ascii 1.0", "comment millimetres", f"element vertex {len(vertices)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    head += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(repr, row)) for row in (vertices / METRES_PER_MM).tolist()]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces.tolist()]
    return "\n".join([*head, *rows, ""]).encode("ascii")


def glb_bytes(parts: list[PlacedPart]) -> bytes:
    """Binary glTF in metres: parts under the root, those whose names begin with ``pin`` in a group."""
    scene = trimesh.Scene()
    group = _pose([0, 0, 4])
    scene.graph.update("pins", matrix=group)
    for part in parts:
        in_group = part.name.startswith("pin")
        scene.add_geometry(
            trimesh.Trimesh(*part.mesh, process=False),
            node_name=part.name,
            geom_name="pin" if in_group else part.name,
            parent_node_name="pins" if in_group else None,
            transform=np.linalg.inv(group) @ part.world_from_part if in_group else part.world_from_part,
        )
    return scene.export(file_type="glb")


def small_files() -> dict[str, bytes]:
    """Names and contents of the files kept beside this script."""
    return {
        "box.stl": stl_bytes(box()),
        "sphere.stl": stl_bytes(sphere()),
        "torus.ply": ply_bytes(torus()),
        "hollow_box.stl": stl_bytes(hollow_box()),
        "bracket.stl": stl_bytes(bracket()),
        "plate.stl": stl_bytes(plate()),
        "gear.stl": stl_bytes(gear()),
        "assembly.glb": glb_bytes(assembly()),
        "assembly.step": step_file.assembly_bytes(),
    }


def large_files() -> dict[str, bytes]:
    """Names and contents of the files for benchmarks: 304,204 and 1,310,720 faces."""
    return {
        "plate_300k.stl": stl_bytes(plate(hole_count=784, segments=96)),
        "sphere_1300k.stl": stl_bytes(sphere(subdivisions=8)),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description="Make the sample parts beside this script.")
    parser.add_argument("--large", metavar="FOLDER", type=Path, help="make the large ones instead, in FOLDER")
    folder = parser.parse_args().large
    files = small_files() if folder is None else large_files()
    folder = folder or FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
        print(f"{len(content):>10,} bytes  {name}")


if __name__ == "__main__":
    main()
