"""Scenes and motions for the ticks: parts by formula, recorded hands, fingers and skins that go their way.

Everything is in metres and seconds, one row of a motion a millisecond; seeds are fixed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from cases import PROJECT, SHARED_PARTS, Mesh, project_module
from proximity import Pose, Scene, Solid
from proximity.recording import Recording, read_recording
from proximity.replay import fitted_pose
from proximity.scene import Part

RATE = 1000.0  # ticks a second
PERIOD_NS = 1_000_000
RADIUS = 0.007  # m, of a fingertip
HAND_FOLDER = SHARED_PARTS.parent / "hands"
HAND_NAMES = ("grab", "hand-splay", "two-hands", "waiting", "wave")
GENERATED_HAND = PROJECT / "meshes" / "hand.csv"


@dataclass(frozen=True, slots=True)
class Sizes:
    """How large the scenes are."""

    plate: tuple[int, int]  # holes, sides of a hole
    freeform: tuple[int, int]  # quads around the ring and around the tube
    part_count: int
    moving_count: int
    kind: tuple[int, int]  # of a part among many: quads of a ring; the spheres have about as many faces
    kind_subdivisions: int
    skin_count: int
    skin_ground: tuple[int, int]
    cavity_subdivisions: int
    large_plate: tuple[int, int]


FULL = Sizes((225, 96), (320, 140), 200, 20, (50, 50), 4, 2000, (1000, 500), 8, (784, 96))
SMALL = Sizes((4, 16), (24, 12), 20, 2, (8, 6), 1, 60, (40, 20), 3, (9, 16))
"""For the smoke test: everything runs, no figure means anything."""


class MissingRecordingError(Exception):
    """A recording is not on this machine."""


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """One hand of a recording."""

    name: str
    recording: Recording


# ------------------------------------------------------------------------------------------------- meshes


def plate(sizes: Sizes) -> Mesh:
    """A plate with holes, 0.15 m long: needles around flat holes, as CAD programs make them."""
    return project_module("meshes", "make").plate(*sizes.plate)


def large_plate(sizes: Sizes) -> Mesh:
    """The same with more holes."""
    return project_module("meshes", "make").plate(*sizes.large_plate)


def freeform(counts: tuple[int, int], size: float = 0.15) -> Mesh:
    """A ring with bumps and hollows, *size* long: even triangles, curved everywhere."""
    ring = project_module("meshes", "make").torus(1.0, 0.4, *counts)
    vertices, faces = ring
    turn = np.arctan2(vertices[:, 1], vertices[:, 0])
    spine = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=1)
    out = (vertices - spine) / 0.4
    around = np.arctan2(out[:, 2], (out * spine).sum(axis=1))
    bumps = 1.0 + 0.2 * np.sin(3 * turn + 2 * around) + 0.1 * np.sin(8 * turn) * np.cos(3 * around)
    vertices = spine * (1.0 + 0.08 * np.cos(2 * turn))[:, None] + 0.4 * bumps[:, None] * out
    return vertices * (size / np.ptp(vertices[:, 0])), faces


def cavity(sizes: Sizes, radius: float = 0.1) -> Mesh:
    """A ball with a spherical hollow of that radius, whose corners are all equally far from the centre."""
    shapes = project_module("tests", "shapes")
    hollow = shapes.inside_out(shapes.sphere(radius, sizes.cavity_subdivisions))
    return shapes.join(shapes.sphere(1.2 * radius, 3), hollow)


# ------------------------------------------------------------------------------------------------- scenes


def scene_of(mesh: Mesh, name: str = "part") -> Scene:
    """One part; the mesh is a body as it is."""
    return Scene([Solid(*mesh, name=name)])


def many_parts(sizes: Sizes) -> Scene:
    """Parts of three kinds, 50 mm long, turned anyhow, on a lattice of 80 mm in two layers."""
    make = project_module("meshes", "make")
    turned = project_module("tests", "shapes").rotation
    solids = [
        Solid(*make.torus(0.018, 0.007, *sizes.kind), name="ring"),
        Solid(*freeform(sizes.kind, 0.05), name="bumps"),
        Solid(*make.sphere(0.020, sizes.kind_subdivisions), name="ball"),
    ]
    columns = int(np.ceil(np.sqrt(sizes.part_count / 2)))
    parts = []
    for row in range(sizes.part_count):
        place = 0.08 * np.array([row // 2 % columns, row // 2 // columns, row % 2], dtype=np.float64)
        solid = solids[row % len(solids)]
        rows = np.arange(solid.mesh.face_count, dtype=np.int32)
        parts.append(Part(f"part {row}", solid, Pose(turned(row), place), rows))
    return Scene(parts)


@dataclass(frozen=True, slots=True, eq=False)
class PartMotion:
    """Where some parts are at each tick: each swings about its place by 10 mm and turns."""

    names: list[str]
    poses: np.ndarray  # (T, K, 4, 4)
    velocities: np.ndarray  # (T, K, 3)
    angular_velocities: np.ndarray  # (T, K, 3)


def moving_parts(scene: Scene, count: int, ticks: int) -> PartMotion:
    """Every tenth part or so, over *ticks*."""
    parts = scene.parts[:: len(scene.parts) // count][:count]
    rng = np.random.default_rng(12)
    t = np.arange(ticks) / RATE
    poses = np.zeros((ticks, count, 4, 4))
    poses[:, :, 3, 3] = 1.0
    velocities, angular = np.zeros((2, ticks, count, 3))
    for k, part in enumerate(parts):
        way = rng.normal(size=3)
        way *= 0.01 / np.linalg.norm(way)
        beat, spin, phase = rng.uniform(3.0, 12.0), rng.uniform(-2.0, 2.0), rng.uniform(0.0, 6.0)
        c, s = np.cos(spin * t), np.sin(spin * t)
        about_z = np.zeros((ticks, 3, 3))
        about_z[:, 0, 0], about_z[:, 0, 1], about_z[:, 1, 0], about_z[:, 1, 1] = c, -s, s, c
        about_z[:, 2, 2] = 1.0
        poses[:, k, :3, :3] = about_z @ part.pose.rotation
        poses[:, k, :3, 3] = part.pose.translation + np.sin(beat * t + phase)[:, None] * way
        velocities[:, k] = (beat * np.cos(beat * t + phase))[:, None] * way
        angular[:, k, 2] = spin
    return PartMotion([part.name for part in parts], poses, velocities, angular)


# ------------------------------------------------------------------------------------------------- motions


def hands() -> Iterator[Hand]:
    """The hand that is always here, then those recorded; `missing_hands` says which are not here."""
    yield Hand("generated", read_recording(GENERATED_HAND))
    for name in HAND_NAMES:
        path = HAND_FOLDER / f"{name}.csv"
        if path.is_file():
            yield from _single_hands(name, read_recording(path))


def missing_hands() -> list[str]:
    """Names of the recordings that are not on this machine."""
    return [f"{name}.csv" for name in HAND_NAMES if not (HAND_FOLDER / f"{name}.csv").is_file()]


def _single_hands(name: str, recording: Recording) -> Iterator[Hand]:
    numbers = sorted({hand for hand, _ in recording.fingers})
    for hand in numbers:
        columns = [k for k, (own, _) in enumerate(recording.fingers) if own == hand]
        if len(columns) == 5:
            one = replace(
                recording,
                positions=recording.positions[:, columns].copy(),
                fingers=tuple(recording.fingers[k] for k in columns),
            )
            yield Hand(name if len(numbers) == 1 else f"{name} {hand}", one)


def ticks_of(hand: Hand, scene: Scene) -> np.ndarray:
    """The positions of a hand's fingers, placed in the scene as `proximity replay` does, (T, 5, 3)."""
    pose = fitted_pose(scene, hand.recording, RADIUS)
    return hand.recording.placed(pose).resampled(1.0 / RATE).positions.copy()


def wandering_hands(scene: Scene, ticks: int, count: int = 2) -> np.ndarray:
    """Hands of five fingers that wander through a scene at some 0.3 m/s, (T, 5 count, 3)."""
    lower, upper = scene.bounds
    rng = np.random.default_rng(5)
    t = np.arange(ticks)[:, None] / RATE
    found = []
    for _ in range(count):
        beats, phases = rng.uniform(0.5, 0.9, 3), rng.uniform(0.0, 6.0, 3)
        middle = 0.5 * (lower + upper) + 0.5 * (upper - lower) * np.sin(beats * t + phases)
        for _ in range(5):
            aside = rng.uniform(-0.05, 0.05, 3)
            found.append(middle + aside + 0.01 * np.sin(rng.uniform(2.0, 9.0, 3) * t + aside))
    return np.ascontiguousarray(np.stack(found, axis=1))


def skin(count: int) -> np.ndarray:
    """Points all over a hand, palm down, fingers along x: capsules and a flat palm, (count, 3) m."""
    rng = np.random.default_rng(8)
    lengths = np.array([0.055, 0.072, 0.080, 0.074, 0.060])
    aside = np.array([-0.055, -0.026, -0.002, 0.022, 0.044])
    forward = np.array([-0.02, 0.045, 0.045, 0.045, 0.045])
    share = lengths / (lengths.sum() + 0.2)
    counts = np.floor(share * count).astype(int)
    points = []
    for length, y, x, own in zip(lengths, aside, forward, counts, strict=True):
        along, angle = rng.uniform(0.0, 1.0, own), rng.uniform(0.0, 2.0 * np.pi, own)
        tip = 0.008 * np.sqrt(np.clip(1.0 - ((along - 0.9) / 0.1).clip(0.0) ** 2, 0.0, 1.0))
        points.append(np.stack([x + length * along, y + tip * np.cos(angle), tip * np.sin(angle)], axis=1))
    palm = rng.normal(size=(count - counts.sum(), 3))
    palm *= [0.05, 0.045, 0.013] / np.linalg.norm(palm, axis=1, keepdims=True)
    return np.concatenate([*points, palm])


def skin_motion(scene: Scene, count: int) -> np.ndarray:
    """A skin that goes round over a scene at 0.2 m/s, touches and leaves it; one round, (T, count, 3)."""
    points = skin(count)
    turn = 2.5 / RATE * np.arange(round(2.0 * np.pi / 2.5 * RATE))  # 0.2 m/s at 80 mm from the axis
    lower, upper = scene.bounds
    rng = np.random.default_rng(9)
    phases = rng.uniform(0.0, 6.0, (count, 3))
    middle = 0.5 * (lower + upper)
    middle[2] = upper[2]
    places = np.empty((len(turn), count, 3))
    for k, angle in enumerate(turn):
        nod = 0.2 * np.sin(2.0 * angle)
        c, s = np.cos(nod), np.sin(nod)
        turned = points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        way = [0.08 * np.cos(angle), 0.08 * np.sin(angle), 0.02 * np.sin(angle)]
        places[k] = middle + turned + way + 0.0002 * np.sin(9.0 * angle + phases)
    # Down until it is pressed in by a millimetre where it is lowest.
    for _ in range(60):
        sampled = places[:: len(turn) // 16].reshape(-1, 3)
        left = float(scene.signed_distance(sampled).min()) + 0.001
        places[..., 2] -= 0.7 * left
        if abs(left) < 1e-4:
            break
    return places


def cavity_motion(radii: np.ndarray, ticks: int, speed: float) -> np.ndarray:
    """Fingers that circle about the origin at those radii (m) and that speed (m/s), (T, N, 3)."""
    rng = np.random.default_rng(3)
    t = np.arange(ticks)[:, None] / RATE
    found = []
    for radius in radii:
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        angle = speed / radius * t if radius > 0.0 else np.zeros_like(t)
        found.append(radius * (np.cos(angle) * frame[0] + np.sin(angle) * frame[1]))
    return np.ascontiguousarray(np.stack(found, axis=1))
