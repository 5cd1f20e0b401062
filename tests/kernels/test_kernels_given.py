"""Objects from Python, looked at by compiled code: which are rows, and that all others are left alone."""

import pickle
import sys
from ctypes import c_int8, c_int32, c_int64

import numpy as np
import pytest
from numba import njit

from proximity.kernels import given
from proximity.simd import IS_COMPILED


def _count_and_sum(rows):
    count = given.row_count(rows)
    total = 0.0
    if count > 0:
        for row in given.rows_of(rows):
            total += row[0] + 2.0 * row[1] + 4.0 * row[2]
    return count, total


def look(thing):
    """How many rows compiled code sees, and a sum over them."""
    if not IS_COMPILED:
        return _count_and_sum(thing)
    if not hasattr(look, "compiled"):
        look.compiled = njit(_nrt=False, nogil=True)(_count_and_sum).compile((given.GIVEN_ROWS,))
    return look.compiled(thing)


ROWS = np.arange(15.0).reshape(5, 3)
WEIGHTS = np.array([1.0, 2.0, 4.0])


class OfOurs(np.ndarray):
    pass


def unaligned():
    room = np.zeros(ROWS.nbytes + 1, np.uint8)
    moved = room[1:].view(np.float64).reshape(ROWS.shape)
    moved[:] = ROWS
    return moved


def read_only():
    rows = ROWS.copy()
    rows.flags.writeable = False
    return rows


RECOGNISED = {
    "rows": ROWS,
    "some of them": ROWS[1:4],
    "one": ROWS[2:3],
    "every fifth, which is one": ROWS[::5],
    "none": ROWS[:0],
    "none of any strides": np.empty((0, 6))[:, ::2],
    "read-only": read_only(),
    "unpickled": pickle.loads(pickle.dumps(ROWS)),
    "with a dtype of its own": ROWS.view(pickle.loads(pickle.dumps(np.dtype(np.float64)))),
    "broadcast over one row": np.broadcast_to(ROWS[0], (1, 3)),
}

LEFT = {
    "None": None,
    "number": 5,
    "small number": -1,
    "float": 1.5,
    "text": "1 2 3",
    "list": ROWS.tolist(),
    "tuple": (),
    "type": np.ndarray,
    "object": object(),
    "function": look,
    "scalar": np.float64(1.0),
    "no axis": np.array(1.0),
    "one axis": ROWS[0],
    "three axes": ROWS[None],
    "many axes": ROWS.reshape((1,) * 20 + (5, 3)),
    "four columns": np.zeros((5, 4)),
    "no columns": np.zeros((5, 0)),
    "none of four columns": np.zeros((0, 4)),
    "float32": ROWS.astype(np.float32),
    "longdouble": ROWS.astype(np.longdouble),
    "big-endian": ROWS.astype(">f8"),
    "int64": ROWS.astype(np.int64),
    "datetime64": ROWS.astype(np.int64).view("M8[ns]"),
    "complex": ROWS.astype(complex),
    "objects": ROWS.astype(object),
    "record": np.zeros((5, 3), [("x", np.float64)]),
    "by column": np.asfortranarray(ROWS),
    "backward": ROWS[::-1],
    "every second": ROWS[::2],
    "mirrored": ROWS[:, ::-1],
    "of wider rows": np.zeros((5, 4))[:, :3],
    "broadcast": np.broadcast_to(ROWS[0], (5, 3)),
    "unaligned": unaligned(),
    "masked": np.ma.masked_array(ROWS),
    "subclass": ROWS.view(OfOurs),
}


@pytest.mark.parametrize("rows", RECOGNISED.values(), ids=RECOGNISED)
def test_rows_are_recognised(rows):
    assert look(rows) == (len(rows), np.sum(rows @ WEIGHTS))


@pytest.mark.parametrize("thing", LEFT.values(), ids=LEFT)
def test_whatever_else_is_left_alone(thing):
    assert look(thing) == (-1, 0.0)


def test_no_references_are_kept():
    rows, other = ROWS.copy(), object()
    before = sys.getrefcount(rows), sys.getrefcount(rows.dtype), sys.getrefcount(other)

    for _ in range(1000):
        look(rows)
        look(other)

    assert (sys.getrefcount(rows), sys.getrefcount(rows.dtype), sys.getrefcount(other)) == before


def test_this_numpy_keeps_what_it_says_of_an_array_where_it_is_read():
    def read(kind, address):
        return kind.from_address(address).value

    rows = ROWS[1:]
    at = id(rows)
    lengths, strides = (read(c_int64, at + place) for place in (given._LENGTHS_AT, given._STRIDES_AT))
    assert read(c_int64, at + given._TYPE_AT) == id(np.ndarray)
    assert read(c_int64, at + given._DATA_AT) == rows.ctypes.data
    assert read(c_int32, at + given._AXES_AT) == 2
    assert [read(c_int64, lengths + 8 * k) for k in range(2)] == [4, 3]
    assert [read(c_int64, strides + 8 * k) for k in range(2)] == [24, 8]
    assert read(c_int64, at + given._DTYPE_AT) == id(rows.dtype)
    assert read(c_int8, id(rows.dtype) + given._ORDER_AT) == ord(rows.dtype.byteorder)
    assert read(c_int32, id(rows.dtype) + given._NUMBER_AT) == rows.dtype.num
