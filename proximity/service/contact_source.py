"""Interface of a source of contacts, and the source that runs a tracker."""

from typing import Any, Protocol

import numpy as np

from proximity.kernels.tracking.motion import (
    ESTIMATE,
    ESTIMATES,
    MAX_ACCELERATION,
    MAX_SPEED,
    PREDICTED,
    observe,
)
from proximity.message import ContactFlag, Source
from proximity.service.description import PartLabels
from proximity.service.samples import FingerPoses, Samples
from proximity.system.time_units import NS_PER_MS
from proximity.tracker.tracker import Tracker

REHEARSAL = 200  # number of ticks, at random positions in the scene
PAGE = 4096  # bytes
METRES_A_BEND = 0.2
"""Approximate length of the path of a fingertip from the flat hand to the fist, m. It converts limits of
noise and acceleration of fingertips to those of bends."""


class ContactSource(Protocol):
    """Computes the contacts of a tick."""

    count: int
    """Number of fingers."""
    source: Source
    """Source of the distances."""
    is_ticked_by_loop: bool
    """True if the loop itself computes the contacts. Otherwise a thread calls `fill`."""

    @property
    def epoch(self) -> int:
        """Number that changes whenever the parts or faces that contacts refer to change."""

    @property
    def notes(self) -> list[str]:
        """Sentences for the report on refused data and failures, with their counts."""

    @property
    def refused(self) -> tuple[int, int, int]:
        """Numbers of unused poses of parts: from the future, older than the previous one, and too old."""

    @property
    def is_late(self) -> bool:
        """Whether the last call of `fill` used data so old that only its bounds are valid."""

    def labels(self) -> PartLabels:
        """Return the names of the parts of the last contacts, and which parts are hidden."""

    def new_samples(self) -> Samples:
        """Return empty samples of the class that `fill` takes."""

    def rehearse(self) -> None:
        """Perform slow first-time work, such as compilation, and undo its effects."""

    def fill(self, contacts: np.ndarray, samples: Any, now_ns: int) -> None:
        """Compute the contacts of N fingers from their newest samples.

        *contacts*: (N,) CONTACT, overwritten with the results. It is fastest if the same arrays are passed
        each time.
        """

    def close(self) -> None:
        """Release open resources."""


class TrackedContacts:
    """Contacts of fingers with the parts of a scene.

    *tracker*: tracker with as many fingers as the input. From now on only the service may tick it.
    """

    source = Source.GEOMETRY
    takes_changes: bool
    """True if messages or another thread move or change the parts, so that they are checked regularly."""
    is_ticked_by_loop = True
    is_late = False  # the loop itself detects late parts

    def __init__(self, tracker: Tracker, moves: Any = None, changes: Any = None) -> None:
        self.tracker = tracker
        self.moves = moves
        self.changes = changes
        self.takes_changes = moves is not None or changes is not None
        self.count = len(tracker.contacts)
        self._bends = Bends(self.count)
        self._filled: np.ndarray | None = None  # records written by ticks

    @property
    def epoch(self) -> int:
        """Epoch of the scene at the last tick."""
        return self.tracker.epoch

    @property
    def notes(self) -> list[str]:
        """Sentences on unusable poses, moves and changes of parts."""
        sources = (self.tracker, self.moves, self.changes)
        return [note for each in sources if each is not None for note in each.notes]

    @property
    def refused(self) -> tuple[int, int, int]:
        """Numbers of unused moves: from the future, older than the previous one, and too old."""
        moves = self.moves
        return (0, 0, 0) if moves is None else (moves.future, moves.backwards, moves.too_old)

    def labels(self) -> PartLabels:
        """Return the names of the scene's parts, and which parts are hidden."""
        model = self.tracker.scene.snapshot()
        return model.names, model.parts["is_hidden"][: len(model.names)] != 0

    def new_samples(self) -> FingerPoses:
        """Return poses of fingers that are all unknown."""
        return FingerPoses(self.count)

    def rehearse(self) -> None:
        """Read the whole scene into memory and run ticks at random points. Reset the tracker afterwards."""
        tracker, rng = self.tracker, np.random.default_rng(0)
        model = tracker.scene.snapshot()
        for array in (model.reals, model.words):
            array.view(np.uint8)[::PAGE].max(initial=0)
        lower, upper = tracker.scene.bounds
        instants = np.zeros(self.count, np.int64)
        for tick in range(REHEARSAL):
            tips = rng.uniform(lower, upper, (self.count, 3))
            instants[:] = tick * NS_PER_MS
            contacts = tracker.advance(tips, instants, tick * NS_PER_MS)
            self._bends.write(contacts, tips[:, 0], instants)
        tracker.reset()
        self._bends.reset()

    def fill(self, contacts: np.ndarray, samples: FingerPoses, now_ns: int) -> None:
        """Compute contacts in Python, with the parts at their poses in the scene.

        It is used for paths that do not fit a message.
        """
        tracker, paths, bends = self.tracker, samples.paths, samples.bends
        if contacts is not self._filled:
            tracker.write_to(contacts)
            self._filled = contacts
        tracker.advance(
            samples.positions,
            samples.pose_ns,
            now_ns,
            velocities=samples.velocities,
            paths=paths,
            bends=None if paths is None else bends,
        )
        if bends is not None:
            self._bends.write(contacts, bends, samples.pose_ns)

    def close(self) -> None:
        """Close the inputs of moves and changes."""
        for opened in (self.moves, self.changes):
            if opened is not None:
                opened.close()


class Bends:
    """Tracks the bends of fingers over time to estimate their rates."""

    def __init__(self, count: int) -> None:
        self._motions = np.zeros((count, ESTIMATES), ESTIMATE)

    def reset(self) -> None:
        """Reset all fingers."""
        self._motions[:] = 0

    def write(self, contacts: np.ndarray, bends: np.ndarray, pose_ns: np.ndarray) -> None:
        """Write bend and bend rate of tracked fingers without a path, at the instants of their poses.

        *contacts*: (N,) CONTACT. *bends*: bends received with the poses; nan if not reported. *pose_ns*: (N,)
        instants of the poses, ns.
        """
        is_tracked = contacts["flags"] & (ContactFlag.TRACKED | ContactFlag.ON_PATH) == ContactFlag.TRACKED
        for i in np.flatnonzero(is_tracked & np.isfinite(bends)).tolist():
            bend = bends.item(i)
            status = observe(
                self._motions, i, pose_ns.item(i), METRES_A_BEND * bend, 0.0, 0.0, MAX_SPEED,
                MAX_ACCELERATION,
            )  # fmt: skip
            contacts["bend"][i] = bend
            if status & PREDICTED:
                contacts["bend_rate"][i] = self._motions["velocity"].item(i, 0, 0) / METRES_A_BEND
