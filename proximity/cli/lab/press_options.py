"""Options of ``proximity simulate``: the wall, what drives the drum, and the part of a scene."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli.options import CABLE, GLOVE, UNITS, cable_stiffness, check_gear, check_range, designed

if TYPE_CHECKING:
    from proximity.lab.simulation.simulated_press import Setup

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
WALLS = ("real", "coupled", "decaff")
STRETCHES = ("left", "torque", "sensor")


@dataclass(frozen=True, slots=True)
class WallOptions:
    """Options of the wall and of what drives the drum; None where the option was not given."""

    wall: Annotated[str, typer.Option(metavar="WALL", help="Kind of wall: real, coupled or decaff.")] = (
        "decaff"
    )
    speed: Annotated[float, typer.Option(metavar="M/S", help="Speed of the approach.")] = 0.1
    latency_ms: Annotated[
        float | None, typer.Option(metavar="MS", help="Latency of forces or distances; 1 if not given.")
    ] = None
    rate_hz: Annotated[
        float | None, typer.Option(metavar="HZ", help="Rate of forces or distances; 1000 if not given.")
    ] = None
    drum: Annotated[
        str | None, typer.Option(metavar="GEAR", help="Gear of the drum: gear14, gear51 or gear111 (total).")
    ] = None
    glove: GLOVE = None
    policy: Annotated[
        str | None,
        typer.Option(
            metavar="POLICY",
            help="naive, latched, feed-forward or time-stamped (default; with --scene: the controller).",
        ),
    ] = None
    stiffness: Annotated[
        float | None,
        typer.Option(metavar="N/M", help="Stiffness of a coupled wall (requires --damping), or of the part."),
    ] = None
    damping: Annotated[
        float | None, typer.Option(metavar="NS/M", help="Damping of the surface. Requires --stiffness.")
    ] = None
    cable: CABLE = None
    stretch: Annotated[
        str | None,
        typer.Option(
            metavar="HOW",
            help="How the drum makes up for the stretch of the --cable: left (not at all, the default), "
            "torque (by the motor's) or sensor (by a force sensor).",
        ),
    ] = None

    def check(self) -> None:
        """Refuse options that a wall of this kind does not have."""
        if self.wall not in WALLS:
            raise typer.BadParameter(
                f"{self.wall!r}: expected one of {', '.join(WALLS)}", param_hint="--wall"
            )
        for option, walls in USED_BY.items():
            if self.wall not in walls:
                value = getattr(self, option.removeprefix("--").replace("-", "_"))
                _refuse({option: value}, f"a {self.wall} wall has none")
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

    scene: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Press on a part: a mesh, STEP or scene file (.toml).")
    ] = None
    part: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Part of the scene to press on. Other parts are ignored."),
    ] = None
    at: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="X Y Z",
            help="Press on the surface point nearest to this position. Default: from above the middle. With "
            "--recording: position of its origin; fitted if not given.",
        ),
    ] = None
    recording: Annotated[
        Path | None, typer.Option(metavar="CSV", help="CSV file of fingertips over time, as for replay.")
    ] = None
    sensor: Annotated[
        bool, typer.Option("--sensor", help="Teleoperation: a sensor at the far end measures the part.")
    ] = False
    units: UNITS = "mm"

    def check(self) -> None:
        """Refuse options that need a scene where there is none."""
        if self.scene is None:
            options = {"--part": self.part, "--at": self.at, "--recording": self.recording}
            _refuse({**options, "--sensor": self.sensor or None}, OF_A_SCENE)


def _refuse(options: dict[str, Any], sentence: str) -> None:
    for option, value in options.items():
        if value is not None:
            raise typer.BadParameter(sentence, param_hint=option)
