"""Signatures of entry points: the types passed between Python and compiled code.

A signature is written as ``"Model, float64[:, 3], int64[:], int -> bool"``. It lists scalars (``int``,
``float``, ``bool``), arrays in C order, and names of bundles. An array is written with its dtype and its
axes, a number being the length of an axis of fixed length. A *bundle* is a named tuple of arrays that is
declared once: compiled code finds its arrays through a table of words, so that a call passes one address for
any number of arrays. The items of an array may be records, as in ``"Settings[:]"``, whose fields are also
declared once, see `record`.

Arguments and results are passed as 64-bit words: the address and lengths of an array, or the value of a
scalar.
"""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

LANES = 8
"""Number of lanes of every vector type."""
SCALARS = ("int", "float", "bool")
DTYPES = ("float64", "float32", "int64", "int32", "uint32", "uint8", "bool")
ANY_LENGTH = -1
_ARRAY = re.compile(r"(\w+)\[([^\]]*)\]")
_PARTS = re.compile(r"\w+(?:\[[^\]]*\])?")


@dataclass(frozen=True, slots=True)
class Array:
    """An array in C order."""

    dtype: str
    lengths: tuple[int, ...]  # of its axes; `ANY_LENGTH` if not fixed

    @property
    def word_count(self) -> int:
        """Number of words that pass the array: its address and its lengths."""
        return 1 + len(self.lengths)


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number or a truth value."""

    kind: str  # of `SCALARS`
    word_count = 1


@dataclass(frozen=True, slots=True)
class Bundle:
    """A named tuple of arrays."""

    kind: Any  # the class of the tuple
    arrays: tuple[Array, ...]  # of its fields
    word_count = 1

    @property
    def name(self) -> str:
        """Name of the tuple's class, used in signatures."""
        return str(self.kind.__name__)


Value = Array | Scalar | Bundle

BUNDLES: dict[str, Bundle] = {}
RECORDS: dict[str, np.dtype[Any]] = {}
"""All declared bundles and records, by name."""


@dataclass(frozen=True, slots=True)
class Signature:
    """Arguments and results of an entry point."""

    text: str  # as written
    arguments: tuple[Value, ...]
    results: tuple[Array | Scalar, ...]


def bundle(kind: Any, **fields: str) -> Any:
    """Declare a named tuple of arrays, and return its class.

    *fields*: the type of the array in each field, as in a signature.
    """
    if tuple(fields) != kind._fields:
        raise ValueError(f"{kind.__name__} has the fields {kind._fields}, declared are {tuple(fields)}")
    arrays = tuple(_value(text) for text in fields.values())
    BUNDLES[kind.__name__] = Bundle(kind, arrays)  # type: ignore[arg-type]
    return kind


def record(name: str, aliases: dict[str, str] | None = None, **fields: str) -> np.dtype[Any]:
    """Declare a structured type by its fields in order. Kernels read a field as ``row.field``, as NumPy does.

    *aliases*: second names of fields, for rows in which they have another meaning.
    """
    layout: Any = np.dtype(list(fields.items()), align=True)
    if aliases:
        placed = dict(layout.fields) | {alias: layout.fields[field] for alias, field in aliases.items()}
        formats, offsets = zip(*((dtype, offset) for dtype, offset, *_ in placed.values()), strict=True)
        layout = np.dtype(
            {"names": list(placed), "formats": formats, "offsets": offsets, "itemsize": layout.itemsize},
            align=True,
        )
    RECORDS[name] = np.dtype((np.record, layout))
    return RECORDS[name]


def dtype_of(name: str) -> np.dtype[Any]:
    """Return the dtype of an array's items, given its name in a signature."""
    return RECORDS[name] if name in RECORDS else np.dtype(name)


def signature(text: str) -> Signature:
    """Parse a signature."""
    arguments, _, results = text.partition("->")
    return Signature(
        text,
        tuple(map(_value, _PARTS.findall(arguments))),
        tuple(map(_value, _PARTS.findall(results))),  # type: ignore[arg-type]
    )


def _value(text: str) -> Value:
    if text in SCALARS:
        return Scalar(text)
    if text in BUNDLES:
        return BUNDLES[text]
    found = _ARRAY.fullmatch(text)
    if not found or (found[1] not in DTYPES and found[1] not in RECORDS):
        raise ValueError(f"{text!r} is no type of an argument: expected {SCALARS}, an array or a bundle")
    lengths = [part.strip() for part in found[2].split(",")]
    return Array(found[1], tuple(ANY_LENGTH if part == ":" else int(part) for part in lengths))
