"""Design of a glove as a builder writes it into the glove's file: a table a part, fields in SI units.

What is not written is of our own dimensions.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from proximity.decaff.drum.drum_model import Gear, Motor, gear_named
from proximity.decaff.glove.drum_geometry import ArmDrum, EccentricDrum
from proximity.decaff.glove.finger import Finger
from proximity.decaff.glove.glove import Glove
from proximity.decaff.glove.linkage import Linkage
from proximity.decaff.glove.transmission import Cable, Potentiometer
from proximity.errors import ArgumentError

PARTS: dict[str, Any] = {
    "finger": Finger, "linkage": Linkage, "cable": Cable, "potentiometer": Potentiometer,
    "drum": ArmDrum, "motor": Motor, "gear": Gear,
}  # fmt: skip
ALWAYS = ("name", "crank")  # fields that are written although they are the usual ones: they tell parts apart


def glove_of(table: Any) -> Glove:
    """Return the glove of a table; a gear may be one of `GEARS` by name, a drum with a crank is eccentric."""
    if not isinstance(table, Mapping):
        raise ArgumentError(f"the design is {table!r}, expected {', '.join(PARTS)}, each with its numbers")
    _check_names("the design", table, PARTS)
    return Glove(**{name: _part(name, numbers) for name, numbers in table.items()})


def table_of(glove: Glove) -> dict[str, Any]:
    """Return what of a glove is not of our own dimensions."""
    usual: Glove = Glove()
    found: dict[str, Any] = {}
    for name in PARTS:
        part = getattr(glove, name)
        if part != getattr(usual, name):
            default = type(part)()
            found[name] = {
                field.name: getattr(part, field.name)
                for field in fields(part)
                if field.name in ALWAYS or getattr(part, field.name) != getattr(default, field.name)
            }
    return found


def _part(name: str, numbers: Any) -> Any:
    if name == "gear" and isinstance(numbers, str):
        return gear_named(numbers)
    if not isinstance(numbers, Mapping):
        raise ArgumentError(f"{name} of the design is {numbers!r}, expected its fields")
    kind: Any = EccentricDrum if name == "drum" and "crank" in numbers else PARTS[name]
    types = {field.name: field.type for field in fields(kind)}
    _check_names(f"{name} of the design", numbers, types)
    for field, value in numbers.items():
        expected = (
            str if types[field] in (str, "str") else list if "tuple" in str(types[field]) else (int, float)
        )
        if not isinstance(value, expected) or isinstance(value, bool):
            raise ArgumentError(f"{field} of {name} is {value!r}, expected {_words(expected)}")
    values = {field: tuple(value) if isinstance(value, list) else value for field, value in numbers.items()}
    return kind(**values)


def _words(expected: Any) -> str:
    return {str: "text", list: "numbers in a list"}.get(expected, "a number")


def _check_names(what: str, found: Mapping[str, Any], known: Mapping[str, Any]) -> None:
    for name in found:
        if name not in known:
            raise ArgumentError(f"{what} has {name!r}, expected some of {', '.join(known)}")
