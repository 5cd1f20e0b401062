"""Arrays that a kernel neither is handed nor makes: those behind one number, and those on the stack.

Handing an array from Python to a compiled kernel costs about 0.05 µs; a call with five points takes 2. So a
model is handed over as the address of a table that holds address and lengths of each array, and the kernel
makes arrays of them again. Whoever calls must keep the model alive meanwhile.

What a kernel needs for itself is on the stack. So no kernel owns an array or counts references to one:
counting was a tenth of the time of a call with five points and a fifth of a tick's.
"""

import ctypes
import math
from typing import NamedTuple

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np import arrayobj

from proximity.simd import IS_COMPILED

LINE = 64  # bytes of a cache line

REALS_AT, WORDS_AT, FRAMES_AT, PARTS_AT, REAL_COUNT, WORD_COUNT, ROWS, FRAME_WIDTH, PART_WIDTH = range(9)
"""Places in a model's table: addresses, and lengths."""


class Model(NamedTuple):
    """The four arrays of a model, see `layout`: what most kernels are handed first."""

    reals: np.ndarray  # (R,) float64
    words: np.ndarray  # (W,) float32
    frames: np.ndarray  # (P, C) float64
    parts: np.ndarray  # (P, D) int64


class TableLength(int):
    """A length that the table tells, at this place; other lengths are as they stand."""

    __slots__ = ()


def make_table(reals, words, frames, parts):
    """Return the table (int64) of a model's arrays; its address is the model's handle.

    The arrays must be C-ordered and outlive every call: float64 (R,), float32 (W,), float64 (P, C),
    int64 (P, D).
    """
    table = [array.ctypes.data for array in (reals, words, frames, parts)]
    return np.array([*table, reals.size, words.size, *frames.shape, parts.shape[1]], dtype=np.int64)


def borrowed_array(context, builder, array_type, data, lengths):
    """An array of those lengths, C-ordered, that owns nothing."""
    intp = context.get_value_type(types.intp)
    item = ir.Constant(intp, context.get_abi_sizeof(context.get_data_type(array_type.dtype)))
    strides = [item]
    for length in reversed(lengths[1:]):
        strides.insert(0, builder.mul(strides[0], length))
    array = context.make_array(array_type)(context, builder)
    arrayobj.populate_array(
        array,
        data=builder.bitcast(data, array.data.type),
        shape=lengths,
        strides=strides,
        itemsize=item,
        meminfo=None,
    )
    return array._getvalue()


def _compiled_arrays_behind(*columns, bundle=None):
    array_types = [types.Array(from_dtype(np.dtype(dtype)), len(shape), "C") for dtype, _, shape in columns]

    @intrinsic
    def arrays(typingctx, handle):
        def codegen(context, builder, sig, args):
            intp = context.get_value_type(types.intp)
            table = builder.inttoptr(args[0], intp.as_pointer())

            def loaded(place):
                return builder.load(builder.gep(table, [ir.Constant(intp, int(place))]))

            values = []
            for array_type, (_, place, shape) in zip(array_types, columns, strict=True):
                lengths = [
                    loaded(one) if isinstance(one, TableLength) else ir.Constant(intp, one) for one in shape
                ]
                data = builder.inttoptr(loaded(place), ir.IntType(8).as_pointer())
                values.append(borrowed_array(context, builder, array_type, data, lengths))
            return context.make_tuple(builder, sig.return_type, values)

        kind = types.NamedTuple(array_types, bundle) if bundle else types.Tuple(array_types)
        return kind(types.int64), codegen

    return arrays


def _uncompiled_arrays_behind(*columns, bundle=None):
    ctypes_of = {"float64": ctypes.c_double, "float32": ctypes.c_float, "int64": ctypes.c_int64}
    ctypes_of["int32"] = ctypes.c_int32

    def arrays(handle):
        places = [place for _, place, shape in columns]
        places += [one for _, _, shape in columns for one in shape if isinstance(one, TableLength)]
        table = (ctypes.c_int64 * (max(places) + 1)).from_address(int(handle))
        found = []
        for dtype, place, shape in columns:
            lengths = [table[one] if isinstance(one, TableLength) else one for one in shape]
            count = int(np.prod(lengths))
            flat = np.zeros(0, dtype)
            if count:
                flat = np.ctypeslib.as_array((ctypes_of[dtype] * count).from_address(table[place]))
            found.append(flat.reshape(lengths))
        return bundle(*found) if bundle else tuple(found)

    return arrays


@intrinsic
def _compiled_as_column(typingctx, array):
    def codegen(context, builder, sig, args):
        given = context.make_array(sig.args[0])(context, builder, args[0])
        (length,) = cgutils.unpack_tuple(builder, given.shape)
        one = ir.Constant(length.type, 1)
        return borrowed_array(context, builder, sig.return_type, given.data, [length, one])

    return types.Array(array.dtype, 2, "C")(array), codegen


as_column = _compiled_as_column if IS_COMPILED else lambda array: array[:, None]
"""The numbers (N,) of an array in C order as a column, (N, 1)."""


def _array_on_stack(context, builder, item_type, *lengths):
    """A C-ordered array of those constant lengths, that lasts as long as the function being compiled."""
    item = context.get_data_type(item_type)
    # numba's own way to do this fills the memory with zeros at every call.
    with builder.goto_entry_block():
        place = builder.alloca(ir.ArrayType(item, math.prod(lengths)))
    place.align = LINE
    intp = context.get_value_type(types.intp)
    constants = [ir.Constant(intp, length) for length in lengths]
    return borrowed_array(context, builder, types.Array(item_type, len(lengths), "C"), place, constants)


def _compiled_here(dtype):
    item_type = from_dtype(np.dtype(dtype))

    @intrinsic
    def here(typingctx, count):
        if not isinstance(count, types.IntegerLiteral):
            return None

        def codegen(context, builder, sig, args):
            return _array_on_stack(context, builder, item_type, count.literal_value)

        return types.Array(item_type, 1, "C")(count), codegen

    @intrinsic
    def rows_here(typingctx, count, columns):
        if not isinstance(count, types.IntegerLiteral) or not isinstance(columns, types.IntegerLiteral):
            return None

        def codegen(context, builder, sig, args):
            lengths = count.literal_value, columns.literal_value
            return _array_on_stack(context, builder, item_type, *lengths)

        return types.Array(item_type, 2, "C")(count, columns), codegen

    return here, rows_here


def _uncompiled_here(dtype):
    return lambda count: np.empty(count, dtype), lambda count, columns: np.empty((count, columns), dtype)


def _compiled_bundle_here(bundle, *columns):
    item_types = [from_dtype(np.dtype(dtype)) for dtype, *_ in columns]
    array_types = [
        types.Array(item_type, len(lengths), "C")
        for item_type, (_, *lengths) in zip(item_types, columns, strict=True)
    ]

    @intrinsic
    def here(typingctx):
        def codegen(context, builder, sig, args):
            arrays = [
                _array_on_stack(context, builder, item_type, *lengths)
                for item_type, (_, *lengths) in zip(item_types, columns, strict=True)
            ]
            return context.make_tuple(builder, sig.return_type, arrays)

        return types.NamedTuple(array_types, bundle)(), codegen

    return here


def _uncompiled_bundle_here(bundle, *columns):
    return lambda: bundle(*(np.empty(lengths, dtype) for dtype, *lengths in columns))


arrays_behind = _compiled_arrays_behind if IS_COMPILED else _uncompiled_arrays_behind
"""A function of a table's address that gives arrays: for each dtype, place of its address, and lengths. It
gives them as a *bundle*, a named tuple, where there is one."""

_here = _compiled_here if IS_COMPILED else _uncompiled_here
reals_here, real_rows_here = _here("float64")
words_here, word_rows_here = _here("float32")
longs_here, long_rows_here = _here("int64")
"""Functions of a constant count, or of two, rows and columns: an array that lasts as long as the caller runs,
with anything in it. The caller must be a function that is called, not one that is put into another: such
memory may be something else's as soon as it returns. To make rows of an array that is there would take longer
than a step of a walk."""

bundle_here = _compiled_bundle_here if IS_COMPILED else _uncompiled_bundle_here
"""A function that gives a *bundle*, a named tuple, of such arrays: of each the dtype and constant lengths."""

arrays_at = arrays_behind(
    ("float64", REALS_AT, (TableLength(REAL_COUNT),)),
    ("float32", WORDS_AT, (TableLength(WORD_COUNT),)),
    ("float64", FRAMES_AT, (TableLength(ROWS), TableLength(FRAME_WIDTH))),
    ("int64", PARTS_AT, (TableLength(ROWS), TableLength(PART_WIDTH))),
    bundle=Model,
)
"""The `Model` whose table is at a handle."""
