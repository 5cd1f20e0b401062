"""The layout of messages for JavaScript, made of the same tables as the NumPy types and the C header.

A module without imports: ``RECORDS[name]`` has the size of a header or a record and its fields, each with
its name, offset, type as `DataView` calls it, and how many numbers it has; ``KINDS`` the magic, header and
record of each message; ``ENUMS`` the numbers of states, flags and modes.
"""

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from proximity.message.c_header import ENUMS, KINDS, RECORDS
from proximity.message.envelope import CHECKED_FROM, MAX_RECORDS, VERSION
from proximity.message.fields import Field, dtype_of
from proximity.message.inputs import PATH_CORNERS

VIEWS = {
    "u1": "Uint8", "u2": "Uint16", "u4": "Uint32", "u8": "BigUint64",
    "i4": "Int32", "i8": "BigInt64", "f4": "Float32", "f8": "Float64",
}  # fmt: skip
"""What `DataView` calls a number."""
TEXT = "Text"


def layout_module(
    records: Mapping[str, Sequence[Field]] | None = None, constants: Mapping[str, Any] | None = None
) -> str:
    """Return the text of an ES module with the layout of all messages.

    Parameters
    ----------
    records : mapping of sequences of Field
        More records, by their names.
    constants : mapping
        More constants, by their names, as JSON has them.
    """
    all_records = {name: fields for name, (_, fields) in RECORDS.items()} | dict(records or {})
    values = {
        "VERSION": VERSION,
        "MAX_RECORDS": MAX_RECORDS,
        "PATH_CORNERS": PATH_CORNERS,
        "CHECKED_FROM": CHECKED_FROM,
        **(constants or {}),
        "RECORDS": {name: _record(fields) for name, fields in all_records.items()},
        "KINDS": {
            kind.name: {
                "header": record_name(kind.header),
                "record": record_name(kind.record),
                "magic": kind.magic,
                "sent": kind.sent,
            }
            for kind in KINDS
        },
        "ENUMS": {
            enum.__name__: {member.name: int(member.value) for member in enum} for enum in ENUMS.values()
        },
    }
    lines = ["// Made by proximity of the tables that the C header is made of: do not edit."]
    lines += [f"export const {name} = {json.dumps(value, indent=1)};" for name, value in values.items()]
    return "\n".join(lines) + "\n"


def record_name(dtype: np.dtype) -> str:
    """The name in `RECORDS` of a header or a record."""
    return next(name for name, (_, fields) in RECORDS.items() if dtype_of(fields).fields == dtype.fields)


def _record(fields: Sequence[Field]) -> dict[str, Any]:
    dtype = dtype_of(fields)
    return {"size": dtype.itemsize, "fields": {field.name: _field(field, dtype) for field in fields}}


def _field(field: Field, dtype: np.dtype) -> dict[str, Any]:
    offset = dtype.fields[field.name][1]  # type: ignore[index]
    base = np.dtype(field.type)
    if base.kind == "S":
        return {"offset": offset, "type": TEXT, "count": base.itemsize}
    count = int(np.prod(field.shape, dtype=np.int64))
    return {"offset": offset, "type": VIEWS[base.str[1:]], "count": count, "size": base.itemsize}
