"""The default placement of a recorded hand: close to the scene, in contact with it.

A recording is made above a sensor, with nothing to touch. The middle of the hand's box is moved to the middle
of the scene's; a hand that would be stuck in the part is raised out of it, one that would miss it is moved to
it. Size and orientation stay.
"""

import math
from collections.abc import Sequence

import numpy as np

from proximity.errors import PoseError, SceneError
from proximity.pose import Pose
from proximity.recording import Recording
from proximity.scene.scene import Scene

TOUCHING_SHARE = 0.1
"""A hand with a larger share of touching samples is raised until it has this: the others are approach."""
PLACEMENT_SAMPLE_COUNT = 2000  # positions tested, evenly chosen
QUARTERS = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}  # cosine, sine
BISECTIONS = 40  # of the height: the remaining interval is far below a micrometre


def fitted_pose(
    scene: Scene,
    recording: Recording,
    radius: float,
    *,
    rotation: np.ndarray | None = None,
    scale: float = 1.0,
) -> Pose:
    """Return a pose of a recording at which its fingers approach and touch the parts.

    The box of the middle 80 % of all positions is made concentric with the box of the scene. If more than a
    tenth of the positions then touch, the hand is raised, along z, until a tenth do. If none touches, the
    hand is moved along the shortest connection of all, until that finger is pressed in by half its radius.

    *rotation*: (3, 3), of the hand; by default none. *scale*: factor of the recorded motion.
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
    if share == 0.0:  # also after raising: all samples of a resting finger leave together
        shift += _shift_to_touch(scene, points + shift, radius)
    return Pose(rotation, pose.translation + shift)


def turn_about_axes(degrees: Sequence[float]) -> np.ndarray:
    """Return the rotation about the target's x, then its y, then its z axis, (3, 3).

    *degrees*: angle about each; counter-clockwise seen from the axis' tip.
    """
    rotation = np.eye(3)
    for axis, angle in enumerate(degrees):
        if not math.isfinite(angle):
            raise PoseError(f"a rotation of {angle:g} degrees about {'xyz'[axis]}, expected finite numbers")
        # Quarter turns are exact.
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
    """Return a height at which at most the share touches, while more do just below."""
    below, above = 0.0, float(scene.bounds[1][2] - points[:, 2].min()) + 2.0 * radius
    for _ in range(BISECTIONS):
        middle = 0.5 * (below + above)
        if _touching_share(scene, points, radius, middle) > TOUCHING_SHARE:
            below = middle
        else:
            above = middle
    return above


def _shift_to_touch(scene: Scene, points: np.ndarray, radius: float) -> np.ndarray:
    """Return the shift that brings the nearest fingertip into contact."""
    hits = scene.closest(points)
    nearest = int(np.argmin(hits.signed_distance))
    direction = hits.point[nearest] - points[nearest]
    return direction * (1.0 - 0.5 * radius / float(hits.signed_distance[nearest]))
