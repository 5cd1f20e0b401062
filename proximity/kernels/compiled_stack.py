"""Arrays on the stack of compiled code, built with numba's internals."""

import math

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.extending import intrinsic
from numba.np import arrayobj

LINE = 64
"""Bytes of a cache line."""


def array_in_memory(context, builder, array_type, data, lengths):
    """Return a C-ordered array with *lengths* over memory that it does not own."""
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


def _array_on_stack(context, builder, item_type, *lengths):
    """Return a C-ordered array of constant lengths, valid until the compiled function returns."""
    item = context.get_data_type(item_type)
    # numba's own implementation clears the memory at every call.
    with builder.goto_entry_block():
        position = builder.alloca(ir.ArrayType(item, math.prod(lengths)))
    position.align = LINE
    intp = context.get_value_type(types.intp)
    constants = [ir.Constant(intp, length) for length in lengths]
    return array_in_memory(context, builder, types.Array(item_type, len(lengths), "C"), position, constants)


@intrinsic
def reals_of(typingctx, records):
    """View records of float64 as numbers, one row per record."""
    size = records.dtype.size // 8

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        intp = context.get_value_type(types.intp)
        lengths = [builder.extract_value(array.shape, 0), ir.Constant(intp, size)]
        return array_in_memory(context, builder, sig.return_type, array.data, lengths)

    return types.Array(types.float64, 2, "C")(records), codegen


@intrinsic
def rows_of_three(typingctx, numbers, start, count):
    """View *count* rows of three of an array's numbers, from *start* on."""

    def codegen(context, builder, sig, args):
        array = context.make_array(sig.args[0])(context, builder, args[0])
        lengths = [args[2], ir.Constant(context.get_value_type(types.intp), 3)]
        data = builder.gep(array.data, [args[1]])
        return array_in_memory(context, builder, sig.return_type, data, lengths)

    return types.Array(numbers.dtype, 2, "C")(numbers, types.intp, types.intp), codegen


def stack_arrays_of(dtype):
    item_type = from_dtype(np.dtype(dtype))

    @intrinsic
    def stack_array(typingctx, count):
        if not isinstance(count, types.IntegerLiteral):
            return None

        def codegen(context, builder, sig, args):
            return _array_on_stack(context, builder, item_type, count.literal_value)

        return types.Array(item_type, 1, "C")(count), codegen

    @intrinsic
    def stack_rows(typingctx, count, columns):
        if not isinstance(count, types.IntegerLiteral) or not isinstance(columns, types.IntegerLiteral):
            return None

        def codegen(context, builder, sig, args):
            lengths = count.literal_value, columns.literal_value
            return _array_on_stack(context, builder, item_type, *lengths)

        return types.Array(item_type, 2, "C")(count, columns), codegen

    return stack_array, stack_rows


def stack_bundle(bundle, *columns):
    item_types = [from_dtype(np.dtype(dtype)) for dtype, *_ in columns]
    array_types = [
        types.Array(item_type, len(lengths), "C")
        for item_type, (_, *lengths) in zip(item_types, columns, strict=True)
    ]

    @intrinsic
    def stack_array(typingctx):
        def codegen(context, builder, sig, args):
            arrays = [
                _array_on_stack(context, builder, item_type, *lengths)
                for item_type, (_, *lengths) in zip(item_types, columns, strict=True)
            ]
            return context.make_tuple(builder, sig.return_type, arrays)

        return types.NamedTuple(array_types, bundle)(), codegen

    return stack_array
