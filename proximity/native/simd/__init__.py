"""Eight-lane vectors for numba. A kernel reads like its formula and runs as vector instructions.

There are three types: ``f32x8``, ``f64x8`` and ``mask8``. They exist only in registers: a kernel loads them
from one-dimensional arrays, computes with ``+ - * /``, comparisons, ``& | ~`` and the functions below, and
extracts lanes or bits. LLVM maps them to AVX-512, AVX2, SSE or NEON. Most functions also take plain floats,
so that one formula serves eight triangles or one.

Every operation rounds once. The compiler neither contracts nor reorders operations; a fused multiply-add must
be written as `fma`. Comparisons with NaN are false.

Under ``NUMBA_DISABLE_JIT=1`` the same names work on NumPy arrays of eight, so that a kernel can be stepped
through. There, too, `fma` is exact before rounding.
"""

from proximity.native import IS_JIT
from proximity.native.signature import LANES

if IS_JIT:
    from proximity.native.simd.compiled import (
        absolute,
        add_rows,
        bits,
        compress,
        count_bits,
        fma,
        halves_swapped,
        horizontal_min,
        lane,
        lane_minima,
        lane_sums,
        like,
        load,
        load_each,
        load_int,
        load_rows,
        lowest_lane,
        maximum,
        minimum,
        narrow,
        nearest_lane,
        prefetch,
        select,
        splat,
        splat32,
        square_root,
        store,
        trailing_zeros,
        widen,
    )
else:  # on NumPy arrays of eight
    from proximity.native.simd.interpreted import (
        absolute,
        add_rows,
        bits,
        compress,
        count_bits,
        fma,
        halves_swapped,
        horizontal_min,
        lane,
        lane_minima,
        lane_sums,
        like,
        load,
        load_each,
        load_int,
        load_rows,
        lowest_lane,
        maximum,
        minimum,
        narrow,
        nearest_lane,
        prefetch,
        select,
        splat,
        splat32,
        square_root,
        store,
        trailing_zeros,
        widen,
    )

__all__ = [
    "LANES",
    "absolute",
    "add_rows",
    "bits",
    "compress",
    "count_bits",
    "fma",
    "halves_swapped",
    "horizontal_min",
    "lane",
    "lane_minima",
    "lane_sums",
    "like",
    "load",
    "load_each",
    "load_int",
    "load_rows",
    "lowest_lane",
    "maximum",
    "minimum",
    "narrow",
    "nearest_lane",
    "prefetch",
    "select",
    "splat",
    "splat32",
    "square_root",
    "store",
    "trailing_zeros",
    "widen",
]
