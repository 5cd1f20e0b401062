"""``proximity simulate --scene``: simulate a press on a CAD part with the engine in the loop."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

import proximity

if TYPE_CHECKING:
    from proximity.lab.part_press import PartSimulation
    from proximity.lab.simulation.simulated_press import Setup

NOTED = ("part", "approach", "reported by", "drum", "cable")  # below the figure
ROWS = (  # label, field, factor from SI units, digits, whether a recorded hand has it
    ("force begins \\[ms after the touch]", "onset", 1e3, 2, True),
    ("peak force \\[N]", "peak", 1.0, 3, True),
    ("force at rest \\[N]", "steady", 1.0, 3, False),
    ("ripple at rest \\[mN rms]", "ripple", 1e3, 1, False),
    ("surface gives way by, at most \\[mm]", "penetration", 1e3, 3, True),
    ("work of the finger \\[mJ]", "work", 1e3, 3, True),
)


@dataclass(frozen=True, slots=True)
class PressedPart:
    """The part that is pressed, and where."""

    file: Path
    part: str | None
    at: tuple[float, float, float] | None  # in units
    units: str
    recording: Path | None
    stiffness: float | None  # N/m
    damping: float | None  # N s/m


def run(
    pressed_part: PressedPart,
    setup: "Setup",
    policy: str | None,
    out: Path | None,
    *,
    is_sensor: bool,
    as_json: bool,
) -> None:
    """Simulate a press on a part, and report it; without a *policy* the drum's controller reads distances."""
    from proximity.cli import progress
    from proximity.cli.views.json_output import write_document
    from proximity.formats import metres_per_unit
    from proximity.lab import part_press
    from proximity.lab.engine.engine_setup import Distances, EngineSetup
    from proximity.lab.figures import captions, press_plots
    from proximity.lab.simulation import simulated_press
    from proximity.lab.simulation.sweeps import Stretch

    reported = EngineSetup(
        Distances.SENSOR if is_sensor else Distances.ENGINE,
        setup.rate,
        setup.latency,
        None if policy is None else simulated_press.POLICIES[policy],
        setup.drum,
        setup.tip_cable,
        Stretch(setup.stretch),
    )
    metres = metres_per_unit(pressed_part.units)
    at = None if pressed_part.at is None else [metres * coordinate for coordinate in pressed_part.at]
    progress.prepare_kernels()
    with progress.spinner(f"reading {pressed_part.file}"):
        scene = _scene(pressed_part)
        recorded = None if pressed_part.recording is None else _recorded(pressed_part.recording, scene, at)
    with progress.spinner("simulating"):
        press = part_press.simulate_on_part(scene, reported, at=at, speed=setup.speed, recording=recorded)
        if out is not None:
            noted = [f"{name} {words}" for name, words in part_press.describe(press) if name in NOTED]
            note = f"{'; '.join(noted)}. {captions.hand_words(press.engine.response.hand)}"
            press_plots.write_curves(out, part_press.numbers(press), simulated_press.Wall.DECAFF, note)
    if as_json:
        write_document(part_press.document(press))
    else:
        _print(press)


def _scene(pressed_part: PressedPart) -> "proximity.Scene":
    """The parts of a scene file or of any file that has parts; of these the one that is named."""
    if pressed_part.file.suffix.lower() == ".toml":
        from proximity.service.config import PartFiles, read_scene_file

        scene = PartFiles().scene(read_scene_file(pressed_part.file))
    else:
        scene = proximity.load(str(pressed_part.file), units=pressed_part.units)
    if pressed_part.part is not None:
        scene = proximity.Scene([scene.part(pressed_part.part)])
    if pressed_part.stiffness is not None:
        for part in scene.parts:
            scene.set_surface(
                part.name, stiffness=pressed_part.stiffness, damping=pressed_part.damping or 0.0
            )
    return scene


def _recorded(path: Path, scene: "proximity.Scene", at: list[float] | None) -> Any:
    """The recording where its origin is reported, or where its hand touches."""
    from proximity.decaff.glove.finger import Finger
    from proximity.recording import read_recording
    from proximity.tracker.replay import fitted_pose

    recording = read_recording(path)
    for note in recording.notes:
        typer.echo(f"proximity: {path}: {note}", err=True)
    pose = fitted_pose(scene, recording, Finger().pad_radius) if at is None else proximity.Pose(None, at)
    return recording.placed(pose)


def _print(press: "PartSimulation") -> None:
    from proximity.cli.console import print_block, results_console, table
    from proximity.cli.wording import MISSING
    from proximity.lab import part_press
    from proximity.lab.simulation.metrics import drum_offset

    console = results_console()
    print_block(console, part_press.describe(press))
    console.print()
    rows = table([""], ("this engine", "ideal distance", "real surface"))
    for label, field, factor, digits, is_of_any in ROWS:
        if is_of_any or press.speed is not None:
            rows.add_row(label, *(f"{factor * getattr(one, field):.{digits}f}" for one in press.felt))
    both = (press.engine, press.ideal)
    rows.add_row("force error \\[% rms]", *(f"{100.0 * one.error.share:.1f}" for one in both), "0.0")
    rows.add_row("force error \\[mN rms]", *(f"{1e3 * one.error.rms:.1f}" for one in both), "0.0")
    offsets = (f"{1e3 * drum_offset(one.response):.3f}" for one in both)
    rows.add_row("drum past the surface at contact \\[mm]", *offsets, MISSING)
    console.print(rows)
