"""Generate the layout of messages for C# from the fields of the NumPy types.

Structures have explicit offsets and contain no references, so that received bytes can be read in place. A
field of three numbers is a ``ProximityVector``; longer fields and text are fixed buffers, row by row.
"""

from collections.abc import Iterator, Sequence
from enum import Enum, Flag

import numpy as np

from proximity.core.receiver_state import LIMITS
from proximity.message.c_header import ENUMS, KINDS, RECORDS, SENT, is_nan, meanings_of
from proximity.message.envelope import CHECKED_FROM, MAX_RECORDS, VERSION
from proximity.message.fields import ROTATION, VECTOR, Field, dtype_of
from proximity.message.inputs import PATH_CORNERS

_TYPES = {
    "u1": "byte",
    "u2": "ushort",
    "u4": "uint",
    "u8": "ulong",
    "i4": "int",
    "i8": "long",
    "f8": "double",
}
_HEAD = """\
// ProximityMessages.cs: messages that a proximity service publishes and receives.
//
// Made by `proximity client csharp`; changes here are lost. Lengths are in metres, instants in
// nanoseconds of the sender's monotonic clock. Unknown values are NaN. Needs "Allow unsafe code": text and
// matrices are fixed buffers.
using System.Runtime.InteropServices;

namespace Proximity
{
    public static class ProximityLayout
    {
@CONSTANTS@
    }

    /// <summary>x, y, z in the scene's frame.</summary>
    [StructLayout(LayoutKind.Explicit, Size = 24)]
    public struct ProximityVector
    {
        [FieldOffset(0)] public double X;
        [FieldOffset(8)] public double Y;
        [FieldOffset(16)] public double Z;

        public ProximityVector(double x, double y, double z) { X = x; Y = y; Z = z; }
    }

@REST@
}
"""


def csharp_layout() -> str:
    """Return the text of ``ProximityMessages.cs``."""
    numbers = {
        "Version": VERSION,
        "MaxRecords": MAX_RECORDS,
        "PathCorners": PATH_CORNERS,
        "CheckedFrom": CHECKED_FROM,
    }
    constants = [f"        public const int {name} = {value};" for name, value in numbers.items()]
    for name, value in LIMITS.items():
        kind = "double" if isinstance(value, float) else "long"
        constants.append(f"        public const {kind} {pascal(name)} = {value!r};")
    constants += [
        f"        public const uint {pascal(kind.name)}Magic = 0x{kind.magic:08x};" for kind in KINDS
    ]
    blocks = ["\n".join(_enum(values)) for values in ENUMS.values()]
    blocks += ["\n".join(_record(name, what, fields)) for name, (what, fields) in RECORDS.items()]
    return _HEAD.replace("@CONSTANTS@", "\n".join(constants)).replace("@REST@", "\n\n".join(blocks))


def pascal(name: str) -> str:
    """Return a name in C# style, such as ``SignedDistance``."""
    return "".join(word.capitalize() for word in name.split("_"))


def csharp_enum(values: type[Enum]) -> str:
    """Return the name of an enumeration in C#, such as ``ProximityContactFlag``."""
    return f"Proximity{values.__name__}"


def _number_of(values: type[Enum]) -> str:
    """Return the type of the fields that hold an enumeration, or of a byte if there are none."""
    for _, fields in RECORDS.values():
        for field in fields:
            if _holds(field, values):
                return _TYPES[field.type[1:]]
    return "uint" if issubclass(values, Flag) else "byte"


def _holds(field: Field, values: type[Enum]) -> bool:
    return field.meaning in (f"a {values.__name__}", f"set of {values.__name__}")


def _enum(values: type[Enum]) -> Iterator[str]:
    meanings = meanings_of(values)
    if issubclass(values, Flag):
        yield "    [System.Flags]"
    yield f"    public enum {csharp_enum(values)} : {_number_of(values)}"
    yield "    {"
    if issubclass(values, Flag):
        yield "        None = 0,"
    for member in values:
        if meanings[member.name]:
            yield f"        /// <summary>{_escaped(meanings[member.name])}</summary>"
        yield f"        {pascal(member.name)} = {int(member.value)},"
    yield "    }"


def _record(name: str, what: str, fields: Sequence[Field]) -> Iterator[str]:
    dtype = dtype_of(fields)
    yield f"    /// <summary>{_escaped(what)} {dtype.itemsize} bytes.</summary>"
    yield f"    [StructLayout(LayoutKind.Explicit, Size = {dtype.itemsize})]"
    yield f"    public unsafe struct Proximity{pascal(name)}"
    yield "    {"
    for field in fields:
        if field.name == "reserved":
            continue
        offset = dtype.fields[field.name][1]  # type: ignore[index]
        unit = f"{field.unit}, " if field.unit else ""
        yield f"        /// <summary>{_escaped(unit + field.meaning)}</summary>"
        yield f"        [FieldOffset({offset})] public {_declaration(field)};"
    if name in SENT:
        yield from _begin(f"Proximity{pascal(name)}", [field for field in fields if is_nan(name, field)])
    yield "    }"


def _begin(record: str, fields: Sequence[Field]) -> Iterator[str]:
    """Yield the lines of the method that returns a record with unset fields, see `blank_of`."""
    yield "        /// <summary>A record with unset fields: start from it, not from zeros.</summary>"
    yield f"        public static {record} Begin()"
    yield "        {"
    yield f"            var r = new {record}();"
    for field in fields:
        name, count = pascal(field.name), int(np.prod(field.shape, dtype=np.int64))
        if field.shape == ROTATION:
            yield f"            r.{name}[0] = r.{name}[4] = r.{name}[8] = 1;"
        elif field.shape == VECTOR:
            yield f"            r.{name} = new ProximityVector(double.NaN, double.NaN, double.NaN);"
        elif field.shape:
            yield f"            for (int i = 0; i < {count}; i++) r.{name}[i] = double.NaN;"
        else:
            yield f"            r.{name} = double.NaN;"
    yield "            return r;"
    yield "        }"


def _declaration(field: Field) -> str:
    name, base = pascal(field.name), np.dtype(field.type)
    if base.kind == "S":
        return f"fixed byte {name}[{base.itemsize}]"
    for values in ENUMS.values():
        if _holds(field, values):
            return f"{csharp_enum(values)} {name}"
    if field.shape == VECTOR and base.kind == "f":
        return f"ProximityVector {name}"
    count = int(np.prod(field.shape, dtype=np.int64))
    kind = _TYPES[field.type[1:]]
    return f"fixed {kind} {name}[{count}]" if field.shape else f"{kind} {name}"


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace("`", "").replace("…", "...")
