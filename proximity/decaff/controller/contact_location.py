"""Location of the coming contact on the finger's path, read from a frame, and the instant that it holds for.

What is reported at an instant is combined with the pose of the same instant, never with a later one: the
place does not depend on how late the frame came.
"""

import math
from dataclasses import dataclass
from typing import Any

from proximity.decaff.glove.finger_path import LEAST_BEND, MOST_BEND, FingerPath
from proximity.message import Mode, Source, State, Surface
from proximity.message.contact import UNIT_ERROR, ContactFlag

MOST_RATE = 100.0  # 1/s: no finger bends faster; assumed
MOST_LENGTH = 100.0  # m: no distance that is measured is greater; assumed
LEAST_CLOSING = 1e-3  # m/s: slower, the finger is not closing; assumed
TABLE_ERROR = 1e-5  # of a bend, that goes to a position and back; two micrometres
MIN_TRAVEL = 3e-3  # m, to the contact: nearer, the position's own error would show in the incidence; assumed
SILENT_STATES = frozenset((State.STARTING, State.STALE, State.STOPPING))
ACTED_UPON = frozenset((State.OK, State.DEGRADED))
_MODES, _SURFACES, _SOURCES = (frozenset(int(value) for value in kind) for kind in (Mode, Surface, Source))


@dataclass(frozen=True, slots=True)
class Location:
    """A position of contact on the finger's path."""

    bend: float  # at pose_ns
    rate: float  # 1/s, by which it drifts as the object moves
    error: float  # by which the bend may be off; 0 where it is not reported
    pose_ns: int
    finger_speed: float  # m/s, when it was reported
    start_ns: int = 0  # of the tick that reported it: poses may be rarer than frames
    incidence: float = 1.0  # cosine between the finger's path and the surface's normal; nan: too near to tell

    def bend_at(self, now_ns: int, longest_ns: int) -> float:
        """Return the bend at an instant; the drift is believed for no longer than *longest_ns*.

        Parameters
        ----------
        now_ns : int, ns
            The instant.
        longest_ns : int, ns
            After the pose.
        """
        return self.bend + self.rate * 1e-9 * min(max(now_ns - self.pose_ns, 0), longest_ns)


@dataclass(frozen=True, slots=True)
class ContactReading:
    """What a record says of a touch, kept after the record itself is overwritten."""

    surface: int
    source: int
    distance: float  # m
    lower: float  # m
    stiffness: float  # N/m
    damping: float  # N s/m
    force: float  # N; nan: not reported

    @classmethod
    def of(cls, contact: Any) -> "ContactReading":
        """Take what is kept of a record."""
        force = float(contact["force"])
        is_known = contact["force_is_valid"] and math.isfinite(force)
        return cls(
            int(contact["surface"]),
            int(contact["source"]),
            float(contact["signed_distance"]),
            float(contact["lower"]),
            float(contact["stiffness"]),
            float(contact["damping"]),
            force if is_known else math.nan,
        )


def is_sound(contact: Any, now_ns: int, future_ns: int) -> bool:
    """Return whether what a tracked finger's record says can be.

    Parameters
    ----------
    contact : CONTACT
        Of the finger.
    now_ns : int, ns
        On the clock of its poses.
    future_ns : int, ns
        By which a pose may seem to lie in the future.
    """
    pose_ns, distance = int(contact["pose_ns"]), float(contact["signed_distance"])
    if pose_ns - now_ns > future_ns or not distance >= -MOST_LENGTH:  # inf: nothing within reach
        return False
    if int(contact["mode"]) not in _MODES or int(contact["surface"]) not in _SURFACES:
        return False
    if int(contact["source"]) not in _SOURCES or math.inf > distance > MOST_LENGTH:
        return False
    x, y, z = (float(number) for number in contact["normal"])
    length = math.sqrt(x * x + y * y + z * z) if max(abs(x), abs(y), abs(z)) < 2.0 else math.inf
    if length == math.inf and not any(math.isnan(number) for number in (x, y, z)):
        return False
    if abs(length - 1.0) > UNIT_ERROR and math.isfinite(length):  # nan: no normal is known
        return False
    return (
        _may_be(contact["bend"], LEAST_BEND, MOST_BEND)
        and _may_be(contact["contact_bend"], LEAST_BEND, MOST_BEND)
        and _may_be(contact["bend_rate"], -MOST_RATE, MOST_RATE)
        and _may_be(contact["contact_bend_rate"], -MOST_RATE, MOST_RATE)
        and not float(contact["contact_bend_error"]) < 0.0
    )


def locate(contact: Any, path: FingerPath) -> Location | None:
    """Return where the finger touches, from what the record says; None: nowhere before the fist.

    Of a path that was followed to the fist and is free, bend and velocity are not asked: the rule guesses by
    them where no path is known. No position is nearer to the finger than its distance is, for certain.
    """
    bend, distance = float(contact["bend"]), float(contact["signed_distance"])
    contact_bend, rate, error = float(contact["contact_bend"]), 0.0, 0.0
    if math.isnan(contact_bend) and int(contact["flags"]) & ContactFlag.ON_PATH:
        return None
    if math.isfinite(contact_bend) and not _is_open(contact):
        rate = _or_zero(contact["contact_bend_rate"])
        error = _or_zero(contact["contact_bend_error"])
    else:
        # Of a path that was not followed to a contact the position is no nearer than its end, for certain.
        contact_bend = max(
            _extrapolated(contact, bend, distance), -math.inf if math.isnan(contact_bend) else contact_bend
        )
    clearance = min(float(contact["lower"]), distance)
    if math.isfinite(bend) and clearance > 0.0:
        # Whatever is said of its travel, a finger that is free goes so far, for certain, before it touches.
        nearest = path.bend(path.position(bend) + clearance)
        contact_bend = nearest if contact_bend < nearest - TABLE_ERROR else contact_bend
    if not contact_bend <= 1.0:
        return None
    travel = path.position(contact_bend) - path.position(bend) if math.isfinite(bend) else math.nan
    incidence = (
        min(max(distance / travel, 0.0), 1.0) if travel > MIN_TRAVEL and distance < math.inf else math.nan
    )
    speed = math.hypot(*(_or_zero(number) for number in contact["velocity"]))
    return Location(contact_bend, rate, error, int(contact["pose_ns"]), speed, incidence=incidence)


def _is_open(contact: Any) -> bool:
    """Whether a path was followed as far as steps sufficed, without a contact: then there is no drift."""
    flags = int(contact["flags"]) & (ContactFlag.ON_PATH | ContactFlag.CONTACT_FOUND)
    return flags == ContactFlag.ON_PATH and math.isnan(contact["contact_bend_rate"])


def is_tracked(contact: Any) -> bool:
    """Return whether the service knows where the finger is."""
    return bool(int(contact["flags"]) & ContactFlag.TRACKED) and int(contact["mode"]) != Mode.HOLD


def _extrapolated(contact: Any, bend: float, distance: float) -> float:
    """b + d/(-n.p'), where -n.p' is how fast the pad closes over how fast the finger bends; nan: it does not.

    The controller does not know how the hand lies in the world, so p' comes of the finger's velocity; where
    that is not known, of how the distance changes.
    """
    bend_rate = float(contact["bend_rate"])
    closing = -sum(float(n) * float(v) for n, v in zip(contact["normal"], contact["velocity"], strict=True))
    if not math.isfinite(closing):
        closing = float(contact["approach_speed"])
    if not (0.0 < distance < math.inf and LEAST_CLOSING < closing < math.inf and bend_rate > 0.0):
        return math.nan
    return bend + distance * bend_rate / closing


def _may_be(number: Any, least: float, most: float) -> bool:
    value = float(number)
    return math.isnan(value) or least <= value <= most


def _or_zero(number: Any) -> float:
    value = float(number)
    return value if math.isfinite(value) else 0.0
