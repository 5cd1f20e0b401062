"""The process that reads a file with trimesh: runs trimesh, imports nothing of this package.

Started by its path, with the kind of the file; takes the file on standard input, and writes arrays.
"""

import io
import sys


def main() -> None:
    """Read one file."""
    import numpy as np
    import trimesh

    mesh = trimesh.load_mesh(io.BytesIO(sys.stdin.buffer.read()), file_type=sys.argv[1], process=False)
    np.savez(sys.stdout.buffer, vertices=mesh.vertices, faces=mesh.faces)


if __name__ == "__main__":
    main()
