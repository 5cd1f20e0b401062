"""Calls into trimesh: nothing it says reaches the user, whatever it raises becomes one sentence."""

import io
import logging
import warnings
from collections.abc import Mapping
from typing import Any

from proximity.errors import MeshFormatError

# Without a handler of its own, warnings of the logger would go to standard error.
logging.getLogger("trimesh").addHandler(logging.NullHandler())


def load_scene(data: bytes, file_type: str, resolver: Mapping[str, bytes] | None = None) -> Any:
    """Return a trimesh scene, its meshes exactly as they stand in the file.

    Parameters
    ----------
    data : bytes
        The file.
    file_type : str
        As trimesh calls it.
    resolver : mapping, optional
        Files that it may refer to, by name; it gets no others.

    Raises
    ------
    MeshFormatError
        Whatever went wrong, in one line.

    Notes
    -----
    Thread: hides warnings of the whole process while it runs.
    """
    import trimesh

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return trimesh.load_scene(io.BytesIO(data), file_type=file_type, resolver=resolver, process=False)
        except Exception as reason:  # its readers raise whatever the data make them raise
            raise MeshFormatError(f"trimesh could not read it ({in_one_line(reason)})") from reason


def in_one_line(reason: Exception) -> str:
    """Return type and message of an exception, shortened.

    Parameters
    ----------
    reason : Exception
        What a library raised.
    """
    message = " ".join(str(reason).split())
    return f"{type(reason).__name__}: {message[:120]}" if message else type(reason).__name__
