"""Drums of all fingers of a service, simulated: controllers, plants, and potentiometers that do not exist.

The finger is where the service has it. The potentiometer tells that bend, or where the drum stops the link.
"""

import math
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from proximity.decaff.controller import FingerController
from proximity.decaff.controller_states import IN_CONTACT, DrumAction, Observation
from proximity.decaff.drum import GEAR4, Drum
from proximity.decaff.drum_plant import DrumPlant
from proximity.decaff.finger_path import FingerPath
from proximity.decaff.glove import Glove
from proximity.message import State
from proximity.message.contact import ContactFlag
from proximity.transport import Reading

CARRIED_NS = 20_000_000  # so long a finger is thought to go on as it did
NS = 1e-9  # in s


@dataclass(slots=True)
class FingerBench:
    """One finger: controller, plant, and what became of them."""

    path: FingerPath
    controller: FingerController
    plant: DrumPlant
    action: DrumAction | None = None
    bend: float = 0.0  # as the service had it last
    has_bend: bool = False  # the service tells where on its way the finger is
    touches: int = 0
    faults: int = 0
    peak_force: float = 0.0  # N
    samples: Counter[str] = field(default_factory=Counter)  # by state

    def step(self, now_ns: int, elapsed: float, state: State, contact: Any) -> None:
        """Run one sample.

        Parameters
        ----------
        now_ns : int, ns
            On the clock of the frames.
        elapsed : float, s
            Since the last sample.
        state : State
            Of the reading.
        contact : CONTACT or None
            Of this finger.
        """
        self._follow(contact, now_ns)
        before = self.controller.state
        if self.action is not None:
            self.plant.advance(self.action, self.path.place(self.bend), elapsed)
        link = self.path.bend(min(self.path.place(self.bend), self.plant.place))
        self.action = self.controller.step(
            Observation(now_ns, link, self.plant.angle, state, contact, self.plant.force)
        )
        after = self.action.state
        self.touches += after in IN_CONTACT and before not in IN_CONTACT
        self.peak_force = max(self.peak_force, self.plant.force)
        self.samples[after.value] += 1
        if self.controller.fault:  # there is nobody to press a button
            self.faults += 1
            self.controller.reset()

    def _follow(self, contact: Any, now_ns: int) -> None:
        if contact is None or not int(contact["flags"]) & ContactFlag.TRACKED:
            return
        bend, rate = float(contact["bend"]), float(contact["bend_rate"])
        if math.isfinite(bend):
            age = min(max(now_ns - int(contact["pose_ns"]), 0), CARRIED_NS)
            self.bend = min(max(bend + (rate * NS * age if math.isfinite(rate) else 0.0), 0.0), 1.0)
            self.has_bend = True


class DrumBench:
    """The drums of all fingers.

    Parameters
    ----------
    rate : float, Hz
        At which `step` is called.
    glove : Glove
        Of every finger.
    drum : Drum
        Of every finger.
    """

    fingers: list[FingerBench]

    def __init__(self, rate: float, glove: Glove | None = None, drum: Drum = GEAR4) -> None:
        self._rate, self._drum = rate, drum
        self._path = FingerPath(glove or Glove())
        self._now_ns: int | None = None
        self.fingers = []

    def step(self, reading: Reading) -> None:
        """Run a sample of every finger.

        Parameters
        ----------
        reading : Reading
            The newest.
        """
        count, now_ns = len(reading.contacts), reading.now_ns
        if count and len(self.fingers) != count:
            self.fingers = [self._finger() for _ in range(count)]
        elapsed = 0.0 if self._now_ns is None else NS * (now_ns - self._now_ns)
        self._now_ns = now_ns
        for i, finger in enumerate(self.fingers):
            finger.step(now_ns, elapsed, reading.state, reading.contacts[i] if i < count else None)

    def warm_up(self) -> None:
        """Compile what a step needs, on a finger that is thrown away."""
        finger = self._finger()
        finger.step(0, 0.0, State.STALE, None)
        finger.step(1_000_000, 1e-3, State.STALE, None)

    def _finger(self) -> FingerBench:
        controller = FingerController(self._path, self._rate, self._drum)
        return FingerBench(self._path, controller, DrumPlant(self._path, self._drum))
