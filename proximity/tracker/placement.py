"""The default placement of a recorded hand: it comes near the scene and touches it.

A recording was made above a sensor, with nothing to touch. The middle of the hand's box goes to the middle
of the scene's; a hand that would then be stuck in the part is raised out of it, one that would miss it is
brought to it. It keeps its size and its attitude.
"""

import math
from collections.abc import Sequence

import numpy as np

from proximity.errors import PoseError, SceneError
from proximity.pose import Pose
from proximity.recording import Recording
from proximity.scene.scene import Scene

TOUCHING_SHARE = 0.1
"""A hand that touches in more of its samples than this is raised until it does not: the rest is approach."""
PLACEMENT_SAMPLE_COUNT = 2000  # positions that are looked at, evenly chosen
QUARTERS = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}  # cosine, sine
BISECTIONS = 40  # of the height searched: what is left is far below a micrometre


def fitted_pose(
    scene: Scene,
    recording: Recording,
    radius: float,
    *,
    rotation: np.ndarray | None = None,
    scale: float = 1.0,
) -> Pose:
    """Return where to put a recording so that its fingers come near the parts and touch them.

    The box of the middle 80 % of all positions is put concentric with the box of the scene. If then more than
    a tenth of the positions touch, the hand is raised, along z, until a tenth do. If none touches then, the
    hand is moved along the shortest connection of all, until that finger is pressed in by half its radius.

    *rotation*: (3, 3); how the hand is turned; not at all where not given. *scale*: how many times as large
    as recorded the motion is.
    """
    if all(part.is_hidden for part in scene.parts):
        raise SceneError("all parts are hidden, expected one that a recording can be fitted to")
    lower, upper = scene.bounds
    pose = recording.fitted_to(lower, upper, rotation=rotation, scale=scale)
    placed = recording.placed(pose, scale)
    points = placed.positions[placed.is_present]
    points = points[:: -(-len(points) // PLACEMENT_SAMPLE_COUNT)]
    share, shift = _touching_share(scene, points, radius, 0.0), np.zeros(3)
    if share > TOUCHING_SHARE:
        shift[2] = _height_to_rise(scene, points, radius)
        share = _touching_share(scene, points, radius, shift[2])
    if share == 0.0:  # after rising too: of a finger that rests, all samples leave at once
        shift += _shift_to_touch(scene, points + shift, radius)
    return Pose(rotation, pose.translation + shift)


def turn_about_axes(degrees: Sequence[float]) -> np.ndarray:
    """Return the rotation about the target's x, then its y, then its z axis, (3, 3).

    *degrees*: how far about each; counter-clockwise seen from the axis' tip.
    """
    rotation = np.eye(3)
    for axis, angle in enumerate(degrees):
        if not math.isfinite(angle):
            raise PoseError(f"a rotation of {angle:g} degrees about {'xyz'[axis]}, expected finite numbers")
        # whole quarters exactly
        cosine, sine = QUARTERS.get(
            angle % 360.0, (math.cos(math.radians(angle)), math.sin(math.radians(angle)))
        )
        u, v = (axis + 1) % 3, (axis + 2) % 3
        about = np.eye(3)
        about[[u, u, v, v], [u, v, u, v]] = cosine, -sine, sine, cosine
        rotation = about @ rotation
    return rotation


def _touching_share(scene: Scene, points: np.ndarray, radius: float, height: float) -> float:
    raised = points + np.array([0.0, 0.0, height])
    return float((scene.signed_distance(raised) <= radius).mean())


def _height_to_rise(scene: Scene, points: np.ndarray, radius: float) -> float:
    """A height at which no more than the share touches, and just below which more do."""
    below, above = 0.0, float(scene.bounds[1][2] - points[:, 2].min()) + 2.0 * radius
    for _ in range(BISECTIONS):
        middle = 0.5 * (below + above)
        if _touching_share(scene, points, radius, middle) > TOUCHING_SHARE:
            below = middle
        else:
            above = middle
    return above


def _shift_to_touch(scene: Scene, points: np.ndarray, radius: float) -> np.ndarray:
    """The shift that brings the nearest fingertip into touch."""
    hits = scene.closest(points)
    nearest = int(np.argmin(hits.signed_distance))
    direction = hits.point[nearest] - points[nearest]
    return direction * (1.0 - 0.5 * radius / float(hits.signed_distance[nearest]))
