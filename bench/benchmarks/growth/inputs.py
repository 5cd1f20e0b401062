"""Inputs of the measurements of growth: parts of any number of faces, points, rays and hands; metres."""

from dataclasses import replace

import numpy as np

from benchmarks.queries import cases
from benchmarks.queries.cases import FINGERS, NEAR_SPREAD, Mesh
from benchmarks.support.project import project_module
from benchmarks.ticks import motions, scenes
from proximity import Scene

RING = (16.0, 7.0)  # quads around the ring to those around the tube, of a ring of even triangles
KIND = (25, 25)  # of a part among many: 1,250 faces
KIND_SUBDIVISIONS = 3
BALL_RADIUS = 0.1
REACH = 0.1  # m, from the middle of a scene to a hand


def ring(face_count: int) -> Mesh:
    """Return the bumpy ring of the ticks, 150 mm, of about *face_count* even triangles."""
    around = max(3, round((0.5 * face_count * RING[0] / RING[1]) ** 0.5))
    return scenes.freeform((around, max(3, round(0.5 * face_count / around))))


def ball(subdivisions: int) -> Mesh:
    """Return a ball whose corners are all equally far from its centre, the origin; 20 · 4^n faces."""
    return project_module("tests/support", "shapes").sphere(BALL_RADIUS, subdivisions)


def hollow_ball(subdivisions: int) -> Mesh:
    """Return a ball with a spherical hollow: its centre is outside."""
    return scenes.cavity(replace(scenes.FULL, cavity_subdivisions=subdivisions), BALL_RADIUS)


def lattice(part_count: int) -> Scene:
    """Return parts of 1,250 faces on a lattice of 80 mm in two layers."""
    return scenes.many_parts(
        replace(scenes.FULL, part_count=part_count, kind=KIND, kind_subdivisions=KIND_SUBDIVISIONS)
    )


def diagonal(mesh: Mesh) -> float:
    """Return the diagonal of the box around a mesh, m."""
    return cases.diagonal(mesh[0])


def on_surface(mesh: Mesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points on faces drawn by area, and their normals, (count, 3) each."""
    points, normals = cases.on_surface(*mesh, count, np.random.default_rng(seed))
    return points, normals / np.linalg.norm(normals, axis=1)[:, None]


def fives(rows: np.ndarray) -> np.ndarray:
    """Return (5 K, 3) rows as (K, 5, 3): the fingers of hands."""
    return np.ascontiguousarray(rows[: len(rows) // FINGERS * FINGERS].reshape(-1, FINGERS, 3))


def near(mesh: Mesh, count: int, seed: int = 1) -> np.ndarray:
    """Return points near a surface, N(0, 2 % of the diagonal) off it, in groups of five."""
    points, normals = on_surface(mesh, FINGERS * count, seed)
    heights = np.random.default_rng(seed + 1).normal(0.0, NEAR_SPREAD * diagonal(mesh), len(points))
    return fives(points + heights[:, None] * normals)


def rays(mesh: Mesh, count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return rays from a sphere around a part toward points on its surface, in groups of five."""
    targets, _ = on_surface(mesh, FINGERS * count, seed)
    outward = np.random.default_rng(seed + 1).normal(size=targets.shape)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    origins = mesh[0].mean(axis=0) + diagonal(mesh) * outward
    directions = targets - origins
    return fives(origins), fives(directions / np.linalg.norm(directions, axis=1)[:, None])


def recorded_hand(mesh: Mesh) -> np.ndarray:
    """Return the generated hand of the samples at a part, (T, 5, 3), a row a millisecond."""
    return motions.ticks_of(next(motions.hands()), scenes.scene_of(mesh))


def wandering_hand(scene: Scene, ticks: int) -> np.ndarray:
    """Return a hand that wanders about the middle of a scene at about 0.3 m/s, (T, 5, 3)."""
    rng, t = np.random.default_rng(6), np.arange(ticks)[:, None] / motions.RATE
    beats, phases = rng.uniform(2.0, 4.0, 3), rng.uniform(0.0, 6.0, 3)
    middle = 0.5 * np.sum(scene.bounds, axis=0) + REACH * np.sin(beats * t + phases)
    aside = rng.uniform(-0.05, 0.05, (FINGERS, 3))
    return np.ascontiguousarray(middle[:, None] + aside)
