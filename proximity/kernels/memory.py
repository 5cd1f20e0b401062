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

from proximity.kernels.compiling import inlined, kernel
from proximity.simd import IS_COMPILED

TABLE_SIZE = 8


@intrinsic
def _pointer(typingctx, address):
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

    @inlined
    def reals_at(address, shape):
        """The float64 array of that shape at an address."""
        return carray(_pointer(address), shape, np.float64)

    @inlined
    def words_at(address, shape):
        """The float32 array of that shape at an address."""
        return carray(_pointer(address), shape, np.float32)

    @inlined
    def longs_at(address, shape):
        """The int64 array of that shape at an address."""
        return carray(_pointer(address), shape, np.int64)

    @inlined
    def ints_at(address, shape):
        """The int32 array of that shape at an address."""
        return carray(_pointer(address), shape, np.int32)

else:  # pragma: no cover — which branch runs is chosen by the environment

    def _array(address, shape, ctype):
        count = int(np.prod(shape))
        if count == 0:
            return np.zeros(shape, ctype)
        return np.ctypeslib.as_array((ctype * count).from_address(int(address))).reshape(shape)

    def reals_at(address, shape):
        """The float64 array of that shape at an address."""
        return _array(address, shape, ctypes.c_double)

    def words_at(address, shape):
        """The float32 array of that shape at an address."""
        return _array(address, shape, ctypes.c_float)

    def longs_at(address, shape):
        """The int64 array of that shape at an address."""
        return _array(address, shape, ctypes.c_int64)

    def ints_at(address, shape):
        """The int32 array of that shape at an address."""
        return _array(address, shape, ctypes.c_int32)


@kernel
def arrays_at(handle):
    """The four arrays of the model whose table is at *handle*."""
    table = longs_at(handle, (TABLE_SIZE,))
    rows, columns = table[6], table[7]
    return (
        reals_at(table[0], (table[4],)),
        words_at(table[1], (table[5],)),
        reals_at(table[2], (rows, columns // 1000)),
        longs_at(table[3], (rows, columns % 1000)),
    )
