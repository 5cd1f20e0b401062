"""Read the rows of a PLY file, text or binary, as columns.

A scalar property gives an array with one value for each row. A list property gives pieces, one for each
length of its lists, in the form that `polygons.assemble` takes.
"""

from collections.abc import Callable

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.formats.ply.ply_header import Element
from proximity.formats.polygons import Piece

Columns = dict[str, np.ndarray | list[Piece]]


def read_binary(data: bytes, start: int, element: Element) -> tuple[Columns, int]:
    """Read the rows of an element from byte *start* of the file. Return them and the end of their bytes."""
    if not element.properties or not element.count:
        return {}, start
    row_dtype = _row_dtype(data, start, element)
    end = start + element.count * row_dtype.itemsize
    has_lists = any(column.count_dtype is not None for column in element.properties)
    if end > len(data):
        if has_lists:
            return _walk(data, start, element)
        raise _cut_off(element, (len(data) - start) // row_dtype.itemsize)
    rows = np.frombuffer(data, dtype=row_dtype, count=element.count, offset=start)
    columns: Columns = {}
    for k, column in enumerate(element.properties):
        values = rows[f"value{k}"]
        if column.count_dtype is not None:
            counts = rows[f"count{k}"].astype(np.int64)
            if (counts != values.shape[1]).any():
                return _walk(data, start, element)  # the lists have several lengths
            columns[column.name] = [(np.arange(element.count), counts, values)]
        else:
            columns[column.name] = values
    return columns, end


def _row_dtype(data: bytes, start: int, element: Element) -> np.dtype:
    """Return the layout of a row whose lists are as long as those in the first row."""
    fields: list[tuple] = []
    at = start
    for k, column in enumerate(element.properties):
        if column.count_dtype is None:
            fields.append((f"value{k}", column.dtype))
            at += column.dtype.itemsize
            continue
        count = _count_at(data, at, column.count_dtype, element, 0)
        fields += [(f"count{k}", column.count_dtype), (f"value{k}", column.dtype, (count,))]
        at += column.count_dtype.itemsize + count * column.dtype.itemsize
    return np.dtype(fields)


def _count_at(data: bytes, at: int, dtype: np.dtype, element: Element, row: int) -> int:
    raw = data[at : at + dtype.itemsize]
    if len(raw) < dtype.itemsize:
        raise _cut_off(element, row)
    count = int.from_bytes(raw, "big" if dtype.str[0] == ">" else "little", signed=dtype.kind == "i")
    if count < 0:
        raise MeshFormatError(f"row {row} of element {element.name} has a list of {count} entries")
    if count > len(data):
        raise _cut_off(element, row)
    return count


def _walk(data: bytes, start: int, element: Element) -> tuple[Columns, int]:
    """Read row by row, because lists differ in length."""
    lists = [(k, column) for k, column in enumerate(element.properties) if column.count_dtype is not None]
    starts: dict[int, list[int]] = {k: [] for k, _ in lists}
    counts: dict[int, list[int]] = {k: [] for k, _ in lists}
    at = start
    for row in range(element.count):
        for k, column in enumerate(element.properties):
            if column.count_dtype is None:
                at += column.dtype.itemsize
                continue
            count = _count_at(data, at, column.count_dtype, element, row)
            at += column.count_dtype.itemsize
            starts[k].append(at)
            counts[k].append(count)
            at += count * column.dtype.itemsize
        if at > len(data):
            raise _cut_off(element, row)
    raw = np.frombuffer(data, dtype=np.uint8)
    columns: Columns = {
        column.name: _gather_lists(raw, np.array(starts[k]), np.array(counts[k]), column.dtype)
        for k, column in lists
    }
    return columns, at


def _gather_lists(raw: np.ndarray, starts: np.ndarray, counts: np.ndarray, dtype: np.dtype) -> list[Piece]:
    pieces = []
    for count in np.unique(counts):
        row_ids = np.flatnonzero(counts == count)
        entry_bytes = starts[row_ids, None] + np.arange(count * dtype.itemsize)
        table = raw[entry_bytes].view(dtype) if count else np.empty((len(row_ids), 0), dtype)
        pieces.append((row_ids, counts[row_ids], table))
    return pieces


def _cut_off(element: Element, row: int) -> MeshFormatError:
    return MeshFormatError(
        f"it ends within row {row} of the {element.count} of element {element.name}: it is cut off"
    )


def read_ascii(rows: list[str], line_ids: list[int], element: Element, notes: list[str]) -> Columns:
    """Read the rows of an element from one line each.

    All lines may end with equally many numbers that are not declared.
    """

    def locate(row: int) -> str:
        return f"line {line_ids[row]} ({element.name} {row})"

    scalars: dict[str, np.ndarray] = {}
    lists: dict[str, list[Piece]] = {}
    surplus = np.zeros(element.count, dtype=np.int64)  # number of undeclared numbers in each row
    for row_ids, table in text_rows.read_rows(rows, locate):
        at = np.zeros(len(table), dtype=np.int64)  # next column of each row
        last = table.shape[1] - 1
        every = np.arange(len(table))
        for column in element.properties:
            values = table[every, np.minimum(at, last)]
            at = at + 1
            if column.count_dtype is None:
                scalars.setdefault(column.name, np.empty(element.count))[row_ids] = values
                continue
            counts = _list_counts(values, table.shape[1], text_rows.located_in(locate, row_ids))
            entries = np.minimum(at[:, None] + np.arange(last + 1), last)
            # the reader of the pieces ignores the rest of a row
            lists.setdefault(column.name, []).append((row_ids, counts, table[every[:, None], entries]))
            at = at + counts
        surplus[row_ids] = table.shape[1] - at
    wrong = np.flatnonzero(surplus)
    if len(wrong):
        # In only one or some rows, they are probably entries of a list whose length is wrong.
        if surplus[0] < 0 or element.count == 1 or (surplus != surplus[0]).any():
            row = int(wrong[0])
            width = len(rows[row].split())
            raise MeshFormatError(
                f"{locate(row)} has {width} numbers, but its header declares {width - surplus[row]}"
            )
        notes.append(f"the last {surplus[0]} numbers of each row of element {element.name} were ignored")
    return {**scalars, **lists}


def _list_counts(values: np.ndarray, width: int, locate: Callable[[int], str]) -> np.ndarray:
    is_count = (values >= 0) & (values <= width) & (values == np.rint(values))
    if not is_count.all():
        row = int(np.flatnonzero(~is_count)[0])
        raise MeshFormatError(f"{locate(row)} announces a list of {values[row]:g}, but has {width} numbers")
    return values.astype(np.int64)
