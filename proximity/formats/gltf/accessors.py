"""Accessors of a glTF document: arrays of positions and indices, checked against the available bytes."""

from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats.gltf.buffers import Document, integer, numbers, shown

INDEX_TYPES = (5121, 5123, 5125)
"""Unsigned whole numbers of 1, 2 and 4 bytes."""
POSITION_TYPES = (5126, 5120, 5121, 5122, 5123)
"""Numbers of single precision, and the whole numbers of KHR_mesh_quantization."""

_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COMPONENTS = {"SCALAR": 1, "VEC3": 3, "MAT4": 16}
_BOUNDS_ROUNDING = 1e-5  # of the largest coordinate: single precision, or six digits of text


def read_positions(document: Document, index: int, place: str) -> np.ndarray:
    """Return positions as stored in the file, (V, 3), not copied unless they are sparse."""
    return _read(document, index, place, "VEC3", POSITION_TYPES)


def read_indices(document: Document, index: int, place: str) -> np.ndarray:
    """Return integers as stored in the file, (count,), not copied unless they are sparse."""
    return _read(document, index, place, "SCALAR", INDEX_TYPES)[:, 0]


def read_matrices(document: Document, index: int, place: str) -> np.ndarray:
    """Return matrices, (count, 4, 4) float64."""
    stored = _read(document, index, place, "MAT4", (5126,))
    return stored.astype(np.float64).reshape(-1, 4, 4).swapaxes(1, 2)  # column after column


def as_lengths(document: Document, index: int, stored: np.ndarray) -> np.ndarray:
    """Return the positions encoded by the stored values of an accessor, a copy in float64."""
    points = stored.astype(np.float64)
    if stored.dtype.kind != "f" and document.entry("accessors", index).get("normalized"):
        points = np.maximum(points / np.iinfo(stored.dtype).max, -1.0)
    return points


def _read(
    document: Document, index: int, place: str, kind: str, component_types: tuple[int, ...]
) -> np.ndarray:
    """Return the entries of an accessor, (count, components); each accessor is checked once."""
    accessor = document.entry("accessors", index)
    name = f"accessor {index} ({place})"
    if accessor.get("type") != kind or accessor.get("componentType") not in component_types:
        raise MeshFormatError(
            f"{name} has type {shown(accessor.get('type'))} of {shown(accessor.get('componentType'))}, "
            f"expected {kind!r} of {' or '.join(map(str, component_types))}"
        )
    if index not in document.arrays:
        document.arrays[index] = _stored(document, accessor, kind, name)
        if kind == "VEC3" and len(document.arrays[index]):
            _check_bounds(document, accessor, document.arrays[index], name)
    return document.arrays[index]


def _stored(document: Document, accessor: dict[str, Any], kind: str, name: str) -> np.ndarray:
    dtype, width = np.dtype(_DTYPES[int(accessor["componentType"])]), _COMPONENTS[kind]
    count = integer(accessor.get("count"), f"the count of {name}")
    sparse = accessor.get("sparse")
    if accessor.get("bufferView") is not None:
        array = _strided(document, accessor, count, width, dtype, name)
    else:  # zeros: the file contains only their count
        held = sum(map(len, document.buffers))
        if count > held:
            raise MeshFormatError(
                f"{name} has {count} entries, but no buffer view, and the file {held} bytes"
            )
        array = np.broadcast_to(np.zeros(width, dtype), (count, width))
    return array if sparse is None else _with_sparse(document, sparse, array, name)


def _strided(
    document: Document, holder: dict[str, Any], count: int, width: int, dtype: np.dtype, name: str
) -> np.ndarray:
    """Return rows at a buffer view and an offset, either of which may be unaligned."""
    view_index = integer(holder.get("bufferView"), f"the buffer view of {name}")
    view = document.view(view_index)
    entry_bytes = width * dtype.itemsize
    given = document.entry("bufferViews", view_index).get("byteStride", entry_bytes)
    stride = integer(given, f"the stride of buffer view {view_index}")
    start = integer(holder.get("byteOffset", 0), f"the offset of {name}")
    if stride < entry_bytes or (count and start + (count - 1) * stride + entry_bytes > len(view)):
        raise MeshFormatError(f"{name} has {count} entries, which do not fit into buffer view {view_index}")
    if not count:
        return np.empty((0, width), dtype)
    return np.ndarray((count, width), dtype, view, start, (stride, dtype.itemsize))


def _with_sparse(document: Document, sparse: Any, base: np.ndarray, name: str) -> np.ndarray:
    """Return a copy of *base* with the rows replaced that a sparse accessor lists."""
    name = f"the sparse part of {name}"
    if not isinstance(sparse, dict) or not all(
        isinstance(sparse.get(k), dict) for k in ("indices", "values")
    ):
        raise MeshFormatError(f"{name} has no indices or no values")
    count = integer(sparse.get("count"), f"the count of {name}")
    component_type = sparse["indices"].get("componentType")
    if component_type not in INDEX_TYPES:
        raise MeshFormatError(
            f"{name} has indices of {shown(component_type)}, expected {' or '.join(map(str, INDEX_TYPES))}"
        )
    rows = _strided(document, sparse["indices"], count, 1, np.dtype(_DTYPES[component_type]), name)[:, 0]
    values = _strided(document, sparse["values"], count, base.shape[1], base.dtype, name)
    if count and int(rows.max()) >= len(base):
        raise MeshFormatError(f"{name} replaces entry {rows.max()}, but there are {len(base)}")
    array = base.copy()
    array[rows] = values
    return array


def _check_bounds(document: Document, accessor: dict[str, Any], stored: np.ndarray, name: str) -> None:
    """Record bounds that contradict the positions. Many writers omit them."""
    measured = {
        "min": np.fmin.reduce(stored).astype(np.float64).tolist(),
        "max": np.fmax.reduce(stored).astype(np.float64).tolist(),
    }
    rounding = _BOUNDS_ROUNDING * max(map(abs, measured["min"] + measured["max"]))
    for key, found in measured.items():
        if accessor.get(key) is None:
            continue
        try:
            given = numbers(accessor[key], 3, key)
        except MeshFormatError:
            document.wrong_bounds.append(f"{name} has a {key} that is not 3 finite numbers")
            continue
        if any(abs(a - b) > rounding for a, b in zip(given, found, strict=True)):
            texts = [", ".join(f"{value:g}" for value in values) for values in (given, found)]
            document.wrong_bounds.append(
                f"{name} says that its {key} is ({texts[0]}), but it is ({texts[1]})"
            )
