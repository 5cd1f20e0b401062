"""Contact logs: the answers of a tracker, tick by tick, as a file that is written whole or not at all."""

import csv
import os
from collections.abc import Callable, Sequence
from io import TextIOWrapper
from pathlib import Path
from typing import BinaryIO

import numpy as np

from proximity.errors import RecordingError
from proximity.recording.frame_tables import scalar_columns
from proximity.recording.recording import NANOSECONDS
from proximity.system.whole_file import whole_file

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

    *path*: the file; replaced where there is one already, at once and wholly. *contacts*: (T, N) CONTACT.
    *fingers*: whom the columns belong to; then ``finger`` in a CSV is the one named here, not the column.
    """
    check_log_name(path)
    target = Path(path)
    labels = None if fingers is None else np.array(fingers, dtype=np.int64).reshape(-1, 2)
    with whole_file(target) as stream:
        SUFFIXES[target.suffix.lower()](stream, contacts, times_ns, labels)


def check_log_name(path: str | os.PathLike[str]) -> None:
    """Refuse a name that no log can be written to, before there is anything to write."""
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
    titles = [title for title in scalar_columns(contacts[:0].reshape(-1)) if title != "finger"]
    writer.writerow(["time_s", *([] if labels is None else ["hand"]), "finger", *titles])
    for first in range(0, len(contacts), CSV_CHUNK):
        part = contacts[first : first + CSV_CHUNK]
        found = scalar_columns(part.reshape(-1))
        seconds = np.repeat(times_ns[first : first + CSV_CHUNK] / NANOSECONDS, part.shape[1])
        columns = [seconds.tolist()]
        if labels is None:
            columns.append(found["finger"].tolist())
        else:
            columns += [np.tile(labels[:, side], len(part)).tolist() for side in range(2)]
        columns += [found[title].tolist() for title in titles]
        writer.writerows(zip(*columns, strict=True))
    text.flush()
    text.detach()


SUFFIXES: dict[str, Callable[[BinaryIO, np.ndarray, np.ndarray, np.ndarray | None], None]] = {
    ".npz": _write_npz,
    ".npy": _write_npy,
    ".csv": _write_csv,
}
