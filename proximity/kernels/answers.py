"""Columns of the answers that kernels write and Python reads: a row a point, ray, segment or pair."""

# --- points: float64 ---
POINT_ANSWER_SIGNED_DISTANCE = 0
POINT_ANSWER_POINT = 1
POINT_ANSWER_GRADIENT = 4
POINT_ANSWER_BARYCENTRIC = 7
POINT_ANSWER_REALS = 10
# and int32, behind them
POINT_ANSWER_PART = 2 * POINT_ANSWER_REALS
POINT_ANSWER_FACE = POINT_ANSWER_PART + 1
POINT_ANSWER_FEATURE = POINT_ANSWER_PART + 2
POINT_ANSWER_IS_SIGNED = POINT_ANSWER_PART + 3
POINT_ANSWER_WIDTH = POINT_ANSWER_REALS + 2
"""float64 that a row takes in all."""

# --- rays: float64 ---
RAY_ANSWER_DISTANCE = 0
RAY_ANSWER_POINT = 1
RAY_ANSWER_NORMAL = 4
RAY_ANSWER_BARYCENTRIC = 7
RAY_ANSWER_REALS = 10
# and int32, behind them
RAY_ANSWER_PART = 2 * RAY_ANSWER_REALS
RAY_ANSWER_FACE = RAY_ANSWER_PART + 1
RAY_ANSWER_WIDTH = RAY_ANSWER_REALS + 1
"""float64 that a row takes in all."""
DISTANCE_WIDTH = 1
"""float64 of a row of which only the distance is asked."""

# --- segments: float64 ---
SEGMENT_ANSWER_DISTANCE = 0
SEGMENT_ANSWER_POINT_ON_SEGMENT = 1
SEGMENT_ANSWER_POINT_ON_SOLID = 4
SEGMENT_ANSWER_FRACTION = 7
SEGMENT_ANSWER_BARYCENTRIC = 8
SEGMENT_ANSWER_REALS = 11
# and int32, behind them
SEGMENT_ANSWER_PART = 2 * SEGMENT_ANSWER_REALS
SEGMENT_ANSWER_FACE = SEGMENT_ANSWER_PART + 1
SEGMENT_ANSWER_WIDTH = SEGMENT_ANSWER_REALS + 1
"""float64 that a row takes in all."""

# --- pairs of parts: float64 ---
CLEARANCE_LOWER = 0
CLEARANCE_DISTANCE = 1
CLEARANCE_POINTS = 2
CLEARANCE_FACES = 8
CLEARANCE_RELATION = 10
CLEARANCE_MAY_BE_INSIDE = 11
CLEARANCE_SIZE = 12
"""A lower bound of the distance, and the distance, m; a point on each part, m, scene's frame; the faces; the
relation of the parts; 1 where one part may be inside the other, because boxes overlap and nothing crosses."""
APART, TOUCHES, CROSSES = 0, 1, 2

DEPTH_LOWER = 0
DEPTH_UPPER = 1
DEPTH_NORMAL = 2
DEPTH_STEPS = 5
DEPTH_SIZE = 6
"""The parts overlap at least and at most so long, m; the direction, scene's frame, in which the first is free
of the second there, or 0; steps."""

DEEPEST_LOWER, DEEPEST_UPPER, DEEPEST_POINT, DEEPEST_STEPS = 0, 1, 2, 5
DEEPEST_SIZE = 6
"""m: a point is so deep, and none is deeper; that point, scene's frame; steps."""
