"""Options that several commands share."""

import inspect
import math
from collections.abc import Callable
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

import proximity

if TYPE_CHECKING:
    from proximity.decaff.glove.calibrated_glove import CalibratedGlove
    from proximity.decaff.glove.glove import Glove

LONGEST_S = 1e9


def _complete_units(incomplete: str) -> list[str]:
    from proximity.formats import UNITS as known  # slow, and only for the one who presses Tab here

    return [name for name in known if name.startswith(incomplete)]


def _unit_name(text: str) -> str:
    """The unit as the library spells it: MM, inch and inches are taken too."""
    unit = text.lower()
    return "in" if unit in ("inch", "inches") else unit


FILE = Annotated[
    Path,
    typer.Argument(
        metavar="FILE", help="Parts: STL, OBJ, PLY, OFF, glTF/GLB, 3MF, STEP or a compiled scene."
    ),
]

UNITS = Annotated[
    str,
    typer.Option(
        "--units",
        metavar="UNIT",
        autocompletion=_complete_units,
        callback=_unit_name,
        help="Unit of coordinates and answers, and of files that declare none: m, cm, mm, um, in, ft ...",
    ),
]


ADDRESS = Annotated[
    str,
    typer.Argument(
        metavar="ADDRESS",
        help="shm://NAME or iox2://NAME (this machine), udp://HOST:PORT (to listen on) or zenoh://KEY.",
    ),
]

LIMIT = Annotated[
    float | None,
    typer.Option(
        "--limit", metavar="SECONDS", help="Stop after this many seconds; Ctrl-C stops at any time."
    ),
]

CABLE = Annotated[
    str | None,
    typer.Option(
        "--cable",
        metavar="N/M|FILE",
        help="Stiffness of the cable at the fingertip, or the calibration of the glove that it was measured "
        "in. Without it, no cable.",
    ),
]
GLOVE = Annotated[
    Path | None,
    typer.Option(
        "--glove",
        metavar="FILE",
        help="File of the glove, as calibrate or a builder wrote it: motor, gear, lever, linkage and cable. "
        "Default: a glove with assumed dimensions.",
    ),
]
GLOVES = Annotated[
    list[Path] | None,
    typer.Option(
        "--glove",
        "--calibration",
        metavar="FILE",
        help="File of the glove, as calibrate or a builder wrote it: one for all fingers, or one for each. "
        "Default: a glove with assumed dimensions.",
    ),
]
SOFTEST_CABLE, STIFFEST_CABLE = 10.0, 1e6  # N/m at the fingertip


@dataclass(frozen=True, slots=True)
class Reading:
    """How a file of parts is read."""

    units: UNITS = "mm"
    step_tolerance: Annotated[
        float,
        typer.Option(
            metavar="MM", help="Largest deviation of triangles from the curved faces of a STEP file."
        ),
    ] = 0.01
    unpacked_limit: Annotated[
        float, typer.Option(metavar="GB", help="Largest unpacked size of a 3MF file.")
    ] = 2.0

    def check(self) -> None:
        """Refuse numbers out of range."""
        limits = {"--step-tolerance": self.step_tolerance, "--unpacked-limit": self.unpacked_limit}
        for name, value in limits.items():
            if not 0.0 < value < math.inf:
                raise typer.BadParameter(f"{value:g}: expected more than 0", param_hint=name)

    @property
    def metres(self) -> float:
        """The unit of coordinates and answers, m."""
        from proximity.formats import metres_per_unit

        return metres_per_unit(self.units)

    def load(self, file: Path, doing: str = "reading") -> "proximity.Scene":
        """Return the scene in a file, with a spinner, compiling kernels first where that is needed."""
        from proximity.cli import progress

        progress.prepare_kernels()
        with progress.spinner(f"{doing} {file}") as count:
            return proximity.load(
                str(file),
                units=self.units,
                progress=count,
                step_tolerance=self.step_tolerance / 1e3,
                unpacked_limit=self.unpacked_limit * 1e9,
            )


def check_range(value: float, option: str, meaning: str, smallest: float, largest: float) -> None:
    """Refuse a number out of range, nan included.

    *option*, *meaning*: which option, and what its number counts, for the message.
    """
    if not smallest <= value <= largest:
        raise typer.BadParameter(
            f"{value:g} {meaning}: expected {smallest:g} to {largest:g}", param_hint=option
        )


def check_limit(limit: float | None) -> None:
    """Refuse what is no time to go on for, nan included."""
    if limit is not None and not 0.0 < limit <= LONGEST_S:
        raise typer.BadParameter(
            f"{limit:g} seconds: expected more than 0, up to {LONGEST_S:g}", param_hint="--limit"
        )


def check_port(port: int) -> None:
    """Refuse what is no port to listen on."""
    if not 0 <= port < 65536:
        raise typer.BadParameter(f"{port}: expected 0 to 65535", param_hint="--port")


def cable_stiffness(text: str, max_age: float | None = None) -> float:
    """Return the stiffness of a cable at the fingertip, half bent, N/m.

    *text*: a number, or the file of a glove's calibration. *max_age*: of a calibration; that of `check_age`
    where not given.
    """
    try:
        stiffness = float(text)
    except ValueError:
        if not Path(text).exists():
            raise typer.BadParameter(
                f"{text!r}: expected a stiffness in N/m, or the file of a calibration", param_hint="--cable"
            ) from None
        from proximity.decaff.glove.calibrated_glove import read_any_glove
        from proximity.decaff.glove.glove import CONTACT_BEND

        stiffness = float(designed(read_any_glove(text, max_age)).tip_stiffness(CONTACT_BEND))
    check_range(stiffness, "--cable", "N/m at the fingertip", SOFTEST_CABLE, STIFFEST_CABLE)
    return stiffness


def designed(worn: "Glove | CalibratedGlove") -> "Glove":
    """Return a glove's parts: as measured where it was calibrated, else as designed."""
    from proximity.decaff.glove.glove import Glove

    return worn if isinstance(worn, Glove) else worn.glove


def check_gear(name: str | None) -> str | None:
    """Return the name of a gear of ours; refuse another one."""
    if name is not None:
        from proximity.decaff.drum.drum_model import gear_named
        from proximity.errors import ArgumentError

        try:
            gear_named(name)
        except ArgumentError as unknown:
            raise typer.BadParameter(str(unknown), param_hint="--drum") from unknown
    return name


def with_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command in which every field of a dataclass among its parameters is an option of its own.

    *command*: its annotations, and those of the dataclasses, are what Typer takes.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Any] = {name: kind for name, kind in hints.items() if is_dataclass(kind)}
    parameters: list[inspect.Parameter] = []
    for parameter in inspect.signature(command).parameters.values():
        if parameter.name not in groups:
            parameters.append(parameter.replace(kind=parameter.KEYWORD_ONLY))
            continue
        group = groups[parameter.name]
        types = get_type_hints(group, include_extras=True)
        hints |= types
        for field in fields(group):
            default = parameter.empty if field.default is MISSING else field.default
            parameters.append(
                inspect.Parameter(
                    field.name, parameter.KEYWORD_ONLY, default=default, annotation=types[field.name]
                )
            )

    def run(**values: Any) -> None:
        made = {
            name: group(**{field.name: values.pop(field.name) for field in fields(group)})
            for name, group in groups.items()
        }
        command(**made, **values)

    run.__doc__ = command.__doc__
    run.__annotations__ = {name: hint for name, hint in hints.items() if name not in groups}
    run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return run


def sample(name: str) -> Path:
    """Return where a sample file is: beside the package in a checkout, inside of it where it was
    installed.
    """
    package = Path(proximity.__file__).parent
    for folder in (package / "samples", package.parent / "meshes"):
        if (folder / name).is_file():
            return folder / name
    raise proximity.ServiceError(f"the sample {name} is neither in {package} nor in meshes beside it")
