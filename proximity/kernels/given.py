"""Rows of three as Python gives them: any object, seen by compiled code as an address and a count.

A call with five rays takes 1.5 µs. To ask two arrays in Python for their types, dtypes and axes was a sixth
of it. So the objects themselves are handed over, and compiled code reads where NumPy keeps what it says of
an array (`PyArrayObject_fields` and `PyArray_Descr`, public and the same in NumPy 1 and 2), while the
interpreter is locked. Nothing is read of an object before its type is known.
"""

import numpy as np
from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.core.extending import NativeValue, models, register_model, unbox
from numba.extending import intrinsic

from proximity.kernels.memory import borrowed_array
from proximity.simd import IS_COMPILED

_SIZE = 8  # bytes of a float64, of an address, of a length
_HEAD = object.__basicsize__
_TYPE_AT = _HEAD - _SIZE
_DATA_AT, _AXES_AT, _LENGTHS_AT, _STRIDES_AT, _DTYPE_AT = (_HEAD + _SIZE * k for k in (0, 1, 2, 3, 5))
_ORDER_AT, _NUMBER_AT = _HEAD + _SIZE + 2, _HEAD + _SIZE + 4
_FLOAT64 = np.dtype(np.float64)
_ARRAY_TYPE = "proximity_ndarray"
"""Name of the address of NumPy's type of arrays, for compiled code that is kept."""

binding.add_symbol(_ARRAY_TYPE, id(np.ndarray))


class GivenRows(types.Type):
    """Type of an object that is hoped to be (N, 3) float64 in C order."""

    def __init__(self) -> None:
        super().__init__("GivenRows")


GIVEN_ROWS = GivenRows()
INTEGER, REAL, FLAG = types.int64, types.float64, types.boolean
TABLE, COLUMN, FLAGS = REAL[:, ::1], REAL[::1], FLAG[::1]
TABLES, WHOLE_TABLE, WHOLE_COLUMN = REAL[:, :, ::1], INTEGER[:, ::1], INTEGER[::1]
SHORT_TABLE, SHORT_COLUMN = types.float32[:, ::1], types.float32[::1]
"""Types of arguments, for `compiling.CompiledCall`; only rows that are given may be anything."""


def bundle_type(bundle: type, *kinds: types.Type) -> types.Type:
    """Return the type of a named tuple as an argument.

    Parameters
    ----------
    bundle : type
        The named tuple.
    kinds : types
        Of its fields.
    """
    if len(set(kinds)) == 1:
        return types.NamedUniTuple(kinds[0], len(kinds), bundle)
    return types.NamedTuple(kinds, bundle)


@register_model(GivenRows)
class _GivenRowsModel(models.StructModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, [("address", types.int64), ("count", types.int64)])


@unbox(GivenRows)
def _take(kind, given, c):
    """Its address and how many rows it has; -1 of what is not such rows."""
    builder = c.builder
    word = ir.IntType(64)

    def load(start, offset, kind=word):
        place = builder.gep(start, [ir.Constant(word, offset)])
        return builder.load(builder.bitcast(place, kind.as_pointer()))

    def follow(start, offset):
        return builder.inttoptr(load(start, offset), ir.IntType(8).as_pointer())

    def equals(value, number):
        return builder.icmp_signed("==", value, ir.Constant(value.type, number))

    module = builder.module
    array_type = module.globals.get(_ARRAY_TYPE) or ir.GlobalVariable(module, ir.IntType(8), _ARRAY_TYPE)
    address = cgutils.alloca_once_value(builder, ir.Constant(word, 0))
    count = cgutils.alloca_once_value(builder, ir.Constant(word, -1))
    given = builder.bitcast(given, ir.IntType(8).as_pointer())
    is_array = builder.icmp_signed("==", load(given, _TYPE_AT), builder.ptrtoint(array_type, word))
    with builder.if_then(is_array, likely=True):
        dtype = follow(given, _DTYPE_AT)
        is_float64 = builder.and_(
            equals(load(dtype, _NUMBER_AT, ir.IntType(32)), _FLOAT64.num),
            equals(load(dtype, _ORDER_AT, ir.IntType(8)), ord(_FLOAT64.byteorder)),
        )
        has_two_axes = equals(load(given, _AXES_AT, ir.IntType(32)), 2)
        with builder.if_then(builder.and_(is_float64, has_two_axes), likely=True):
            lengths, strides = follow(given, _LENGTHS_AT), follow(given, _STRIDES_AT)
            row_count, data = load(lengths, 0), load(given, _DATA_AT)
            has_rows_on_end = builder.or_(equals(load(strides, 0), 3 * _SIZE), equals(row_count, 1))
            is_ordered = builder.and_(has_rows_on_end, equals(load(strides, _SIZE), _SIZE))
            is_rows = builder.and_(
                equals(load(lengths, _SIZE), 3), builder.or_(is_ordered, equals(row_count, 0))
            )
            is_aligned = equals(builder.and_(data, ir.Constant(word, _SIZE - 1)), 0)
            with builder.if_then(builder.and_(is_rows, is_aligned), likely=True):
                builder.store(data, address)
                builder.store(row_count, count)
    rows = cgutils.create_struct_proxy(kind)(c.context, builder)
    rows.address, rows.count = builder.load(address), builder.load(count)
    return NativeValue(rows._getvalue())


@intrinsic
def _compiled_row_count(typingctx, given):
    def codegen(context, builder, sig, args):
        return cgutils.create_struct_proxy(sig.args[0])(context, builder, value=args[0]).count

    return types.int64(given), codegen


@intrinsic
def _compiled_rows_of(typingctx, given):
    def codegen(context, builder, sig, args):
        rows = cgutils.create_struct_proxy(sig.args[0])(context, builder, value=args[0])
        lengths = [rows.count, ir.Constant(rows.count.type, 3)]
        data = builder.inttoptr(rows.address, ir.IntType(8).as_pointer())
        return borrowed_array(context, builder, sig.return_type, data, lengths)

    return types.Array(types.float64, 2, "C")(given), codegen


def _uncompiled_row_count(given):
    is_rows = (
        type(given) is np.ndarray
        and given.dtype == _FLOAT64
        and given.ndim == 2
        and given.shape[1] == 3
        and given.flags.c_contiguous
        and given.flags.aligned
    )
    return len(given) if is_rows else -1


row_count = _compiled_row_count if IS_COMPILED else _uncompiled_row_count
"""How many rows were given; -1 where that is not (N, 3) float64 in C order, at an address for such."""

rows_of = _compiled_rows_of if IS_COMPILED else lambda given: given
"""The rows that were given, of which `row_count` has found that there are some."""
