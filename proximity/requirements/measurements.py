"""Measure the parts of a requirement, with bounds that include the deviation of their triangles.

`KINDS` has the kinds of requirements. A new kind is added there only.
"""

from collections.abc import Callable, Mapping
from math import cos, floor, inf, log10
from typing import NamedTuple

import numpy as np

from proximity.pose import Pose
from proximity.requirements.records import Requirement, Verdict, VerifiedPair
from proximity.scene.motion import Motion
from proximity.scene.motion_clearance import TOLERANCE
from proximity.scene.pairs import SHARING, Clearance, deepest_of, widened_bounds
from proximity.scene.scene import Scene
from proximity.scene.walls.thin_walls import WALL_ANGLE

STEPS = (1.05, 1.5, 2.0, 4.0, 8.0, 16.0)
"""Displacements in deviations, at which parts are compared to bound a gap along an axis."""
DEPTH_TOLERANCES = (1e-3, 1e-5, 1e-7)
"""Relative tolerances of a depth, from the fastest on."""
SINGLE = 2.0**-23
"""Rounding of coordinates by the import of STEP, as a share of the largest one."""
WALL_SHARE = 2.0 / cos(WALL_ANGLE)
"""Deviations by which a wall of CAD surfaces may be thinner or thicker than that of the triangles."""
MIN_MARGIN = 1e-9  # m; a smaller difference from a limit is not resolved by another tolerance


class Subject(NamedTuple):
    """Two parts, or one and "", and the requirement that they are compared with."""

    scene: Scene
    requirement: Requirement
    first: str
    second: str
    deviation: float  # m, of the triangles of both from their CAD surfaces
    step_tolerance: float  # m
    rounding: float  # m, allowance of comparisons with limits


class Measured(NamedTuple):
    """Bounds of a length, m, of the triangles and of the CAD surfaces, with its ends."""

    triangles: tuple[float, float]
    lower: float
    upper: float
    ends: tuple[np.ndarray, np.ndarray]
    position: float | None = None


class Kind(NamedTuple):
    """A kind of requirement: its limits in the file, the other keys that it takes, and its measurement.

    *limits*: by key, the field of `Limits`. *noun*: name of the measured length. *names*: "between" for
    pairs of parts, "part" for single ones. *default*: patterns if no names are given; empty if they are
    required.
    """

    noun: str
    limits: Mapping[str, str]
    takes: tuple[str, ...]
    measure: Callable[[Subject], Measured]
    names: str = "between"
    default: tuple[str, ...] = ()


def deviation_of(scene: Scene, name: str, approximation: float) -> float:
    """Return the largest distance, m, of a part's triangles from its CAD surfaces, and the other way round.

    It is 0 for a part from a file of triangles, and inf if it is not known. *approximation*: that of the
    file, m, for scenes that were compiled before parts had deviations.
    """
    part = scene.part(name)
    if len(part.deviation_by_face) or not approximation:
        return part.deviation
    return max(approximation, SINGLE * float(np.abs(scene.part(name).solid.bounds).max()))


def verify_subject(subject: Subject) -> VerifiedPair:
    """Measure the parts and compare the bounds with the limits."""
    limits, rounding = subject.requirement.limits, subject.rounding
    found = KINDS[subject.requirement.kind].measure(subject)
    verdict, reason, tolerance = limits.judge(found.lower, found.upper, rounding), "", None
    if found.triangles[1] == inf and limits.greatest == inf:
        verdict = Verdict.UNDECIDED
        reason = f"{subject.first} does not meet {subject.second} along this axis: there is no gap"
        if not subject.second:
            reason = f"{subject.first} has no wall: no two faces of it are parallel enough"
    elif verdict is Verdict.UNDECIDED:
        reason, tolerance = _remedy(subject, found)
    return VerifiedPair(
        subject.first, subject.second, verdict, found.lower, found.upper, subject.deviation, *found.ends,
        found.position, reason, tolerance,
    )  # fmt: skip


def _remedy(subject: Subject, found: Measured) -> tuple[str, float | None]:
    """Return the reason of an undecided verdict, and the step tolerance that may decide it."""
    limits, noun = subject.requirement.limits, KINDS[subject.requirement.kind].noun
    if subject.deviation == inf:
        return "the deviation of the triangles from the CAD surfaces is not known: see proximity check", None
    lower, upper = found.triangles
    verdict = limits.judge(lower, upper, subject.rounding)
    if verdict is Verdict.UNDECIDED:
        if _mm(lower) == _mm(upper):
            return f"the {noun} equals a limit within the precision of the measurement", None
        return f"the {noun} is between {_mm(lower)} and {_mm(upper)}, and a limit is between these", None
    margin = limits.margin(lower, upper)
    if verdict is Verdict.VIOLATED:
        margin = max(limits.least - upper, lower - limits.greatest)
    if margin <= MIN_MARGIN:
        return f"the {noun} of the triangles equals its limit: no tolerance decides it", None
    reason = f"it depends on the deviation of the triangles, {_mm(subject.deviation)}"
    share = 0.5 * margin / subject.deviation
    if share >= 1.0:  # along an axis: the deviation changes the gap by more than itself
        return f"{reason}: a smaller step_tolerance may decide it", None
    tolerance = _rounded_down(share * subject.step_tolerance)
    return f"{reason}: step_tolerance = {1e3 * tolerance:g} (mm) may decide it", tolerance


def _rounded_down(value: float) -> float:
    """Return a positive number rounded down to one significant digit."""
    digit = 10.0 ** floor(log10(value))
    return float(f"{floor(value / digit * (1.0 + 1e-12)) * digit:.1g}")


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g} mm"


def pose_at_end(scene: Scene, name: str, motion: Motion) -> Pose:
    """Return the pose of a part at the end of a motion."""
    span = motion.spans(scene.part(name).pose, np.zeros(3))[-1]
    return span.pose_at(span.end)


def _gap(subject: Subject) -> Measured:
    """Measure the gap of two parts in any direction, along an axis or over a motion."""
    if subject.requirement.along is not None:
        return _gap_along_axis(subject, np.array(subject.requirement.along))
    if subject.requirement.motion is not None:
        return _gap_over_motion(subject, subject.requirement.motion)
    pair = subject.scene.clearance(subject.first, subject.second)
    return _with_deviation(subject, pair.lower, pair.distance, pair)


def _with_deviation(
    subject: Subject, lower: float, upper: float, pair: Clearance, position: float | None = None
) -> Measured:
    """Return the bounds of a distance of triangles, and of CAD surfaces that deviate from them."""
    ends = pair.point_on_first, pair.point_on_second
    return Measured((lower, upper), *widened_bounds(lower, upper, subject.deviation), ends, position)


def _gap_over_motion(subject: Subject, motion: Motion) -> Measured:
    """Measure the smallest gap over a motion; search again near the limit until it is decided."""
    first, others, limits = subject.first, [subject.second], subject.requirement.limits
    lower, upper, nearest = 0.0, inf, None
    deviation = subject.deviation if subject.deviation < inf else 0.0
    for below in (None, limits.least + deviation, max(limits.least - deviation, 0.0)):
        tolerance = TOLERANCE if below is None else 0.0
        found = subject.scene.clearance_along(first, motion, others=others, tolerance=tolerance, below=below)
        lower = max(lower, found.lower)
        if found.distance <= upper:
            upper, nearest = found.distance, found
        assert nearest is not None
        position = nearest.position / subject.requirement.scale
        measured = _with_deviation(subject, lower, upper, nearest.nearest, position)
        if limits.judge(measured.lower, measured.upper, subject.rounding) is not Verdict.UNDECIDED:
            break
    return measured


def _gap_along_axis(subject: Subject, along: np.ndarray) -> Measured:
    """Measure how far the first part can move along an axis, with bounds for the CAD surfaces.

    While the distance of the triangles exceeds the deviation, the CAD surfaces do not touch. When a point is
    deeper inside the other part than the deviation, they overlap.
    """
    scene, first, second = subject.scene, subject.first, subject.second
    found, pair = scene.gap(first, second, along), scene.clearance(first, second)
    ends = pair.point_on_first, pair.point_on_second
    triangles = found.lower, found.distance
    if not subject.deviation:
        return Measured(triangles, *triangles, ends)
    if subject.deviation == inf:
        return Measured(triangles, -inf, inf, ends)
    pose = scene.part(first).pose
    try:
        lower = _free_along_axis(subject, along, pair.lower, found.lower)
        upper = _overlap_along_axis(subject, along, pair, found.distance)
    finally:
        scene.move(first, pose)
    return Measured(triangles, lower, upper, ends)


def _free_along_axis(subject: Subject, along: np.ndarray, distance: float, gap: float) -> float:
    """Return a displacement before which the CAD surfaces certainly do not touch; negative: see `Gap`."""
    scene, first, deviation = subject.scene, subject.first, subject.deviation
    if distance <= deviation:
        for step in STEPS:
            _displace(subject, along, -step * deviation)
            is_free = scene.clearance(first, subject.second).lower > deviation
            _displace(subject, along, step * deviation)
            if is_free:
                return -step * deviation
        return -inf
    if gap == inf:
        lower, upper = scene.bounds
        motion = Motion.slide(along, 0.0, 2.0 * float(np.linalg.norm(upper - lower)))
        found = scene.clearance_along(first, motion, others=[subject.second], below=deviation)
        is_near = found.bounds <= deviation
        return float(found.positions[np.argmax(is_near)]) if is_near.any() else inf
    for step in STEPS:
        end = gap - step * deviation
        if end <= 0.0:
            break
        motion = Motion.slide(along, 0.0, end)
        found = scene.clearance_along(first, motion, others=[subject.second], below=deviation)
        if found.lower > deviation:
            return end
    return 0.0


def _overlap_along_axis(subject: Subject, along: np.ndarray, pair: Clearance, gap: float) -> float:
    """Return a displacement at which the CAD parts certainly overlap, or inf."""
    if gap == inf:
        return inf
    start = max(gap, 0.0)
    if pair.relation in SHARING and _is_overlap(subject):
        return 0.0
    _displace(subject, along, start)
    for before, step in zip((0.0, *STEPS), STEPS, strict=False):
        _displace(subject, along, (step - before) * subject.deviation)
        if _is_overlap(subject):
            return start + step * subject.deviation
    return inf


def _displace(subject: Subject, along: np.ndarray, length: float) -> None:
    """Move the first part of the scene along an axis."""
    pose = subject.scene.part(subject.first).pose
    subject.scene.move(subject.first, Pose(pose.rotation, pose.translation + length * along))


def _is_overlap(subject: Subject) -> bool:
    """Return whether the CAD parts certainly overlap."""
    names = subject.first, subject.second
    if subject.scene.clearance(*names).relation not in SHARING:
        return False
    return deepest_of(subject.scene, *names, DEPTH_TOLERANCES[0]).lower > subject.deviation


def _depth(subject: Subject) -> Measured:
    """Measure the largest depth of a point of one part inside the other."""
    scene, first, second, deviation = subject.scene, subject.first, subject.second, subject.deviation
    pair, limits = scene.clearance(first, second), subject.requirement.limits
    if pair.relation not in SHARING:
        ends = pair.point_on_first, pair.point_on_second
        return Measured((0.0, 0.0), 0.0, max(deviation - pair.lower, 0.0), ends)
    for tolerance in DEPTH_TOLERANCES:
        found = deepest_of(scene, first, second, tolerance)
        if limits.judge(found.lower, found.upper, subject.rounding) is not Verdict.UNDECIDED:
            break
    bounds = found.lower, found.upper
    return Measured(bounds, *widened_bounds(*bounds, deviation), (found.point, found.point))


def _thickness(subject: Subject) -> Measured:
    """Measure the least wall thickness of a part."""
    found = subject.scene.part(subject.first).thin_places(below=subject.requirement.limits.least)
    bounds = found.lower, found.upper
    widened = widened_bounds(*bounds, WALL_SHARE * subject.deviation)
    return Measured(bounds, *widened, (found.point, found.opposite))


KINDS = {
    "gap": Kind("gap", {"least": "least", "greatest": "greatest"}, ("along", "motion", "pose"), _gap),
    "clash": Kind("depth", {"deepest": "greatest"}, ("pose",), _depth, default=("*", "*")),
    "thickness": Kind("thickness", {"least": "least"}, (), _thickness, names="part"),
}
"""Kinds of requirements by their key in the file."""
