"""Press of ``proximity simulate`` on a wall, or on a CAD part with the engine in the loop, and its report."""

from pathlib import Path
from typing import Any

import proximity
from proximity.cli import progress
from proximity.cli.lab.press_options import PartOptions, WallOptions
from proximity.cli.output import MISSING, print_block, write_document
from proximity.cli.tables import results_console, table
from proximity.formats import metres_per_unit
from proximity.lab import part_press
from proximity.lab.engine.engine_loop import Distances, EngineSetup
from proximity.lab.figures.style import write_table
from proximity.lab.simulation import simulated_press
from proximity.lab.simulation.devices import COUPLED_DEVICE
from proximity.lab.simulation.metrics import drum_offset
from proximity.lab.simulation.sweeps import Stretch
from proximity.service.config import PartFiles, read_scene_file

SHAKING = 0.1  # share of the real force at rest; more ripple means that a wall does not come to rest
SHOWN_LONG = 1e7  # smaller numbers are shown with all decimal places
ROWS = (  # label, field, factor from SI units, digits
    ("force begins [ms after the touch]", "onset", 1e3, 2),
    ("peak force [N]", "peak", 1.0, 3),
    ("force at rest [N]", "steady", 1.0, 3),
    ("ripple at rest [mN rms]", "ripple", 1e3, 1),
    ("largest deflection of the {} [mm]", "penetration", 1e3, 3),
    ("impulse of the first 5 ms [mN s]", "impulse", 1e3, 3),
    ("work of the finger [mJ]", "work", 1e3, 3),
)


def simulate_press(surface: WallOptions, out: Path | None, *, as_json: bool) -> None:
    """Simulate a press on a wall and print or write the results."""
    setup = surface.setup(is_on_part=False)
    with progress.spinner("simulating"):
        press = simulated_press.simulate(setup)
        if out is not None:
            write_table(out, part_press.numbers_on_wall(press))
    if as_json:
        write_document(simulated_press.document(press))
        return
    lines = [("wall", simulated_press.describe(press)), ("approach", f"{setup.speed:g} m/s")]
    if press.coupled is not None:
        gains = f"{press.coupled.stiffness:.4g} N/m, {press.coupled.damping:.3g} N·s/m"
        device = f"{1e3 * COUPLED_DEVICE.mass:.0f} g that the finger carries"
        lines += [("spring, damper", gains), ("device", device)]
    real = simulated_press.felt(press.real)
    rows = _rows("wall", (press.felt, real))
    rows.append(("force error [% rms]", _shown(100.0 * press.force_error, 1), "0.0"))
    if setup.wall == simulated_press.Wall.DECAFF:
        rows.append(("drum past the wall at contact [mm]", f"{1e3 * press.drum_offset:.3f}", MISSING))
    _print(lines, ("this wall", "real wall"), rows)
    if press.felt.ripple > SHAKING * abs(real.steady):
        results_console().print(
            "\nIt does not come to rest: with these gains a wall is unstable, or nearly so."
        )


def simulate_press_on_part(
    surface: WallOptions, pressed: PartOptions, out: Path | None, *, as_json: bool
) -> None:
    """Simulate a press on a part and print or write the results.

    Without a policy the drum's controller uses the distances directly.
    """
    setup, file = surface.setup(is_on_part=True), pressed.scene
    assert file is not None, "asked for"
    reported = EngineSetup(
        Distances.SENSOR if pressed.sensor else Distances.ENGINE,
        setup.rate,
        setup.latency,
        None if surface.policy is None else simulated_press.POLICIES[surface.policy],
        setup.drum,
        setup.tip_cable,
        Stretch(setup.stretch),
    )
    metres = metres_per_unit(pressed.units)
    at = None if pressed.at is None else [metres * coordinate for coordinate in pressed.at]
    progress.prepare_kernels()
    with progress.spinner(f"reading {file}"):
        scene = _scene(surface, pressed, file)
    with progress.spinner("simulating"):
        press = part_press.simulate_on_part(scene, reported, at=at, speed=setup.speed)
        if out is not None:
            write_table(out, part_press.numbers(press))
    if as_json:
        write_document(part_press.document(press))
        return
    both = (press.engine, press.ideal)
    rows = [
        *_rows("surface", press.felt),
        ("force error [% rms]", *(f"{100.0 * one.error.share:.1f}" for one in both), "0.0"),
        ("force error [mN rms]", *(f"{1e3 * one.error.rms:.1f}" for one in both), "0.0"),
        (
            "drum past the surface at contact [mm]",
            *(f"{1e3 * drum_offset(one.response):.3f}" for one in both),
            MISSING,
        ),
    ]
    _print(part_press.describe(press), ("this engine", "ideal distance", "real surface"), rows)


def _scene(surface: WallOptions, pressed: PartOptions, file: Path) -> proximity.Scene:
    """Return the scene of a file, or only the part that the options name."""
    if file.suffix.lower() == ".toml":
        scene = PartFiles().scene(read_scene_file(file))
    else:
        scene = proximity.load(str(file), units=pressed.units)
    if pressed.part is not None:
        scene = proximity.Scene([scene.part(pressed.part)])
    if surface.stiffness is not None:
        for part in scene.parts:
            scene.set_surface(part.name, stiffness=surface.stiffness, damping=surface.damping or 0.0)
    return scene


def _rows(surface: str, felt: Any) -> list[tuple[str, ...]]:
    return [
        (label.format(surface), *(_shown(factor * getattr(one, field), digits) for one in felt))
        for label, field, factor, digits in ROWS
    ]


def _print(lines: Any, titles: tuple[str, ...], rows: list[tuple[str, ...]]) -> None:
    print_block(lines)
    console = results_console()
    console.print()
    console.print(table([""], titles, rows))


def _shown(value: float, digits: int) -> str:
    """Return a number with the given decimal places. The large number of an unstable wall is shortened."""
    return f"{value:.{digits}f}" if abs(value) < SHOWN_LONG else f"{value:.3g}"
