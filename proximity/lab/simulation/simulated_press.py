"""Simulation of a press on one wall, compared with the same press on a real wall."""

import math
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

from proximity.checks import not_negative
from proximity.decaff.drum.drum_model import Drum
from proximity.decaff.glove.glove import Glove, with_gear
from proximity.errors import ArgumentError
from proximity.lab.simulation.closed_loop import Response, coupled_wall, decaff, real_wall
from proximity.lab.simulation.devices import CoupledWall, Decaff, Hand, TipCable
from proximity.lab.simulation.metrics import drum_offset, force_error, onset, rest, work
from proximity.lab.simulation.sweeps import (
    Stretch,
    best_coupled_wall,
    with_latency,
    with_transmission,
)
from proximity.lab.simulation.target_policies import Target

SPEEDS_ALLOWED = (0.01, 10.0)  # m/s; slower presses take long, and much memory
RATES_ALLOWED = (5.0, 50_000.0)  # Hz
LONGEST_LATENCY = 1.0  # s
CABLES_ALLOWED = (10.0, 1e6)  # N/m at the fingertip
IMPULSE_TIME = 0.005  # s after the touch
STIFFEST, MAX_DAMPED = 1e6, 1e4  # N/m and N s/m, of a coupled wall; beyond, unstable walls overflow
POLICIES = {
    "naive": Target.NAIVE,
    "latched": Target.LATCHED,
    "feed-forward": Target.FEED_FORWARD,
    "time-stamped": Target.TIME_STAMPED,
}


class Wall(StrEnum):
    """Kinds of walls."""

    REAL = "real"
    COUPLED = "coupled"
    """A traditional wall, a spring and a damper rendered by a motor that the finger carries."""
    DECAFF = "decaff"
    """A drum that is moved to the measured wall."""


@dataclass(frozen=True, slots=True)
class Setup:
    """Setup of a simulated press. Settings of other kinds of walls are ignored."""

    wall: Wall = Wall.DECAFF
    speed: float = 0.1  # m/s
    latency: float = 0.001  # s, of forces or of distances
    rate: float = 1000.0  # Hz, of forces or of distances
    glove: Glove = field(default_factory=Glove)  # its servo runs at 3 kHz
    gear: str | None = None  # of `GEARS`, instead of the glove's
    policy: str = "time-stamped"  # of `POLICIES`
    stiffness: float | None = None  # N/m, of a coupled wall; None: the best gains of a grid
    damping: float | None = None  # N s/m
    cable: float | None = None  # N/m at the fingertip, of the cable to the drum; None: no cable
    stretch: str = "left"  # of `Stretch`: compensation of the cable's stretch

    def __post_init__(self) -> None:
        _within("speed", self.speed, SPEEDS_ALLOWED, "metres a second")
        _within("rate", self.rate, RATES_ALLOWED, "hertz")
        _within("latency", self.latency, (0.0, LONGEST_LATENCY), "seconds")
        _one_of("wall", self.wall, tuple(Wall))
        if self.gear is not None:
            object.__setattr__(self, "glove", with_gear(self.glove, self.gear))
        _one_of("policy", self.policy, tuple(POLICIES))
        _one_of("stretch", self.stretch, tuple(Stretch))
        if self.cable is not None:
            _within("cable", self.cable, CABLES_ALLOWED, "newtons a metre")
        elif self.stretch != Stretch.LEFT:
            raise ArgumentError(
                f"stretch is {self.stretch!r}, but the cable is missing: expected its stiffness"
            )
        if (self.stiffness is None) != (self.damping is None):
            raise ArgumentError("stiffness and damping belong together: expected both or neither")
        if self.stiffness is not None and self.damping is not None:
            _within("stiffness", self.stiffness, (0.0, STIFFEST), "newtons a metre")
            _within("damping", self.damping, (0.0, MAX_DAMPED), "newton seconds a metre")

    @property
    def drum(self) -> Drum:
        """Drum of the glove, with the wall at random within a count of its encoder."""
        return Decaff.of(self.glove).drum

    @property
    def tip_cable(self) -> TipCable | None:
        """Cable of the glove with the given stiffness, or None without a cable."""
        return None if self.cable is None else replace(TipCable.of(self.glove), stiffness=self.cable)


@dataclass(frozen=True, slots=True)
class Felt:
    """Measures of a press."""

    onset: float  # s after the touch, from 0.1 N on
    peak: float  # N
    steady: float  # N, mean at rest
    ripple: float  # N, standard deviation at rest
    penetration: float  # m, maximum displacement of the wall before the release
    work: float  # J, of the finger until the release
    impulse: float  # N s, of the force in the first `IMPULSE_TIME`


@dataclass(frozen=True, slots=True, eq=False)
class Simulation:
    """A simulated press."""

    setup: Setup
    response: Response
    real: Response  # the same on a real wall, at the same instants
    coupled: CoupledWall | None  # the coupled wall, tuned

    @property
    def felt(self) -> Felt:
        """Measures of the press on this wall."""
        return felt(self.response)

    @property
    def force_error(self) -> float:
        """Rms of the difference from the real force over the rms of that, from the contact on."""
        return force_error(self.response, self.real)

    @property
    def drum_offset(self) -> float:
        """Distance of the drum past the wall when the link meets it, m, or nan without a drum."""
        return drum_offset(self.response) if self.setup.wall == Wall.DECAFF else math.nan


def simulate(setup: Setup) -> Simulation:
    """Simulate a press on a wall, and the same press on a real wall."""
    hand, coupled = Hand(), None
    press = hand.press(setup.speed)
    if setup.wall == Wall.COUPLED:
        coupled = _coupled(hand, setup)
        response = coupled_wall(hand, press, coupled)
    elif setup.wall == Wall.DECAFF:
        reported = with_latency(Decaff.of(setup.glove), setup.latency, setup.rate)
        if setup.tip_cable is not None:
            reported = with_transmission(reported, setup.tip_cable, Stretch(setup.stretch))
        response = decaff(hand, press, reported, POLICIES[setup.policy])
    else:
        response = real_wall(hand, press)
    return Simulation(setup, response, real_wall(hand, press, like=response), coupled)


def felt(response: Response) -> Felt:
    """Return the measures of a press."""
    at_rest = response.force[rest(response)]
    before_release = response.times < response.press.release_time
    first = slice(response.zero, response.zero + round(IMPULSE_TIME / response.step) + 1)
    return Felt(
        onset(response),
        float(response.force.max()),
        float(at_rest.mean()),
        float(at_rest.std()),
        float(response.thimble[before_release].max()),
        work(response),
        float(np.trapezoid(response.force[first], dx=response.step)),
    )


def _coupled(hand: Hand, setup: Setup) -> CoupledWall:
    if setup.stiffness is None or setup.damping is None:
        return best_coupled_wall(hand, setup.rate, setup.latency)
    return CoupledWall(setup.stiffness, setup.damping, setup.rate, setup.latency)


def _within(name: str, value: float, limits: tuple[float, float], unit: str) -> None:
    if not limits[0] <= not_negative(name, value, unit) <= limits[1]:
        raise ArgumentError(f"{name} is {value:g}, expected {limits[0]:g} to {limits[1]:g} {unit}")


def _one_of(name: str, value: str, known: tuple[str, ...]) -> None:
    if value not in known:
        raise ArgumentError(f"{name} is {value!r}, expected one of {', '.join(known)}")


def describe(simulation: Simulation) -> str:
    """Return a text that describes a wall."""
    setup = simulation.setup
    late = f"{1e3 * setup.latency:g} ms of latency at {setup.rate:g} Hz"
    if setup.wall == Wall.COUPLED:
        return f"coupled, {late}"
    if setup.wall == Wall.DECAFF:
        words = f"DECAFF, drum {setup.drum.words}, {setup.policy} distances, {late}"
        return (
            words if setup.cable is None else f"{words}; cable of {cable_words(setup.cable, setup.stretch)}"
        )
    return "real"


def cable_words(stiffness: float, stretch: str) -> str:
    """Return a text that describes a cable."""
    return f"{stiffness:.4g} N/m at the fingertip, {Stretch(stretch).words}"


def document(simulation: Simulation) -> dict[str, Any]:
    """Return the reported values of a press as a dictionary of plain values in SI units."""
    setup, coupled = simulation.setup, simulation.coupled
    reported: dict[str, Any] = {"wall": str(setup.wall), "speed": setup.speed}
    if setup.wall != Wall.REAL:
        reported |= {"latency": setup.latency, "rate": setup.rate}
    if setup.wall == Wall.DECAFF:
        reported |= {"drum": setup.drum.words, "policy": setup.policy, "drum_offset": simulation.drum_offset}
        if setup.cable is not None:
            reported |= {"cable": setup.cable, "stretch": setup.stretch}
    if coupled is not None:
        reported |= {"stiffness": coupled.stiffness, "damping": coupled.damping}
    reported["force_error"] = simulation.force_error
    return reported | {"felt": asdict(simulation.felt), "real": asdict(felt(simulation.real))}
