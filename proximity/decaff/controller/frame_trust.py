"""State that a controller keeps of frames: the last one that is trusted, and the contact that it predicts.

Distrust is counted, never repaired: a frame that cannot be is as if it had not come, and the one before ages.
"""

import math
from dataclasses import replace
from typing import Any

from proximity.decaff.controller.contact_location import (
    ACTED_UPON,
    SILENT_STATES,
    ContactReading,
    Location,
    is_sound,
    is_tracked,
    locate,
)
from proximity.decaff.controller.controller_states import FrameMark, Observation, Trust
from proximity.decaff.controller.drum_limits import Limits
from proximity.decaff.glove.finger_path import FingerPath
from proximity.message.contact import ContactFlag

LARGEST_POSITION_ERROR = 5e-3
"""m: a contact whose position is less certain than that still does not come nearer unconfirmed. Assumed."""
_NONE = -1, -(2**63)  # before every sequence and every pose


class FrameTrust:
    """The frames of one finger, as far as they are believed.

    Each frame is looked at once. Several may be of the same pose, and parts may have moved from one to the
    next: what they say counts at once. But they do not confirm each other: a mistake of the pose is in all.

    Parameters
    ----------
    path : FingerPath
        Of the finger.
    limits : Limits
        Of ages and speeds.
    """

    reading: ContactReading | None  # by the record that was believed last
    location: Location | None  # None: nothing will be touched
    dropped: int  # records that could not be
    awaited: int  # contacts that came nearer than can be, until a frame of a second pose agreed
    was_outside: bool  # since the start, since nothing was known, or since the last jump of finger or part

    def __init__(self, path: FingerPath, limits: Limits) -> None:
        self._path, self._limits = path, limits
        self.dropped = self.awaited = 0
        self.forget()

    def forget(self) -> None:
        """Start anew: what comes next is confirmed by a frame of a second pose."""
        self.reading = self.location = None
        self.was_outside = False
        self._pose_ns: int | None = None
        self._frame: FrameMark | None = None  # that was looked at last
        self._newest = (
            _NONE  # of this run of the service: its highest sequence, its last pose that was believed
        )
        self._pending: Location | None = None
        self._distrust: Trust | None = None

    def take(self, seen: Observation) -> Trust:
        """Take in what is new, and say what is known."""
        if seen.contact is None or seen.frame is None:
            return self._trust(seen.now_ns)
        if seen.state in SILENT_STATES:  # whatever its age: the service itself knows nothing
            return self._distrusted(Trust.STALE)
        if not is_tracked(seen.contact):
            return self._distrusted(Trust.LOST)
        if seen.state in ACTED_UPON:
            self._take_record(seen.contact, seen.frame, seen.now_ns)
        return self._trust(seen.now_ns)

    def _distrusted(self, trust: Trust) -> Trust:
        """Nothing is known until another record can be believed; who is inside then may be so by a jump."""
        self.location = self._pending = None
        self.was_outside = False
        self._distrust = trust
        return trust

    def position(self, now_ns: int) -> float:
        """Return where the finger will touch, m; inf: nowhere.

        Parameters
        ----------
        now_ns : int, ns
            The instant.
        """
        if self.location is None:
            return math.inf
        bend = self.location.bend_at(now_ns, self._limits.fresh_ns)
        if not bend <= 1.0:
            return math.inf
        elapsed = 1e-9 * min(max(self.age_ns(now_ns), 0), self._limits.fresh_ns)
        # However fast it is said to drift: nothing comes nearer faster than that.
        nearest = self._path.position(self.location.bend) - self._limits.max_speed * elapsed
        return max(self._path.position(bend), nearest)

    def age_ns(self, now_ns: int) -> int:
        """Return how long ago the last pose was that is believed, ns.

        Parameters
        ----------
        now_ns : int, ns
            The instant.
        """
        return now_ns if self._pose_ns is None else now_ns - self._pose_ns

    def _trust(self, now_ns: int) -> Trust:
        if self._pose_ns is None or self._distrust is not None:
            return self._distrust or Trust.LOST
        age = now_ns - self._pose_ns
        if age >= -self._limits.future_ns:  # else the clock is another one now
            if age <= self._limits.fresh_ns:
                return Trust.FRESH
            if age <= self._limits.stale_ns:
                return Trust.OLD
        self.location = self._pending = None
        self.was_outside = False
        return Trust.STALE

    def _take_record(self, contact: Any, frame: FrameMark, now_ns: int) -> None:
        before, pose_ns = self._frame, int(contact["pose_ns"])
        if frame == before:
            return  # seen before
        self._frame = frame
        if before is None or frame.session != before.session:
            self._newest = _NONE  # another run may have another clock
        sequence, newest_ns = self._newest
        is_backward = frame.sequence <= sequence or pose_ns < newest_ns
        self._newest = max(sequence, frame.sequence), newest_ns
        if is_backward or not is_sound(contact, now_ns, self._limits.future_ns):
            self.dropped += 1
            return
        if now_ns - pose_ns > self._limits.stale_ns:
            return  # too old to tell anything
        self._take_side(contact)
        self._take_location(contact, frame.start_ns)
        self._pose_ns, self._distrust = pose_ns, None
        self._newest = frame.sequence, pose_ns
        self.reading = ContactReading.of(contact)

    def _take_side(self, contact: Any) -> None:
        """Remember whether the finger was outside of everything; a jump makes that unknown."""
        flags, distance = int(contact["flags"]), float(contact["signed_distance"])
        if flags & ContactFlag.JUMPED:
            self.was_outside = False
        if distance > 0.0 and not flags & ContactFlag.INSIDE:
            self.was_outside = True

    def _take_location(self, contact: Any, start_ns: int) -> None:
        """Take a farther position or one no nearer than is possible, at once; others when confirmed."""
        is_outside = float(contact["signed_distance"]) > 0.0
        if not is_outside and self.location is not None:
            return  # in contact, however deep: the position reported before is that of the surface
        reading = locate(contact, self._path)
        if reading is None:
            self._pending = None
            if is_outside:
                self.location = None
            return
        known = 1.0 if self.location is None else self.location.incidence
        is_near = math.isnan(reading.incidence)
        reading = replace(reading, start_ns=start_ns, incidence=known if is_near else reading.incidence)
        pending = self._pending
        is_same_pose = pending is not None and pending.pose_ns == reading.pose_ns  # this pose itself
        if self._may_follow(self.location, reading, by_pose=is_same_pose) or (
            not is_same_pose and self._may_follow(pending, reading)
        ):
            self.location, self._pending = reading, None
        else:
            if self.location is not None and not float(contact["signed_distance"]) > 0.0:
                self.was_outside = False  # a part was put where the finger is
            self._pending = reading
            self.awaited += not is_same_pose

    def _may_follow(self, before: Location | None, reading: Location, *, by_pose: bool = False) -> bool:
        """Whether a contact that was there may have come to where it is now; *by_pose*: by its pose."""
        if before is None:
            return False
        elapsed_ns = reading.pose_ns - before.pose_ns
        if not by_pose:
            elapsed_ns = max(elapsed_ns, reading.start_ns - before.start_ns)
        elapsed_ns = min(elapsed_ns, self._limits.fresh_ns)
        position = self._path.position(reading.bend)
        error = min(self._path.position(reading.bend + reading.error) - position, LARGEST_POSITION_ERROR)
        nearer = self._path.position(before.bend) - position
        return nearer <= self._limits.max_speed * 1e-9 * elapsed_ns + error
