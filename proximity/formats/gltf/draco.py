"""Geometry that KHR_draco_mesh_compression has packed, unpacked by DracoPy in a process of its own."""

import io
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from proximity.errors import MeshFormatError
from proximity.system.extras import needed

EXTENSION = "KHR_draco_mesh_compression"
_WORKER = Path(__file__).with_name("draco_worker.py")


def check_installed() -> None:
    """Raise if DracoPy is not there, with what to install."""
    with needed(f"geometry stored by {EXTENSION} needs", "gltf"):
        import DracoPy  # noqa: F401


def unpack(streams: Sequence[tuple[memoryview, int]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return faces, (F, 3), and stored positions, (V, 3), of streams, given the identifiers of positions."""
    if not streams:
        return []
    check_installed()
    given = io.BytesIO()
    np.save(given, np.array([position_id for _, position_id in streams]))
    for stream, _ in streams:
        np.save(given, np.frombuffer(stream, dtype=np.uint8))
    done = subprocess.run(
        [sys.executable, "-P", _WORKER],
        input=given.getvalue(),
        capture_output=True,
        check=False,
        # Threads would use up the addresses that the process is limited to.
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "OPENBLAS_NUM_THREADS": "1"},
    )
    if done.returncode:
        printed = done.stderr.decode("utf-8", "replace").strip().splitlines()
        died = f"the decoder crashed, signal {-done.returncode}"
        reported = died if done.returncode < 0 or not printed else printed[-1][:160]
        raise MeshFormatError(f"its geometry stored by {EXTENSION} cannot be unpacked ({reported})")
    found = io.BytesIO(done.stdout)
    unpacked = [(np.load(found), np.load(found)) for _ in streams]
    if not all(array.shape[1:] == (3,) for arrays in unpacked for array in arrays):
        raise MeshFormatError(f"its positions stored by {EXTENSION} are not 3 numbers each")
    return unpacked
