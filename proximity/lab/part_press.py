"""Press on a CAD part: with the engine in the loop, with the ideal distance, and on the real surface."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from proximity.decaff.controller.controller import SurfaceLaw
from proximity.decaff.controller.settings import ControllerSettings, Limits
from proximity.decaff.drum.servo import SERVO_RATE
from proximity.lab.engine.engine_loop import Distances, EnginePress, EngineSetup, press_on_part
from proximity.lab.engine.finger_placement import place_finger
from proximity.lab.figures.style import SAMPLING, Table
from proximity.lab.simulation.closed_loop import Response
from proximity.lab.simulation.devices import Hand
from proximity.lab.simulation.metrics import drum_offset
from proximity.lab.simulation.simulated_press import Felt, Simulation, Wall, cable_words, felt
from proximity.scene.part import Part
from proximity.scene.scene import Scene


@dataclass(frozen=True, slots=True, eq=False)
class PartSimulation:
    """A press on a part, with the engine and with the ideal distance in the same loop."""

    engine: EnginePress
    ideal: EnginePress
    speed: float  # m/s, of the approach

    @property
    def felt(self) -> tuple[Felt, Felt, Felt]:
        """Responses: with the engine, with the ideal distance, on the real wall."""
        return felt(self.engine.response), felt(self.ideal.response), felt(self.engine.real)


def simulate_on_part(
    scene: Scene,
    setup: EngineSetup,
    *,
    at: Sequence[float] | None = None,
    speed: float = 0.1,
) -> PartSimulation:
    """Return a press on a part."""
    hand = Hand()
    finger, press = place_finger(scene, at), hand.press(speed)
    runs = [press_on_part(finger, press, each, hand) for each in (setup, setup.ideal)]
    return PartSimulation(runs[0], runs[1], speed)


def describe(simulation: PartSimulation) -> list[tuple[str, str]]:
    """Return a description of the press: part, hand, and source of the drum's data."""
    press = simulation.engine
    finger, setup, part = press.finger, press.setup, press.finger.scene.parts[press.finger.part]
    surface = "rigid" if part.stiffness is None else f"{part.stiffness:g} N/m, {part.damping:g} N·s/m"
    shown = _displayed(part, setup)
    point = finger.point(finger.contact_bend) - finger.glove.finger.pad_radius * finger.normal
    touched = ", ".join(f"{round(1e3 * coordinate, 2) + 0.0:.2f}" for coordinate in point.tolist())
    reported = "a sensor at the far end" if setup.distances == Distances.SENSOR else "the tracker"
    who = (
        "controller" if setup.reading is None else f"{setup.reading.name.lower().replace('_', '-')} distances"
    )
    lines = [
        ("part", f"{part.name}, {surface}, touched at ({touched}) mm, incidence {finger.incidence:.3f}"),
        ("approach", f"{simulation.speed:g} m/s"),
        ("reported by", f"{reported} at {setup.rate:g} Hz, {1e3 * setup.expected_latency:g} ms late"),
        ("drum", f"{who}, servo at {SERVO_RATE:g} Hz"),
        *([("displayed", shown)] if shown else []),
        *([("cable", cable_words(setup.cable.stiffness, setup.stretch))] if setup.cable else []),
        ("frames", str(press.counts)),
        ("states", ", ".join(f"{state} {count / SERVO_RATE:.3f} s" for state, count in press.states.items())),
    ]
    fresh = 1e-9 * Limits().fresh_ns
    if setup.reading is None and setup.expected_latency > fresh:
        lines.append(
            (
                "no force",
                f"no frame is younger than {1e3 * fresh:g} ms when it arrives: the controller does "
                "not let the "
                "drum come nearer on such old frames",
            )
        )
    if math.isfinite(press.switched_at):
        lines.append(("force", f"served from {1e3 * press.switched_at:.1f} ms after the touch on"))
    return lines


def _displayed(part: Part, setup: EngineSetup) -> str | None:
    """Return a text about the displayed surface of a part too stiff for the controller; None of others."""
    if setup.reading is not None or part.stiffness is None:
        return None
    stiffness, _ = SurfaceLaw(ControllerSettings(SERVO_RATE)).displayed(part.stiffness, part.damping or 0.0)
    if stiffness >= part.stiffness:
        return None
    return f"{stiffness:.4g} N/m, the stiffest that is passive at {SERVO_RATE:g} Hz"


def document(simulation: PartSimulation) -> dict[str, Any]:
    """Return the reported values of a press, as plain values in SI units."""
    press = simulation.engine
    finger, setup = press.finger, press.setup
    names = ("engine", "ideal", "real")
    return {
        "part": finger.scene.parts[finger.part].name,
        "place": {
            "fingertip": finger.point(finger.contact_bend).tolist(),
            "normal": finger.normal.tolist(),
            "incidence": finger.incidence,
            "contact_bend": finger.contact_bend,
        },
        "speed": simulation.speed,
        "distances": str(setup.distances),
        "rate": setup.rate,
        "latency": setup.expected_latency,
        "cable": None if setup.cable is None else setup.cable.stiffness,
        "stretch": None if setup.cable is None else str(setup.stretch),
        "reported_contact": press.reported_contact,
        "reported_error": press.reported_error,
        "drum_offset": drum_offset(press.response),
        "switched_at": press.switched_at,
        "states": {state: count / SERVO_RATE for state, count in press.states.items()},
        "frames": {"received": press.counts.received, "lost": press.counts.lost},
        "force_error": {"engine": asdict(press.error), "ideal": asdict(simulation.ideal.error)},
        "felt": {name: asdict(each) for name, each in zip(names, simulation.felt, strict=True)},
    }


def numbers(simulation: PartSimulation) -> Table:
    """Return the press every 0.1 ms or so, with the ideal distance and on the real wall."""
    engine, ideal = simulation.engine, simulation.ideal.response
    return curves(engine.response, engine.real, has_drum=True, ideal=ideal)


def numbers_on_wall(simulation: Simulation) -> Table:
    """Return a press on a simulated wall about every 0.1 ms, with the same press on a real wall."""
    return curves(simulation.response, simulation.real, has_drum=simulation.setup.wall == Wall.DECAFF)


def curves(response: Response, real: Response, *, has_drum: bool, ideal: Response | None = None) -> Table:
    """Return a press about every 0.1 ms, in whole steps, with the compared presses at the same instants."""
    stride = max(round(SAMPLING / response.step), 1)
    every = slice(response.zero % stride, None, stride)  # the contact among them
    times = response.times[every]
    columns = {
        "time_s": times,
        "intent_m": response.press.at(times).position,
        "finger_m": response.finger[every],
        "link_m": response.link[every],
        "force_N": response.force[every],
        "real_finger_m": real.finger[every],
        "real_force_N": real.force[every],
    }
    if has_drum:
        columns |= {"drum_m": response.drum[every], "drum_force_N": response.contact[every]}
    if ideal is not None:
        columns["ideal_force_N"] = ideal.force[every]
    return Table(columns)
