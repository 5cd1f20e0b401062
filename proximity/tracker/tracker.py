"""Trackers: at every tick, signed distances with bounds, predictions, time and location of contact."""

import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from proximity import native
from proximity.checks import is_whole, positive, whole
from proximity.errors import ArgumentError
from proximity.kernels.contact_record import CONTACT_RECORD
from proximity.kernels.layout import NO_PART, PART
from proximity.kernels.tracking import track
from proximity.kernels.tracking.motion import MAX_ACCELERATION, MAX_SPEED
from proximity.kernels.tracking.part_drift import POSE_COLUMNS, movers_workspace
from proximity.kernels.tracking.tick import DONE, NOT_DONE, tick
from proximity.kernels.tracking.track import MAX_NS
from proximity.message import CONTACT
from proximity.message.contact import Contacts
from proximity.scene.model.assembly import Model
from proximity.scene.scene import Scene
from proximity.tracker.tracker_arguments import (
    EARLY_NS,
    SHORTEST_NS,
    PoseNotes,
    as_instants,
    as_nanoseconds,
    as_path_bends,
    as_paths,
    as_radii,
    as_shape,
    ignoring_none,
    new_arrays,
    new_settings,
    refuse_seconds,
)

GONE = -2
"""Part of a last answer that is no longer in the scene."""
HORIZON = 0.25
"""s. A drum needs less than a tenth of a second to arrive."""

_Given = tuple[np.ndarray | None, np.ndarray | None, np.ndarray | None, np.ndarray | None]
"""Velocities, paths, bends at their corners, and bends, as a tick reads them."""
NOTHING_GIVEN: _Given = (None, None, None, None)
MAX_PACKS = 8  # in the cache


class Tracker:
    """Distances, predictions and contacts of all fingertips at every tick, for a haptic glove's controller.

    Parameters
    ----------
    scene : Scene
        Its parts may be moved, added, removed, hidden or deformed between ticks.
    fingers : int
        Number of fingertips.
    radius : float or (fingers,) floats, m
        Of the fingertip spheres, 0.1 at most; 0 is a point, whose contact with a sheet (which has no
        inside) is predicted on its path but never confirmed.
    period : float, s
        Time between ticks; only returned by the property `period`.
    latency : float, s
        Time from a tick until the controller acts on its answer, 0 to 1: predictions are for that instant.
    budget : int
        Largest number of nodes and leaves visited per finger and tick, plus a few for the sign and the path.
        None: 250, which keeps any tick of five fingers below 0.2 ms. All fingers together have 20 budgets for
        distances (eight if there are thousands) and four for predictions. If that is not enough, fingers take
        turns, and the bounds of all have the same, smallest possible relative difference.
    working_range : float, m
        10 at most. At a larger distance only bounds are computed.
    tolerance : float
        Relative tolerance of the bounds of a finger. 0: exact at every tick. 0.05 suits skins of thousands of
        points: most answers then follow from the tick before, and searches end earlier.
    horizon : float, s
        Contacts are predicted up to this time ahead.
    max_speed : float, m/s
        A faster finger is treated as a tracking jump.
    max_acceleration : float, m/s²
        Largest acceleration of a fingertip: bounds of predictions hold while neither maximum is exceeded.

    Raises
    ------
    ArgumentError
        If an argument cannot be used; the message names it and the expected value.

    Notes
    -----
    Thread: a tick releases the interpreter lock. One thread ticks a tracker; any thread may move parts during
    a tick.
    Source: conservative advancement after Mirtich 1996.
    """

    contacts: Contacts  # (fingers,) CONTACT, overwritten by each tick

    def __init__(
        self,
        scene: Scene,
        *,
        fingers: int = 5,
        radius: npt.ArrayLike = 0.007,
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
        settings = new_settings(
            budget, working_range, latency, tolerance, horizon, max_speed, max_acceleration
        )
        self._settings = settings
        self._has_velocities, self._has_paths = settings["has_velocities"], settings["has_paths"]
        self._pose_notes = PoseNotes()
        self._shape, self._arrays = (count, 3), new_arrays(count, settings)
        self._arrays["tracks"]["radius"] = as_radii(radius, count)
        self._pose_ns = np.zeros(count, np.int64)  # of `tick`
        self._copies: dict[str, np.ndarray] = {}  # of the arguments of `tick`, by name
        self._given: _Given | None = None  # arrays read by ticks; None: they are being exchanged
        self._packs: dict[tuple[int, ...], tuple[_Given, Any]] = {}  # by the arrays they read
        # A weak reference: the scene cannot overwrite a model that a tracker keeps alive.
        self._last_model: Callable[[], Model | None] = lambda: None
        self._last_now_ns = -MAX_NS  # of the last tick
        self._last_epoch = -1  # of the parts and faces in `contacts`
        self._epoch = -1
        self._names: tuple[str, ...] = ()  # of the parts to which `reported_part` refers
        self._ignored: dict[int, set[str]] = {}  # names of parts that fingers ignore
        self.reset()
        self._read_from(NOTHING_GIVEN)

    @property
    def scene(self) -> Scene:
        """The scene. Another scene needs another tracker."""
        return self._scene

    @property
    def period(self) -> float:
        """Time between ticks, s, as given to the tracker."""
        return self._period

    @property
    def latency(self) -> float:
        """Time from a tick to the instant of its predictions, s, as given to the tracker."""
        return self._settings["latency"].item()

    @property
    def notes(self) -> list[str]:
        """Notes on poses that are probably of another clock or in millimetres."""
        return list(self._pose_notes.sentences)

    def __reduce__(self) -> tuple[Any, ...]:
        raise ArgumentError(
            "a tracker cannot be copied, because its state depends on its ticks: make a new one of its scene"
        )

    def tick(
        self,
        positions: npt.ArrayLike,
        t_pose_ns: npt.ArrayLike,
        now_ns: int,
        *,
        velocities: npt.ArrayLike | None = None,
        paths: npt.ArrayLike | None = None,
        path_bends: npt.ArrayLike | None = None,
        bends: npt.ArrayLike | None = None,
    ) -> Contacts:
        """Return the contacts of all fingers.

        Parameters
        ----------
        positions : (fingers, 3) float64, m, scene's frame
            Centres of the fingertips. A row that is not finite marks a finger that is not tracked, also in
            its record; the others are answered. Do not write to the array during the tick.
        t_pose_ns : int or (fingers,) int64, ns
            Instant of the positions, on the clock of *now_ns*. Repeating an instant does not change the
            velocity; an earlier one is a jump. A finger whose instant is more than a second from *now_ns* is
            not tracked, and `notes` reports another clock.
        now_ns : int, ns
            Instant of the tick, as `time.monotonic_ns` gives it.
        velocities : (fingers, 3) float64, m/s
            Velocities, if more accurate ones are known than from the poses. Rows that are not finite are
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
            The same array at each tick: copy values needed after the next tick.

        Raises
        ------
        ArgumentError
            If shapes or types do not fit, bends are given without paths, or instants are obviously seconds.
            No value that a sensor may deliver raises an error.

        Notes
        -----
        Sign: as `Scene.signed_distance`, minus the radius.
        Cost: 10 µs for five fingers near parts of 100 k faces.
        """
        if velocities is not None:
            velocities = self._copied("velocities", as_shape(velocities, "velocities", self._shape))
        if paths is not None:
            paths = self._copied("paths", as_paths(paths, len(self._pose_ns)))
            path_bends = self._copied("path_bends", as_path_bends(path_bends, paths.shape[1]))
            if bends is not None:
                bends = self._copied("bends", as_shape(bends, "bends", self._pose_ns.shape))
        elif bends is not None or path_bends is not None:
            raise ArgumentError("path_bends are given without paths")
        rows = as_shape(positions, "positions", self._shape)
        # The usual case.
        if (
            type(t_pose_ns) is type(now_ns) is int
            and EARLY_NS <= t_pose_ns <= MAX_NS
            and EARLY_NS <= now_ns <= MAX_NS
            and now_ns - self._last_now_ns >= SHORTEST_NS
        ):
            self._pose_ns.fill(t_pose_ns)
        else:
            self._pose_ns[...] = as_instants(t_pose_ns, len(self._pose_ns))
            now_ns = as_nanoseconds(now_ns)
            refuse_seconds(self._pose_ns, now_ns, self._last_now_ns)
        return self.advance(
            rows,
            self._pose_ns,
            now_ns,
            velocities=velocities,
            paths=paths,
            path_bends=path_bends,
            bends=bends,
        )

    def advance(
        self,
        positions: np.ndarray,
        pose_ns: np.ndarray,
        now_ns: int,
        *,
        velocities: np.ndarray | None = None,
        paths: np.ndarray | None = None,
        path_bends: np.ndarray | None = None,
        bends: np.ndarray | None = None,
    ) -> Contacts:
        """Run `tick` without validation.

        All arrays are contiguous and exactly of the types below. They are not copied; ticks are fastest with
        the same arrays each time.

        Parameters
        ----------
        positions : (fingers, 3) float64, m, scene's frame
            Centres of the fingertips; nan: not tracked.
        pose_ns : (fingers,) int64, ns
            Instants of the positions, within 2**62.
        now_ns : int, ns
            Instant of the tick, within 2**62.
        velocities, paths, path_bends, bends : float64
            As of `tick`.

        Returns
        -------
        (fingers,) CONTACT
            The same array at each tick.

        Raises
        ------
        ArgumentError, TypeError
            If the number of positions or instants is not that of fingers, or an array has another type or
            layout.
        """
        v, p, b, own = self._given or (self,) * 4  # differs from any argument
        if velocities is not v or paths is not p or path_bends is not b or bends is not own:
            self._read_from((velocities, paths, path_bends, bends))
        # Moved parts are reported until a tick has processed them, even if a tick is interrupted.
        model = self._scene.snapshot()
        is_moved = model is not self._last_model()
        if is_moved:
            self._adopt_model(model)
        answer = tick(model.packed, self._packed, positions, pose_ns, now_ns, is_moved)
        if answer != DONE:
            if answer == NOT_DONE:
                raise ArgumentError(
                    f"{len(positions)} positions and {len(pose_ns)} instants, expected {len(self.contacts)}"
                )
            self._pose_notes.add(answer, self.contacts, model)
        self._last_now_ns = now_ns
        if is_moved:
            self._last_model, self._last_epoch = weakref.ref(model), model.epoch
        return self.contacts

    def write_to(self, contacts: np.ndarray) -> None:
        """Make ticks write other records, such as those of a message; `contacts` is a view of them.

        Parameters
        ----------
        contacts : (fingers,) CONTACT
            Contiguous.
        """
        self.contacts = contacts.view(Contacts)
        self._packs.clear()
        self._read_from(self._given or NOTHING_GIVEN)

    @property
    def epoch(self) -> int:
        """Epoch of the scene at the last tick, of the parts and faces in contacts; -1 before it."""
        return self._last_epoch

    def reset(self) -> None:
        """Reset all fingers: the next tick is treated as the first."""
        self._arrays["motions"][:] = 0
        self._arrays["tracks"]["reported_part"] = NO_PART
        self._last_now_ns = -MAX_NS
        self._settings["first_finger"] = self._settings["adaptive_tolerance"] = 0
        track.forget_surfaces(self._arrays["tracks"], self._arrays["balls"])

    def ignore(self, finger: int, part: str | int, is_ignored: bool = True) -> None:
        """Exclude a part, such as one that the hand holds, from the contacts of a finger.

        This takes effect at the next tick. Other fingers, trackers and queries are not affected. The part
        stays ignored when it is moved, hidden, shown or deformed, and after `reset`; removing it ends that.

        Parameters
        ----------
        finger : int
            Number of the finger.
        part : str or int
            Name or index of the part.
        is_ignored : bool
            False: the finger is tracked against the part again.

        Raises
        ------
        ArgumentError
            If there is no such finger.
        SceneError
            If there is no such part.
        """
        if not is_whole(finger, 0) or finger >= len(self.contacts):
            raise ArgumentError(f"finger is {finger!r}, expected 0 to {len(self.contacts) - 1}")
        name, names = self._scene.part(part).name, self._ignored.setdefault(int(finger), set())
        if (name in names) == bool(is_ignored):
            return
        (names.add if is_ignored else names.discard)(name)
        row = slice(finger, finger + 1)
        track.forget_surfaces(self._arrays["tracks"][row], self._arrays["balls"][row])
        self._write_ignored()
        self._packs.clear()
        self._read_from(self._given or NOTHING_GIVEN)

    def _write_ignored(self) -> None:
        """Write which parts each finger ignores, of those at the last tick."""
        rows = {name: row for row, name in enumerate(self._names)}
        count = len(self.contacts)
        self._arrays |= ignoring_none(count)
        if any(self._ignored.values()) and rows:
            ignored = self._arrays["ignored"] = np.zeros((count, len(rows)), np.bool_)
            self._arrays["heeded"] = np.zeros(len(rows) + 1, PART)
            for finger, names in self._ignored.items():
                ignored[finger, [rows[name] for name in names if name in rows]] = True

    def _adopt_model(self, model: Model) -> None:
        """Switch to *model*; its epoch is written last, so that an interrupted switch is repeated."""
        if model.epoch != self._epoch:
            self._renumber_parts(model.names)
            count = len(model.parts) - 1
            self._arrays["before"] = np.empty((count, POSE_COLUMNS))
            self._arrays["movers"] = movers_workspace(count)
            self._write_ignored()
            self._packs.clear()
            self._read_from(self._given or NOTHING_GIVEN)
            track.adopt_parts(model.packed, self._packed)
            self._epoch = model.epoch

    def _renumber_parts(self, names: tuple[str, ...]) -> None:
        """Update the part rows in the last answers; `GONE` for a part that was removed."""
        if names != self._names:
            rows = {name: row for row, name in enumerate(names)}
            reported = self._arrays["tracks"]["reported_part"]
            found = [rows.get(self._names[row], GONE) if row >= 0 else row for row in reported.tolist()]
            reported[:], self._names = found, names
            self._ignored = {finger: known & rows.keys() for finger, known in self._ignored.items()}

    def _pack(self) -> None:
        """Pack the present arrays for ticks."""
        records = self.contacts.view(np.ndarray).view(CONTACT_RECORD)
        self._packed: Any = native.packed(track.TrackerArrays(**self._arrays, records=records))

    def _copied(self, name: str, values: np.ndarray) -> np.ndarray:
        """Return a copy of the values, in the same array at each tick while the shape stays."""
        copy = self._copies.get(name)
        if copy is None or copy.shape != values.shape:
            copy = self._copies[name] = np.empty(values.shape)
        copy[...] = values
        return copy

    def _read_from(self, given: _Given) -> None:
        """Set the arrays that ticks read; callers may alternate between several sets."""
        self._given = None
        velocities, paths, path_bends, bends = given
        arrays = self._arrays
        self._has_velocities[0], self._has_paths[0] = velocities is not None, paths is not None
        key = id(velocities), id(paths), id(path_bends), id(bends)
        if key not in self._packs:
            if len(self._packs) == MAX_PACKS:
                self._packs.clear()
            if velocities is not None:
                arrays["velocities"] = velocities
            if paths is not None:
                count = paths.shape[1]
                arrays["paths"], arrays["path_lengths"] = paths, np.zeros(count)
                arrays["path_bends"] = np.linspace(0.0, 1.0, count) if path_bends is None else path_bends
                arrays["bends"] = np.full(len(self.contacts), np.nan) if bends is None else bends
            self._pack()
            self._packs[key] = given, self._packed
        self._packed = self._packs[key][1]
        self._given = given

    def __repr__(self) -> str:
        return f"Tracker({self.scene!r}, {len(self.contacts)} fingers)"


def arrays_of(tracker: Tracker, *given: np.ndarray) -> tuple[Model, track.TrackerArrays]:
    """Return the model and the arrays for a compiled loop that ticks instead of the tracker.

    *given*: velocities, paths, bends at their corners, and bends.
    """
    model = tracker._scene.snapshot()
    if model is not tracker._last_model():
        tracker._adopt_model(model)
        tracker._last_model, tracker._last_epoch = weakref.ref(model), model.epoch
    tracker._read_from(given)  # type: ignore[arg-type]
    records = tracker.contacts.view(np.ndarray).view(CONTACT_RECORD)
    return model, track.TrackerArrays(**tracker._arrays, records=records)


def arrays_after(tracker: Tracker, model: Model) -> tuple[track.TrackerArrays, np.ndarray]:
    """Return the arrays of such a loop once its scene has other parts, and their rows by previous rows."""
    count, rows = len(model.parts) - 1, {name: row for row, name in enumerate(model.names)}
    rows_after = np.array([rows.get(name, GONE) for name in tracker._names], np.int64)
    tracker._arrays["before"] = np.empty((count, POSE_COLUMNS))
    tracker._arrays["movers"] = movers_workspace(count)
    tracker._packs.clear()
    tracker._names, tracker._epoch, tracker._last_epoch = model.names, model.epoch, model.epoch
    tracker._ignored = {finger: known & rows.keys() for finger, known in tracker._ignored.items()}
    tracker._write_ignored()
    records = tracker.contacts.view(np.ndarray).view(CONTACT_RECORD)
    return track.TrackerArrays(**tracker._arrays, records=records), rows_after


def note_answers(tracker: Tracker, answers: int) -> None:
    """Record the notes on poses in the answers of such a loop."""
    tracker._pose_notes.add(answers, tracker.contacts.copy(), tracker._scene.snapshot())
