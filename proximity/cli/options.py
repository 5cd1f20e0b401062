"""Options that several commands share."""

import inspect
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

import proximity
from proximity.cli import progress
from proximity.cli.output import report

if TYPE_CHECKING:
    from proximity.decaff.glove.calibrated_glove import CalibratedGlove
    from proximity.decaff.glove.glove import Glove
    from proximity.lab.figures.style import Sheet

LARGEST = sys.float_info.max
MAX_S = 1e9
SLOW_S = 2.0
"""Reading time above which a faster command is suggested, s."""
SOFTEST_CABLE, STIFFEST_CABLE = 10.0, 1e6  # N/m at the fingertip


def _complete_units(incomplete: str) -> list[str]:
    from proximity.formats import UNITS as known  # slow to import, and only needed for completion

    return [name for name in known if name.startswith(incomplete)]


def _unit_name(text: str | None) -> str | None:
    """Return the library's name of a unit, which may be given as MM, inch or metres."""
    if text in ("mm", "m", None):
        return text
    from proximity.formats import unit_name  # slow to import

    return unit_name(text)


def check_range(
    value: float, option: str, lower: float, upper: float = LARGEST, unit: str = "", *, is_open: bool = False
) -> None:
    """Reject nan and a number that is out of range.

    *is_open*: whether *lower* itself is also rejected.
    """
    if not (lower < value if is_open else lower <= value) or not value <= upper:
        above = f"more than {lower:g}" + (f", up to {upper:g}" if upper < LARGEST else "")
        expected = above if is_open else f"{lower:g} to {upper:g}"
        raise typer.BadParameter(f"{f'{value:g} {unit}'.rstrip()}: expected {expected}", param_hint=option)


def within(*ends: Any, **options: Any) -> Callable[[Any, typer.CallbackParam], Any]:
    """Return a callback of an option that checks the given number by `check_range`."""

    def check(value: Any, param: typer.CallbackParam) -> Any:
        if value is not None:
            check_range(value, param.opts[0], *ends, **options)
        return value

    return check


def milliseconds(text: str) -> float:
    """Return a duration in ms from a text such as 10, 10ms, 0.01s or 500us.

    A number without a unit is in ms.
    """
    number = text.strip().replace("µ", "u")
    unit = next((each for each in ("ms", "us", "s") if number.endswith(each)), "")
    try:
        return {"": 1.0, "ms": 1.0, "us": 1e-3, "s": 1e3}[unit] * float(number.removesuffix(unit))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r}: expected milliseconds, or a time such as 10ms or 500us"
        ) from None


def refuse(*cases: tuple[object, str, str]) -> None:
    """Reject an option if one of the cases applies.

    A case has a condition, an option and a reason; the first true one is reported.
    """
    for is_true, name, why in cases:
        if is_true:
            raise typer.BadParameter(why, param_hint=name)


def option(metavar: str, help: str, *names: str, **more: Any) -> Any:
    """Return an option with a value, for Typer."""
    return typer.Option(*names, metavar=metavar, help=help, **more)


def flag(name: str, help: str, **more: Any) -> Any:
    """Return an option without a value, for Typer."""
    return typer.Option(name, help=help, **more)


def argument(metavar: str, help: str, **more: Any) -> Any:
    """Return an argument, for Typer."""
    return typer.Argument(metavar=metavar, help=help, **more)


def _check_gear(name: str | None, param: typer.CallbackParam) -> str | None:
    """Reject a gear whose name is unknown."""
    if name is not None:
        from proximity.decaff.drum.drum_model import gear_named
        from proximity.errors import ArgumentError

        try:
            gear_named(name)
        except ArgumentError as unknown:
            raise typer.BadParameter(str(unknown), param_hint=param.opts[0]) from unknown
    return name


FILE_HELP = "Parts: STL, OBJ, PLY, OFF, glTF/GLB, 3MF, STEP, a compiled scene or a scene file (.toml)."
FILE = Annotated[Path, argument("FILE", FILE_HELP)]
FILES = Annotated[list[Path], argument("FILE", FILE_HELP)]
SCENE_FILE = ".toml"
MAY_CONVERT = (".step", ".stp", SCENE_FILE)
"""STEP files, and files that may refer to them."""

UNITS = Annotated[
    str,
    option(
        "UNIT",
        "Unit of coordinates and answers, and of files that declare none: m, cm, mm, um, in, ft ...",
        autocompletion=_complete_units,
        callback=_unit_name,
    ),
]
POINTS_UNITS = Annotated[
    str | None,
    option(
        "UNIT",
        "Unit of the points of --points. Default: that of --units.",
        autocompletion=_complete_units,
        callback=_unit_name,
    ),
]
CONTACT = Annotated[
    float | None,
    option(
        "LENGTH",
        "Pairs no deeper in each other than this are touching. Default: the tolerance of a STEP file, "
        "else 1e-5 mm.",
        callback=within(0.0),
    ),
]
ALLOW = Annotated[
    Path | None,
    option("FILE", "Leave out the pairs of this CSV file, as --csv writes it; patterns are names, too."),
]

ADDRESS = Annotated[
    str,
    argument("ADDRESS", "shm://NAME (this machine), udp://HOST:PORT (to listen on) or zenoh://KEY."),
]

JSON = Annotated[bool, flag("--json", "Write one JSON document.")]
JSON_SI = Annotated[bool, flag("--json", "Write one JSON document, in SI units.")]
JSON_SUMMARY = Annotated[bool, flag("--json", "Write the summary as a JSON document.")]
SECONDS = within(0.0, MAX_S, "seconds", is_open=True)
LIMIT = Annotated[
    float | None, option("S", "Stop after this many seconds; Ctrl-C stops at any time.", callback=SECONDS)
]
GEAR = Annotated[
    str | None,
    option(
        "GEAR",
        "Gear of the drum: gear14, gear51 or gear111, named by the total gear ratio.",
        callback=_check_gear,
    ),
]
CABLE = Annotated[
    str | None,
    option(
        "N/M|FILE",
        "Stiffness of the cable at the fingertip, or a glove file with its measured stiffness. "
        "Default: no cable.",
    ),
]
GLOVE = Annotated[
    Path | None,
    option(
        "FILE",
        "Glove file, written by calibrate or by hand: motor, gear, lever, linkage and cable. "
        "Default: a glove with assumed dimensions.",
    ),
]
GLOVES = Annotated[
    list[Path] | None,
    option(
        "FILE",
        "Glove file, written by calibrate or by hand: one for all fingers, or one for each. "
        "Default: a glove with assumed dimensions.",
    ),
]


@contextmanager
def _conversions(files: tuple[Path, ...]) -> Iterator[Callable[[], int]]:
    """Convert all STEP files of the block in one process.

    Yield a function that returns the number of results stored in the cache.
    """
    if not any(file.suffix.lower() in MAY_CONVERT for file in files):
        yield lambda: 0
        return
    from proximity.formats.step.conversion import CACHE, converter  # imports 12 modules

    before = CACHE.kept_count
    with converter():
        yield lambda: CACHE.kept_count - before


@dataclass(frozen=True, slots=True)
class Reading:
    """Options for reading a file of parts."""

    units: UNITS = "mm"
    scale: Annotated[
        float,
        option(
            "FACTOR",
            "Multiply all lengths of the file; 0.001 for a GLB in mm.",
            callback=within(0.0, is_open=True),
        ),
    ] = 1.0
    step_tolerance: Annotated[
        float,
        option(
            "MM",
            "Deviation of triangles from the curved faces of a STEP file; free-form faces may exceed it.",
            callback=within(0.0, is_open=True),
        ),
    ] = 0.01
    unpacked_limit: Annotated[
        float, option("GB", "Largest unpacked size of a 3MF file.", callback=within(0.0, is_open=True))
    ] = 2.0
    no_cache: Annotated[
        bool, flag("--no-cache", "Convert a STEP file again, without the triangles of earlier commands.")
    ] = False

    def load(self, *files: Path, doing: str = "reading") -> "proximity.Scene":
        """Read the files and return them as one scene.

        A spinner shows the progress, and kernels are compiled first if needed.
        """
        progress.prepare_kernels()
        started, scenes = time.monotonic(), []
        with _conversions(files) as kept_count:
            for file in files:
                with progress.spinner(f"{doing} {file}") as count:
                    scenes.append(self._load(file, count))
        seconds = time.monotonic() - started
        if seconds > SLOW_S and doing == "reading" and sys.stderr.isatty():
            words = " ".join(map(str, files))
            remedy = f"a file of `proximity compile {words}` opens immediately"
            if kept_count():
                remedy = "the triangles are stored, and the next command will not convert the file again"
            report(f"note: reading took {seconds:.1f} s; {remedy}")
        if len(scenes) == 1:
            return scenes[0]
        from proximity.scene.loader import joined

        return joined(scenes)

    def _load(self, file: Path, count: Callable[[int, int], None]) -> "proximity.Scene":
        if file.suffix.lower() == SCENE_FILE:
            from proximity.service.config import PartFiles, read_scene_file

            refuse((self.scale != 1.0, "--scale", f"{file} is a scene file, whose files are not scaled"))
            return PartFiles(cache=not self.no_cache).scene(read_scene_file(file))
        return proximity.load(str(file), units=self.units, progress=count, **self.options())

    def options(self) -> dict[str, Any]:
        """Return the options of `load` except the unit."""
        return {
            "scale": self.scale,
            "step_tolerance": self.step_tolerance / 1e3,
            "unpacked_limit": self.unpacked_limit * 1e9,
            "cache": not self.no_cache,
        }


WIDTH = Annotated[
    float | None,
    option("MM", "Width of the figure; the text size is fixed.", callback=within(40.0, 1000.0, "mm")),
]


@dataclass(frozen=True, slots=True)
class Printing:
    """Options for the layout of a figure."""

    width: WIDTH = None
    caption: Annotated[
        bool, flag("--caption/--no-caption", "Print the conditions below the figure.", show_default=False)
    ] = True

    def sheet(self) -> "Sheet":
        """Return the options in the form that the library takes."""
        from proximity.lab.figures.style import Sheet

        return Sheet(None if self.width is None else self.width / 1e3, self.caption)


def cable_stiffness(text: str, max_age: float | None = None) -> float:
    """Return the stiffness of a cable at the fingertip of a half bent finger, N/m.

    *text*: a number, or the file of a glove's calibration. *max_age*: maximum age of a calibration; None:
    that of `check_age`.
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
    check_range(stiffness, "--cable", SOFTEST_CABLE, STIFFEST_CABLE, "N/m at the fingertip")
    return stiffness


def designed(worn: "Glove | CalibratedGlove") -> "Glove":
    """Return the parts of a glove. They are as measured if it was calibrated, else as designed."""
    from proximity.decaff.glove.glove import Glove

    return worn if isinstance(worn, Glove) else worn.glove


def with_option_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command in which every field of its dataclass parameters is a separate option.

    *command*: function whose annotations, and those of the dataclasses, are in the form that Typer takes.
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
    """Return the path of a sample file.

    In a checkout it is next to the package, otherwise inside the package.
    """
    package = Path(proximity.__file__).parent
    for folder in (package / "samples", package.parent / "meshes"):
        if (folder / name).is_file():
            return folder / name
    raise proximity.ServiceError(f"the sample {name} is neither in {package} nor in meshes next to it")
