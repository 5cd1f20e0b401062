"""Fields of messages, from which NumPy types, the C header and documentation are generated.

Each field is declared once. Numbers are little-endian, and offsets are multiples of the size.
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
    type: str  # NumPy type string
    unit: str  # empty for a number without a unit
    meaning: str
    shape: tuple[int, ...] = ()


def dtype_of(fields: Sequence[Field]) -> np.dtype:
    """Return the NumPy type of a header or a record, which has no gaps."""
    return np.dtype([(field.name, field.type, field.shape) for field in fields])


def blank_of(record: np.dtype, zeros: Sequence[str] = ()) -> np.ndarray:
    """Return a record with unset fields.

    Real numbers are nan, rotations are the identity, and other fields and those named in *zeros* are 0.
    """
    blank = np.zeros((), record)
    for name in record.names or ():
        if record[name].base.kind == "f" and name not in zeros:
            blank[name] = np.eye(3) if record[name].shape == ROTATION else np.nan
    return blank


def struct_of(fields: Sequence[Field]) -> Struct:
    """Return a `Struct` that unpacks all whole numbers of a header at once.

    It takes a third of the time in which NumPy unpacks one number. Fields whose name begins with ``reserved``
    are skipped.
    """
    codes = {"u1": "B", "u2": "H", "u4": "I", "u8": "Q", "i4": "i", "i8": "q"}
    parts = []
    for field in fields:
        size = np.dtype((field.type, field.shape)).itemsize
        parts.append(f"{size}x" if field.name.startswith("reserved") else codes[field.type[1:]])
    return Struct("<" + "".join(parts))


def reserved(size: int) -> Field:
    """Return a field of padding that aligns the next field."""
    return Field("reserved", "<u1", "", "zeros", (size,))
