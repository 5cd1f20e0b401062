"""Numbers of nodes and leaves visited by a query: the same on every machine.

Rays are counted by a kernel of this file, which numba compiles together with the kernels it calls: it does
not work with kernels compiled ahead of time.
"""

import numpy as np

from proximity import Scene, Tracker
from proximity.kernels.geometry.frames import (
    direction_to_local,
    to_local,
)
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    NO_SLOT,
    STACKS_SIZE,
)
from proximity.kernels.ray.ray_lanes import scaled_direction
from proximity.kernels.ray.walk import (
    SLAB_MARGIN,
    aim_and_view,
    approach,
    bound_of_parameter,
    first_in_block,
    is_from_afar,
    open_boxes,
)
from proximity.kernels.stack_arrays import stack_f32
from proximity.kernels.traverse.depth_first import depth_first, in_blocks, in_order
from proximity.native import inlined, kernel
from proximity.native.simd import splat32

UNLIMITED = 10**9
WHOLE_SCENE = 10.0  # m, search range of a tracker
NO_HORIZON = 1e-9  # s


def work_of_points(scene: Scene, points: np.ndarray) -> np.ndarray:
    """Return nodes and leaves of an exact signed distance for each of (..., 3) *points*, (...).

    As counted by the first tick of a track without a limit to its budget and without a prediction.
    """
    rows = points.reshape(-1, 3)
    tracker = Tracker(
        scene,
        fingers=len(rows),
        radius=0.0,
        budget=UNLIMITED,
        working_range=WHOLE_SCENE,
        horizon=NO_HORIZON,
    )
    return tracker.tick(rows, 0, 0)["work"].astype(np.int64).reshape(points.shape[:-1])


def work_of_rays(scene: Scene, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return nodes and leaves of each ray (..., 3), (...), and its length to the first hit, m; one part."""
    assert len(scene.parts) == 1, "rays are counted in scenes of one part"
    rows, rays = origins.reshape(-1, 3), directions.reshape(-1, 3)
    work, lengths = np.zeros(len(rows), np.int64), np.zeros(len(rows))
    model = scene.snapshot()
    _count_rays(model.reals, model.words, model.frames, model.parts, rows, rays, work, lengths)
    return work.reshape(origins.shape[:-1]), lengths.reshape(origins.shape[:-1])


@kernel
def _count_rays(reals, words, frames, parts, origins, directions, work, lengths):
    """Count the steps of rays with `_ray_steps`; lengths are inf for misses."""
    stacks = stack_f32(STACKS_SIZE)
    for i in range(len(origins)):
        x, y, z = to_local(frames, parts, 0, origins[i, 0], origins[i, 1], origins[i, 2])
        dx, dy, dz = scaled_direction(directions[i, 0], directions[i, 1], directions[i, 2])
        length = (dx * dx + dy * dy + dz * dz) ** 0.5
        dx, dy, dz = direction_to_local(frames, parts, 0, dx, dy, dz)
        best = _ray_steps(reals, words, parts[0].root, x, y, z, dx, dy, dz, stacks, work[i : i + 1])
        lengths[i] = best * length / frames[0].scale


@inlined
def _open_children(words, base, query, reach):
    query[3][0] += 1
    return open_boxes(words, base, query[0], splat32(np.float32(0.0)), reach)


@inlined
def _first_in_leaf(reals, reference, query, best):
    _, view, entry, steps = query
    steps[0] += 1
    found, first, _, _, _ = first_in_block(reals, BLOCK_STRIDE * ~reference, view, entry, best[1])
    slot = LANES * ~reference + first
    if first >= 0 and (found < best[1] or slot < best[2] or best[2] == NO_SLOT):
        return bound_of_parameter(found, entry), found, slot
    return best


_walk = depth_first(_open_children, in_blocks(_first_in_leaf), in_order)


@kernel
def _ray_steps(reals, words, start, ox, oy, oz, dx, dy, dz, stacks, steps):
    """Traverse like `kernels.ray.walk.first_hit` with a counter; return the first parameter and the steps."""
    is_near, entry = True, 0.0
    if is_from_afar(ox, oy, oz):
        is_near, entry, ox, oy, oz = approach(ox, oy, oz, dx, dy, dz)
    aim, view = aim_and_view(ox, oy, oz, dx, dy, dz, SLAB_MARGIN)
    best32 = bound_of_parameter(np.inf, entry) if is_near else np.float32(-1.0)
    best = best32, np.inf, np.int64(NO_SLOT)
    return _walk((reals, words), start, 0, (aim, view, entry, steps), best, stacks)[1]
