"""Convert frames to tables for other programs, streamed as CSV or Parquet.

The table has a row for each finger and frame. A row has the fields of the frame's header (session, number,
state, instants), then those of the contact with their units. A vector has three columns, and every number has
all its digits. CSV has names for sets and enumerations, Parquet has numbers.
"""

import csv
from collections.abc import Iterable
from enum import IntEnum, IntFlag
from importlib import import_module
from typing import Any, BinaryIO, TextIO

import numpy as np

from proximity.message import FRAME, ContactFlag, State
from proximity.message.contact import CONTACT_FIELDS, Mode, Surface
from proximity.message.frame import Source
from proximity.recording.frame_bytes import frame_type
from proximity.system.extras import needed

ROW_GROUP = 1 << 17
"""Number of rows of a Parquet file that are buffered before writing, some 50 MB."""

HEADER_COLUMNS = {
    "session": "session",
    "sequence": "sequence",
    "state": "state",  # name of the state
    "frame_pose_ns": "pose_ns",  # another name, because contacts have a pose_ns, too
    "start_ns": "start_ns",
    "publish_ns": "publish_ns",
    "valid_until_ns": "valid_until_ns",
    "period_ns": "period_ns",
    "epoch": "epoch",
    "missed": "missed",
}
"""Columns that are equal for all fingers of a frame, and the corresponding fields of its header."""

_STATES = {state.value: state.name.lower() for state in State}
STATE_NAMES = np.array([_STATES.get(number, str(number)) for number in range(256)])
"""Names of the states, by their numbers."""
WORDS: dict[str, type[IntEnum] | type[IntFlag]] = {
    "flags": ContactFlag,
    "surface": Surface,
    "mode": Mode,
    "source": Source,
}
"""Columns of enumerations, for which CSV has names instead of numbers."""
_NO_FRAMES = np.zeros(0, frame_type(FRAME.size(0)))


def scalar_columns(records: np.ndarray) -> dict[str, np.ndarray]:
    """Return one column for each number of the records, in their order.

    The columns of a vector end in _x, _y and _z. *records*: (N,) structured.
    """
    columns: dict[str, np.ndarray] = {}
    for name in records.dtype.names or ():
        if records.dtype[name].shape == (3,):
            columns |= {f"{name}_{axis}": records[name][:, column] for column, axis in enumerate("xyz")}
        else:
            columns[name] = records[name]
    return columns


def frame_columns(frames: np.ndarray) -> dict[str, np.ndarray]:
    """Return frames as columns with a row for each finger and frame.

    *frames*: (B,) structured.
    """
    header, contacts = frames["header"], frames["contacts"]
    shown = {title: header[field] for title, field in HEADER_COLUMNS.items()}
    shown["state"] = STATE_NAMES[header["state"]]
    repeated = {title: np.repeat(column, contacts.shape[1]) for title, column in shown.items()}
    numbers = scalar_columns(contacts.reshape(-1))
    return repeated | {with_unit(name): column for name, column in numbers.items()}


def with_unit(column: str) -> str:
    """Return the name of a column of contacts with its unit, such as ``velocity_x_m_per_s``."""
    unit = _UNITS.get(column, _UNITS.get(column[:-2], ""))  # a coordinate ends in _x, _y or _z
    suffix = "_" + unit.replace("1/", "per_").replace("/", "_per_").replace(" ", "_")
    return column if not unit or column.endswith(suffix) else column + suffix


_UNITS = {field.name: field.unit for field in CONTACT_FIELDS}


def _in_words(name: str, column: np.ndarray) -> np.ndarray:
    """Return a column for CSV, in which names replace the numbers of enumerations.

    An unknown number is unchanged.
    """
    if name not in WORDS:
        return column
    numbers, rows = np.unique(column, return_inverse=True)
    return np.array([_name_of(WORDS[name], number) for number in numbers.tolist()])[rows]


def _name_of(kind: type[IntEnum | IntFlag], number: int) -> str:
    try:
        return (kind(number).name or "").lower()
    except ValueError:
        return str(number)


def write_frames_csv(stream: TextIO, runs: Iterable[np.ndarray]) -> int:
    """Write frames as CSV. Return the number of rows, excluding the header.

    *runs*: arrays of frames, (B,) structured.
    """
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(frame_columns(_NO_FRAMES))
    count = 0
    for frames in runs:
        columns = [_in_words(name, column) for name, column in frame_columns(frames).items()]
        writer.writerows(zip(*(column.tolist() for column in columns), strict=True))
        count += frames["contacts"].size
    return count


def write_frames_parquet(stream: BinaryIO, runs: Iterable[np.ndarray]) -> int:
    """Write frames as Parquet. Return the number of rows.

    *runs*: arrays of frames, (B,) structured.
    """
    arrow, parquet = load_pyarrow()
    schema = arrow.table(frame_columns(_NO_FRAMES)).schema
    count, waiting, waiting_count = 0, [], 0
    with parquet.ParquetWriter(stream, schema) as writer:
        for frames in runs:
            waiting.append(arrow.table(frame_columns(frames), schema=schema))
            waiting_count += frames["contacts"].size
            count += frames["contacts"].size
            if waiting_count >= ROW_GROUP:
                writer.write_table(arrow.concat_tables(waiting))
                waiting, waiting_count = [], 0
        if waiting:
            writer.write_table(arrow.concat_tables(waiting))
    return count


def load_pyarrow() -> tuple[Any, Any]:
    """Import pyarrow. Return the modules ``pyarrow`` and ``pyarrow.parquet``."""
    with needed("Parquet needs", "parquet"):
        return import_module("pyarrow"), import_module("pyarrow.parquet")
