"""The point of one part that lies deepest inside another, with bounds of its depth.

First pieces of the inner part's surface are searched, then boxes of the volume that both have in common.
"""

from proximity.kernels.geometry.frames import ROUNDED_DOWN, ROUNDED_UP, to_scene
from proximity.kernels.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.layout import SIGN_NONE, ModelArrays
from proximity.kernels.pair.boxes import frames_between
from proximity.kernels.pair.deepest_boxes import fill_common_box, search_volume
from proximity.kernels.pair.deepest_pieces import search_surface
from proximity.kernels.pair.deepest_state import BEST, BOUND, CAPACITY, POSITION, STATE_SIZE, STEPS
from proximity.kernels.pair.triangles import SIDE_ROUNDING
from proximity.kernels.stack_arrays import stack_f64, stack_f64_rows
from proximity.native import entry

DEEPEST_LOWER, DEEPEST_UPPER, DEEPEST_POINT, DEEPEST_STEPS = 0, 1, 2, 5
DEEPEST_SIZE = 6
"""m: a point is so deep, and none is deeper; that point, scene's frame; steps."""


@entry(ModelArrays, "int, int, float, float, int, float64[:]")
def deepest_point(model, inner, outer, tolerance, rest, budget, deepest):
    """Fill how deep points of one part are inside another at most; (`DEEPEST_SIZE`,).

    *tolerance*, *rest*: share of the depth, and length, m, that may be left between its bounds. *budget*:
    steps at most. The lower bound that is in *deepest* before is known from elsewhere.
    """
    frames, scale = model.frames, model.frames[outer].scale
    workspace, state, boxes = new_workspace(), stack_f64(STATE_SIZE), stack_f64_rows(CAPACITY, 7)
    turn, offset = stack_f64(9), stack_f64(3)
    reset_recent(workspace)
    known = deepest[DEEPEST_LOWER]
    deepest[DEEPEST_UPPER], deepest[DEEPEST_STEPS] = known, 0.0
    if model.parts[outer].sign == SIGN_NONE or model.parts[inner].sign == SIGN_NONE:
        return
    frames_between(frames, outer, inner, turn, offset)
    slack = 1.0
    for k in range(3):
        slack = max(slack, abs(offset[k]) + 2.0 * abs(scale / frames[inner].scale))
    limits = tolerance, max(rest * scale, 16.0 * SIDE_ROUNDING * slack), 16.0 * SIDE_ROUNDING * slack
    state[BEST], state[BOUND], state[STEPS] = known * scale, 0.0, 0.0
    cap = fill_common_box(model, inner, outer, (turn, offset), boxes)
    search_surface(model, inner, outer, (turn, offset), cap, state, limits, budget, workspace)
    search_volume(model, inner, outer, (turn, offset), boxes, state, limits, 2.0 * budget, workspace)
    deepest[DEEPEST_STEPS] = state[STEPS]
    deepest[DEEPEST_UPPER] = max(known, max(state[BEST], state[BOUND]) / scale * ROUNDED_UP)
    if state[BEST] > known * scale:
        deepest[DEEPEST_LOWER] = state[BEST] / scale * ROUNDED_DOWN
        to_scene(frames, model.parts, outer, state, POSITION, deepest, DEEPEST_POINT)
