"""Validation of the description in a compiled scene: types and ranges of its entries."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from proximity.errors import ArgumentError, MeshFormatError
from proximity.mesh.body_split import Repairs
from proximity.scene.model.scene_state import first_unfit_move
from proximity.scene.part import NO_DEVIATIONS, checked_surface
from proximity.scene.sign import SignMethod

_NO_ROWS = np.zeros((0, 3))
_REPAIRS = tuple(field.name for field in fields(Repairs))
_REPORT = {
    "path": str,
    "format": str,
    "units": str,
    "units_declared": bool,
    "notes": list,
    "approximation": float,
}


def expect(is_right: Any, message: str) -> None:
    """Raise a `MeshFormatError` with *message* unless *is_right*."""
    if not is_right:
        raise MeshFormatError(message)


def list_of(kind: type, value: Any, what: str, count: int | None = None) -> list[Any]:
    """Return *value* if it is a list whose entries all have the type *kind*, otherwise raise an error.

    *kind*: exact type, so that True is not a whole number. *count*: expected number of entries, if given.
    """
    expect(type(value) is list, f"{what} are {_shown(value)}, expected a list")
    expect(count is None or len(value) == count, f"there are {len(value)} {what}, expected {count}")
    for number, entry in enumerate(value):
        expect(type(entry) is kind, f"entry {number} of {what} is {_shown(entry)}, expected {kind.__name__}")
    return list(value)


def numbers_below(limit: int, value: Any, what: str, count: int | None = None) -> list[int]:
    """Return *value* if it is a list of whole numbers from 0 to *limit* - 1, otherwise raise an error.

    *count*: expected number of entries, if given.
    """
    numbers = list_of(int, value, what, count)
    bad = next((number for number in numbers if not 0 <= number < limit), None)
    expect(bad is None, f"{what} have {_shown(bad)}, expected 0 to {limit - 1}")
    return numbers


def names_of(value: Any) -> tuple[str, ...]:
    """Return the names of all parts, or raise an error if two are equal."""
    names = list_of(str, value, "names")
    expect(len(set(names)) == len(names), "two parts have one name")
    return tuple(names)


def repairs_of(value: Any) -> Repairs:
    """Return repairs from a dictionary of counts."""
    expect(type(value) is dict and tuple(value) == _REPAIRS, f"repairs are {_shown(value)}")
    for entry in value.values():
        expect(type(entry) in (bool, int, float) and 0 <= entry < np.inf, f"repairs are {_shown(value)}")
    return Repairs(**value)


def velocities_of(value: Any, what: str, count: int) -> np.ndarray:
    """Return the velocities of all parts as a read-only array, (P, 3) float64."""
    rows = list_of(list, value, what, count)
    expect(all(len(row) == 3 and all(type(entry) is float for entry in row) for row in rows),
           f"{what} are not three numbers each")  # fmt: skip
    velocities = np.array(rows, np.float64).reshape(count, 3)
    still = np.broadcast_to(np.eye(4), (count, 4, 4)).copy()
    row = first_unfit_move(still, velocities, _NO_ROWS)
    expect(row < 0, f"{what} of part {row} are not finite, or too fast")
    velocities.flags.writeable = False
    return velocities


def surfaces_of(
    stiffness: Any, damping: Any, names: tuple[str, ...]
) -> tuple[list[float | None], list[float]]:
    """Return two lists with the stiffness and the damping of all parts."""
    expect(type(stiffness) is list and len(stiffness) == len(names), "stiffness is not a list, one a part")
    expect(all(one is None or type(one) is float for one in stiffness), "stiffness is no number of some part")
    dampings = list_of(float, damping, "damping", len(names))
    try:
        pairs = [checked_surface(*each) for each in zip(names, stiffness, dampings, strict=True)]
    except ArgumentError as reason:
        raise MeshFormatError(str(reason)) from None
    return [pair[0] for pair in pairs], [pair[1] for pair in pairs]


def deviations_of(value: Any, faces: list[np.ndarray]) -> list[np.ndarray]:
    """Return the deviations of all parts from their CAD faces as read-only arrays; empty in earlier files.

    *faces*: CAD face of each face of each part.
    """
    if value is None:
        return [NO_DEVIATIONS] * len(faces)
    found = []
    for row, (entries, rows) in enumerate(
        zip(list_of(list, value, "deviations", len(faces)), faces, strict=True)
    ):
        deviations = np.array([np.inf if entry is None else entry for entry in entries], np.float64)
        expect(deviations.ndim == 1 and (deviations >= 0.0).all(), f"deviations of part {row} are negative")
        expect(
            not len(deviations) or (rows.min(initial=-1) >= -1 and rows.max(initial=-1) < len(deviations)),
            f"part {row} has {len(deviations)} deviations, but other CAD faces",
        )
        deviations.flags.writeable = False
        found.append(deviations)
    return found


def report_of(value: Any) -> dict[str, Any] | None:
    """Return the fields of a report, or None if there is none."""
    if value is None:
        return None
    expect(type(value) is dict, f"the report is {_shown(value)}")
    value = {"approximation": 0.0} | value  # earlier files do not have it
    expect(value.keys() == _REPORT.keys(), f"the report is {_shown(value)}")
    for field, kind in _REPORT.items():
        expect(type(value[field]) is kind, f"the report has {_shown(value[field])} for {field}")
    list_of(str, value["notes"], "notes")
    return dict(value)


def solid_of(value: Any, part_count: int) -> tuple[int, str, SignMethod, str, bool]:
    """Return the five fields of a solid.

    They are its first part, name, sign method, the reason for it, and whether the solid is watertight.
    """
    expect(type(value) is list and len(value) == 5, f"a solid is {_shown(value)}")
    kinds: tuple[Callable[..., Any], ...] = (int, str, str, str, bool)
    expect(all(type(entry) is kind for entry, kind in zip(value, kinds, strict=True)),
           f"a solid is {_shown(value)}")  # fmt: skip
    row, name, method, reason, is_watertight = value
    expect(0 <= row < part_count, f"a solid is that of part {row}, but there are {part_count}")
    methods = {known.value: known for known in SignMethod}
    expect(method in methods, f"solid {name!r} has the sign method {_shown(method)}")
    return row, name, methods[method], reason, is_watertight


def _shown(value: Any) -> str:
    """Return a value as text, shortened for a message."""
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."
