"""Motions for timing ticks, in metres with one row per tick. Their seeds are fixed."""

import numpy as np

from proximity.scene.scene import Scene

FINGERS_PER_HAND = 5  # fingers
SPREAD = 0.05  # m, of the fingers of a hand
PAUSE_TICKS = 10  # between two rounds of a motion
PASSING_SPEED, PASSING_DISTANCE = 0.2, 0.005
"""Maximum speed, m/s, and distance to either side, m, of fingers that pass through a position."""


def wandering_hands(
    scene: Scene, ticks: int, count: int = 2, *, seed: int = 5, rate: float = 1000.0
) -> np.ndarray:
    """Return positions of hands of five fingers that wander through a scene, (T, 5 count, 3).

    Their speed is about 0.3 m/s.
    """
    lower, upper = scene.bounds
    rng = np.random.default_rng(seed)
    t = np.arange(ticks)[:, None] / rate
    found = []
    for _ in range(count):
        beats, phases = rng.uniform(0.5, 0.9, 3), rng.uniform(0.0, 6.0, 3)
        middle = 0.5 * (lower + upper) + 0.5 * (upper - lower) * np.sin(beats * t + phases)
        for _ in range(FINGERS_PER_HAND):
            aside = rng.uniform(-SPREAD, SPREAD, 3)
            found.append(middle + aside + 0.01 * np.sin(rng.uniform(2.0, 9.0, 3) * t + aside))
    return np.ascontiguousarray(np.stack(found, axis=1))


def resting(positions: np.ndarray, fingers: int, ticks: int) -> np.ndarray:
    """Return positions of resting fingers, (T, N, 3).

    *positions*: (K, 3), m, which are assigned to the fingers in turn.
    """
    own = positions[np.arange(fingers) % len(positions)]
    return np.ascontiguousarray(np.broadcast_to(own, (ticks, fingers, 3)))


def passing(
    positions: np.ndarray, fingers: int, ticks: int, rng: np.random.Generator, *, rate: float = 1000.0
) -> np.ndarray:
    """Return positions of fingers that move back and forth through given positions, (T, N, 3).

    Each finger has its own direction.
    """
    directions = rng.normal(size=(fingers, 3))
    directions *= PASSING_DISTANCE / np.linalg.norm(directions, axis=1, keepdims=True)
    beat, phases = PASSING_SPEED / PASSING_DISTANCE, rng.uniform(0.0, 2.0 * np.pi, fingers)
    swing = np.sin(beat * np.arange(ticks)[:, None] / rate + phases)
    return np.ascontiguousarray(resting(positions, fingers, ticks) + swing[:, :, None] * directions)


def repeated(positions: np.ndarray, ticks: int) -> np.ndarray:
    """Return a repeated motion, with a pause without fingers between two rounds.

    *positions*: (T, N, 3), m. *ticks*: number of ticks without the pauses.
    """
    nobody = np.full((PAUSE_TICKS, *positions.shape[1:]), np.nan)
    one = np.concatenate([positions, nobody])
    rounds = -(-ticks // len(positions))
    return np.ascontiguousarray(np.concatenate([one] * rounds)[: ticks + (rounds - 1) * PAUSE_TICKS])
