"""Arrays behind a table's address and on the stack, and that kernels own none."""

import ast
import os
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.errors import NumbaError
from project import TRIALS

import proximity
from proximity.kernels.compiler import kernel
from proximity.kernels.memory import (
    TableLength,
    arrays_at,
    arrays_behind,
    as_column,
    bundle_here,
    longs_here,
    make_table,
    real_rows_here,
    reals_here,
)
from proximity.simd import IS_COMPILED

compiled = pytest.mark.skipif(not IS_COMPILED, reason="kernels are not compiled")
SIZE = 40

two_at = arrays_behind(
    ("float64", 1, (TableLength(0), 2, 3)), ("int32", 2, (TableLength(0),)), ("float32", 1, (TableLength(3),))
)


@kernel
def sums(handle):
    blocks, numbers, _ = two_at(handle)
    total = 0.0
    for i in range(blocks.shape[0]):
        for j in range(blocks.shape[1]):
            for k in range(blocks.shape[2]):
                total += blocks[i, j, k] * numbers[i]
                blocks[i, j, k] = -1.0
    return total, blocks.shape[0], len(numbers)


@kernel
def shapes_of(handle):
    reals, words, frames, parts = arrays_at(handle)
    return len(reals), len(words), frames.shape, parts.shape, reals[0], words[1], frames[1, 2], parts[1, 0]


@kernel
def reverse(values):
    """Through the stack, in parts of `SIZE`."""
    room, places = reals_here(SIZE), longs_here(SIZE)
    for first in range(0, len(values), SIZE):
        count = min(SIZE, len(values) - first)
        for k in range(count):
            room[k], places[k] = values[first + k], first + count - 1 - k
        for k in range(count):
            values[places[k]] = room[k]


@kernel
def transpose(values):
    """Through the stack, rows of `SIZE`."""
    room = real_rows_here(SIZE, 3)
    for k in range(3 * SIZE):
        room[k // 3, k % 3] = values[k]
    for k in range(3 * SIZE):
        values[k] = room[k % SIZE, k // SIZE]
    return room.shape


class Squares(NamedTuple):
    numbers: np.ndarray
    table: np.ndarray


squares_here = bundle_here(Squares, ("int64", SIZE), ("float32", SIZE, 2))


@kernel
def fill(squares):
    for k in range(SIZE):
        squares.table[k, 0], squares.table[k, 1] = squares.numbers[k], squares.numbers[k] ** 2


@kernel
def sum_of_squares():
    """Through a bundle on the stack, which another function fills."""
    squares = squares_here()
    numbers, table = squares
    for k in range(SIZE):
        numbers[k] = k
    fill(squares)
    total = 0.0
    for k in range(SIZE):
        total += table[k, 1] - table[k, 0]
    return total, numbers.shape, table.shape


@kernel
def count_down(values):
    column = as_column(values)
    for row in range(column.shape[0]):
        column[row, 0] = column.shape[0] - row
    return column.shape


def test_bundle_on_the_stack_has_arrays_of_the_shapes_asked_for():
    numbers = np.arange(SIZE)

    assert sum_of_squares() == ((numbers**2 - numbers).sum(), (SIZE,), (SIZE, 2))


def test_numbers_are_written_through_the_column_made_of_them():
    values = np.full(5, np.nan)

    assert count_down(values) == (5, 1)
    assert (values == [5.0, 4.0, 3.0, 2.0, 1.0]).all()
    assert count_down(np.empty(0)) == (0, 1)


def test_arrays_are_found_again_behind_an_address():
    blocks, numbers = np.arange(18.0).reshape(3, 2, 3), np.array([1, 10, 100], np.int32)
    table = np.array([3, blocks.ctypes.data, numbers.ctypes.data, 0])

    assert sums(int(table.ctypes.data)) == (15.0 + 510.0 + 8700.0, 3, 3)
    assert (blocks == -1.0).all()


def test_a_model_is_found_again_behind_its_handle():
    reals, words = np.array([2.0, 3.0]), np.array([4.0, 5.0, 6.0], np.float32)
    frames, parts = np.arange(12.0).reshape(3, 4), np.arange(6).reshape(3, 2)
    table = make_table(reals, words, frames, parts)

    assert shapes_of(int(table.ctypes.data)) == (2, 3, (3, 4), (3, 2), 2.0, 5.0, 6.0, 2)


def test_arrays_of_no_length_are_arrays():
    nothing = np.zeros(0)
    table = np.array([0, nothing.ctypes.data, nothing.ctypes.data, 0])

    assert sums(int(table.ctypes.data)) == (0.0, 0, 0)


@pytest.mark.parametrize("count", [0, 1, SIZE, 3 * SIZE + 7])
def test_room_on_the_stack_is_a_calls_own(count):
    values = np.random.default_rng(count).normal(size=count)
    given = values.copy()
    reverse(values)

    for first in range(0, count, SIZE):
        assert (values[first : first + SIZE] == given[first : first + SIZE][::-1]).all()


def test_room_on_the_stack_may_have_rows():
    values = np.arange(3.0 * SIZE)

    assert transpose(values) == (SIZE, 3)
    assert values.tolist() == np.arange(3.0 * SIZE).reshape(SIZE, 3).T.ravel().tolist()


@compiled
def test_room_on_the_stack_has_a_constant_size():
    @kernel
    def greedy(count):
        return len(reals_here(count))

    with pytest.raises(NumbaError):
        greedy(3)


MAKING = {
    "arange", "argsort", "array", "asarray", "astype", "concatenate", "copy", "cumsum", "empty", "empty_like",
    "flatten", "full", "full_like", "linspace", "ones", "repeat", "sort", "zeros", "zeros_like",
}  # fmt: skip
"""Names of what makes an array."""
DECORATORS = {"kernel", "inlined", "maker"}


def decorated():
    """All compiled functions of the package: the file, the name, the decorator, and the names called."""
    package = Path(proximity.__file__).parent
    for path in sorted([*package.glob("kernels/**/*.py"), *package.glob("*/**/*_kernels.py")]):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.FunctionDef):
                continue
            marks = {getattr(mark, "id", None) for mark in node.decorator_list} & DECORATORS
            called = [each.func for each in ast.walk(node) if isinstance(each, ast.Call)]
            names = {getattr(each, "attr", None) or getattr(each, "id", None) for each in called}
            if marks:
                yield path.name, node.name, marks.pop(), names


def test_only_makers_make_arrays_or_call_makers():
    """What a kernel made would never be given back, since it counts no references."""
    functions = list(decorated())
    makers = {name for _, name, mark, _ in functions if mark == "maker"}

    assert {"build_tree", "refit_part", "run_loop"} <= makers
    assert len(functions) > 200
    for path, name, mark, called in functions:
        if mark != "maker":
            assert not called & (MAKING | makers), f"{path}: {name}"


def test_room_on_the_stack_is_not_taken_for_a_caller():
    """Of a function that is put into another it may be something else's as soon as that returns."""
    takers = {
        f"{prefix}_here" for prefix in ("real_rows", "reals", "word_rows", "words", "long_rows", "longs")
    }
    taking = [(path, name, mark) for path, name, mark, called in decorated() if called & takers]

    assert len(taking) > 8
    assert not [(path, name) for path, name, mark in taking if mark == "inlined"]


@compiled
def test_nothing_that_is_made_is_left_behind():
    environment = os.environ | {"NUMBA_NRT_STATS": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    script = TRIALS / "array_accounts.py"
    told = subprocess.run(
        [sys.executable, script], env=environment, stdout=subprocess.PIPE, text=True, check=True
    ).stdout
    left, objects_left, made = (int(word) for word in told.split())

    assert (left, objects_left) == (0, 0)
    assert made > 0
