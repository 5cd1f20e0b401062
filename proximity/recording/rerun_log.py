"""A frame log for Rerun, a viewer of recordings: parts, fingertips, nearest points, distances."""

import os
from collections.abc import Iterable
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np

from proximity.errors import RecordingError
from proximity.message import ContactFlag
from proximity.system.extras import needed

TIME = "time"
"""Of ticks, s from the first frame of their session."""
FINGERTIP, CONNECTION = (225, 170, 60), (120, 180, 230)


class ShownPart(NamedTuple):
    """A part as it stands at the beginning."""

    name: str
    vertices: np.ndarray  # (V, 3) m, in the scene's frame
    faces: np.ndarray  # (F, 3) int


def write_rerun(
    path: str | os.PathLike[str],
    frames: Iterable[np.ndarray],
    parts: Iterable[ShownPart] = (),
    radius: float = 0.007,
) -> int:
    """Write frames as a recording for Rerun; return how many frames.

    *frames*: (B,) structured.
    """
    with needed("a recording for Rerun needs", "rerun"):
        rerun = import_module("rerun")
    recording = rerun.RecordingStream("proximity")
    try:
        recording.save(os.fspath(path))
    except (OSError, RuntimeError) as failure:
        raise RecordingError(f"{os.fspath(path)}: cannot be written ({failure})") from failure
    recording.log("parts", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for part in parts:
        mesh = rerun.Mesh3D(vertex_positions=part.vertices, triangle_indices=part.faces)
        recording.log(f"parts/{part.name}", mesh, static=True)
    written = 0
    for run in frames:
        for finger in range(run["contacts"].shape[1]):
            _log_finger(rerun, recording, run["header"], run["contacts"][:, finger], radius)
        written += len(run)
    recording.flush()
    recording.disconnect()
    return written


def _log_finger(rerun: Any, recording: Any, header: np.ndarray, contacts: np.ndarray, radius: float) -> None:
    """Log a finger of many frames; of those where it is not tracked nothing is said."""
    is_tracked = (contacts["flags"] & ContactFlag.TRACKED) != 0
    contacts, start_ns = contacts[is_tracked], header["start_ns"][is_tracked]
    if not len(contacts):
        return
    times = (start_ns - header["start_ns"][0]) / 1e9
    entity = f"fingers/{int(contacts['finger'][0])}"

    def send(name: str, columns: Any, where: Any = ...) -> None:
        indexes = [rerun.TimeColumn(TIME, duration=times[where])]
        rerun.send_columns(f"{entity}/{name}", indexes=indexes, columns=columns, recording=recording)

    count = len(contacts)
    send(
        "tip",
        rerun.Points3D.columns(
            positions=contacts["position"],
            radii=np.full(count, radius),
            colors=np.tile(FINGERTIP, (count, 1)),
        ),
    )
    near = np.isfinite(contacts["point_on_part"]).all(axis=1)
    origins = contacts["point_on_finger"][near]
    arrows = rerun.Arrows3D.columns(
        origins=origins,
        vectors=contacts["point_on_part"][near] - origins,
        colors=np.tile(CONNECTION, (len(origins), 1)),
    )
    send("nearest", arrows, near)
    for field in ("signed_distance", "lower", "upper"):
        known = np.isfinite(contacts[field])
        send(f"{field}_mm", rerun.Scalars.columns(scalars=1e3 * contacts[field][known]), known)
