"""A mesh as a solid of `manifold3d`, the library that judges solids and cuts them with each other."""

from typing import Any

import numpy as np


def manifold_solid(points: np.ndarray, corner_ids: np.ndarray, face_ids: np.ndarray | None = None) -> Any:
    """Return the ``manifold3d.Manifold`` of balanced faces; its ``status()`` says whether it is one.

    *points* are (K, 3) float64, one row a position, *corner_ids* (F, 3) int32, as in `Topology`; what is cut
    out of the solid keeps the (F,) *face_ids*. manifold3d 3.5.4 ends the process on 4 of 735 meshes whose
    faces are not balanced.
    """
    import manifold3d  # 40 ms, and most meshes are never judged

    is_folded = (corner_ids == np.roll(corner_ids, 1, axis=1)).any(axis=1)
    faces = corner_ids[~is_folded].astype(np.uint64)
    numbers = None if face_ids is None else face_ids[~is_folded].astype(np.uint64)
    return manifold3d.Manifold(manifold3d.Mesh64(points, faces, face_id=numbers))
