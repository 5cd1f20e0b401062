"""Setup of a press with the engine: source, rate and latency of distances, and simulated failures."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

from proximity.checks import not_negative, positive
from proximity.decaff.drum.drum_model import USUAL_GEAR, Drum, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE
from proximity.decaff.glove.glove import DRUMS
from proximity.errors import ArgumentError
from proximity.lab.engine.delayed_link import Latency
from proximity.lab.simulation.devices import TipCable
from proximity.lab.simulation.sweeps import Stretch
from proximity.lab.simulation.target_policies import Target
from proximity.message import PATH_CORNERS

FARTHEST = 0.100  # m, that a wall is known of; assumed
DRUM = with_random_phases(DRUMS[USUAL_GEAR], 1)[0]
Spans = Sequence[tuple[float, float]]
"""From, to; s from the touch."""


class Distances(StrEnum):
    """Source of a controller's distances."""

    ENGINE = "engine"
    """The tracker, at the service's rate, as late as the service."""
    IDEAL = "ideal"
    """The true position of contact, at the servo's rate and at once: what drum and controller cost alone."""
    SENSOR = "sensor"
    """Teleoperation: a sensor at the far end, at the service's rate and as late."""


@dataclass(frozen=True, slots=True)
class EngineSetup:
    """Setup of a press with the engine in the loop."""

    distances: Distances = Distances.ENGINE
    rate: float = 1000.0  # Hz, of the service
    latency: Latency = 0.001  # s, from the pose until its frame has arrived
    reading: Target | None = None  # a plain reading of distances instead of the controller
    drum: Drum = DRUM  # its servo runs at 3 kHz
    cable: TipCable | None = None  # between finger and link; None: the finger holds the link itself
    stretch: Stretch = Stretch.LEFT  # of the cable, how it is made up for
    far_force: float | None = None  # N, that the sensor measures; None: what the real wall does
    corners: int = PATH_CORNERS  # of the polyline that a tracker takes as the finger's path
    tolerance: float = 0.0  # of the tracker: share of a distance by which its bounds may be apart
    budget: int | None = None  # of the tracker: nodes and leaves; None: its own
    phase: float = 0.5  # of a period, before the first tick
    start_distance: float = FARTHEST  # m from the touch, where a scripted hand begins
    blind: Spans = field(default=())  # the finger is not tracked
    silent: Spans = field(default=())  # frames are lost

    def __post_init__(self) -> None:
        positive("rate", self.rate, "hertz")
        if self.far_force is not None:
            not_negative("far_force", self.far_force, "newtons")
        positive("start_distance", self.start_distance, "metres")
        if not 0.0 <= self.phase < 1.0:
            raise ArgumentError(f"phase is {self.phase!r}, expected 0 or more, and below 1 of a period")

    @property
    def ideal(self) -> "EngineSetup":
        """The same drum and hand, informed without delay."""
        return replace(self, distances=Distances.IDEAL, rate=SERVO_RATE, latency=0.0, phase=0.0)

    @property
    def expected_latency(self) -> float:
        """For which a tracker predicts, s."""
        return float(max(self.latency)) if isinstance(self.latency, Sequence) else float(self.latency)
