"""Memory read by queries: alignment, ownership, and the request for huge pages."""

import multiprocessing
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from proximity.mesh.part_memory import ALIGNMENT, HUGE_PAGE, aligned_empty

SMAPS = Path("/proc/self/smaps")


@pytest.mark.parametrize("dtype", [np.float32, np.uint8])
@pytest.mark.parametrize("size", [0, 4096, HUGE_PAGE, 5 * HUGE_PAGE // 2])
def test_it_begins_on_a_line_and_holds_what_is_written(size, dtype):
    count = size // np.dtype(dtype).itemsize
    room = aligned_empty(count, dtype)
    assert room.shape == (count,) and room.dtype == dtype
    assert room.flags.writeable and room.flags.c_contiguous
    assert not count or room.ctypes.data % ALIGNMENT == 0
    room[:] = np.arange(count) % 100
    other = aligned_empty(count, dtype)
    other[:] = 101
    assert np.array_equal(room, (np.arange(count) % 100).astype(dtype))


def test_too_much_is_told_as_the_usual_source_tells_it():
    with pytest.raises(MemoryError):
        aligned_empty(2**55, np.float64)


def test_it_outlives_the_call_that_made_it():
    views = [aligned_empty(HUGE_PAGE, np.uint8)[5:9] for _ in range(20)]
    for number, view in enumerate(views):
        view[:] = number
    assert [int(view.sum()) for view in views] == [4 * number for number in range(20)]


@pytest.mark.skipif(not SMAPS.is_file(), reason="no /proc/self/smaps here")
def test_huge_pages_are_asked_for_where_they_fill():
    room = aligned_empty(3 * HUGE_PAGE // 2, np.uint8)
    start = room.ctypes.data
    assert start % HUGE_PAGE == 0
    flags = _flags_of(start)
    if flags is None:
        pytest.skip("this system says nothing of a mapping's flags")
    assert "hg" in flags
    assert "hg" not in _flags_of(start + HUGE_PAGE), "the rest, of half a page, is on ordinary pages"


def _flags_of(address):
    """Return the flags of the mapping that contains an address."""
    for each in re.split(r"\n(?=[0-9a-f]+-[0-9a-f]+ )", SMAPS.read_text()):
        first, last = (int(number, 16) for number in each.split(" ", 1)[0].split("-"))
        found = re.search(r"VmFlags: (.*)", each)
        if first <= address < last:
            return found and found[1].split()
    return None


def _change(room, answer):
    room[:] = 7
    answer.put(int(room[0]))


@pytest.mark.processes
@pytest.mark.skipif(sys.platform != "linux", reason="processes are not forked everywhere")
def test_a_forked_process_writes_to_memory_of_its_own():
    room = aligned_empty(2 * HUGE_PAGE, np.uint8)
    room[:] = 1
    context = multiprocessing.get_context("fork")
    answer = context.Queue()
    child = context.Process(target=_change, args=(room, answer))
    child.start()
    assert answer.get(timeout=60) == 7
    child.join()
    assert (room == 1).all()
