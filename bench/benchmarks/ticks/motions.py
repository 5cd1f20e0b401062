"""Motions for ticks: recorded hands, moving parts, fingers and skins on paths by formula.

Metres and seconds, one row a millisecond; seeds are fixed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.support.project import MESHES, SHARED_HANDS
from benchmarks.ticks.scenes import RADIUS
from proximity.lab.certificate.motions import wandering_hands
from proximity.recording import Recording, read_recording
from proximity.scene.scene import Scene
from proximity.tracker.placement import fitted_pose

__all__ = [
    "Hand",
    "PartMotion",
    "cavity_motion",
    "hands",
    "missing_hands",
    "moving_parts",
    "skin",
    "skin_motion",
    "ticks_of",
    "wandering_hands",
]

RATE = 1000.0  # ticks a second
HAND_NAMES = ("grab", "hand-splay", "two-hands", "waiting", "wave")
GENERATED_HAND = MESHES / "hand.csv"


@dataclass(frozen=True, slots=True, eq=False)
class Hand:
    """One hand of a recording."""

    name: str
    recording: Recording


@dataclass(frozen=True, slots=True, eq=False)
class PartMotion:
    """Poses of some parts at each tick: each swings about its position by 10 mm and turns."""

    names: list[str]
    poses: np.ndarray  # (T, K, 4, 4)
    velocities: np.ndarray  # (T, K, 3)
    angular_velocities: np.ndarray  # (T, K, 3)


def moving_parts(scene: Scene, count: int, ticks: int) -> PartMotion:
    """Return poses of about every tenth part, over *ticks*."""
    parts = scene.parts[:: len(scene.parts) // count][:count]
    rng = np.random.default_rng(12)
    t = np.arange(ticks) / RATE
    poses = np.zeros((ticks, count, 4, 4))
    poses[:, :, 3, 3] = 1.0
    velocities, angular = np.zeros((2, ticks, count, 3))
    for k, part in enumerate(parts):
        swing = rng.normal(size=3)
        swing *= 0.01 / np.linalg.norm(swing)
        beat, spin, phase = rng.uniform(3.0, 12.0), rng.uniform(-2.0, 2.0), rng.uniform(0.0, 6.0)
        c, s = np.cos(spin * t), np.sin(spin * t)
        about_z = np.zeros((ticks, 3, 3))
        about_z[:, 0, 0], about_z[:, 0, 1], about_z[:, 1, 0], about_z[:, 1, 1] = c, -s, s, c
        about_z[:, 2, 2] = 1.0
        poses[:, k, :3, :3] = about_z @ part.pose.rotation
        poses[:, k, :3, 3] = part.pose.translation + np.sin(beat * t + phase)[:, None] * swing
        velocities[:, k] = (beat * np.cos(beat * t + phase))[:, None] * swing
        angular[:, k, 2] = spin
    return PartMotion([part.name for part in parts], poses, velocities, angular)


def hands() -> Iterator[Hand]:
    """Yield the generated hand, then the available recorded ones; see `missing_hands`."""
    yield Hand("generated", read_recording(GENERATED_HAND))
    for name in HAND_NAMES:
        path = SHARED_HANDS / f"{name}.csv"
        if path.is_file():
            yield from _single_hands(name, read_recording(path))


def missing_hands() -> list[str]:
    """Return the names of the recordings that are not on this machine."""
    return [f"{name}.csv" for name in HAND_NAMES if not (SHARED_HANDS / f"{name}.csv").is_file()]


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
    """Return the positions of a hand's fingers, placed so that it touches the scene, (T, 5, 3)."""
    pose = fitted_pose(scene, hand.recording, RADIUS)
    return hand.recording.placed(pose).resampled(1.0 / RATE).positions.copy()


def skin(count: int) -> np.ndarray:
    """Return points on a hand's skin, palm down, fingers along x: capsules and a palm, (count, 3) m."""
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
    """Return a skin that circles over a scene at 0.2 m/s, with a touch; one circle, (T, count, 3)."""
    points = skin(count)
    turn = 2.5 / RATE * np.arange(round(2.0 * np.pi / 2.5 * RATE))  # 0.2 m/s at 80 mm from the axis
    lower, upper = scene.bounds
    rng = np.random.default_rng(9)
    phases = rng.uniform(0.0, 6.0, (count, 3))
    middle = 0.5 * (lower + upper)
    middle[2] = upper[2]
    positions = np.empty((len(turn), count, 3))
    for k, angle in enumerate(turn):
        nod = 0.1 * np.sin(2.0 * angle)
        c, s = np.cos(nod), np.sin(nod)
        turned = points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
        offset = [0.08 * np.cos(angle), 0.08 * np.sin(angle), 0.005 * np.sin(angle)]
        positions[k] = middle + turned + offset + 0.0002 * np.sin(9.0 * angle + phases)
    # Down until its lowest point is pressed in by a millimetre.
    for _ in range(60):
        sampled = positions[:: len(turn) // 16].reshape(-1, 3)
        lowest = float(scene.signed_distance(sampled).min()) + 0.001
        positions[..., 2] -= 0.7 * lowest
        if abs(lowest) < 1e-4:
            break
    return positions


def cavity_motion(radii: np.ndarray, ticks: int, speed: float) -> np.ndarray:
    """Return fingers that circle about the origin at given radii (m) and speed (m/s), (T, N, 3)."""
    rng = np.random.default_rng(3)
    t = np.arange(ticks)[:, None] / RATE
    found = []
    for radius in radii:
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        angle = speed / radius * t if radius > 0.0 else np.zeros_like(t)
        found.append(radius * (np.cos(angle) * frame[0] + np.sin(angle) * frame[1]))
    return np.ascontiguousarray(np.stack(found, axis=1))
