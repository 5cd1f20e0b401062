"""Overlapping parts of a tracker: containment, depth, and whether a tracked part can move away."""

from math import sqrt

import numpy as np

from proximity.kernels.answers import EXIT_ANSWER
from proximity.kernels.geometry.triangle import dot
from proximity.kernels.pair.exit_search import begin_exit, follow_normals, search_exit, try_direction
from proximity.kernels.pair.part_query import inner_part
from proximity.kernels.pair.triangles import between
from proximity.kernels.scene.inside.containment import Surfaces, surfaces_of_pair
from proximity.kernels.stack_arrays import stack_arrays_of, stack_f64
from proximity.kernels.tracking.tracked_motion import SLIP
from proximity.native import inlined, kernel

MIN_DEPTH_TOLERANCE = 0.01
stack_exits, _ = stack_arrays_of(EXIT_ANSWER)


@kernel
def decide_inner_parts(model, held):
    """Decide for undecided pairs, whose surfaces do not cross, whether one part is inside the other."""
    surfaces = Surfaces(held.faces, held.ranges)
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        if pair.is_undecided:
            faces, other_faces = surfaces_of_pair(model, pair.own, pair.other, surfaces)
            pair.is_inside = inner_part(model, pair.own, pair.other, faces, other_faces)
            pair.is_unsure = 1 if pair.lower <= 0.0 else 0


@kernel
def comes_free(model, held):
    """Test whether a small displacement frees all touching parts: whether they touch from outside."""
    normal, best, surfaces = stack_f64(3), stack_exits(1)[0], Surfaces(held.faces, held.ranges)
    for number in range(len(held.pairs)):
        pair = held.pairs[number]
        if not pair.is_opening:
            continue
        if not _copy_normal(pair, normal):
            return False
        frame = model.frames[pair.own]
        x, y, z = between(frame.own_lower, frame.own_upper)
        length = SLIP * sqrt(dot(x, y, z, x, y, z))
        faces, other_faces = surfaces_of_pair(model, pair.own, pair.other, surfaces)
        parts = pair.own, pair.other, faces, other_faces, held.settings[0].budget
        begin_exit(best)
        try_direction(model, parts, normal, 0.5, length, best)
        if best.depth > length:
            return False
    return True


@inlined
def _copy_normal(pair, normal):
    """Copy the direction of the last search; return whether there is one."""
    for k in range(3):
        normal[k] = pair.normal[k]
    return normal[0] != 0.0 or normal[1] != 0.0 or normal[2] != 0.0


@kernel
def fill_depth(model, held, record):
    """Fill the displacement that frees a part of another, in the last direction or a new one."""
    normal, best, surfaces, row = stack_f64(3), stack_exits(1)[0], Surfaces(held.faces, held.ranges), 0
    while held.pairs[row].own != record["own_part"] or held.pairs[row].other != record["part"]:
        row += 1
    pair, tolerance = held.pairs[row], max(held.settings[0].tolerance, MIN_DEPTH_TOLERANCE)
    faces, other_faces = surfaces_of_pair(model, pair.own, pair.other, surfaces)
    parts = pair.own, pair.other, faces, other_faces, held.settings[0].budget
    begin_exit(best)
    if _copy_normal(pair, normal):
        try_direction(model, parts, normal, tolerance, pair.depth, best)
        follow_normals(model, parts, tolerance, best)
    else:
        search_exit(model, parts, tolerance, best)
    record["depth"], record["depth_lower"] = best.depth, best.lower
    record["work"] += np.uint32(best.steps)
    if best.depth > 0.0:
        pair.depth = best.depth
        for k in range(3):
            record["normal"][k] = pair.normal[k] = best.direction[k]
