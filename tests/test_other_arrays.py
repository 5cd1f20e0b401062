"""Arrays of other libraries, by ``__array__`` and by DLPack."""

import numpy as np
import pytest
import shapes

import proximity
from proximity.checks import as_float64, as_points

ROWS = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
CPU, CUDA, METAL = 1, 2, 8


class Exported:
    """An array with nothing but the protocol of DLPack."""

    def __init__(self, array, device=CPU):
        self._array, self._device = array, device

    def __dlpack__(self, **options):
        return self._array.__dlpack__(**options)

    def __dlpack_device__(self):
        return self._device, 0


class Converted:
    """An array with ``__array__``."""

    def __init__(self, array):
        self._array = array

    def __array__(self, dtype=None, copy=None):
        return self._array


class Refusing:
    """A tensor that must be detached from a graph first."""

    def __array__(self, dtype=None, copy=None):
        raise RuntimeError("Use tensor.detach()")


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
@pytest.mark.parametrize("kind", [Exported, Converted])
def test_arrays_of_other_libraries_are_points(kind, dtype):
    points = as_points(kind(ROWS.astype(dtype)))

    assert points.flags.carray
    assert np.array_equal(points, ROWS)


def test_scenes_take_them_for_meshes_and_points():
    vertices, faces = shapes.cube()
    scene = proximity.Scene.from_mesh(Exported(np.array(vertices)), Exported(np.array(faces)))
    expected = proximity.Scene.from_mesh(vertices, faces)

    hit = scene.closest(Exported(ROWS))

    assert np.array_equal(hit.point, expected.closest(ROWS).point)
    distances = scene.cast(Exported(ROWS), Exported(-ROWS)).distance
    assert np.array_equal(distances, expected.cast(ROWS, -ROWS).distance)


@pytest.mark.parametrize("device", [CUDA, METAL])
def test_memory_of_a_gpu_is_refused_with_what_to_do(device):
    with pytest.raises(proximity.ArgumentError, match=rf"type {device}.*copy"):
        as_float64(Exported(ROWS, device), "points")
    with pytest.raises(proximity.ArgumentError, match=r"faces.*GPU"):
        proximity.TriangleMesh(np.zeros((3, 3)), Exported(np.array([[0, 1, 2]]), device))


def test_reason_of_a_library_that_refuses_is_passed_on():
    with pytest.raises(proximity.ArgumentError, match=r"points.*detach"):
        as_points(Refusing())
