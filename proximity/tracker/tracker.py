"""Trackers: every tick, signed distances with bounds, predictions, time and location of contact."""

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np

from proximity import native
from proximity.checks import as_float64, not_negative, positive, whole
from proximity.errors import ArgumentError
from proximity.kernels import layout
from proximity.kernels.layout import NO_PART, NO_SLOT
from proximity.kernels.tracking import track
from proximity.kernels.tracking.motion import MAX_ACCELERATION, MAX_SPEED
from proximity.kernels.tracking.part_drift import POSE_COLUMNS, movers_workspace
from proximity.kernels.tracking.tick import DONE, tick
from proximity.kernels.tracking.track import EACH_ITS_OWN, MOST_NS
from proximity.message import CONTACT
from proximity.message.contact import Contacts
from proximity.message.envelope import MAX_FUTURE_NS
from proximity.message.instant_advice import OTHER_CLOCK_NS
from proximity.scene.model.assembly import Model
from proximity.scene.scene import Scene
from proximity.tracker.finger_arrays import arrays_for
from proximity.tracker.pose_notes import PoseNotes
from proximity.tracker.tracker_arguments import (
    LARGEST_WORKING_RANGE,
    LONGEST_LATENCY,
    instant,
    instants,
    radii,
    shaped,
    too_long,
)

DEFAULT_BUDGET = 250
"""Nodes and leaves a finger and tick. Near CAD parts a walk takes 10 to 60, near free forms 3 in 100 000 take
more than these. At the centre of a ball of 1.3 M faces they take 13 to 28 µs, as fast as the memory is, and
bound the distance within 4.1 %. With 350 it is 2.5 %, but on a busy machine one tick in a hundred of five
fingers there took longer than 0.2 ms then; with 175 it is 6.4 %."""
MOST = 2**31 - 1
"""Nodes and leaves: more than any scene has."""
GONE = -2
"""Part of the last answer that is not in the scene any more."""
SHORTEST_NS = 1000
"""From one tick to another, and from a clock's 0 to the first: a tick takes longer."""
EARLY_NS = 100_000
"""Instants below are seconds where the other instant of the tick is more than `OTHER_CLOCK_NS` away."""
LARGEST_SECONDS = 10_000_000_000
"""No clock or calendar shows as many."""
HORIZON = 0.25
"""s. A drum needs less than a tenth of a second to arrive."""

NOT_NANOSECONDS = "expected nanoseconds, as time.monotonic_ns() gives them: it looks like seconds"

_tick = native.lenient("tick")


class Tracker:
    """Distances, predictions and contacts for the controller of a haptic glove: every fingertip, every tick.

    Parameters
    ----------
    scene : Scene
        Its parts may be moved, added, removed, hidden or deformed between ticks.
    fingers : int
        How many fingertips.
    radius : float or (fingers,) floats, m
        Of the fingertip spheres, 0.1 at most; 0 is a point, whose contact with a sheet (which has no
        inside) is predicted on its path but never confirmed.
    period : float, s
        Time between ticks; only returned by the property `period`.
    latency : float, s
        From a tick until the controller acts on its answer, 0 to 1: predictions are for that instant.
    budget : int
        Largest number of nodes and leaves visited per finger and tick, without a few for the side and the
        path. None: 250, which keeps any tick of five fingers below 0.2 ms. All fingers together have 20
        budgets for distances (eight if there are thousands) and four for predictions. If that is not
        enough, fingers take turns, and the bounds of all differ by the same share of their distance, as
        small as possible.
    working_range : float, m
        10 at most. At a larger distance only bounds are computed.
    tolerance : float
        Share of its distance by which the bounds of a finger may differ. 0: exact at every tick. 0.05 suits
        skins of thousands of points: most answers then follow from the tick before, and searches end
        earlier.
    horizon : float, s
        Contacts are predicted up to this time ahead.
    max_speed : float, m/s
        A finger that seems faster than this is treated as a tracking jump.
    max_acceleration : float, m/s²
        Largest acceleration of a fingertip: bounds of predictions hold as long as neither is exceeded.

    Raises
    ------
    ArgumentError
        If an argument cannot be used; the message names it and what was expected.

    Notes
    -----
    Thread: a tick releases the interpreter lock. One thread ticks a tracker; any thread may move parts
    meanwhile.
    Source: conservative advancement after Mirtich 1996.
    """

    contacts: Contacts  # (fingers,) CONTACT, filled anew by each tick

    def __init__(
        self,
        scene: Scene,
        *,
        fingers: int = 5,
        radius: Any = 0.007,
        period: float = 0.001,
        latency: float = 0.001,
        budget: int | None = None,
        working_range: float = 0.12,
        tolerance: float = 0.0,
        horizon: float = HORIZON,
        max_speed: float = MAX_SPEED,
        max_acceleration: float = MAX_ACCELERATION,
    ) -> None:
        if not isinstance(scene, Scene):
            raise ArgumentError(f"a tracker looks at a Scene, not at a {type(scene).__name__}")
        count = whole("fingers", fingers)
        self._scene = scene
        self._period = positive("period", period, "seconds")
        self.contacts = np.zeros(count, CONTACT).view(Contacts)
        settings = np.zeros(track.SETTING_COUNT)
        reach = not_negative("working_range", working_range, "metres")
        if reach > LARGEST_WORKING_RANGE:
            raise ArgumentError(f"working_range is {too_long(reach, LARGEST_WORKING_RANGE)}")
        settings[track.SETTING_WORKING_RANGE] = reach
        settings[track.SETTING_LATENCY] = not_negative("latency", latency, "seconds", most=LONGEST_LATENCY)
        settings[track.SETTING_TOLERANCE] = not_negative("tolerance", tolerance, "shares")
        settings[track.SETTING_HORIZON] = positive("horizon", horizon, "seconds")
        settings[track.SETTING_MAX_SPEED] = positive("max_speed", max_speed, "metres a second")
        settings[track.SETTING_MAX_ACCELERATION] = positive("max_acceleration", max_acceleration, "m/s²")
        wanted = DEFAULT_BUDGET if budget is None else whole("budget", budget)
        settings[track.SETTING_BUDGET] = min(wanted, MOST)
        settings[track.SETTING_AHEAD_NS] = MAX_FUTURE_NS
        settings[track.SETTING_OTHER_CLOCK_NS] = OTHER_CLOCK_NS
        self._settings = settings
        self._pose_notes = PoseNotes()
        self._shape, self._arrays = (count, 3), arrays_for(count, settings)
        self._pose_ns = self._arrays["pose_ns"]
        self._velocities = self._arrays["velocities"]
        self._arrays["tracks"][:, track.TRACK_RADIUS] = radii(radius, count)
        # Not the model itself: what trackers hold on to, a scene could not write its next one to.
        self._last_model: Callable[[], Model | None] = lambda: None
        self._last_now_ns = -MOST_NS  # of the last tick
        self._last_epoch = -1  # of the parts and faces in `contacts`
        self._has_velocities = self._has_paths = False
        self._path_count = 2  # corners of paths that the arrays hold
        self._epoch = -1
        self._names: tuple[str, ...] = ()  # of the parts that `REPORTED_PART` counts
        self.reset()
        self._pack()

    @property
    def scene(self) -> Scene:
        """The scene. For another scene, make another tracker."""
        return self._scene

    @property
    def period(self) -> float:
        """Time between ticks, s, as given to the tracker."""
        return self._period

    @property
    def latency(self) -> float:
        """From a tick until the instant that predictions are for, s, as given to the tracker."""
        return float(self._settings[track.SETTING_LATENCY])

    @property
    def notes(self) -> list[str]:
        """Sentences on poses that were probably meant otherwise: of another clock, or in millimetres."""
        return list(self._pose_notes.sentences)

    def __reduce__(self) -> tuple[Any, ...]:
        raise ArgumentError(
            "a tracker cannot be copied, because its state depends on its ticks: make a new one of its scene"
        )

    def tick(
        self,
        positions: Any,
        t_pose_ns: Any,
        now_ns: int,
        *,
        velocities: Any = None,
        paths: Any = None,
        path_bends: Any = None,
        bends: Any = None,
    ) -> Contacts:
        """Answer for all fingers.

        Parameters
        ----------
        positions : (fingers, 3) float64, m, scene's frame
            Centres of the fingertips. A row that is not finite is a finger that is not tracked: its record
            says so, and the others are answered. Do not write to the array during the tick.
        t_pose_ns : int or (fingers,) int64, ns
            Instant of the positions, on the clock of *now_ns*. The same instant again does not change the
            velocity; an earlier one is a jump. A finger whose instant is more than a second from *now_ns* is
            not tracked: it is of another clock, and `notes` says so.
        now_ns : int, ns
            Instant of the tick, as `time.monotonic_ns` gives it.
        velocities : (fingers, 3) float64, m/s
            Velocities, if they are known better than from the poses. Rows that are not finite are
            estimated.
        paths : (fingers, K, 3) float64, m, scene's frame
            Path of each fingertip as the finger bends: the corners of a polyline. A finger whose first
            corner is not finite has no path.
        path_bends : (K,) float64
            Bend at each corner, increasing. Default: evenly from 0 to 1.
        bends : (fingers,) float64
            Bend of each finger at its pose. Default: that of the nearest position on the path.

        Returns
        -------
        (fingers,) CONTACT
            The same array at each tick: copy what you need after the next tick.

        Raises
        ------
        ArgumentError
            If shapes or types do not fit, bends are given without paths, or instants are obviously seconds.
            No value that a sensor may deliver raises an error.

        Notes
        -----
        Sign: as `Scene.signed_distance`, minus the radius.
        Cost: some 10 µs for five fingers near parts of 100 k faces.
        """
        if velocities is not None or self._has_velocities:
            self._take_velocities(velocities)
        if paths is not None or self._has_paths or bends is not None or path_bends is not None:
            self._take_paths(paths, path_bends, bends)
        # That parts have moved is reported until a tick has taken it in, even if someone interrupts this one.
        model = self._scene.snapshot()
        is_moved = model is not self._last_model()
        if is_moved:
            self._take_over(model)
        try:
            # As they nearly always are; what the positions are, and which instants, compiled code looks at.
            answer = (
                type(t_pose_ns) is type(now_ns) is int
                and t_pose_ns >= EARLY_NS
                and now_ns >= EARLY_NS
                and now_ns - self._last_now_ns >= SHORTEST_NS
                and _tick(model.packed, self._packed, positions, t_pose_ns, now_ns, is_moved)
            )
        except OverflowError:
            answer = False
        if answer != DONE:
            if answer is NotImplemented or not answer:
                answer, now_ns = self._tick(model, positions, t_pose_ns, now_ns, is_moved)
            self._pose_notes.add(answer, self.contacts, model)
        self._last_now_ns = now_ns
        if is_moved:
            self._last_model, self._last_epoch = weakref.ref(model), model.epoch
        return self.contacts

    def _tick(
        self, model: Model, positions: Any, t_pose_ns: Any, now_ns: Any, is_moved: bool
    ) -> tuple[int, int]:
        """Check the arguments, and tick; what that answers, and its instant."""
        rows = as_float64(shaped(positions, "positions", self._shape), "positions")
        if type(t_pose_ns) is not int or not -MOST_NS <= t_pose_ns <= MOST_NS:
            self._pose_ns[...] = instants(t_pose_ns, self._shape[0])
            t_pose_ns = EACH_ITS_OWN
        now = instant(now_ns)
        self._refuse_seconds(t_pose_ns, now)
        return tick(model.packed, self._packed, rows, t_pose_ns, now, is_moved), now

    def _refuse_seconds(self, t_pose_ns: int, now_ns: int) -> None:
        """Refuse instants, of the poses and of the tick, that no clock shows in nanoseconds."""
        pose_ns = self._pose_ns.item(0) if t_pose_ns == EACH_ITS_OWN else t_pose_ns
        is_apart = abs(now_ns - pose_ns) > OTHER_CLOCK_NS
        is_too_soon = 0 < now_ns - self._last_now_ns < SHORTEST_NS and 0 < now_ns < LARGEST_SECONDS
        if 0 < now_ns < (EARLY_NS if is_apart else SHORTEST_NS) or is_too_soon:
            raise ArgumentError(f"now_ns is {now_ns}, {NOT_NANOSECONDS}")
        if is_apart and 0 < pose_ns < EARLY_NS:
            if t_pose_ns == EACH_ITS_OWN and self._pose_ns.max() >= EARLY_NS:
                return  # of one finger alone it may be a fault of its sensor
            raise ArgumentError(f"t_pose_ns is {pose_ns}, {NOT_NANOSECONDS}")

    @property
    def epoch(self) -> int:
        """Epoch of the scene at the last tick, to which parts and faces in contacts refer; -1 before it."""
        return self._last_epoch

    def reset(self) -> None:
        """Forget all fingers: the next tick is treated as the first."""
        self._arrays["motions"][:] = 0.0
        self._arrays["motion_marks"][:] = 0
        self._arrays["marks"][:, track.TRACK_REPORTED_PART] = NO_PART
        self._last_now_ns = -MOST_NS
        self._settings[track.SETTING_FIRST_FINGER] = self._settings[track.SETTING_ADAPTIVE_TOLERANCE] = 0
        self._forget()

    def _forget(self) -> None:
        """Forget what was known of surfaces."""
        track.forget_surfaces(self._arrays["tracks"], self._arrays["balls"])
        marks = self._arrays["marks"]
        marks[:, track.TRACK_SLOT], marks[:, track.TRACK_PART] = NO_SLOT, NO_PART
        marks[:, track.TRACK_IS_OUTSIDE] = marks[:, track.TRACK_FRONTIER_COUNT] = 0

    def _take_over(self, model: Model) -> None:
        """Look at *model* from now on; parts that changed in more than their pose are looked at anew.

        Whoever interrupts this has it done again: that it is done is written last.
        """
        if model.epoch != self._epoch:
            self._forget()
            self._find_again(model.names)
            count = len(model.parts) - 1
            signs, grids = model.parts[:count, layout.PART_SIGN], model.parts[:count, layout.PART_GRID]
            is_open = (signs == layout.SIGN_WINDING) & (grids == layout.NO_GRID)
            self._settings[track.SETTING_HAS_HOLES] = is_open.any()
            first, end = layout.FRAME_ROTATION, layout.FRAME_ROTATION + POSE_COLUMNS
            self._arrays["before"] = model.frames[:count, first:end].copy()
            self._arrays["movers"] = movers_workspace(count)
            self._pack()
            self._epoch = model.epoch

    def _find_again(self, names: tuple[str, ...]) -> None:
        """Write what the parts of the last answers are numbered now; one that is gone is another than all."""
        if names != self._names:
            rows = {name: row for row, name in enumerate(names)}
            reported = self._arrays["marks"][:, track.TRACK_REPORTED_PART]
            found = [rows.get(self._names[row], GONE) if row >= 0 else row for row in reported.tolist()]
            reported[:], self._names = found, names

    def _pack(self) -> None:
        """Have ticks find the arrays that there are now."""
        records = self.contacts.view(np.ndarray)
        shape = len(records), -1
        views: dict[str, np.ndarray] = {
            "records": records.view(np.float64).reshape(shape),
            "wide": records.view(np.int64).reshape(shape),
            "numbers": records.view(np.int32).reshape(shape),
        }
        self._packed: Any = native.packed(track.TrackerArrays(**(self._arrays | views)))

    def _take_velocities(self, velocities: Any) -> None:
        self._has_velocities = True  # until it is known that there are none
        if velocities is not None:
            self._velocities[...] = shaped(velocities, "velocities", self._shape)
        self._settings[track.SETTING_HAS_VELOCITIES] = velocities is not None
        self._has_velocities = velocities is not None

    def _take_paths(self, paths: Any, path_bends: Any, bends: Any) -> None:
        self._has_paths = True  # until it is known that there are none
        if paths is None:
            self._settings[track.SETTING_HAS_PATHS] = self._has_paths = False
            if bends is not None or path_bends is not None:
                raise ArgumentError("path_bends are given without paths")
            return
        expected = f"({len(self.contacts)}, K, 3) with K of 2 or more"
        corners = as_float64(paths, "values of paths", expected=f"numbers of shape {expected}")
        if corners.ndim != 3 or corners.shape[::2] != self._shape or corners.shape[1] < 2:
            raise ArgumentError(f"paths have shape {corners.shape}, expected {expected}")
        count = corners.shape[1]
        arrays = self._arrays
        if self._path_count != count:
            self._path_count = 0  # until arrays hold so many
            arrays["paths"] = np.empty((len(self.contacts), count, 3))
            arrays["path_bends"] = np.linspace(0.0, 1.0, count)
            arrays["path_lengths"] = np.zeros(count)
            self._pack()
            self._path_count = count
        arrays["paths"][...] = corners
        if path_bends is None:
            arrays["path_bends"][:] = np.linspace(0.0, 1.0, count)
        else:
            given = shaped(path_bends, "path_bends", (count,))
            if not (np.isfinite(given).all() and (np.diff(given) > 0.0).all()):
                raise ArgumentError(
                    "path_bends do not increase, or are not finite, expected the bend at each corner"
                )
            arrays["path_bends"][:] = given
        arrays["bends"][:] = np.nan if bends is None else shaped(bends, "bends", (len(self.contacts),))
        self._settings[track.SETTING_HAS_PATHS] = True

    def __repr__(self) -> str:
        return f"Tracker({self.scene!r}, {len(self.contacts)} fingers)"
