"""Options of ``proximity simulate`` for the wall, the motion of the drum, and the part of a scene."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from proximity.cli.options import (
    CABLE,
    GEAR,
    GLOVE,
    UNITS,
    cable_stiffness,
    check_range,
    designed,
    flag,
    milliseconds,
    option,
    refuse,
)

if TYPE_CHECKING:
    from proximity.lab.simulation.simulated_press import Setup

USED_BY = {  # options that only some walls have
    "--latency": ("coupled", "decaff"),
    "--rate": ("coupled", "decaff"),
    "--drum": ("decaff",),
    "--glove": ("decaff",),
    "--policy": ("decaff",),
    "--cable": ("decaff",),
    "--stretch": ("decaff",),
    "--stiffness": ("coupled",),
    "--damping": ("coupled",),
}
OF_A_SCENE = "requires --scene FILE"
WALLS = ("real", "coupled", "decaff")
STRETCHES = ("left", "torque", "sensor")


@dataclass(frozen=True, slots=True)
class WallOptions:
    """Options of the wall and of the drum. They are None if not given."""

    wall: Annotated[str, option("WALL", "Kind of wall: real, coupled or decaff.")] = "decaff"
    speed: Annotated[float, option("M/S", "Speed of the approach.")] = 0.1
    latency: Annotated[
        float | None, option("MS", "Latency of forces or distances; 1 if not given.", parser=milliseconds)
    ] = None
    rate: Annotated[float | None, option("HZ", "Rate of forces or distances; 1000 if not given.")] = None
    drum: GEAR = None
    glove: GLOVE = None
    policy: Annotated[
        str | None,
        option(
            "POLICY",
            ("naive, latched, feed-forward or time-stamped (default; with --scene: the controller)."),
        ),
    ] = None
    stiffness: Annotated[
        float | None, option("N/M", "Stiffness of a coupled wall (requires --damping), or of the part.")
    ] = None
    damping: Annotated[float | None, option("NS/M", "Damping of the surface. Requires --stiffness.")] = None
    cable: CABLE = None
    stretch: Annotated[
        str | None,
        option(
            "HOW",
            "Compensation of the stretch of the --cable: left (none, the default), torque (by the "
            "motor's) or sensor (by a force sensor).",
        ),
    ] = None

    def check(self) -> None:
        """Reject options that a wall of this kind does not have."""
        given = {"--" + name.replace("_", "-"): value for name, value in asdict(self).items()}
        refuse(
            (self.wall not in WALLS, "--wall", f"{self.wall!r}: expected one of {', '.join(WALLS)}"),
            *(
                (self.wall not in walls and given[name] is not None, name, f"a {self.wall} wall has none")
                for name, walls in USED_BY.items()
            ),
        )
        self._check_stretch()

    def check_on_part(self) -> None:
        """Reject options that a press on a part does not have."""
        alone = self.damping is not None and self.stiffness is None
        refuse(
            (self.wall != "decaff", "--wall", "must be decaff on a part of a scene"),
            (alone, "--damping", "requires --stiffness on a part"),
        )
        self._check_stretch()

    def _check_stretch(self) -> None:
        expected = f"{self.stretch!r}: expected one of {', '.join(STRETCHES)}"
        has_cable = self.cable is not None or self.glove is not None
        refuse(
            (self.stretch not in (None, *STRETCHES), "--stretch", expected),
            (self.stretch is not None and not has_cable, "--stretch", "there is no --cable that stretches"),
        )

    def setup(self, *, is_on_part: bool) -> "Setup":
        """Return the setup of the simulation."""
        from proximity.lab.simulation import simulated_press

        if self.latency is not None:
            check_range(self.latency, "--latency", 0.0, 1e3 * simulated_press.LONGEST_LATENCY, "ms")
        check_range(self.speed, "--speed", *simulated_press.SPEEDS_ALLOWED, "m/s")
        if self.rate is not None:
            check_range(self.rate, "--rate", *simulated_press.RATES_ALLOWED, "Hz")
        options = self._worn() | {
            "gear": self.drum,
            "policy": self.policy,
            "rate": self.rate,
            "stiffness": None if is_on_part else self.stiffness,
            "damping": None if is_on_part else self.damping,
            "stretch": self.stretch,
        }
        if self.latency is not None:
            options["latency"] = 1e-3 * self.latency
        if self.cable is not None:
            options["cable"] = cable_stiffness(self.cable)
        chosen: dict[str, Any] = {name: value for name, value in options.items() if value is not None}
        return simulated_press.Setup(wall=simulated_press.Wall(self.wall), speed=self.speed, **chosen)

    def _worn(self) -> dict[str, Any]:
        """Return the settings that the glove file provides.

        They are the glove, its cable, and its measured latency if any.
        """
        if self.glove is None:
            return {}
        from proximity.decaff.glove.calibrated_glove import CalibratedGlove, read_any_glove
        from proximity.decaff.glove.glove import CONTACT_BEND

        worn = read_any_glove(self.glove)
        parts = designed(worn)
        latency = worn.calibration.latency if isinstance(worn, CalibratedGlove) else None
        return {"glove": parts, "cable": float(parts.tip_stiffness(CONTACT_BEND)), "latency": latency}


@dataclass(frozen=True, slots=True)
class PartOptions:
    """Options of a press on a part of a scene."""

    scene: Annotated[Path | None, option("FILE", "Press on a part: a mesh, STEP or scene file (.toml).")] = (
        None
    )
    part: Annotated[str | None, option("NAME", "Part of the scene to press on. Other parts are ignored.")] = (
        None
    )
    at: Annotated[
        tuple[float, float, float] | None,
        option(
            "X Y Z",
            "Press on the surface point nearest to this position. Default: from above the middle.",
        ),
    ] = None
    sensor: Annotated[bool, flag("--sensor", "Teleoperation: a sensor at the far end measures the part.")] = (
        False
    )
    units: UNITS = "mm"

    def check(self) -> None:
        """Reject options that require a scene."""
        given = {"--part": self.part, "--at": self.at}
        if self.scene is None:
            refuse(*((value is not None, name, OF_A_SCENE) for name, value in given.items()))
            refuse((self.sensor, "--sensor", OF_A_SCENE))
