"""Fingerprint of a scene: a hash of everything that a tick's answer and cost depend on.

Corners, faces, places and surfaces of the parts count. Names, files, and the order in which parts were loaded
do not.
"""

import hashlib

import numpy as np

from proximity.scene.part import Part
from proximity.scene.scene import Scene


def fingerprint(scene: Scene) -> str:
    """Return the SHA-256 of a scene's content, 64 hexadecimal digits."""
    parts = sorted(_part_digest(part) for part in scene.parts)
    return hashlib.sha256(b"".join(parts)).hexdigest()


def _part_digest(part: Part) -> bytes:
    mesh = part.solid.mesh
    surface = [-1.0 if part.stiffness is None else part.stiffness, part.damping, float(part.is_hidden)]
    digest = hashlib.sha256()
    for array, kind in (
        (mesh.vertices, "<f8"),
        (mesh.faces, "<i4"),
        (part.pose.rotation, "<f8"),
        (part.pose.translation, "<f8"),
        (surface, "<f8"),
    ):
        # A zero has one sign here; lengths keep the arrays apart.
        plain = np.ascontiguousarray(np.asarray(array) + 0, dtype=kind)
        digest.update(np.int64(plain.size).tobytes() + plain.tobytes())
    return digest.digest()
