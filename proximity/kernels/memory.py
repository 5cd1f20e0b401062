"""A model's arrays behind one number.

Handing an array from Python to a compiled kernel costs about 0.05 µs; a call with five points takes 2. So a
model is handed over as the address of a table that holds address and shape of each array, and the kernel
makes arrays of them again. Whoever calls must keep the model alive meanwhile.
"""

import ctypes

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from proximity.kernels.compiling import kernel
from proximity.simd import IS_COMPILED

TABLE_SIZE = 8


@intrinsic
def _compiled_pointer(typingctx, address):
    def codegen(context, builder, sig, args):
        return builder.inttoptr(args[0], ir.IntType(8).as_pointer())

    return types.voidptr(types.int64), codegen


def make_table(reals, words, frames, parts):
    """Return the table (int64) of a model's arrays; its address is the model's handle.

    The arrays must be C-ordered and outlive every call: float64 (R,), float32 (W,), float64 (P, C),
    int64 (P, D).
    """
    arrays = (reals, words, frames, parts)
    table = [array.ctypes.data for array in arrays]
    table += [reals.size, words.size, frames.shape[0], frames.shape[1] * 1000 + parts.shape[1]]
    return np.array(table, dtype=np.int64)


if IS_COMPILED:

    @kernel
    def arrays_at(handle):
        """The four arrays of the model whose table is at *handle*."""
        table = carray(_compiled_pointer(handle), (TABLE_SIZE,), np.int64)
        rows, columns = table[6], table[7]
        return (
            carray(_compiled_pointer(table[0]), (table[4],), np.float64),
            carray(_compiled_pointer(table[1]), (table[5],), np.float32),
            carray(_compiled_pointer(table[2]), (rows, columns // 1000), np.float64),
            carray(_compiled_pointer(table[3]), (rows, columns % 1000), np.int64),
        )

else:  # pragma: no cover — which branch runs is chosen by the environment

    def _array(address, shape, ctype):
        count = int(np.prod(shape))
        return np.ctypeslib.as_array((ctype * count).from_address(int(address))).reshape(shape)

    def arrays_at(handle):
        """The four arrays of the model whose table is at *handle*."""
        table = _array(handle, (TABLE_SIZE,), ctypes.c_int64)
        rows, columns = int(table[6]), int(table[7])
        return (
            _array(table[0], (int(table[4]),), ctypes.c_double),
            _array(table[1], (int(table[5]),), ctypes.c_float),
            _array(table[2], (rows, columns // 1000), ctypes.c_double),
            _array(table[3], (rows, columns % 1000), ctypes.c_int64),
        )
