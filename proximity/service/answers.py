"""Sources of contacts: a tracker, or the measurements of a sensor."""

from typing import Any, Protocol

import numpy as np

from proximity.message import Source
from proximity.service.bends import Bends
from proximity.service.description import PartLabels
from proximity.service.samples import FingerPoses, Samples
from proximity.system.time_units import NS_PER_MS
from proximity.tracker.tracker import Tracker

REHEARSAL = 200  # ticks, at places all over the scene
PAGE = 4096  # bytes


class Answering(Protocol):
    """Makes the contacts of a tick."""

    count: int
    """Of fingers."""
    source: Source
    """Where its distances come from."""

    @property
    def epoch(self) -> int:
        """A number that grows with each change of what parts and faces of the last answer mean."""

    @property
    def notes(self) -> list[str]:
        """Sentences for the report: what was refused or failed, and how often."""

    @property
    def refused(self) -> tuple[int, int, int]:
        """Poses of parts left out so far: from the future, older than the one before, and too old."""

    @property
    def is_late(self) -> bool:
        """Whether what the last answer was made of is too old for more than its bounds to be used."""

    def labels(self) -> PartLabels:
        """Return names of the parts of the last answer, and which are hidden."""

    def new_samples(self) -> Samples:
        """Make room for the samples that it takes."""

    def rehearse(self) -> None:
        """Do all that takes long the first time, and forget it."""

    def answer(self, samples: Any, now_ns: int) -> np.ndarray:
        """Return (N,) CONTACT for samples of N fingers; the same array each time, overwritten by the next."""

    def close(self) -> None:
        """Give back what is open."""


class TrackerAnswers:
    """Contacts with the parts of a scene.

    *tracker*: of as many fingers as the input has. Only the service may tick it from now on.
    """

    source = Source.GEOMETRY

    def __init__(self, tracker: Tracker, moves: Any = None, changes: Any = None) -> None:
        self.tracker = tracker
        self.moves = moves
        self.changes = changes
        self.count = len(tracker.contacts)
        self._bends = Bends(self.count)

    @property
    def epoch(self) -> int:
        """Epoch of the scene at the last tick."""
        return self.tracker.epoch

    @property
    def notes(self) -> list[str]:
        """Sentences on poses, and on moves and changes of parts, that could not be used."""
        sources = (self.tracker, self.moves, self.changes)
        return [note for each in sources if each is not None for note in each.notes]

    @property
    def refused(self) -> tuple[int, int, int]:
        """Moves of parts left out so far."""
        moves = self.moves
        return (0, 0, 0) if moves is None else (moves.future, moves.backwards, moves.too_old)

    @property
    def is_late(self) -> bool:
        """Whether of a part that moved nothing more is reported."""
        return self.moves is not None and self.moves.is_late

    def labels(self) -> PartLabels:
        """Return names of the scene's parts, and which are hidden."""
        model = self.tracker.scene.snapshot()
        return model.names, model.parts["is_hidden"][: len(model.names)] != 0

    def new_samples(self) -> FingerPoses:
        """Make room for poses."""
        return FingerPoses(self.count)

    def rehearse(self) -> None:
        """Read all of the scene into memory, and tick all over it, which compiles what is not yet."""
        tracker, rng = self.tracker, np.random.default_rng(0)
        model = tracker.scene.snapshot()
        for array in (model.reals, model.words):
            array.view(np.uint8)[::PAGE].max(initial=0)
        lower, upper = tracker.scene.bounds
        for tick in range(REHEARSAL):
            tips = rng.uniform(lower, upper, (self.count, 3))
            contacts = tracker.tick(tips, tick * NS_PER_MS, tick * NS_PER_MS)
            self._bends.write(contacts, tips[:, 0], contacts["pose_ns"])
        tracker.reset()
        self._bends.forget()

    def answer(self, samples: FingerPoses, now_ns: int) -> np.ndarray:
        """Change and move the parts that are to change and move, and tick.

        Parts that have a velocity stand where they are at the instant of the newest pose. Bounds hold for the
        pose of each finger, with parts where they were reported to be, carried on with the velocities
        reported.
        """
        if self.changes is not None:
            self.changes.apply(self.tracker.scene)
        if self.moves is not None:
            self.moves.apply(self.tracker.scene, now_ns, samples)
        paths, bends = samples.paths, samples.bends
        contacts = self.tracker.tick(
            samples.positions,
            samples.pose_ns,
            now_ns,
            velocities=samples.velocities,
            paths=paths,
            bends=None if paths is None else bends,
        )
        if self.moves is not None:
            self.moves.widen(contacts)
        if bends is not None:
            self._bends.write(contacts, bends, samples.pose_ns)
        return contacts

    def close(self) -> None:
        """Close the inputs of moves and changes."""
        for opened in (self.moves, self.changes):
            if opened is not None:
                opened.close()
