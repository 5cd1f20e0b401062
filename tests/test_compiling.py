"""Kernels that take no other types than at first; where a walk goes on."""

import numpy as np
import pytest

from proximity.kernels.compiling import Settled, kernel
from proximity.kernels.descent import descend_in_order, next_open
from proximity.kernels.layout import CHILDREN, LANES, NODE_STRIDE, STACK_SIZE
from proximity.simd import IS_COMPILED, bits, load, load_int, splat32


@kernel
def _total(values):
    return values.sum()


@pytest.mark.skipif(not IS_COMPILED, reason="uncompiled functions take anything")
def test_a_settled_kernel_takes_what_it_was_called_with_and_nothing_else():
    total, values = Settled(_total), np.arange(4.0)
    with pytest.raises(TypeError):
        total.quick(values)

    assert total.call(values) == total.quick(values) == 6.0
    read_only = values.copy()
    read_only.setflags(write=False)
    for other in (values.astype(np.float32), values[::2], values.reshape(2, 2), read_only, [1.0], None):
        with pytest.raises(TypeError):
            total.quick(other)


def test_an_uncompiled_function_is_never_quick():
    total = Settled(sum)

    assert total.call([1, 2]) == 3
    with pytest.raises(TypeError):
        total.quick([1, 2])


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
