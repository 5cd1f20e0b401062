"""The shortest connection of two parts, as Python asks for it."""

from math import sqrt

import numpy as np

from proximity.kernels.geometry.frames import to_scene
from proximity.kernels.layout import ModelArrays
from proximity.kernels.pair.boxes import frames_between
from proximity.kernels.pair.connection import BOTH, connect, cross_at
from proximity.kernels.pair.triangles import CROSSING
from proximity.kernels.pair.walk import nearest_of_parts, read_both
from proximity.kernels.stack_arrays import stack_f64, stack_i64
from proximity.native import entry
from proximity.native.simd import load_int

ANSWER_SIZE = 9
"""Distance, m; a point on each part, m, scene's frame; the face of each."""


@entry(ModelArrays, "int, int, float64[:]")
def connect_parts(model, first, second, answer):
    """Fill the shortest connection of two parts, (`ANSWER_SIZE`,): 0 long where they cross."""
    reals, words, frames, parts = model
    slots, turn, offset = stack_i64(2), stack_f64(9), stack_f64(3)
    corners, ends = stack_f64(BOTH), stack_f64(6)
    best = nearest_of_parts(model, first, second, np.inf, slots)
    frames_between(frames, first, second, turn, offset)
    read_both(reals, slots, turn, offset, corners)
    apart_sq = cross_at(corners, ends) if best == CROSSING else connect(corners, ends)
    answer[0] = sqrt(apart_sq) / frames[first].scale
    to_scene(frames, parts, first, ends, 0, answer, 1)
    to_scene(frames, parts, first, ends, 3, answer, 4)
    answer[7] = load_int(words, parts[first].slot_faces + slots[0])
    answer[8] = load_int(words, parts[second].slot_faces + slots[1])
