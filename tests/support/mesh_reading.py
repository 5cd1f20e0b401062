"""Write a mesh file, read it, and compare the result."""

import numpy as np
import pytest

from proximity import formats
from proximity.errors import MeshFormatError
from proximity.formats.contents import DialectError


def write(folder, name, data):
    """Write a file, bytes or text; return its path."""
    path = folder / name
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def read(folder, name, data, **options):
    return formats.read_geometries(write(folder, name, data), **options)


def refusal(path, **options):
    """Error message for a refused file, without its path."""
    with pytest.raises(MeshFormatError) as caught:
        formats.read_geometries(path, **options)
    assert not isinstance(caught.value, DialectError)
    return str(caught.value).removeprefix(f"{path}: ")


def volume(geometry):
    a, b, c = geometry.vertices[geometry.faces].transpose(1, 0, 2)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


def world(geometry):
    """Vertices in the file's common frame."""
    return geometry.pose.point(geometry.vertices)


def corners(geometry):
    """Corners of all faces in the file's common frame, in file order."""
    return world(geometry)[geometry.faces]
