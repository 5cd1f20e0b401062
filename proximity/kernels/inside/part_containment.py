"""Whether one part is inside another: as a whole, or one of its surfaces.

Where no faces of two parts cross, each connected surface of one is inside the other as a whole, or not at
all: one point of each tells.
"""

from proximity.kernels.geometry.frames import to_local, to_scene
from proximity.kernels.inside.chunk_tables import new_workspace, reset_recent
from proximity.kernels.inside.containment import depth_in_part, state_in_part
from proximity.kernels.layout import CELL_INSIDE, CELL_OUTSIDE, NO_GRID, SIGN_NONE, ModelArrays
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import entry, inlined, kernel
from proximity.native.simd import load_int

CLEAR = 2.0**-41
"""A point farther from a surface is clear of it; in sizes of coordinates."""


@entry(ModelArrays, "int, int32[:], int32[:] -> int")
def surface_faces(model, part, waiting, faces):
    """Fill the first face of each surface that is connected across edges; how many they are.

    *waiting*, *faces*: (F,), as many as the part has faces; the latter also keeps which were seen.
    """
    row = model.parts[part]
    for face in range(row.face_count):
        faces[face] = 0
    count = 0
    for first in range(row.face_count):
        if faces[first]:
            continue
        left, faces[first], waiting[0] = 1, 1, first
        while left:
            left -= 1
            at = row.neighbors + 3 * waiting[left]
            for edge in range(3):
                face = load_int(model.words, at + edge)
                if face >= 0 and not faces[face]:
                    faces[face], waiting[left] = 1, face
                    left += 1
        # All faces up to here were seen, and their places stay marks.
        faces[count] = first + 1
        count += 1
    for k in range(count):
        faces[k] -= 1
    return count


@inlined
def _is_in_box(frame, point):
    """Whether a point of the scene's frame is in the box around a part."""
    return (
        frame.box_lower[0] <= point[0] <= frame.box_upper[0]
        and frame.box_lower[1] <= point[1] <= frame.box_upper[1]
        and frame.box_lower[2] <= point[2] <= frame.box_upper[2]
    )


@kernel
def is_deep(model, part, p, margin, workspace):
    """Whether *p*, in a part's local frame, is inside the part, by more than *margin*."""
    state = state_in_part(model, part, p)
    if state == CELL_OUTSIDE or (state == CELL_INSIDE and model.parts[part].grid != NO_GRID):
        return state == CELL_INSIDE
    depth_sq, slot = depth_in_part(model, part, p, state, workspace)
    return slot >= 0 and depth_sq > margin * margin


@kernel
def contained_corner(model, part, inner, faces, shift, point, workspace):
    """Whether a part contains another's surfaces, displaced by *shift*, if nothing of them crosses.

    *faces*: one of each surface of the other. One of its corners, or its middle, has to be clear of the
    part's surface. *point*: filled with the one that is inside, (3,) m, scene's frame.
    """
    reals, words, frames, parts = model
    if parts[part].sign == SIGN_NONE:
        return False
    local, middle, margin = stack_f64(3), stack_f64(3), 0.0
    for axis in range(3):
        margin = max(margin, abs(frames[inner].box_lower[axis]), abs(frames[inner].box_upper[axis]))
    margin = CLEAR * (1.0 + margin * frames[part].scale)
    for k in range(len(faces)):
        middle[0] = middle[1] = middle[2] = 0.0
        for number in range(4):
            corner = load_int(words, parts[inner].faces + 3 * faces[k] + number % 3)
            for axis in range(3):
                middle[axis] += reals[parts[inner].corners + 3 * corner + axis] / 3.0 if number < 3 else 0.0
                local[axis] = reals[parts[inner].corners + 3 * corner + axis] if number < 3 else middle[axis]
            to_scene(frames, parts, inner, local, 0, point, 0)
            for axis in range(3):
                point[axis] += shift[axis]
            p = to_local(frames, parts, part, point[0], point[1], point[2])
            if _is_in_box(frames[part], point) and is_deep(model, part, p, margin, workspace):
                return True
    return False


@entry(ModelArrays, "int, int, int32[:], float64[:] -> bool")
def contains_corner(model, part, inner, faces, point):
    """Whether a part contains a surface of another part; fills a point of it, (3,) m, scene's frame.

    Nothing of both may cross. *faces*: one of each surface of the other part.
    """
    workspace = new_workspace()
    reset_recent(workspace)
    return contained_corner(model, part, inner, faces, (0.0, 0.0, 0.0), point, workspace)
