"""New vertex positions for a part of a model. The tree of the part is refitted, not rebuilt.

The corners, leaf blocks, boxes, corner normals and moments change, and so does the part's own box. Its local
frame changes if the old one no longer fits. Faces, neighbours, slots and the topology of the tree stay. The
caller updates the tree over the parts.
"""

import numpy as np

from proximity.checks import as_float64
from proximity.errors import ArgumentError, MeshError
from proximity.kernels import layout
from proximity.kernels.entries import refit_part, survey_vertices
from proximity.kernels.layout import CELL_CROSSED, NO_ROW
from proximity.kernels.thresholds import SMALLEST_SHARE
from proximity.mesh.bvh import MAX_COORDINATE, SMALLEST_SIZE, LocalFrame, local_frame
from proximity.scene.model.assembly import Model
from proximity.scene.solid import Solid

FARTHEST = MAX_COORDINATE / 4.0
"""m. Limit of a coordinate, which leaves room for any rotation and for the farthest move of a part."""
INSIDE_OUT = 1e-12
"""Rounding error of the enclosed volume, relative to area times size in the local frame.

A volume below minus this error is negative.
"""
GRID_MARGIN = 1.0 + 2.0**-20


def deform_part(model: Model, row: int, solid: Solid, vertices: object, name: str) -> Solid:
    """Write new vertices into a part of *model*, and return the solid with the new shape.

    *solid* is the part before the change. It keeps its shape: it rebuilds its arrays on its next use.
    Afterwards, the part's box in the scene and the tree over the parts are out of date.

    *vertices*: (V, 3) m, part's frame.
    """
    assert model.reals.flags.writeable and model.words.flags.writeable, "what is deformed is not shared"
    count = solid.mesh.vertex_count
    shape = f"({count}, 3)"
    array = as_float64(vertices, f"vertices of part {name!r}", expected=f"numbers of shape {shape}")
    if array.shape != (count, 3):
        raise ArgumentError(
            f"vertices of part {name!r} have shape {array.shape}, expected {shape}, as its mesh"
        )
    kept, box = np.empty((count, 3)), np.empty(6)
    bad = survey_vertices(array, solid.first_vertices, FARTHEST, kept, box)
    if bad != NO_ROW:
        raise MeshError(_why_not(kept, solid.first_vertices, bad, name))
    lower, upper = box[:3], box[3:]
    extent = float((upper - lower).max())
    if 0.0 < extent < SMALLEST_SIZE:
        raise MeshError(f"part {name!r} would be {extent:.3g} m long, expected 0 or from {SMALLEST_SIZE:g} m")

    before, normals = model.frames[row].copy(), _normals_of(model, row)
    normals_before = normals.copy()
    arrays = solid._arrays
    is_own = arrays.row == row  # a solid that occurs in several parts has its arrays in one of them
    arrays.is_overwritten |= is_own  # before the first write
    _frame_for(before, lower, upper).write(model.frames[row])
    area, volume = refit_part(model.packed, row, kept, solid.first_vertices)
    is_closed = model.parts["grid"][row] != layout.NO_GRID
    if is_closed and volume < -INSIDE_OUT * area:
        model.frames[row] = before
        # Copied, as kernels are compiled for writeable arrays.
        refit_part(model.packed, row, solid.mesh.vertices.copy(), solid.first_vertices)
        normals[:] = normals_before  # bit for bit: refitting sums them in another order
        arrays.is_overwritten = arrays.is_overwritten and not is_own
        raise MeshError(
            f"part {name!r} would be turned inside out: its faces would enclose a negative volume"
        )
    model.frames["own_lower"][row] = lower
    model.frames["own_upper"][row] = upper
    if is_closed:
        _search_surface_only(model, row, lower, extent)
    return solid._deformed(kept, model, row)


def _normals_of(model: Model, row: int) -> np.ndarray:
    """Return a flat view of the part's corner normals."""
    at = model.parts["corner_normals"][row]
    return model.reals[at : at + 3 * model.parts["corner_count"][row]]


def _why_not(vertices: np.ndarray, first_vertices: np.ndarray, row: int, name: str) -> str:
    """Return a message that describes an invalid vertex."""
    position = _shown_position(vertices[row])
    if not np.isfinite(vertices[row]).all():
        return f"vertex {row} of part {name!r} would be at {position}, expected finite coordinates"
    if np.abs(vertices[row]).max() > FARTHEST:
        return (
            f"vertex {row} of part {name!r} would be at {position}, expected coordinates up to {FARTHEST:g} m"
        )
    first = first_vertices[row]
    return (
        f"vertices {first} and {row} of part {name!r} are one corner, but would be at "
        f"{_shown_position(vertices[first])} and {position}: that tears the surface, "
        "expected one position for both"
    )


def _shown_position(point: np.ndarray) -> str:
    return "(" + ", ".join(f"{value:.6g}" for value in point.tolist()) + ")"


def _frame_for(row: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> LocalFrame:
    """Return the part's local frame if the box fits well in it. Otherwise return a new frame."""
    frame = LocalFrame.read(row)
    centre = frame.centre
    low, high = frame.of(lower), frame.of(upper)
    is_held = bool(max(np.abs(low).max(), np.abs(high).max()) <= 1.0)
    # The difference is exact between half and twice the centre (Sterbenz).
    side, off = np.sign(centre), np.abs(centre)
    near, far = np.minimum(side * lower, side * upper), np.maximum(side * lower, side * upper)
    is_exact = bool((near >= 0.5 * off).all() and (far <= 2.0 * off).all())
    if is_held and is_exact and float((high - low).max()) >= SMALLEST_SHARE:
        return frame
    return local_frame(lower, upper)


def _search_surface_only(model: Model, row: int, lower: np.ndarray, extent: float) -> None:
    """Replace the sign grid by one crossed cell, so that inside the box the nearest face gives the sign."""
    part, frame = model.parts[row], model.frames[row]
    scale = frame["scale"]
    model.words[part["grid"] :][:1].view(np.int32)[0] = CELL_CROSSED
    part["grid_x"] = part["grid_y"] = part["grid_z"] = 1
    local = (lower - frame["centre"]) * scale
    frame["grid_lower"] = local
    frame["grid_rate"] = 1.0 / (extent * scale * GRID_MARGIN) if extent > 0.0 else 1.0
