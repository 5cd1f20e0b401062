"""Kernels that are called past numba's look at arguments; where a walk goes on."""

import subprocess
import sys

import numpy as np
import pytest

from proximity.kernels.compiling import Settled, kernel
from proximity.kernels.descent import descend_in_order, next_open
from proximity.kernels.layout import CHILDREN, LANES, NODE_STRIDE, STACK_SIZE
from proximity.kernels.memory import are_rows, as_rows
from proximity.simd import bits, load, load_int, splat32


@kernel
def _total(points):
    return as_rows(points).sum() if are_rows(points) else -1.0


def test_a_settled_kernel_takes_arrays_that_lie_anyhow_and_looks_at_them_itself():
    total, rows = Settled(_total, "(float64[:,:],)"), np.arange(12.0).reshape(4, 3)
    for _ in range(2):
        assert total.call(rows) == 66.0
    read_only = rows.copy()
    read_only.setflags(write=False)
    at_odd_address = np.frombuffer(b"?" + rows.tobytes(), np.uint8)[1:].view(np.float64).reshape(4, 3)
    assert total.call(read_only) == 66.0
    assert total.call(rows[2:]) == 51.0
    assert total.call(np.broadcast_to(rows, (4, 4, 3))[0, :1]) == total.call(rows[::2][:1]) == 3.0
    assert total.call(rows[:0]) == total.call(rows[::2][:0]) == total.call(rows[:0, ::-1]) == 0.0
    for other in (rows[::2], rows[::-1], rows[:, ::-1], np.asfortranarray(rows), rows[:, :2], at_odd_address):
        assert total.call(other) == -1.0


LEFT_OVER = """
import proximity
from proximity import queries, tracker
from proximity.kernels.compiling import Settled

proximity.warm_up()
for module in (queries, tracker):
    for name, value in vars(module).items():
        if isinstance(value, Settled) and getattr(value.call, "__self__", None) is value:
            print(name)
"""


def test_warming_up_leaves_no_kernel_of_a_call_to_be_compiled():
    told = subprocess.run([sys.executable, "-c", LEFT_OVER], capture_output=True, text=True, timeout=600)

    assert (told.returncode, told.stdout) == (0, ""), told.stderr


@kernel
def _two_steps(words, bounds, limit, stacks):
    """References of the child gone to and of the one that is next, and how many wait."""
    distances = load(bounds, 0)
    is_open = distances <= splat32(limit)
    if not bits(is_open):
        return -1, -1, -1
    first, at = descend_in_order(words, 0, distances, is_open, stacks, 0)
    waiting = at
    at = next_open(stacks, 0, at, limit)
    return first, load_int(stacks, at + STACK_SIZE) if at >= 0 else -1, waiting


@pytest.mark.parametrize("count", range(1, LANES + 1))
def test_of_those_that_wait_the_nearest_is_taken_up_first(count):
    rng = np.random.default_rng(count)
    words = np.zeros(NODE_STRIDE, np.float32)
    words.view(np.int32)[CHILDREN:] = 10 + np.arange(NODE_STRIDE - CHILDREN)
    for _ in range(50):
        bounds = rng.permutation(np.arange(1.0, LANES + 1.0)).astype(np.float32)
        order = np.argsort(bounds)

        first, second, waiting = _two_steps(
            words, bounds, np.float32(count), np.zeros(2 * STACK_SIZE, np.float32)
        )

        assert (first, waiting) == (10 + order[0], count - 1)
        assert second == (10 + order[1] if count > 1 else -1)
