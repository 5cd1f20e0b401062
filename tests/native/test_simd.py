"""All operations of the eight-lane vectors against NumPy, bit by bit in each lane, compiled or not."""

import os
import subprocess
import sys
from fractions import Fraction

import numba
import numpy as np
import pytest
from project import ROOT

from proximity import native
from proximity.native import simd
from proximity.native.simd import (
    LANES,
    absolute,
    add_rows,
    bits,
    compress,
    count_bits,
    fma,
    horizontal_min,
    lane,
    lane_minima,
    lane_sums,
    like,
    load,
    load_each,
    load_int,
    load_rows,
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

FLOATS = [np.float32, np.float64]
VECTOR_RESULTS = [
    "add", "sub", "mul", "div", "neg", "minimum", "maximum", "absolute", "square_root", "select", "fma",
]  # fmt: skip
MASK_RESULTS = ["lt", "le", "gt", "ge", "eq", "and", "or", "xor", "not"]

# Without contraction or reordering: the flags of kernels.
compiled = numba.njit(boundscheck=False, error_model="numpy")


@compiled
def vector_results(a, b, c, out, masks):
    """Compute rows of *out* (11, N) and *masks* (9, N / 8), in the order of the names above."""
    for at in range(0, len(a), LANES):
        x, y, z = load(a, at), load(b, at), load(c, at)
        store(out[0], at, x + y)
        store(out[1], at, x - y)
        store(out[2], at, x * y)
        store(out[3], at, x / y)
        store(out[4], at, -x)
        store(out[5], at, minimum(x, y))
        store(out[6], at, maximum(x, y))
        store(out[7], at, absolute(x))
        store(out[8], at, square_root(x))
        store(out[9], at, select(x < z, x, y))
        store(out[10], at, fma(x, y, z))
        row = at // LANES
        masks[0, row], masks[1, row] = bits(x < y), bits(x <= y)
        masks[2, row], masks[3, row] = bits(x > y), bits(x >= y)
        masks[4, row] = bits(x == y)
        masks[5, row], masks[6, row] = bits((x < y) & (y < z)), bits((x < y) | (y < z))
        masks[7, row], masks[8, row] = bits((x < y) ^ (y < z)), bits(~(x < y))


@compiled
def scalar_results(a, b, c, out):
    """Compute the rows of functions that also accept plain floats."""
    for i in range(len(a)):
        x, y, z = a[i], b[i], c[i]
        out[5, i] = minimum(x, y)
        out[6, i] = maximum(x, y)
        out[7, i] = absolute(x)
        out[8, i] = square_root(x)
        out[9, i] = select(x < z, x, y)
        out[10, i] = fma(x, y, z)


def expected_fma(x, y, z, dtype):
    """Return a b + c rounded once, from fractions."""
    with np.errstate(all="ignore"):
        if not np.isfinite([x, y]).all():
            return x * y + z
        if not np.isfinite(z):
            return z  # the product is finite before rounding
        exact = Fraction(float(x)) * Fraction(float(y)) + Fraction(float(z))
        if exact == 0:
            return dtype(float(x) * float(y) + float(z))
        # The nearest number with that many bits, down to the smallest denormal; `round` rounds ties to even.
        info = np.finfo(dtype)
        exponent = len(bin(abs(exact.numerator))) - len(bin(exact.denominator))
        exponent -= abs(exact) < Fraction(2) ** exponent
        step = Fraction(2) ** (max(exponent, int(info.minexp)) - int(info.nmant))
        rounded = round(exact / step) * step
        if abs(rounded) > Fraction(float(info.max)):
            return dtype(np.inf if exact > 0 else -np.inf)
        return dtype(float(rounded)) if rounded else dtype(-0.0 if exact < 0 else 0.0)


def expected_vectors(name, a, b, c):
    with np.errstate(all="ignore"):
        return {
            "add": lambda: a + b,
            "sub": lambda: a - b,
            "mul": lambda: a * b,
            "div": lambda: a / b,
            "neg": lambda: -a,
            "minimum": lambda: np.where(a < b, a, b),
            "maximum": lambda: np.where(a > b, a, b),
            "absolute": lambda: np.abs(a),
            "square_root": lambda: np.sqrt(a),
            "select": lambda: np.where(a < c, a, b),
            "fma": lambda: np.array([expected_fma(*row, a.dtype.type) for row in zip(a, b, c, strict=True)]),
        }[name]()


def expected_masks(name, a, b, c):
    return {
        "lt": a < b,
        "le": a <= b,
        "gt": a > b,
        "ge": a >= b,
        "eq": a == b,
        "and": (a < b) & (b < c),
        "or": (a < b) | (b < c),
        "xor": (a < b) ^ (b < c),
        "not": ~(a < b),
    }[name]


def assert_same_bits(found, expected):
    """Assert equality including the sign of zero; all NaNs are equal."""
    found, expected = np.asarray(found), np.asarray(expected)
    assert found.dtype == expected.dtype
    differs = ~(
        (np.isnan(found) & np.isnan(expected))
        | ((found == expected) & ~(np.signbit(found) ^ np.signbit(expected)))
    )
    assert not differs.any(), f"{found[differs][:4]} instead of {expected[differs][:4]}"


def special_values(dtype):
    info = np.finfo(dtype)
    positive = [0.0, 1.0, 3.0, np.inf, info.max, info.tiny, info.smallest_subnormal, 1.0 + info.eps, 0.1]
    return np.array([*positive, *(-value for value in map(dtype, positive)), np.nan], dtype)


@pytest.fixture(scope="module", params=FLOATS, ids=["f32x8", "f64x8"])
def operands(request):
    """Three arrays: all pairs of special values with a third, then numbers of all sizes, then near ties."""
    dtype = request.param
    rng = np.random.default_rng(7)
    special = special_values(dtype)
    a, b = (side.ravel() for side in np.meshgrid(special, special))
    c = rng.permutation(np.resize(special, len(a)))
    reach = 30 if dtype is np.float32 else 300
    sizes = dtype(10.0) ** rng.uniform(-reach, reach, (3, 400)).astype(dtype)
    wild = sizes * rng.normal(size=(3, 400)).astype(dtype)
    # Products that the third number nearly cancels: one rounding differs from two.
    near = rng.normal(size=(2, 401)).astype(dtype)
    a, b = (np.concatenate([old, wild[k], near[k]]) for k, old in enumerate((a, b)))
    c = np.concatenate([c, wild[2], -near[0] * near[1]])
    end = len(a) // LANES * LANES
    return a[:end], b[:end], c[:end]


@pytest.fixture(scope="module")
def answers(operands):
    a = operands[0]
    out = np.empty((len(VECTOR_RESULTS), len(a)), a.dtype)
    masks = np.empty((len(MASK_RESULTS), len(a) // LANES), np.int64)
    with np.errstate(all="ignore"):
        vector_results(*operands, out, masks)
    return dict(zip(VECTOR_RESULTS, out, strict=True)), dict(zip(MASK_RESULTS, masks, strict=True))


@pytest.mark.internals
@pytest.mark.parametrize("name", VECTOR_RESULTS)
def test_vector_operation_rounds_once_in_every_lane(name, operands, answers):
    assert_same_bits(answers[0][name], expected_vectors(name, *operands))


@pytest.mark.internals
@pytest.mark.parametrize("name", MASK_RESULTS)
def test_comparison_has_one_bit_a_lane_and_is_false_for_nan(name, operands, answers):
    expected = np.packbits(expected_masks(name, *operands).reshape(-1, LANES), axis=1, bitorder="little")

    np.testing.assert_array_equal(answers[1][name], expected[:, 0])


@pytest.mark.internals
def test_scalars_give_what_vectors_give(operands, answers):
    out = np.empty((len(VECTOR_RESULTS), len(operands[0])), operands[0].dtype)
    with np.errstate(all="ignore"):
        scalar_results(*operands, out)

    for row, name in list(enumerate(VECTOR_RESULTS))[5:]:
        assert_same_bits(out[row], answers[0][name])


@compiled
def moved(source, offset, target, at):
    store(target, at, load(source, offset))


@pytest.mark.internals
@pytest.mark.parametrize("dtype", FLOATS)
@pytest.mark.parametrize("offset", [0, 1, 5, 8])
def test_load_and_store_begin_anywhere_and_touch_eight(dtype, offset):
    source, target = np.arange(16, dtype=dtype), np.full(16, -1.0, dtype)

    moved(source, offset, target, 3)

    np.testing.assert_array_equal(target[3:11], source[offset : offset + 8])
    assert (np.delete(target, np.s_[3:11]) == -1.0).all()


@compiled
def int_of(words, offset):
    return load_int(words, offset)


@pytest.mark.internals
@pytest.mark.parametrize("value", [0, 1, -1, 7, ~5, 2**31 - 1, -(2**31), 0x7FC00001])
def test_load_int_reads_the_bits_of_a_float32(value):
    words = np.array([9, value], np.int32).view(np.float32)

    assert int_of(words, 1) == value


@compiled
def filled(value, narrow_value, wide, small):
    store(wide, 0, splat(value))
    store(small, 0, splat32(np.float32(narrow_value)))


@pytest.mark.internals
@pytest.mark.parametrize("value", [0.1, -0.0, np.inf, np.nan, 5e-324])
def test_splat_fills_all_lanes(value):
    wide, small = np.empty(8), np.empty(8, np.float32)

    filled(value, np.float32(value), wide, small)

    assert_same_bits(wide, np.full(8, value))
    assert_same_bits(small, np.full(8, value, np.float32))


@compiled
def alike(wide, small, wide_out, small_out):
    store(wide_out, 0, like(0.1, load(wide, 0)))
    store(small_out, 0, like(0.1, load(small, 0)))
    return like(0.1, wide[0]), like(0.1, small[0]), narrow(wide[0]), widen(small[0])


@pytest.mark.internals
def test_a_constant_is_of_the_type_of_what_it_goes_with():
    wide, small = np.full(8, 2.0 / 3.0), np.full(8, np.float32(2.0 / 3.0))
    wide_out, small_out = np.empty(8), np.empty(8, np.float32)

    one, other, narrowed, widened = alike(wide, small, wide_out, small_out)

    assert_same_bits(wide_out, np.full(8, 0.1))
    assert_same_bits(small_out, np.full(8, np.float32(0.1)))
    assert (one, other) == (0.1, np.float32(0.1))
    assert (narrowed, widened) == (np.float32(2.0 / 3.0), float(np.float32(2.0 / 3.0)))


@compiled
def converted(wide, small, wide_out, small_out):
    for at in range(0, len(wide), LANES):
        store(small_out, at, narrow(load(wide, at)))
        store(wide_out, at, widen(load(small, at)))


@pytest.mark.internals
def test_narrow_rounds_to_nearest_and_widen_is_exact():
    rng = np.random.default_rng(7)
    wide = np.concatenate([special_values(np.float64), 10.0 ** rng.uniform(-46, 39, 205)])
    wide = np.resize(wide, 224)
    with np.errstate(over="ignore"):
        small = wide.astype(np.float32)
    wide_out, small_out = np.empty(224), np.empty(224, np.float32)

    with np.errstate(all="ignore"):
        converted(wide, small, wide_out, small_out)

    assert_same_bits(small_out, small)
    assert_same_bits(wide_out, small.astype(np.float64))


@compiled
def compressed(values, limits, out):
    store(out, 0, compress(load(values, 0), load(limits, 0) > load(limits, LANES)))


@pytest.mark.internals
@pytest.mark.parametrize("dtype", FLOATS)
def test_compress_moves_chosen_lanes_to_the_front_in_order(dtype):
    values = np.array([3.0, -0.0, np.nan, np.inf, 5.0, 1e-40, 7.0, -8.0], dtype)
    for pattern in range(256):
        chosen = np.array([pattern >> i & 1 for i in range(LANES)], bool)
        out = np.empty(8, dtype)

        compressed(values, np.concatenate([chosen, np.zeros(8)]).astype(dtype), out)

        assert_same_bits(out[: chosen.sum()], values[chosen])


@compiled
def min_of(values):
    return horizontal_min(load(values, 0))


@compiled
def lane_of(values, i):
    return lane(load(values, 0), i)


@compiled
def truth_of(values, other, i):
    return lane(load(values, 0) < load(other, 0), i)


@pytest.mark.internals
@pytest.mark.parametrize("dtype", FLOATS)
def test_horizontal_min_and_lane_take_the_right_lanes(dtype):
    for seed in range(20):
        values = np.random.default_rng(seed).normal(size=8).astype(dtype)
        values[seed % 8] = [np.inf, -np.inf, 0.0, np.finfo(dtype).smallest_subnormal][seed % 4]

        assert min_of(values) == values.min()
        assert [lane_of(values, i) for i in range(LANES)] == values.tolist()
        assert [bool(truth_of(values, -values, i)) for i in range(LANES)] == (values < 0.0).tolist()


@compiled
def each_of(values, sums, minima):
    """Apply the reductions to the eight rows of *values* (64,) as vectors."""
    a, b, c, d = load(values, 0), load(values, 8), load(values, 16), load(values, 24)
    e, f, g, h = load(values, 32), load(values, 40), load(values, 48), load(values, 56)
    store(sums, 0, lane_sums(a, b, c, d, e, f, g, h))
    store(minima, 0, lane_minima(a, b, c, d, e, f, g, h))


@pytest.mark.internals
@pytest.mark.parametrize("dtype", FLOATS)
def test_sums_and_minima_of_eight_vectors_stand_in_their_order(dtype):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        values = rng.integers(-1000, 1000, (8, 8)).astype(dtype)
        sums, minima = np.empty(8, dtype), np.empty(8, dtype)

        each_of(values.reshape(-1), sums, minima)

        assert sums.tolist() == values.sum(axis=1).tolist()
        assert minima.tolist() == values.min(axis=1).tolist()
        values[seed % 8, seed // 3] = np.inf
        each_of(values.reshape(-1), sums, minima)
        assert np.isinf(sums).tolist() == [row == seed % 8 for row in range(8)]
        assert minima.tolist() == values.min(axis=1).tolist()


@compiled
def sum_after_prefetch(array):
    total = 0.0
    for i in range(len(array)):
        prefetch(array, i)
        total += array[i]
    return total


@pytest.mark.internals
def test_prefetch_changes_nothing():
    array = np.arange(40.0)

    assert sum_after_prefetch(array) == 780.0
    assert array.tolist() == list(range(40))


ROWS = [99, 3, 0, 20, 20, 7, 33, 11, 34]
"""Two before the rows of four in an array of 40; the first is unused, one is repeated."""


@compiled
def numbers_at(array, offsets, out):
    store(out, 0, load_each(array, offsets, 1, 2))


@pytest.mark.internals
@pytest.mark.parametrize("shape", [(40,), (10, 4), (2, 5, 4)])
def test_numbers_are_taken_from_wherever_they_are(shape):
    array, out = np.random.default_rng(7).normal(size=shape), np.empty(8)

    numbers_at(array, np.array(ROWS), out)

    assert out.tolist() == [array.ravel()[row + 2] for row in ROWS[1:]]


@compiled
def columns_of(array, offsets, out):
    x, y, z, w = load_rows(array, offsets, 1, 2)
    store(out, 0, x)
    store(out, 8, y)
    store(out, 16, z)
    store(out, 24, w)


@compiled
def with_rows_added(array, offsets, columns):
    add_rows(array, offsets, 1, 2, load(columns, 0), load(columns, 8), load(columns, 16))


@pytest.mark.internals
def test_rows_become_columns_and_come_back():
    array, out = np.random.default_rng(7).normal(size=40), np.empty(32)

    columns_of(array, np.array(ROWS), out)

    assert out.reshape(4, 8).T.tolist() == [array[row + 2 : row + 6].tolist() for row in ROWS[1:]]


@pytest.mark.internals
def test_adding_to_rows_is_done_lane_by_lane():
    rng = np.random.default_rng(7)
    array, columns = rng.integers(-99, 99, 40).astype(float), rng.integers(-99, 99, 24).astype(float)
    expected = array.copy()
    for i, row in enumerate(ROWS[1:]):
        expected[row + 2 : row + 5] += columns[i::8]

    with_rows_added(array, np.array(ROWS), columns)

    assert array.tolist() == expected.tolist()


@compiled
def nearest_of(bounds, limit):
    x = load(bounds, 0)
    nearest, it = nearest_lane(x, x <= splat32(limit))
    return nearest, bits(it)


@pytest.mark.internals
def test_nearest_lane_is_the_smallest_chosen_one_but_for_three_bits():
    rng = np.random.default_rng(7)
    for _ in range(200):
        bounds = (10.0 ** rng.uniform(-40, 38, 8)).astype(np.float32)
        bounds[rng.random(8) < 0.2] = rng.choice([0.0, np.inf, np.nan, 1e-45])
        limit = np.float32(rng.choice([np.inf, 1.0, 1e30]))
        chosen = bounds <= limit
        if not chosen.any():
            continue

        nearest, it = nearest_of(bounds, limit)

        assert chosen[nearest]
        assert it == 1 << nearest
        # The three lowest bits contain the lane.
        assert bounds[nearest].view(np.int32) & ~7 == bounds[chosen].min().view(np.int32) & ~7


@pytest.mark.internals
def test_nearest_lane_takes_the_lowest_of_equals():
    bounds = np.array([9, 4, 4, 8, 4, 9, 9, 9], np.float32)

    assert nearest_of(bounds, np.float32(np.inf)) == (1, 1 << 1)


@compiled
def fetched(words, reals, offset):
    prefetch(words, offset)
    prefetch(reals, offset)
    return load_int(words, 0)


@pytest.mark.internals
def test_prefetch_changes_nothing_and_may_be_asked_beyond_the_array():
    words, reals = np.arange(16, dtype=np.float32), np.arange(16.0)

    for offset in (0, 15, 16, -1, 2**40, -(2**40)):
        assert fetched(words, reals, offset) == 0
    assert (words == np.arange(16)).all() and (reals == np.arange(16)).all()


@pytest.mark.internals
@pytest.mark.skipif(not native.IS_JIT, reason="there is nothing to look into")
def test_prefetch_is_an_instruction_of_the_compiled_code():
    fetched(np.zeros(16, np.float32), np.zeros(16), 0)
    (code,) = fetched.inspect_llvm().values()
    calls = [line for line in code.splitlines() if "call void @llvm.prefetch" in line]

    # Arguments: read, keep in all caches, data.
    assert len(calls) >= 2 and all("i32 0, i32 3, i32 1)" in line for line in calls)


@compiled
def bits_of(value):
    return trailing_zeros(value), count_bits(value)


@pytest.mark.internals
@pytest.mark.parametrize("value", [1, 2, 3, 0b10100, 255, 128, 2**40, 2**62])
def test_bit_counts_are_those_of_whole_numbers(value):
    assert bits_of(value) == ((value & -value).bit_length() - 1, value.bit_count())


@compiled
def mixed(x):
    return minimum(x, 1), maximum(2.0, x), fma(x, 2, 1.0)


@pytest.mark.internals
def test_whole_numbers_and_literals_count_as_float64():
    assert mixed(np.float64(1.5)) == (1.0, 2.0, 4.0)


def test_public_names_are_those_that_the_module_lists():
    assert simd.__all__ == sorted(simd.__all__)
    assert all(hasattr(simd, name) for name in simd.__all__)


@pytest.mark.processes
@pytest.mark.skipif(native.MODE == "interpreted", reason="this is the interpreted run")
def test_all_of_this_holds_when_numba_interprets():
    program = [sys.executable, "-m", "pytest", "-n", "0", "-p", "no:cacheprovider", "-p", "no:dash", __file__]
    done = subprocess.run(
        program,
        cwd=ROOT,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        timeout=120,
    )

    assert done.returncode == 0, done.stdout + done.stderr
