"""Fields of messages, each declared once: NumPy types, C header and documentation are generated from them.

A field's number is little-endian and its offset is a multiple of its size.
"""

from collections.abc import Sequence
from struct import Struct
from typing import NamedTuple

import numpy as np

VECTOR = (3,)
"""Shape of x, y, z in the scene's frame."""
ROTATION = (3, 3)
"""Shape of a rotation, row by row."""


class Field(NamedTuple):
    """One field of a header or a record."""

    name: str
    type: str  # as NumPy writes it
    unit: str  # empty: a number without one
    meaning: str
    shape: tuple[int, ...] = ()


def dtype_of(fields: Sequence[Field]) -> np.dtype:
    """Return the NumPy type of a header or a record, without gaps."""
    return np.dtype([(field.name, field.type, field.shape) for field in fields])


def blank_of(record: np.dtype, zeros: Sequence[str] = ()) -> np.ndarray:
    """Return a record with unset fields: reals are nan, rotations the identity, all else and *zeros* 0."""
    blank = np.zeros((), record)
    for name in record.names or ():
        if record[name].base.kind == "f" and name not in zeros:
            blank[name] = np.eye(3) if record[name].shape == ROTATION else np.nan
    return blank


def struct_of(fields: Sequence[Field]) -> Struct:
    """Return a `Struct` that unpacks whole numbers together, three times as fast as NumPy unpacks one.

    Fields whose name begins with ``reserved`` are skipped.
    """
    codes = {"u1": "B", "u2": "H", "u4": "I", "u8": "Q", "i4": "i", "i8": "q"}
    parts = []
    for field in fields:
        size = np.dtype((field.type, field.shape)).itemsize
        parts.append(f"{size}x" if field.name.startswith("reserved") else codes[field.type[1:]])
    return Struct("<" + "".join(parts))


def reserved(size: int) -> Field:
    """Return padding that aligns the next field."""
    return Field("reserved", "<u1", "", "zeros", (size,))
