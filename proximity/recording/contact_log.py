"""Contact logs: what a tracker answered, tick by tick, as a file.

A log is either wholly there or not at all: it is written under another name and then renamed.
"""

import csv
import os
from collections.abc import Callable, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import BinaryIO

import numpy as np

from proximity.errors import RecordingError
from proximity.recording.records import NANOSECONDS

CSV_CHUNK = 2000  # ticks turned into text at once


def write_contacts(
    path: str | os.PathLike[str],
    contacts: np.ndarray,
    times_ns: np.ndarray,
    fingers: Sequence[tuple[int, int]] | None = None,
) -> None:
    """Write what a tracker answered; the name's ending says how.

    ``.npz`` holds the arrays ``contacts``, ``times_ns`` and ``fingers`` as they are, ``.npy`` the contacts
    alone, ``.csv`` a line a finger and tick: ``time_s``, ``hand`` where *fingers* are given, then the fields
    of a contact, three columns (``_x``, ``_y``, ``_z``) for each vector, every number with all its digits.

    Parameters
    ----------
    path : path
        The file; replaced where there is one already, at once and wholly.
    contacts : (T, N) CONTACT
        What was answered.
    times_ns : (T,) int64
        The instants of the poses.
    fingers : sequence of (hand, finger), N of them
        Whom the columns belong to; then ``finger`` in a CSV is the one named here, not the column.

    Raises
    ------
    RecordingError
        If the ending is another or the file cannot be written.
    """
    check_log_name(path)
    target = Path(path)
    labels = None if fingers is None else np.array(fingers, dtype=np.int64).reshape(-1, 2)
    unfinished = target.with_name(f".{target.name}.{os.getpid()}.unfinished")
    try:
        try:
            with unfinished.open("wb") as stream:
                SUFFIXES[target.suffix.lower()](stream, contacts, times_ns, labels)
            os.replace(unfinished, target)
        finally:
            unfinished.unlink(missing_ok=True)
    except OSError as failure:
        raise RecordingError(f"{target}: cannot be written ({failure.strerror or failure})") from failure


def check_log_name(path: str | os.PathLike[str]) -> None:
    """Refuse a name that no log can be written to, before there is anything to write.

    Parameters
    ----------
    path : path
        Of the log to be.

    Raises
    ------
    RecordingError
        If the ending says no format, or the folder is not there.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise RecordingError(f"{target}: expected a name that ends in {', '.join(SUFFIXES)}")
    if not target.parent.is_dir():
        raise RecordingError(f"{target}: cannot be written (there is no folder {target.parent})")


def _write_npz(
    stream: BinaryIO, contacts: np.ndarray, times_ns: np.ndarray, labels: np.ndarray | None
) -> None:
    if labels is None:
        np.savez(stream, contacts=contacts, times_ns=times_ns)
    else:
        np.savez(stream, contacts=contacts, times_ns=times_ns, fingers=labels)


def _write_npy(
    stream: BinaryIO, contacts: np.ndarray, times_ns: np.ndarray, labels: np.ndarray | None
) -> None:
    np.save(stream, contacts)


def _write_csv(
    stream: BinaryIO, contacts: np.ndarray, times_ns: np.ndarray, labels: np.ndarray | None
) -> None:
    text = TextIOWrapper(stream, encoding="utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")
    rest = [name for name in contacts.dtype.names or () if name != "finger"]
    is_vector = {name: contacts.dtype[name].shape == (3,) for name in rest}
    titles = [title for name in rest for title in _titles(name, is_vector[name])]
    writer.writerow(["time_s", *([] if labels is None else ["hand"]), "finger", *titles])
    for first in range(0, len(contacts), CSV_CHUNK):
        part = contacts[first : first + CSV_CHUNK]
        seconds = np.repeat(times_ns[first : first + CSV_CHUNK] / NANOSECONDS, part.shape[1])
        columns = [seconds.tolist()]
        if labels is None:
            columns.append(part["finger"].reshape(-1).tolist())
        else:
            columns += [np.tile(labels[:, side], len(part)).tolist() for side in range(2)]
        for name in rest:
            if is_vector[name]:
                columns += part[name].reshape(-1, 3).T.tolist()
            else:
                columns.append(part[name].reshape(-1).tolist())
        writer.writerows(zip(*columns, strict=True))
    text.flush()
    text.detach()


def _titles(name: str, is_vector: bool) -> list[str]:
    return [f"{name}_{axis}" for axis in "xyz"] if is_vector else [name]


SUFFIXES: dict[str, Callable[[BinaryIO, np.ndarray, np.ndarray, np.ndarray | None], None]] = {
    ".npz": _write_npz,
    ".npy": _write_npy,
    ".csv": _write_csv,
}
