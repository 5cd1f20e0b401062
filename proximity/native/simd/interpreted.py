"""Vector functions on NumPy arrays of eight, with bit-identical results, for stepping through kernels."""

from fractions import Fraction

import numpy as np

from proximity.native.signature import LANES

absolute = np.abs
square_root = np.sqrt


def load(array, offset):
    return array[offset : offset + LANES].copy()


def load_int(array, offset):
    return int(array[offset : offset + 1].view(np.int32)[0])


def store(array, offset, vector):
    array[offset : offset + LANES] = vector


def load_each(array, offsets, at, shift):
    return array.reshape(-1)[offsets[at : at + LANES] + shift]


def load_rows(array, offsets, at, shift):
    rows = np.array([array[offset : offset + 4] for offset in offsets[at : at + LANES] + shift])
    return tuple(np.ascontiguousarray(column) for column in rows.T)


def add_rows(array, offsets, at, shift, x, y, z):
    for i, offset in enumerate(offsets[at : at + LANES] + shift):
        array[offset : offset + 4] += (x[i], y[i], z[i], 0.0)


def prefetch(array, offset):
    pass


def compress(vector, mask):
    return np.concatenate([vector[mask], vector[~mask]])


def nearest_lane(bounds, mask):
    return lowest_lane(np.where(mask, bounds, np.float32(np.inf)))


def lowest_lane(bounds):
    keys = (bounds.view(np.uint32) & np.uint32(0xFFFFFFF8)) | np.arange(LANES, dtype=np.uint32)
    return int(keys.min()) & 7, keys == keys.min()


def fma(a, b, c):
    if np.ndim(a) or np.ndim(b) or np.ndim(c):
        a, b, c = np.broadcast_arrays(a, b, c)
        return np.array([fma(*lanes) for lanes in zip(a, b, c, strict=True)], dtype=a.dtype)
    is_narrow = all(isinstance(each, np.float32) for each in (a, b, c))
    a, b, c = float(a), float(b), float(c)
    if not (np.isfinite(a) and np.isfinite(b)):
        result = a * b + c
    elif not np.isfinite(c):
        result = c  # the product is finite before rounding
    else:
        exact = Fraction(a) * Fraction(b) + Fraction(c)
        try:
            result = float(exact) if exact else a * b + c  # the sum has the correct sign of zero
        except OverflowError:
            result = np.inf if exact > 0 else -np.inf
        if is_narrow and np.isfinite(result) and Fraction(result) != exact:
            result = _rounded_to_odd(result, exact)
    with np.errstate(over="ignore"):
        return np.float32(result) if is_narrow else np.float64(result)


def _rounded_to_odd(result, exact):
    """Return the float64 next to *exact* whose last bit is odd. It rounds to the same float32 as *exact*."""
    other = np.nextafter(result, np.inf if exact > Fraction(result) else -np.inf)
    return result if np.float64(result).view(np.int64) & 1 else float(other)


def select(mask, a, b):
    return np.where(mask, a, b) if np.ndim(mask) else (a if mask else b)


def minimum(a, b):
    return select(np.less(a, b), a, b)


def maximum(a, b):
    return select(np.greater(a, b), a, b)


def bits(mask):
    return int(np.packbits(mask, bitorder="little")[0])


def splat(value):
    return np.full(LANES, value, dtype=np.float64)


def splat32(value):
    return np.full(LANES, value, dtype=np.float32)


def like(value, example):
    return (
        np.full(LANES, value, dtype=example.dtype)
        if np.ndim(example)
        else np.asarray(example).dtype.type(value)
    )


def widen(value):
    return value.astype(np.float64) if np.ndim(value) else np.float64(value)


def narrow(value):
    return value.astype(np.float32) if np.ndim(value) else np.float32(value)


def lane(vector, index):
    return vector[index]


def horizontal_min(vector):
    for step in (4, 2, 1):
        vector = minimum(vector, np.roll(vector, -step))
    return vector[0]


def halves_swapped(vector):
    return np.roll(vector, 4)


def _each(combine, vectors):
    vectors = list(vectors)
    for step in (1, 2, 4):
        low = [i + (LANES - step if i & step else 0) for i in range(LANES)]
        both = [np.concatenate(vectors[k : k + 2]) for k in range(0, len(vectors), 2)]
        vectors = [combine(pair[low], pair[[i + step for i in low]]) for pair in both]
    return vectors[0]


def lane_sums(*vectors):
    return _each(np.add, vectors)


def lane_minima(*vectors):
    return _each(minimum, vectors)


def trailing_zeros(value):
    return (int(value) & -int(value)).bit_length() - 1


def count_bits(value):
    return int(value).bit_count()
