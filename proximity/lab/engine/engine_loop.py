"""Press on a CAD part with the real engine in the loop, from hand to drum: setup and simulation.

The finger of the closed loop moves on its path toward a part. Its pose enters a tracker at the service's
rate, the answer becomes a frame, its bytes arrive after the service's latency and are validated, and the
drum's controller acts on them at its rate. The reference is the real wall: exact geometry, with the same
hand. Time is simulated, so every run is the same. Forces are along the finger's path, its one degree of
freedom.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from proximity.checks import not_negative, positive
from proximity.decaff.controller.controller import FingerController, FrameMark
from proximity.decaff.controller.settings import CableRule
from proximity.decaff.drum.drum_model import USUAL_GEAR, Drum, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, DrumCommand, servo_for
from proximity.decaff.glove.glove import DRUMS
from proximity.errors import ArgumentError
from proximity.lab.engine.finger_placement import PlacedFinger
from proximity.lab.engine.simulated_service import (
    DelayedLink,
    ExactAnswers,
    Feed,
    Latency,
    MeasuredFinger,
    SimulatedService,
    TrackedFinger,
)
from proximity.lab.paper.trajectories import Intent
from proximity.lab.simulation.closed_loop import LEAD, DecaffLoop, Response, real_wall, soft_wall
from proximity.lab.simulation.devices import Decaff, Hand, Holding, Sensing, TipCable
from proximity.lab.simulation.frame_readers import START_NS, ControllerReader, PolicyReader
from proximity.lab.simulation.metrics import force_error, onset, work
from proximity.lab.simulation.sweeps import Stretch, with_transmission
from proximity.lab.simulation.target_policies import DistanceSample, Target, TargetPolicy
from proximity.message import PATH_CORNERS
from proximity.service.contact_source import TrackedContacts
from proximity.system.time_units import NS_PER_S
from proximity.tracker.tracker import Tracker
from proximity.transport import Counts, Subscriber

FARTHEST = 0.100  # m, maximum distance at which a wall is known; assumed
DRUM = with_random_phases(DRUMS[USUAL_GEAR], 1)[0]
Spans = Sequence[tuple[float, float]]
"""Intervals; s from the touch."""


class Distances(StrEnum):
    """Source of a controller's distances."""

    ENGINE = "engine"
    """The tracker, at the service's rate and latency."""
    IDEAL = "ideal"
    """The true position of contact, at the servo's rate without delay: drum and controller alone."""
    SENSOR = "sensor"
    """Teleoperation: a sensor at the far end, at the service's rate and latency."""


@dataclass(frozen=True, slots=True)
class EngineSetup:
    """Setup of a press with the engine in the loop."""

    distances: Distances = Distances.ENGINE
    rate: float = 1000.0  # Hz, of the service
    latency: Latency = 0.001  # s, from the pose until its frame has arrived
    reading: Target | None = None  # a plain reading of distances instead of the controller
    drum: Drum = DRUM  # its servo runs at 3 kHz
    cable: TipCable | None = None  # between finger and link; None: the finger holds the link itself
    stretch: Stretch = Stretch.LEFT  # of the cable, and its compensation
    far_force: float | None = None  # N, measured by the sensor; None: that of the real wall
    corners: int = PATH_CORNERS  # of the tracker's polyline of the finger's path
    tolerance: float = 0.0  # of the tracker: maximum difference of its bounds, as a share of the distance
    budget: int | None = None  # of the tracker: nodes and leaves; None: its default
    phase: float = 0.5  # of a period, before the first tick
    start_distance: float = FARTHEST  # m from the touch, start of a scripted hand
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
        """Latency that the tracker predicts for, s."""
        return float(max(self.latency)) if isinstance(self.latency, Sequence) else float(self.latency)


@dataclass(frozen=True, slots=True, eq=False)
class EnginePress:
    """Result of a press; positions of `response` count from the true surface, along the finger's path."""

    finger: PlacedFinger
    setup: EngineSetup
    response: Response
    real: Response  # on the real wall, at the same instants
    states: Counter[str]  # samples of the servo in each state of the controller
    switched_at: float  # s, of the controller's first served force; nan: none
    counts: Counts  # frames, as the subscriber counts them
    reported_contact: (
        float  # m past the true surface, the position of contact in the last frame before the touch
    )
    reported_error: float  # m, bound in this frame, on the tracker's polyline
    advances: int  # samples at which the drum moved nearer without fresh data

    @property
    def error(self) -> "ForceError":
        """Error against the real wall."""
        return ForceError.of(self)


@dataclass(frozen=True, slots=True)
class ForceError:
    """A press on a part compared with the same on the real wall, from the touch on."""

    share: float  # rms of the difference of the forces over the rms of the real one
    rms: float  # N, of the difference
    largest: float  # N, of it
    onset: float  # s, later start of the force
    penetration: float  # m, of the pad's far side past the real surface, before the release
    work: float  # J, of the finger until the release, less the real one

    @classmethod
    def of(cls, press: EnginePress) -> "ForceError":
        """Compare."""
        response, real = press.response, press.real
        off = response.force[response.zero :] - real.force[response.zero :]
        before_release = response.times < response.press.release_time
        past = response.link - np.maximum(real.link, 0.0)
        return cls(
            force_error(response, real),
            math.sqrt(float(np.square(off).mean())),
            float(np.abs(off).max()),
            onset(response) - onset(real),
            float(past[before_release].max()),
            work(response) - work(real),
        )


def press_on_part(
    finger: PlacedFinger, press: Intent, setup: EngineSetup | None = None, hand: Hand | None = None
) -> EnginePress:
    """Return a press on a part."""
    setup, hand = setup or EngineSetup(), hand or Hand()
    loop = DecaffLoop(hand, press, _glove(finger, setup))
    part = finger.scene.parts[finger.part]
    if part.stiffness is None:
        real = real_wall(hand, press, like=loop.response)
    else:
        along = finger.incidence**2  # of the surface's law, along the finger's path
        real = soft_wall(hand, press, along * part.stiffness, along * part.damping, like=loop.response)
    engine = Engine(finger, setup, loop, real)
    while not loop.is_over:
        loop.tick(engine.command(loop.distance_sample()))
    reader = engine.reader
    return EnginePress(
        finger, setup, loop.response, real, reader.states, reader.switched_at, engine.counts,
        engine.reported_contact, engine.reported_error, reader.advances,
    )  # fmt: skip


class Engine:
    """Service, message and controller of one finger, stepped by the closed loop."""

    reported_contact: float
    reported_error: float
    reader: ControllerReader | PolicyReader

    def __init__(self, finger: PlacedFinger, setup: EngineSetup, loop: DecaffLoop, real: Response) -> None:
        self._finger, self._setup, self._loop, self._real = finger, setup, loop, real
        self._wall, self._intent = finger.contact_position, loop.response.press
        self._now_ns = 0
        link = DelayedLink(setup.latency, lambda: self._now_ns, [_in_ns(span) for span in setup.silent])
        self._period = 1.0 / setup.rate
        self._service = SimulatedService(_feed(finger, setup, self._period), link, self._period)
        self._frames = Subscriber(link, "simulation", clock=lambda: self._now_ns)
        self._begin = loop.now + setup.phase * self._period
        self._ticks = 0
        self.reported_contact = self.reported_error = math.nan
        self._has_touched = False
        holding = _glove(finger, setup).holding
        if setup.reading is None:
            cable = CableRule(1.0 / holding.compliance, holding.smoothing) if holding.compliance else None
            self.reader = ControllerReader(
                FingerController(finger.path, SERVO_RATE, setup.drum, cable=cable),
                finger.path,
                self._wall,
                has_force_sensor=setup.stretch != Stretch.TORQUE,
            )
        else:
            self.reader = PolicyReader(TargetPolicy(setup.reading, holding), finger.path, self._wall)

    @property
    def counts(self) -> Counts:
        """Frames received, lost and refused."""
        return self._frames.counts

    def command(self, distance_sample: DistanceSample) -> DrumCommand:
        """Make the due frames, receive arrived ones, and update the drum."""
        while self._begin + self._ticks * self._period <= distance_sample.now + 1e-9:
            self._tick(self._begin + self._ticks * self._period)
            self._ticks += 1
        self._now_ns = _instant_ns(distance_sample.now)
        reading = self._frames.read()
        contact = reading.contacts[0] if len(reading.contacts) else None
        self._has_touched = self._has_touched or distance_sample.force > 0.0 or distance_sample.link >= 0.0
        if reading.is_valid and contact is not None and not self._has_touched:
            self._note(float(contact["contact_bend"]), float(contact["contact_bend_error"]))
        frame = FrameMark.of(reading.header)
        return self.reader.read(distance_sample, self._now_ns, reading.state, contact, frame)

    def _tick(self, time: float) -> None:
        position, speed = self._loop.link_at(time)
        path, bend = self._finger.path, math.nan
        if not any(first <= time <= last for first, last in self._setup.blind):
            bend = path.bend(self._wall + position)
        self._now_ns = _instant_ns(time)
        self._service.tick(self._now_ns, bend=bend, **self._measured(time, bend, speed))

    def _measured(self, time: float, bend: float, speed: float) -> dict[str, float]:
        """Return a sensor's measurements: rate of the finger's bend, 1/s, and the force on it, N."""
        if self._setup.distances != Distances.SENSOR or not math.isfinite(bend):
            return {"bend_rate": math.nan, "force": math.nan}
        force = self._setup.far_force
        if force is None:
            force = float(self._real.force[self._loop.row(time)])
        return {"bend_rate": speed / float(self._finger.glove.finger.speed(bend)), "force": force}

    def _note(self, bend: float, error: float) -> None:
        """Store the last report of the contact."""
        if math.isfinite(bend):
            position = self._finger.path.position(bend)
            self.reported_contact = position - self._wall
            self.reported_error = (
                self._finger.path.position(bend + error) - position if error < math.inf else math.inf
            )


def _feed(finger: PlacedFinger, setup: EngineSetup, period: float) -> Feed:
    if setup.distances == Distances.SENSOR:
        return MeasuredFinger(finger, setup.expected_latency)
    tracker = Tracker(
        finger.scene,
        fingers=1,
        radius=finger.glove.finger.pad_radius,
        period=period,
        latency=setup.expected_latency,
        tolerance=setup.tolerance,
        budget=setup.budget,
    )
    if setup.distances == Distances.IDEAL:
        return TrackedFinger(finger, ExactAnswers(tracker, finger.contact_bend))
    return TrackedFinger(finger, TrackedContacts(tracker), setup.corners)


def _glove(finger: PlacedFinger, setup: EngineSetup) -> Decaff:
    """Return drum, servo and cable; the drum starts at the controller's retracted position."""
    reach = min(setup.start_distance, finger.contact_position - LEAD)
    glove = Decaff(
        drum=setup.drum,
        servo=servo_for(setup.drum, SERVO_RATE),
        sensing=Sensing(reach=reach),
        holding=Holding(retracted=finger.retraction),
    )
    return glove if setup.cable is None else with_transmission(glove, setup.cable, setup.stretch)


def _instant_ns(time: float) -> int:
    return START_NS + round(NS_PER_S * time)


def _in_ns(span: tuple[float, float]) -> tuple[int, int]:
    return _instant_ns(span[0]), _instant_ns(span[1])
