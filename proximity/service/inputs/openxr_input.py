"""Poses of ten fingertips from hands that OpenXR tracks.

A session without graphics (XR_MND_headless), the joints of both hands (XR_EXT_hand_tracking) located for the
present instant (XR_KHR_convert_timespec_time). Positions are in the runtime's frame: metres, right-handed, y
up. pyopenxr is imported when it is needed.
"""

import ctypes
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from importlib import import_module
from typing import Any, Protocol

import numpy as np

from proximity.errors import ProximityError, ServiceError
from proximity.pose import Pose
from proximity.service.samples import FingerPoses
from proximity.system.extras import needed
from proximity.system.time_units import NS_PER_S

EXTENSIONS = ("XR_EXT_hand_tracking", "XR_MND_headless", "XR_KHR_convert_timespec_time")
JOINTS = 26
TIPS = (5, 10, 15, 20, 25)
"""Joints of thumb, index, middle, ring and little fingertip."""
FINGERS = 2 * len(TIPS)
"""Those of the left hand first."""
PERIOD = 0.004  # s between looks: hands are tracked 30 to 120 times a second


class TrackedHands(Protocol):
    """A source of fingertips: `OpenXrHands`, or calls that were recorded."""

    is_over: bool
    """Whether nothing will come any more."""

    def tips(self) -> tuple[int, np.ndarray]:
        """Return an instant, ns, and the fingertips, (10, 3) m, y up; nan: not tracked."""

    def close(self) -> None:
        """Give back what is open."""


class OpenXrHands:
    """A session with an OpenXR runtime."""

    is_over: bool
    """Whether the runtime has ended the session."""

    def __init__(self) -> None:
        self._xr = xr = _load_pyopenxr()
        self.is_over = self._is_running = False
        self._open = ExitStack()
        with ExitStack() as opened:
            try:
                missing = set(EXTENSIONS) - {
                    each.extension_name.decode() for each in xr.enumerate_instance_extension_properties()
                }
                if missing:
                    raise ServiceError(f"the OpenXR runtime lacks {', '.join(sorted(missing))}")
                self._instance = xr.create_instance(
                    xr.InstanceCreateInfo(enabled_extension_names=list(EXTENSIONS))
                )
                opened.callback(xr.destroy_instance, self._instance)
                system = xr.get_system(
                    self._instance, xr.SystemGetInfo(form_factor=xr.FormFactor.HEAD_MOUNTED_DISPLAY)
                )
                self._session = xr.create_session(self._instance, xr.SessionCreateInfo(system_id=system))
                opened.callback(xr.destroy_session, self._session)
                self._space = xr.create_reference_space(
                    self._session,
                    xr.ReferenceSpaceCreateInfo(reference_space_type=xr.ReferenceSpaceType.LOCAL),
                )
                self._trackers = []
                for hand in (xr.HandEXT.LEFT, xr.HandEXT.RIGHT):
                    tracker = xr.create_hand_tracker_ext(
                        self._session, xr.HandTrackerCreateInfoEXT(hand=hand)
                    )
                    opened.callback(xr.destroy_hand_tracker_ext, tracker)
                    self._trackers.append(tracker)
            except xr.exception.XrException as failure:
                raise ServiceError(f"OpenXR cannot be used: {failure}") from failure
            self._open = opened.pop_all()
        # pyopenxr's own function passes no room for joints, which runtimes refuse.
        self._locate = ctypes.cast(
            xr.get_instance_proc_addr(self._instance, "xrLocateHandJointsEXT"),
            xr.functions.PFN_xrLocateHandJointsEXT,
        )
        self._joints = (xr.HandJointLocationEXT * JOINTS)()
        self._locations = xr.HandJointLocationsEXT(joint_count=JOINTS, joint_locations=self._joints)
        self._needed = int(xr.SPACE_LOCATION_POSITION_VALID_BIT | xr.SPACE_LOCATION_POSITION_TRACKED_BIT)

    def tips(self) -> tuple[int, np.ndarray]:
        """Return an instant, ns, monotonic, and the fingertips then, (10, 3) m; nan where not tracked."""
        xr, positions = self._xr, np.full((FINGERS, 3), np.nan)
        try:
            self._follow_session()
            now_ns = time.monotonic_ns()
            if self._is_running:
                at = xr.HandJointsLocateInfoEXT(base_space=self._space, time=self._xr_time(now_ns))
                for row, tracker in zip((0, len(TIPS)), self._trackers, strict=True):
                    positions[row : row + len(TIPS)] = self._hand(tracker, at)
        except xr.exception.XrException as failure:
            raise ServiceError(f"OpenXR: {failure}") from failure
        return now_ns, positions

    def close(self) -> None:
        """End the session and give all handles back."""
        with suppress(self._xr.exception.XrException):
            self._open.close()

    def _hand(self, tracker: Any, at: Any) -> np.ndarray:
        result = self._xr.check_result(self._locate(tracker, at, ctypes.byref(self._locations)))
        if result.is_exception():
            raise result
        tips = np.full((len(TIPS), 3), np.nan)
        if self._locations.is_active:
            for row, joint in enumerate(TIPS):
                found = self._joints[joint]
                if int(found.location_flags) & self._needed == self._needed:
                    tips[row] = found.pose.position.x, found.pose.position.y, found.pose.position.z
        return tips

    def _xr_time(self, now_ns: int) -> Any:
        seconds, rest = divmod(now_ns, NS_PER_S)
        instant = self._xr.timespec(seconds, rest)
        return self._xr.convert_timespec_time_to_time_khr(self._instance, instant)

    def _follow_session(self) -> None:
        """Begin and end the session as the runtime asks for."""
        xr = self._xr
        while True:
            try:
                event = xr.poll_event(self._instance)
            except xr.EventUnavailable:
                return
            if xr.StructureType(event.type) != xr.StructureType.EVENT_DATA_SESSION_STATE_CHANGED:
                continue
            changed = ctypes.cast(ctypes.byref(event), ctypes.POINTER(xr.EventDataSessionStateChanged))
            state = xr.SessionState(changed.contents.state)
            if state == xr.SessionState.READY:
                xr.begin_session(
                    self._session,
                    xr.SessionBeginInfo(
                        primary_view_configuration_type=xr.ViewConfigurationType.PRIMARY_STEREO
                    ),
                )
                self._is_running = True
            elif state == xr.SessionState.STOPPING:
                xr.end_session(self._session)
                self._is_running = False
            elif state in (xr.SessionState.EXITING, xr.SessionState.LOSS_PENDING):
                self.is_over = True


class OpenXrInput:
    """Fingertips of both hands, thumb to little finger, the left hand first.

    A thread looks every 4 ms, since a call into a runtime may take longer than a tick. Fingertips that are
    exactly where they were are no new sample: a runtime that repeats its last one would make fingers stand.

    *scene_from_openxr*: where the runtime's origin is in the scene, and how its axes are turned. *count*: of
    fingers that are served; more than ten are never tracked.
    """

    is_over: bool
    address = "OpenXR"

    def __init__(
        self, scene_from_openxr: Pose, count: int, *, open_hands: Callable[[], TrackedHands] = OpenXrHands
    ) -> None:
        self._scene_from_openxr = scene_from_openxr
        self.is_over = False
        self._hands = open_hands()
        self._poses = FingerPoses(count)
        self._rows = min(count, FINGERS)
        self._latest: tuple[int, np.ndarray] | None = None  # replaced as a whole by the thread
        self._failure_count, self._first_failure = 0, ""
        self._has_ended, self._is_new = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._look, name="openxr", daemon=True)
        self._thread.start()

    @property
    def notes(self) -> list[str]:
        """A sentence on calls that failed."""
        if not self._failure_count:
            return []
        return [f"OpenXR failed {self._failure_count} times, first: {self._first_failure}"]

    def poll(self, now_ns: int) -> Iterator[FingerPoses]:
        """Give the newest fingertips, unless they are those given before."""
        latest, self._latest = self._latest, None
        if latest is not None:
            pose_ns, positions = latest
            self._poses.pose_ns[: self._rows] = pose_ns
            self._poses.positions[: self._rows] = positions[: self._rows]
            yield self._poses

    def wait(self, timeout: float) -> None:
        """Wait for fingertips that are new, or that many seconds."""
        self._is_new.wait(timeout)
        self._is_new.clear()

    def close(self) -> None:
        """End the thread and the session."""
        self._has_ended.set()
        self._thread.join()
        self._hands.close()

    def _look(self) -> None:
        before = np.full((FINGERS, 3), np.inf)
        while not self._has_ended.wait(PERIOD) and not self._hands.is_over:
            try:
                pose_ns, tips = self._hands.tips()
            except ProximityError as failure:
                self._failure_count += 1
                self._first_failure = self._first_failure or str(failure)
                continue
            if not np.array_equal(tips, before, equal_nan=True):
                self._latest = pose_ns, self._scene_from_openxr.point(tips)
                self._is_new.set()
                before = tips
        self.is_over = True


def _load_pyopenxr() -> Any:
    if sys.platform != "linux":
        raise ServiceError("input.openxr works on Linux only, where OpenXR uses the monotonic clock")
    with needed("input.openxr needs", "openxr"):
        return import_module("xr")
