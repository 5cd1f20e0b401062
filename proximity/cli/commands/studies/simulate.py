"""``proximity simulate``: simulate one press on a wall, and compare it with a press on a real wall."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli.options import (
    CABLE,
    GLOVE,
    UNITS,
    cable_stiffness,
    check_gear,
    check_range,
    designed,
    with_option_groups,
)

if TYPE_CHECKING:
    from proximity.lab.simulation.simulated_press import Setup, Simulation

HELP = "\n\n".join(
    (
        "Simulate a hand that presses on a wall, and compare the force with that of a real wall.",
        "The hand approaches at --speed, presses with 0.8 N and leaves. A coupled wall is a spring and a "
        "damper, rendered by a motor on the finger; without --stiffness and --damping the best pair of a "
        "grid is used. A decaff wall is a drum that moves to the reported position of the wall; --policy "
        "chooses how a distance becomes a position; --cable puts a cable between finger and drum. --glove "
        "takes motor, gear, lever, cable and measured latency from the file of your glove. --out draws the "
        "press, or writes it as CSV every 0.1 ms.",
        "With --scene the wall is a CAD part, and the engine controls the drum: the tracker on the finger's "
        "path, frames with the latency of --latency-ms, and the drum's controller. The result is compared "
        "with the ideal distance in the same loop, and with the true surface. --stiffness and --damping "
        "make the part deformable. With --recording the hand repeats the motion of a recorded fingertip.",
    )
)

EXAMPLES = """
Examples:
  proximity simulate
  proximity simulate --speed 0.5 --latency-ms 10 --policy latched --out late.png
  proximity simulate --cable 1212 --stretch torque
  proximity simulate --glove glove.json --stretch torque
  proximity simulate --wall coupled --latency-ms 3 --stiffness 734 --damping 4.4 --json
  proximity simulate --scene bracket.stl --at 48 30 20 --latency-ms 10 --out bracket.png
  proximity simulate --scene bracket.stl --recording hand.csv
"""

USED_BY = {  # options that only some walls have
    "--latency-ms": ("coupled", "decaff"),
    "--rate-hz": ("coupled", "decaff"),
    "--drum": ("decaff",),
    "--glove": ("decaff",),
    "--policy": ("decaff",),
    "--cable": ("decaff",),
    "--stretch": ("decaff",),
    "--stiffness": ("coupled",),
    "--damping": ("coupled",),
}
OF_A_SCENE = "only a press on a part has that: expected --scene FILE as well"
ROWS = (  # label, field, factor from SI units, digits
    ("force begins \\[ms after the touch]", "onset", 1e3, 2),
    ("peak force \\[N]", "peak", 1.0, 3),
    ("force at rest \\[N]", "steady", 1.0, 3),
    ("ripple at rest \\[mN rms]", "ripple", 1e3, 1),
    ("wall gives way by, at most \\[mm]", "penetration", 1e3, 3),
    ("work of the finger \\[mJ]", "work", 1e3, 3),
)
SHAKING = 0.1  # of the real force at rest: ripple of a wall that does not come to rest
SHOWN_LONG = 1e7  # less is shown with all its digits
STRETCHES = ("left", "torque", "sensor")
SUFFIXES = (".png", ".svg", ".pdf", ".csv")


WALL = Annotated[str, typer.Option("--wall", metavar="WALL", help="Kind of wall: real, coupled or decaff.")]
SPEED = Annotated[float, typer.Option("--speed", metavar="M/S", help="Speed of the approach.")]
LATENCY_MS = Annotated[
    float | None,
    typer.Option("--latency-ms", metavar="MS", help="Latency of forces or distances; 1 if not given."),
]
RATE_HZ = Annotated[
    float | None,
    typer.Option("--rate-hz", metavar="HZ", help="Rate of forces or distances; 1000 if not given."),
]
DRUM = Annotated[
    str | None,
    typer.Option("--drum", metavar="GEAR", help="Gear of the drum: gear14, gear51 or gear111 (total)."),
]
POLICY = Annotated[
    str | None,
    typer.Option(
        "--policy",
        metavar="POLICY",
        help="naive, latched, feed-forward or time-stamped (default; with --scene: the controller).",
    ),
]
STIFFNESS = Annotated[
    float | None,
    typer.Option(
        "--stiffness", metavar="N/M", help="Stiffness of a coupled wall (requires --damping), or of the part."
    ),
]
DAMPING = Annotated[
    float | None,
    typer.Option("--damping", metavar="NS/M", help="Damping of the surface. Requires --stiffness."),
]
STRETCH = Annotated[
    str | None,
    typer.Option(
        "--stretch",
        metavar="HOW",
        help="How the drum makes up for the stretch of the --cable: left (not at all, the default), torque "
        "(by the motor's) or sensor (by a force sensor).",
    ),
]
SCENE = Annotated[
    Path | None,
    typer.Option("--scene", metavar="FILE", help="Press on a part: a mesh, STEP or scene file (.toml)."),
]
PART = Annotated[
    str | None,
    typer.Option("--part", metavar="NAME", help="Part of the scene to press on. Other parts are ignored."),
]
AT = Annotated[
    tuple[float, float, float] | None,
    typer.Option(
        "--at",
        metavar="X Y Z",
        help="Press on the surface point nearest to this position. Default: from above the middle. With "
        "--recording: position of its origin; fitted if not given.",
    ),
]
RECORDING = Annotated[
    Path | None,
    typer.Option("--recording", metavar="CSV", help="CSV file of fingertips over time, as for replay."),
]
SENSOR = Annotated[
    bool, typer.Option("--sensor", help="Teleoperation: a sensor at the far end measures the part.")
]
OUT = Annotated[
    Path | None,
    typer.Option("--out", metavar="FILE", help="Write a drawing (.png, .svg, .pdf) or numbers (.csv)."),
]
AS_JSON = Annotated[bool, typer.Option("--json", help="Write one JSON document, in SI units.")]


@dataclass(frozen=True, slots=True)
class WallOptions:
    """Options of the wall and of what drives the drum; None where the option was not given."""

    wall: WALL = "decaff"
    speed: SPEED = 0.1
    latency_ms: LATENCY_MS = None
    rate_hz: RATE_HZ = None
    drum: DRUM = None
    glove: GLOVE = None
    policy: POLICY = None
    stiffness: STIFFNESS = None
    damping: DAMPING = None
    cable: CABLE = None
    stretch: STRETCH = None

    def check(self) -> None:
        """Refuse options that a wall of this kind does not have."""
        _check(
            self.wall,
            {
                "--latency-ms": self.latency_ms,
                "--rate-hz": self.rate_hz,
                "--drum": self.drum,
                "--glove": self.glove,
                "--policy": self.policy,
                "--stiffness": self.stiffness,
                "--damping": self.damping,
                "--cable": self.cable,
                "--stretch": self.stretch,
            },
        )
        self._check_stretch()

    def check_on_part(self) -> None:
        """Refuse options that a press on a part does not have."""
        wall = None if self.wall == "decaff" else self.wall
        _refuse({"--wall": wall}, "on a part of a scene there is only decaff")
        if self.stiffness is None:
            _refuse({"--damping": self.damping}, "a part that has it has a --stiffness as well")
        self._check_stretch()

    def _check_stretch(self) -> None:
        if self.stretch not in (None, *STRETCHES):
            raise typer.BadParameter(
                f"{self.stretch!r}: expected one of {', '.join(STRETCHES)}", param_hint="--stretch"
            )
        if self.cable is None and self.glove is None:
            _refuse({"--stretch": self.stretch}, "there is no --cable that stretches")

    def setup(self, *, is_on_part: bool) -> "Setup":
        """Return the setup of the simulation."""
        from proximity.lab.simulation import simulated_press

        if self.latency_ms is not None:
            check_range(self.latency_ms, "--latency-ms", "ms", 0.0, 1e3 * simulated_press.LONGEST_LATENCY)
        options = self._worn() | {
            "gear": check_gear(self.drum),
            "policy": self.policy,
            "rate": self.rate_hz,
            "stiffness": None if is_on_part else self.stiffness,
            "damping": None if is_on_part else self.damping,
            "stretch": self.stretch,
        }
        if self.latency_ms is not None:
            options["latency"] = 1e-3 * self.latency_ms
        if self.cable is not None:
            options["cable"] = cable_stiffness(self.cable)
        chosen: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
        return simulated_press.Setup(wall=simulated_press.Wall(self.wall), speed=self.speed, **chosen)

    def _worn(self) -> dict[str, Any]:
        """The glove of the file, with its cable, and its latency where that was measured."""
        if self.glove is None:
            return {}
        from proximity.decaff.glove.glove import CONTACT_BEND
        from proximity.decaff.glove.glove_set import CalibratedGlove, read_any_glove

        worn = read_any_glove(self.glove)
        parts = designed(worn)
        latency = worn.calibration.latency if isinstance(worn, CalibratedGlove) else None
        return {"glove": parts, "cable": float(parts.tip_stiffness(CONTACT_BEND)), "latency": latency}


@dataclass(frozen=True, slots=True)
class PartOptions:
    """Options of a press on a part of a scene."""

    scene: SCENE = None
    part: PART = None
    at: AT = None
    recording: RECORDING = None
    sensor: SENSOR = False
    units: UNITS = "mm"

    def check(self) -> None:
        """Refuse options that need a scene where there is none."""
        if self.scene is None:
            options = {"--part": self.part, "--at": self.at, "--recording": self.recording}
            _refuse({**options, "--sensor": self.sensor or None}, OF_A_SCENE)


@with_option_groups
def command(
    surface: WallOptions,
    pressed: PartOptions,
    out: OUT = None,
    as_json: AS_JSON = False,
) -> None:
    """Simulate a press and compare it."""
    pressed.check()
    if pressed.scene is None:
        surface.check()
    else:
        surface.check_on_part()
    _check_out(out)
    # NumPy, Rich and the models: only now, so that --help and mistakes above answer at once.
    from proximity.cli import progress, scene_press
    from proximity.lab.figures import press_plots
    from proximity.lab.simulation import simulated_press

    setup = surface.setup(is_on_part=pressed.scene is not None)
    if pressed.scene is not None:
        pressed_part = scene_press.PressedPart(
            pressed.scene,
            pressed.part,
            pressed.at,
            pressed.units,
            pressed.recording,
            surface.stiffness,
            surface.damping,
        )
        scene_press.run(pressed_part, setup, surface.policy, out, is_sensor=pressed.sensor, as_json=as_json)
        _say_written(out)
        return
    with progress.spinner("simulating"):
        press = simulated_press.simulate(setup)
        if out is not None:
            press_plots.write(out, press)
    if as_json:
        from proximity.cli.views.json_output import write_document

        write_document(simulated_press.document(press))
    else:
        _print(press)
    _say_written(out)


def _say_written(out: Path | None) -> None:
    if out is not None:
        typer.echo(f"proximity: wrote {out}", err=True)


def _refuse(options: dict[str, Any], sentence: str) -> None:
    for option, value in options.items():
        if value is not None:
            raise typer.BadParameter(sentence, param_hint=option)


def _check(wall: str, options: dict[str, Any]) -> None:
    walls = ("real", "coupled", "decaff")
    if wall not in walls:
        raise typer.BadParameter(f"{wall!r}: expected one of {', '.join(walls)}", param_hint="--wall")
    for option, value in options.items():
        if value is not None and wall not in USED_BY[option]:
            raise typer.BadParameter(f"a {wall} wall has none", param_hint=option)


def _check_out(out: Path | None) -> None:
    if out is not None and out.suffix.lower() not in SUFFIXES:
        raise typer.BadParameter(f"{out} does not end in {', '.join(SUFFIXES)}", param_hint="--out")


def _print(press: "Simulation") -> None:
    from proximity.cli.console import print_block, results_console, table
    from proximity.cli.wording import MISSING
    from proximity.lab.simulation import simulated_press
    from proximity.lab.simulation.devices import COUPLED_DEVICE

    console = results_console()
    print_block(
        console, [("wall", simulated_press.describe(press)), ("approach", f"{press.setup.speed:g} m/s")]
    )
    if press.coupled is not None:
        gains = f"{press.coupled.stiffness:.4g} N/m, {press.coupled.damping:.3g} N·s/m"
        device = f"{1e3 * COUPLED_DEVICE.mass:.0f} g that the finger carries"
        print_block(console, [("spring, damper", gains), ("device", device)])
    console.print()
    rows = table([""], ("this wall", "real wall"))
    this, real = press.felt, simulated_press.felt(press.real)
    for label, field, factor, digits in ROWS:
        rows.add_row(label, *(_shown(factor * getattr(one, field), digits) for one in (this, real)))
    rows.add_row("force error \\[% rms]", _shown(100.0 * press.force_error, 1), "0.0")
    if press.setup.wall == simulated_press.Wall.DECAFF:
        rows.add_row("drum past the wall at contact \\[mm]", f"{1e3 * press.drum_offset:.3f}", MISSING)
    console.print(rows)
    if press.felt.ripple > SHAKING * abs(real.steady):
        console.print("\nIt does not come to rest: with these gains a wall is unstable, or nearly so.")


def _shown(value: float, digits: int) -> str:
    """A number with digits after its point; one that a wall out of control makes, in short."""
    return f"{value:.{digits}f}" if abs(value) < SHOWN_LONG else f"{value:.3g}"
