"""The process that unpacks Draco streams, since damaged ones can crash the decoder.

Started by its path; imports nothing of this package. Takes the identifiers of positions and then as many
streams, as arrays of bytes; writes faces and positions of each. All of them by `np.save`.
"""

import io
import sys

import DracoPy
import numpy as np

_LEAST_MEMORY, _MEMORY_PER_BYTE = 2 << 30, 400
"""Limit of the process, on Linux: packed meshes seldom grow twentyfold."""


def main() -> None:
    """Unpack all streams of standard input."""
    data = sys.stdin.buffer.read()
    if sys.platform == "linux":
        _limit_memory(_LEAST_MEMORY + _MEMORY_PER_BYTE * len(data))
    source = io.BytesIO(data)
    for position_id in np.load(source):
        mesh = DracoPy.decode(np.load(source).tobytes())
        (points,) = [a["data"] for a in mesh.attributes if a["unique_id"] == position_id]
        for array in (mesh.faces, points):
            np.save(sys.stdout.buffer, np.ascontiguousarray(array))


def _limit_memory(size: int) -> None:
    import resource

    hard = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (size if hard < 0 else min(size, hard), hard))


if __name__ == "__main__":
    main()
