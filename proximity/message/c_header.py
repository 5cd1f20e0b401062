"""Generate the C and C++ header ``proximity_message.h`` from the fields of the NumPy types.

The header needs only types of the standard library, also on a microcontroller. It has structures, numbers,
and a function that verifies that bytes are a frame.
"""

import ast
import inspect
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import Enum
from itertools import pairwise

import numpy as np

from proximity.core import CORE, receiver_state
from proximity.message.changes import (
    ADDITION_FIELDS,
    ADDITIONS,
    BLOCK_VERTICES,
    CHANGE_FIELDS,
    CHANGES,
    DEFORMATION_FIELDS,
    DEFORMATIONS,
    PartAction,
)
from proximity.message.contact import CONTACT_FIELDS, ContactFlag, Mode, Surface
from proximity.message.description import DESCRIPTION, DESCRIPTION_FIELDS, LABEL_FIELDS
from proximity.message.envelope import CHECKED_FROM, MAX_RECORDS, PREFIX_FIELDS, VERSION, Defect
from proximity.message.fields import ROTATION, Field, dtype_of
from proximity.message.frame import FRAME, FRAME_FIELDS, Source, State
from proximity.message.inputs import (
    GLOVE_POSE_FIELDS,
    GLOVE_POSES,
    INPUT_FIELDS,
    MEASURED,
    MEASUREMENT_FIELDS,
    MOVE_FIELDS,
    MOVES,
    PATH_CORNERS,
    PATH_POSE_FIELDS,
    PATH_POSES,
    POSE_FIELDS,
    POSES,
)

RECORDS = {
    "prefix": ("The beginning of every message.", PREFIX_FIELDS),
    "frame_header": ("The header of a frame; `count` contacts follow.", FRAME_FIELDS),
    "contact": ("One finger of a frame.", CONTACT_FIELDS),
    "input_header": ("The header of a message to a service; `count` records follow.", INPUT_FIELDS),
    "pose": ("One finger of a `poses` message.", POSE_FIELDS),
    "path_pose": ("One finger of a `path_poses` message.", PATH_POSE_FIELDS),
    "glove_pose": ("One finger of a `glove_poses` message.", GLOVE_POSE_FIELDS),
    "move": ("One part of a `moves` message.", MOVE_FIELDS),
    "measurement": ("One finger of a `measured` message.", MEASUREMENT_FIELDS),
    "change": ("One part of a `changes` message.", CHANGE_FIELDS),
    "addition": ("One file of an `additions` message.", ADDITION_FIELDS),
    "deformation": ("Up to 64 vertices of the one part of a `deformations` message.", DEFORMATION_FIELDS),
    "description_header": ("The header of a description; `count` labels follow.", DESCRIPTION_FIELDS),
    "label": ("One part or finger of a description.", LABEL_FIELDS),
}
"""Description and fields of each record of messages, by its name."""
NAMES_IN_C = {"pose": "finger_pose", "move": "part_move"}
"""Other names in C for records whose names have another meaning in the C library."""
KINDS = (
    FRAME, POSES, PATH_POSES, GLOVE_POSES, MOVES, MEASURED, CHANGES, ADDITIONS, DEFORMATIONS, DESCRIPTION,
)  # fmt: skip
ENUMS: dict[str, type[Enum]] = {
    "flag": ContactFlag,
    "state": State,
    "source": Source,
    "surface": Surface,
    "mode": Mode,
    "part_action": PartAction,
}
SENT = (
    "pose", "path_pose", "glove_pose", "move", "measurement", "addition", "deformation",
)  # fmt: skip
"""Records with real numbers that clients send to a service. They are initially unset, see `blank_of`."""
ZEROS = {("addition", name) for name in ADDITIONS.zeros}
WIDTH = 100
CRC_POLYNOMIAL = 0xEDB88320
"""Polynomial of the CRC-32, lowest bit first."""
_C_TYPES = {"u1": "uint8_t", "u2": "uint16_t", "u4": "uint32_t", "u8": "uint64_t"}
_C_TYPES |= {"i4": "int32_t", "i8": "int64_t", "f8": "double"}


def header_text() -> str:
    """Return the text of ``proximity_message.h``, in ASCII."""
    kinds = {
        "VERSION": str(VERSION),
        "MAX_RECORDS": str(MAX_RECORDS),
        "PATH_CORNERS": str(PATH_CORNERS),
        "BLOCK_VERTICES": str(BLOCK_VERTICES),
        "CHECKED_FROM": str(CHECKED_FROM),
        "LIMITS": "\n".join(_limits()),
        "MAGICS": "\n".join(_magics()),
        "ENUMS": "\n\n".join(enum_text(name, values) for name, values in ENUMS.items()),
        "RECORDS": "\n\n".join(_record(name, *reported) for name, reported in RECORDS.items()),
        "BLANKS": "\n".join(_blank(name, RECORDS[name][1]) for name in SENT),
        "STATE": "\n".join(
            structure(name, record, receiver_state.RECORDS) for name, record in receiver_state.RECORDS.items()
        ),
        "FLAWS": "\n".join(_flaws()),
        "CRC_TABLE": _crc_table(),
        "ASSERTS": "\n".join(_assertions()),
    }
    text = (CORE / "receiver" / "proximity_message.h.in").read_text(encoding="utf-8")
    for name, value in kinds.items():
        text = text.replace(f"@{name}@", value)
    return text


def meanings_of(values: type[Enum]) -> dict[str, str]:
    """Return the descriptions of an enumeration's members.

    They are the strings below the members in the source, or "".
    """
    (definition,) = ast.parse(inspect.getsource(values)).body
    assert isinstance(definition, ast.ClassDef)
    return dict.fromkeys(values.__members__, "") | _texts_below(definition.body)


def _texts_below(statements: Sequence[ast.stmt]) -> dict[str, str]:
    """Return the strings below assignments in the source, by the assigned names."""
    texts = {}
    for statement, below in pairwise(statements):
        is_text = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name) and is_text:
            texts[statement.targets[0].id] = " ".join(str(below.value.value).split())  # type: ignore[attr-defined]
    return texts


def structure(
    name: str, record: np.dtype, declared: Mapping[str, np.dtype], passed: Iterable[str] = ()
) -> str:
    """Return the declaration of a record in C.

    Its fields are numbers of eight bytes, or records that were *declared* before. Fields of *passed* are
    omitted, since they are other names for the bytes of other fields.
    """
    lines = [f"typedef struct {name} {{"]
    for field, (kind, *_) in sorted(record.fields.items(), key=lambda item: item[1][1]):  # type: ignore[union-attr]
        if field not in passed:
            names = (known for known, each in declared.items() if each is kind.base)
            lengths = "".join(f"[{length}]" for length in kind.shape)
            lines.append(f"    {_C_TYPES.get(kind.base.str[1:]) or next(names)} {field}{lengths};")
    return "\n".join([*lines, f"}} {name};"])


def c_type(field: Field) -> str:
    """Return the type of a field in C, such as ``double[3]``."""
    numbers = np.dtype(field.type)
    if numbers.kind == "S":
        return f"char[{numbers.itemsize}]"
    return _C_TYPES[field.type[1:]] + "".join(f"[{length}]" for length in field.shape)


def record_name(name: str) -> str:
    """Return the name of a record in C."""
    return f"proximity_{NAMES_IN_C.get(name, name)}"


def _magics() -> Iterator[str]:
    for kind in KINDS:
        letters = kind.magic.to_bytes(4, "little").decode("ascii")
        yield f'#define PROXIMITY_{kind.name.upper()}_MAGIC 0x{kind.magic:08x}u /* "{letters}" */'


def _limits() -> Iterator[str]:
    texts = _texts_below(ast.parse(inspect.getsource(receiver_state)).body)
    for name, value in receiver_state.LIMITS.items():
        number = f"INT64_C({value})" if name.endswith("_NS") else repr(value)
        yield from comment_lines(texts[name], "")
        yield f"#define PROXIMITY_{name} {number}"


def enum_text(name: str, values: type[Enum]) -> str:
    """Return the declaration of an enumeration in C. Members with text values are numbered in order.

    *values*: enumeration with a string below each member that needs an explanation.
    """
    meanings = meanings_of(values)
    lines = [*comment_lines(inspect.getdoc(values) or "", ""), f"enum proximity_{name} {{"]
    for place, member in enumerate(values):
        lines += comment_lines(meanings[member.name], "    ") if meanings[member.name] else []
        number = place if isinstance(member.value, str) else int(member.value)
        lines.append(f"    PROXIMITY_{name.upper()}_{member.name} = {number},")
    return "\n".join([*lines[:-1], lines[-1].removesuffix(","), "};"])


def _flaws() -> Iterator[str]:
    for number, defect in enumerate(Defect, 1):
        comma = "," if number < len(Defect) else ""
        yield f"    PROXIMITY_FLAW_{defect.name} = {number}{comma} /* {defect.value} */"


def _record(name: str, what: str, fields: Sequence[Field]) -> str:
    """Return the declaration of a record in C, with the unit and the meaning of each field."""
    size = dtype_of(fields).itemsize
    lines = comment_lines(f"{what} {size} bytes.", "")
    own = record_name(name)
    lines.append(f"typedef struct {own} {{")
    for field in fields:
        begin = f" PROXIMITY_BEGINS({first})" if name in SENT and (first := _first(name, field)) else ""
        line, comment = f"    {_declaration(field)}{begin};", comment_lines(_meaning(field), "    ")
        reported = f"{line} {comment[0].strip()}"
        lines += [reported] if len(comment) == 1 and len(reported) <= WIDTH else [*comment, line]
    return "\n".join([*lines, f"}} {own};"])


def is_nan(name: str, field: Field) -> bool:
    """Return whether a field of a record is initially nan."""
    return field.type.endswith("f8") and (name, field.name) not in ZEROS


def _first(name: str, field: Field) -> str:
    """Return the initial value of an unset field in C.

    For a field with many rows it is that of the first row.
    """
    if not is_nan(name, field):
        return "{0.0, 0.0, 0.0}" if (name, field.name) in ZEROS else ""
    if field.shape == ROTATION:
        return "{{1.0, 0.0, 0.0}, {0.0, 1.0, 0.0}, {0.0, 0.0, 1.0}}"
    text = "NAN"
    for length in reversed(field.shape):
        text = f"{{{', '.join([text] * (length if length == 3 else 1))}}}"
    return text


def _blank(name: str, fields: Sequence[Field]) -> str:
    firsts = (_first(name, field) or ("{0}" if "[" in c_type(field) else "0") for field in fields)
    lines = textwrap.wrap(", ".join(firsts), WIDTH - 8, break_long_words=False)
    return f"#define {record_name(name).upper()}_INIT \\\n    {{" + " \\\n     ".join(lines) + "}"


def _meaning(field: Field) -> str:
    text = f"{field.unit}, {field.meaning}" if field.unit else field.meaning
    for name, values in ENUMS.items():
        text = text.replace(f"a {values.__name__}", f"an enum proximity_{name}")
        text = text.replace(f"set of {values.__name__}", f"set of enum proximity_{name}")
    return text


def _declaration(field: Field) -> str:
    name, _, lengths = c_type(field).partition("[")
    return f"{name} {field.name}" + (f"[{lengths}" if lengths else "")


def _assertions() -> Iterator[str]:
    for name, (_, fields) in RECORDS.items():
        dtype = dtype_of(fields)
        yield f"PROXIMITY_ASSERT(sizeof({record_name(name)}) == {dtype.itemsize});"
        for field in fields:
            part, offset = dtype.fields[field.name][:2]  # type: ignore[index]
            yield f"PROXIMITY_FIELD({record_name(name)}, {field.name}, {offset}, {part.itemsize});"


def _crc_table() -> str:
    """Return the table of the checksum, which processes four bits at a time."""
    table = []
    for bits in range(16):
        for _ in range(4):
            bits = bits >> 1 ^ (CRC_POLYNOMIAL if bits & 1 else 0)
        table.append(f"0x{bits:08x}u")
    return ",\n".join(f"        {', '.join(table[first : first + 4])}" for first in range(0, 16, 4))


def comment_lines(text: str, indent: str) -> list[str]:
    """Return a text as the lines of a C comment in ASCII."""
    text = text.replace("``", "`").replace("…", "...").replace("²", "2")
    lines = textwrap.wrap(text, WIDTH - len(indent) - 6)
    if len(lines) == 1:
        return [f"{indent}/* {lines[0]} */"]
    return [
        f"{indent}/* {lines[0]}",
        *(f"{indent} * {line}" for line in lines[1:-1]),
        f"{indent} * {lines[-1]} */",
    ]
