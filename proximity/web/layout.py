"""The layout of messages for JavaScript, made of the same tables as the NumPy types and the C header.

A module without imports: ``RECORDS[name]`` has the size of a header or a record and its fields, each with
its name, offset, type as `DataView` calls it, and how many numbers it has; ``KINDS`` the magic, header and
record of each message; ``ENUMS`` the numbers of states, flags and modes.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from proximity.message import MAX_RECORDS, PATH_CORNERS, VERSION
from proximity.message.c_header import ENUMS, KINDS, RECORDS
from proximity.message.envelope import CHECKED_FROM
from proximity.message.fields import Field, dtype_of
from proximity.web.slice_fields import SLICE_FIELDS, SLICE_MAGIC

VIEWS = {
    "u1": "Uint8", "u2": "Uint16", "u4": "Uint32", "u8": "BigUint64",
    "i4": "Int32", "i8": "BigInt64", "f4": "Float32", "f8": "Float64",
}  # fmt: skip
"""What `DataView` calls a number."""
TEXT = "Text"

_RECORD_OF = {
    "frame": ("frame_header", "contact"),
    "poses": ("input_header", "pose"),
    "path_poses": ("input_header", "path_pose"),
    "glove_poses": ("input_header", "glove_pose"),
    "moves": ("input_header", "move"),
    "measured": ("input_header", "measurement"),
}


def layout_module() -> str:
    """Return the text of ``layout.js``, an ES module."""
    records = {name: _record(fields) for name, (_, fields) in RECORDS.items()}
    records["slice_header"] = _record(SLICE_FIELDS)
    kinds = {
        kind.name: dict(zip(("header", "record"), _RECORD_OF[kind.name], strict=True)) | {"magic": kind.magic}
        for kind in KINDS
    }
    enums = {
        values.__name__: {member.name: int(member.value) for member in values} for values in ENUMS.values()
    }
    constants = {
        "VERSION": VERSION,
        "MAX_RECORDS": MAX_RECORDS,
        "PATH_CORNERS": PATH_CORNERS,
        "CHECKED_FROM": CHECKED_FROM,
        "SLICE_MAGIC": SLICE_MAGIC,
        "RECORDS": records,
        "KINDS": kinds,
        "ENUMS": enums,
    }
    lines = ["// Made by proximity.web.layout of the tables that the C header is made of: do not edit."]
    lines += [f"export const {name} = {json.dumps(value, indent=1)};" for name, value in constants.items()]
    return "\n".join(lines) + "\n"


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
