"""Calibration of one finger's glove, which is read from a file and refused if too old or inconsistent.

A calibration consists of a table of counts over bends, some numbers (guide/motors.md) and the measured
design. Its file is JSON with units in the names of its fields, and is written atomically.
`decaff.calibration` computes the numbers from measurements, and `calibrated_glove` uses them.
"""

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from proximity.checks import as_float64, finite, not_negative, positive
from proximity.decaff.drum.drum_model import MAX_LATENCY as MAX_DRUM_LATENCY
from proximity.decaff.drum.drum_model import Gear, Motor, gear_named
from proximity.decaff.glove.finger import Finger
from proximity.decaff.glove.glove import ArmDrum, Glove
from proximity.decaff.glove.transmission import Cable, Linkage, Potentiometer
from proximity.errors import ArgumentError, DecaffError
from proximity.system.regular_file import open_regular
from proximity.system.whole_file import whole_file

PARTS: dict[str, Any] = {
    "finger": Finger, "linkage": Linkage, "cable": Cable, "potentiometer": Potentiometer,
    "drum": ArmDrum, "motor": Motor, "gear": Gear,
}  # fmt: skip
ALWAYS = "name"  # also written if it is the default, as it distinguishes parts


def glove_of(table: Any) -> Glove:
    """Return the glove that a table describes. Its gear may be the name of one of `GEARS`."""
    if not isinstance(table, Mapping):
        raise ArgumentError(f"the design is {table!r}, expected {', '.join(PARTS)}, each with its numbers")
    _check_names("the design", table, PARTS)
    return Glove(**{name: _part(name, numbers) for name, numbers in table.items()})


def table_of(glove: Glove) -> dict[str, Any]:
    """Return the fields of a glove that differ from the default dimensions."""
    usual: Glove = Glove()
    found: dict[str, Any] = {}
    for name in PARTS:
        part = getattr(glove, name)
        if part != getattr(usual, name):
            default = type(part)()
            found[name] = {
                field.name: getattr(part, field.name)
                for field in fields(part)
                if field.name == ALWAYS or getattr(part, field.name) != getattr(default, field.name)
            }
    return found


def _part(name: str, numbers: Any) -> Any:
    if name == "gear" and isinstance(numbers, str):
        return gear_named(numbers)
    if not isinstance(numbers, Mapping):
        raise ArgumentError(f"{name} of the design is {numbers!r}, expected its fields")
    kind: Any = PARTS[name]
    types = {one.name: one.type for one in fields(kind)}
    _check_names(f"{name} of the design", numbers, types)
    for key, value in numbers.items():
        expected = str if types[key] in (str, "str") else list if "tuple" in str(types[key]) else (int, float)
        if not isinstance(value, expected) or isinstance(value, bool):
            raise ArgumentError(f"{key} of {name} is {value!r}, expected {_words(expected)}")
    values = {key: tuple(value) if isinstance(value, list) else value for key, value in numbers.items()}
    return kind(**values)


def _words(expected: Any) -> str:
    return {str: "text", list: "numbers in a list"}.get(expected, "a number")


def _check_names(what: str, found: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    for name in found:
        if name not in known:
            raise ArgumentError(f"{what} has {name!r}, expected some of {', '.join(known)}")


FORMAT = "proximity glove calibration"
DESIGN_FORMAT = "proximity glove design"
"""Format of a file with a design alone, without measurements."""
FILE_VERSION = 1
"""Version of the file. Files of other versions are refused, as their fields may have other meanings."""
TABLE_SIZE = 7
"""Number of points of the table, including flat hand and fist."""
MAX_AGE_DAYS = 30.0
"""Maximum age of a calibration, as hands and straps change. Assumed."""
SLACK_DAYS = 1.0
"""Tolerance for future dates, as clocks of machines differ."""
MAX_TOUCH_OFFSET = 0.5
"""Maximum offset, rad, either way. A larger one indicates an encoder without a zero, or degrees. Assumed."""
MAX_COMPLIANCE = 1.0 / 500.0
"""Maximum compliance, m/N. A softer cable would be felt as a spring under any control. Assumed."""
MAX_BACKLASH = 10e-3
"""Maximum backlash, m of cable, which is a third of a radian of the replica. Assumed."""
MAX_LATENCY = 1.0
"""Maximum latency, s. With a longer one no frame would be valid. Assumed."""
MAX_FILE = 100_000
"""Maximum size of a file, bytes. A calibration has about 700."""


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """Measurements of one finger's glove. Raises an error if they contradict each other."""

    made: datetime  # when it was measured; with its time zone
    counts: np.ndarray  # (7,) float64, potentiometer with a slack cable while the finger closes; increasing
    bends: np.ndarray  # (7,) float64, from 0 to 1, increasing
    touch_offset: float  # rad, drum angle that the encoder reads at a touch, minus that of the geometry
    cable_compliance: float  # m/N
    backlash: float  # m of cable
    latency: float  # s, from a motion of the finger until its measurement
    phalanges: tuple[float, float, float]  # m
    name: str = ""  # of hand and finger, for display
    is_simulated: bool = False  # measured on a simulated glove: for practice only
    drum_inertia: float | None = None  # kg m² at the drum, rotor and gear together; None: as designed
    drum_friction: float | None = None  # N m at the drum
    drum_latency: float | None = None  # s, from the command of a torque to its effect
    design: Glove = field(default_factory=Glove)

    def __post_init__(self) -> None:
        if not isinstance(self.made, datetime) or self.made.tzinfo is None:
            raise DecaffError(f"the date is {self.made}, expected a date with a time zone")
        for name in ("counts", "bends"):
            object.__setattr__(self, name, _column(name, getattr(self, name)))
        if not (self.bends[0] == 0.0 and self.bends[-1] == 1.0):
            raise DecaffError(f"bends go from {self.bends[0]:g} to {self.bends[-1]:g}, expected 0 to 1")
        offset = finite("touch_offset", self.touch_offset, "radians")
        if abs(offset) > MAX_TOUCH_OFFSET:
            raise DecaffError(
                f"touch_offset is {offset:g} radians, expected {MAX_TOUCH_OFFSET:g} at most, either way"
            )
        for name, most, unit in (
            ("cable_compliance", MAX_COMPLIANCE, "metres a newton"),
            ("backlash", MAX_BACKLASH, "metres"),
            ("latency", MAX_LATENCY, "seconds"),
        ):
            value = not_negative(name, getattr(self, name), unit)
            if value > most:
                raise DecaffError(f"{name} is {value:g} {unit}, expected {most:g} at most")
        if len(self.phalanges) != 3:
            raise DecaffError(f"phalanges are {self.phalanges!r}, expected three numbers of metres")
        for length in self.phalanges:
            positive("one of phalanges", length, "metres")
        if self.drum_inertia is not None:
            positive("drum_inertia", self.drum_inertia, "kilogram square metres")
        if self.drum_friction is not None:
            not_negative("drum_friction", self.drum_friction, "newton metres")
        if self.drum_latency is not None and (
            not_negative("drum_latency", self.drum_latency, "seconds") > MAX_DRUM_LATENCY
        ):
            raise DecaffError(
                f"drum_latency is {self.drum_latency:g} seconds, expected {MAX_DRUM_LATENCY:g} at most"
            )


def write_calibration(path: str | os.PathLike[str], calibration: Calibration) -> None:
    """Write a calibration to a file atomically, replacing an existing one."""
    text = json.dumps(_as_document(calibration), indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with whole_file(path) as stream:
        stream.write(text.encode())


def read_calibration(path: str | os.PathLike[str]) -> Calibration:
    """Return the calibration in a file written by `write_calibration`, possibly edited by hand."""
    found = read_glove_file(path)
    if isinstance(found, Glove):
        raise DecaffError(f"{path}: is a design without measurements, expected a calibration of a glove")
    return found


def read_glove_file(path: str | os.PathLike[str]) -> Calibration | Glove:
    """Read the file of a glove, which contains a calibration or only a design."""
    try:
        document = _read_document(Path(path))
        if document["format"] == DESIGN_FORMAT:
            return glove_of(
                {name: part for name, part in document.items() if name not in ("format", "version")}
            )
        return _of_document(document)
    except (ArgumentError, DecaffError) as unfit:
        raise DecaffError(f"{path}: {unfit}") from unfit


def check_age(calibration: Calibration, *, max_days: float | None = None) -> None:
    """Raise an error for a calibration that is too old or dated in the future."""
    most = positive("max_days", MAX_AGE_DAYS if max_days is None else max_days, "days")
    age = (datetime.now(UTC) - calibration.made) / timedelta(days=1)
    date = f"{calibration.made:%Y-%m-%d}"
    if age > most:
        raise DecaffError(
            f"the calibration is of {date}, {age:.0f} days ago, expected {most:g} at most: calibrate again"
        )
    if age < -SLACK_DAYS:
        raise DecaffError(
            f"the calibration is of {date}, which is in the future, expected a date in the past: "
            "set the clock or calibrate again"
        )


# --- the document: its fields, and their attributes of a calibration ---

_FIELDS = {
    "name": "name",
    "made": "made",
    "counts": "counts",
    "bends": "bends",
    "touch_offset_rad": "touch_offset",
    "cable_compliance_m_per_N": "cable_compliance",
    "backlash_m": "backlash",
    "latency_s": "latency",
    "phalanges_m": "phalanges",
    "simulated": "is_simulated",
    "drum_inertia_kg_m2": "drum_inertia",
    "drum_friction_N_m": "drum_friction",
    "drum_latency_s": "drum_latency",
    "design": "design",
}
_MAY_LACK = {"simulated", "drum_inertia_kg_m2", "drum_friction_N_m", "drum_latency_s", "design"}
assert set(_FIELDS.values()) == {field.name for field in fields(Calibration)}, "every field has a position"


def _as_document(calibration: Calibration) -> dict[str, Any]:
    document: dict[str, Any] = {"format": FORMAT, "version": FILE_VERSION}
    for key, name in _FIELDS.items():
        value = getattr(calibration, name)
        if isinstance(value, np.ndarray):
            value = value.tolist()
        elif isinstance(value, datetime):
            value = value.isoformat()
        elif isinstance(value, Glove):
            value = table_of(value)
        elif value is None:
            continue
        elif not isinstance(value, str | tuple | bool):
            value = float(value)
        document[key] = value
    return document


def _read_document(path: Path) -> dict[str, Any]:
    try:
        with open_regular(path) as stream:
            data = stream.read(MAX_FILE + 1)
    except OSError as failure:
        raise DecaffError(f"cannot be read ({failure.strerror or failure})") from failure
    if len(data) > MAX_FILE:
        raise DecaffError(f"has more than {MAX_FILE} bytes, expected a calibration of a glove")
    try:
        document = json.loads(data.decode("utf-8"), object_pairs_hook=_once_each)
    except DecaffError:
        raise
    except (ValueError, RecursionError) as unfit:
        raise DecaffError(f"is not JSON ({unfit})") from unfit
    if not isinstance(document, dict) or document.get("format") not in (FORMAT, DESIGN_FORMAT):
        raise DecaffError(f"is not a calibration of a glove, expected the format {FORMAT!r}")
    if document.get("version") != FILE_VERSION or isinstance(document["version"], bool):
        raise DecaffError(
            f"has version {document.get('version')!r}, expected {FILE_VERSION}: "
            "calibrate again with this version"
        )
    return document


def _once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the fields of a JSON object. Raise an error for duplicates, whose meaning is ambiguous."""
    document = dict(pairs)
    if len(document) < len(pairs):
        twice = next(name for i, (name, _) in enumerate(pairs) if name in dict(pairs[:i]))
        raise DecaffError(f"has {twice!r} twice, expected each field once")
    return document


def _of_document(document: dict[str, Any]) -> Calibration:
    present = set(document) - {"format", "version"}
    lacking = set(_FIELDS) - present - _MAY_LACK
    for verb, names in (("lacks", lacking), ("has an unknown field", present - set(_FIELDS))):
        if names:
            raise DecaffError(f"{verb} {', '.join(map(repr, sorted(names)))}")
    values = {name: document[key] for key, name in _FIELDS.items() if key in document}
    if not isinstance(values["name"], str):
        raise DecaffError(f"the name is {values['name']!r}, expected text")
    if not isinstance(simulated := values.get("is_simulated", False), bool):
        raise DecaffError(f"simulated is {simulated!r}, expected true or false")
    try:
        values["made"] = datetime.fromisoformat(values["made"])
    except (TypeError, ValueError):
        raise DecaffError(
            f"the date is {values['made']!r}, expected a date such as 2026-11-21T19:30:00+00:00"
        ) from None
    if not isinstance(values["phalanges"], list):
        raise DecaffError(f"phalanges are {values['phalanges']!r}, expected three numbers of metres")
    values["phalanges"] = tuple(values["phalanges"])
    if "design" in values:
        values["design"] = glove_of(values["design"])
    return Calibration(**values)


def _column(name: str, values: Any) -> np.ndarray:
    """Return one column of the table, read-only."""
    expected = f"{TABLE_SIZE} increasing numbers"
    column = as_float64(values, name, expected=expected).copy()
    if column.shape != (TABLE_SIZE,):
        raise DecaffError(f"{name} have shape {column.shape}, expected {expected}")
    if not np.isfinite(column).all():
        raise DecaffError(f"{name} are {column.tolist()}, expected {expected}")
    falls = np.flatnonzero(~(np.diff(column) > 0.0))
    if len(falls):
        row = int(falls[0])
        raise DecaffError(
            f"the table is not monotone: {name} go from {column[row]:g} to {column[row + 1]:g} at its point "
            f"{row + 1}, expected {expected}"
        )
    column.flags.writeable = False
    return column
