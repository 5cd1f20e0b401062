"""Kernels that are called past numba's look at arguments; where a walk goes on."""

import os
import subprocess
import sys

import numpy as np
import pytest

import proximity
from proximity.errors import QueryError
from proximity.kernels.compiler import CompiledCall, kernel
from proximity.kernels.given import GIVEN_ROWS, row_count, rows_of
from proximity.kernels.layout import LANES, NODE_CHILDREN, NODE_STRIDE, STACK_SIZE
from proximity.kernels.tree.traversal import descend_in_order, next_open
from proximity.simd import bits, load, load_int, splat32
from proximity.tracker.warm_up import _HELP


@kernel
def _total(points):
    return rows_of(points).sum() if row_count(points) >= 0 else -1.0


def test_a_settled_kernel_takes_arrays_that_lie_anyhow_and_looks_at_them_itself():
    total, rows = CompiledCall(_total, (GIVEN_ROWS,)), np.arange(12.0).reshape(4, 3)
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


DOUBLING = """
from proximity.kernels import compiler

@compiler.kernel
def double(number):
    return number + number
"""

SIDE_BY_SIDE = """
import os, sys, time
from pathlib import Path
from numba.core.caching import IndexDataCacheFile

save_index, here = IndexDataCacheFile._save_index, Path(sys.argv[1])

def save_when_the_other_has_looked(self, versions):
    (here / f"looked.{os.getpid()}").touch()
    give_up = time.monotonic() + 3.0
    while len(list(here.glob("looked.*"))) < 2 and time.monotonic() < give_up:
        time.sleep(0.01)
    save_index(self, versions)

IndexDataCacheFile._save_index = save_when_the_other_has_looked
from doubling import double
print(double(eval(sys.argv[2])), sum(double.stats.cache_hits.values()))
"""


def test_processes_that_compile_side_by_side_keep_what_each_has_compiled(tmp_path):
    """Of two versions of a function one was lost, or the list of one led to the code of the other."""
    (tmp_path / "doubling.py").write_text(DOUBLING)
    folders = os.pathsep.join([str(tmp_path), *sys.path])
    around = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONPATH": folders}

    def start(number):
        arguments = [sys.executable, "-c", SIDE_BY_SIDE, str(tmp_path), number]
        return subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True, env=around)

    for hits in (0, 1):
        both = [start("21"), start("0.25")]
        told = [each.communicate(timeout=120)[0] for each in both]
        assert told == [f"42 {hits}\n", f"0.5 {hits}\n"]


LEFT_OVER = """
import proximity
from proximity.scene.queries import line_queries, point_queries
from proximity.tracker import tracker
import proximity
from proximity.errors import QueryError
from proximity.kernels.compiler import CompiledCall

proximity.warm_up()
for module in (point_queries, line_queries, tracker):
    for name, value in vars(module).items():
        if isinstance(value, CompiledCall) and getattr(value.call, "__self__", None) is value:
            print(name)
"""


HELPED = """
import subprocess
from proximity.tracker import warm_up as warmup
started = []
class Popen(subprocess.Popen):
    def __init__(self, arguments, **options):
        super().__init__(arguments, **options)
        started.append(self)
subprocess.Popen = Popen
warmup.kernels_are_cached = lambda: {are_cached}
warmup.warm_up(workers={workers})
print(len(started), *(helper.poll() is not None for helper in started))
"""


@pytest.mark.parametrize(
    ("workers", "are_cached", "told"),
    [(1, False, "0"), (3, False, "2 True True"), (9, False, "3 True True True"), (9, True, "0")],
)
def test_helpers_compile_beside_and_are_gone_at_the_end(workers, are_cached, told):
    code = HELPED.format(workers=workers, are_cached=are_cached)
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)

    assert (result.returncode, result.stdout.strip()) == (0, told), result.stderr


def test_a_helper_compiles_what_is_called():
    code = (
        f"{_HELP.format(first=3)}\n"
        "from proximity.tracker import warm_up as warmup\n"
        "print([call for call in warmup._calls() if getattr(call.call, '__self__', None) is call])"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)

    assert result.stdout == "[]\n", result.stderr


def test_number_of_processes_is_looked_at():
    with pytest.raises(QueryError, match=r"^workers is 0, expected a number of processes, or -1"):
        proximity.warm_up(workers=0)


def test_warming_up_leaves_no_kernel_of_a_call_to_be_compiled():
    told = subprocess.run([sys.executable, "-c", LEFT_OVER], capture_output=True, text=True, timeout=600)

    assert (told.returncode, told.stdout) == (0, ""), told.stderr


@kernel
def _two_steps(words, bounds, ends, limit, stacks):
    """References of the child gone to and of the one that is next, and how many wait."""
    distances = load(bounds, 0)
    is_open = distances <= splat32(limit)
    if not bits(is_open):
        return -1, -1, -1
    first, at = descend_in_order(words, 0, distances, load(ends, 0), is_open, stacks, 0)
    waiting = at
    at = next_open(stacks, 0, at, limit)
    return first, load_int(stacks, at + STACK_SIZE) if at >= 0 else -1, waiting


@pytest.mark.parametrize("is_tie", [False, True], ids=["entered in order", "entered at once, left in order"])
@pytest.mark.parametrize("count", range(1, LANES + 1))
def test_of_those_that_wait_the_nearest_is_taken_up_first(count, is_tie):
    rng = np.random.default_rng(count)
    words = np.zeros(NODE_STRIDE, np.float32)
    words.view(np.int32)[NODE_CHILDREN:] = 10 + np.arange(NODE_STRIDE - NODE_CHILDREN)
    for _ in range(50):
        places = rng.permutation(np.arange(1.0, LANES + 1.0)).astype(np.float32)
        order = np.argsort(places)
        bounds = np.where(places <= count, 1.0, 2.0).astype(np.float32) if is_tie else places
        ends = places + 2 if is_tie else rng.permutation(places) * np.float32(0.5) + LANES

        first, second, waiting = _two_steps(
            words, bounds, ends, np.float32(1.0 if is_tie else count), np.zeros(2 * STACK_SIZE, np.float32)
        )

        assert (first, waiting) == (10 + order[0], count - 1)
        assert second == (10 + order[1] if count > 1 else -1)
