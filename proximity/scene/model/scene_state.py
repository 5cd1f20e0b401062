"""Models of one scene while its parts move. Readers keep their model while the next one is written.

A `SceneState` has the present state. When a model is requested, a copy of the arrays that no living model
uses becomes the model: its rows, boxes and dynamic nodes are brought up to date first. When a part moves for
the first time or is hidden, the static tree is copied without this part. The static tree is rebuilt only when
a static part is shown, or when a part leaves the scene's frame.
"""

import weakref
from typing import Any

import numpy as np

from proximity.kernels.contact_record import SURFACE_DEFORMABLE, SURFACE_RIGID
from proximity.kernels.entries import (
    bring_up_to_date,
    copies_in_use,
    copy_offsets,
    first_unfit,
    make_static,
    move_parts,
    thin_static,
    update_box,
)
from proximity.kernels.layout import NEVER, REGION_COPIES, STATIC_COPIES, DynamicParts, ModelArrays
from proximity.kernels.thresholds import SMALLEST_REACH, SORT_STEPS
from proximity.mesh.bvh import MAX_COORDINATE
from proximity.native import packed
from proximity.pose import ORTHONORMAL_TOLERANCE, Pose
from proximity.scene.model.assembly import EXACT_ENOUGH, Model, finished

FARTHEST_MOVE = MAX_COORDINATE / 4.0
"""m. Sums of coordinates from farther moves could leave the range of computation."""
FASTEST_MOVE = 1e9
"""m/s, three times the speed of light, or rad/s. Displacements and squares of more could overflow."""
UPDATES_BEFORE_SHRINKING = 1000
"""Number of updates of a new frame of the scene before it may be made smaller.

A part that returned from far away leaves a frame that is too large. A smaller frame requires a new tree,
which a part that oscillates must not cause at every tick.
"""


def write_motion(frame: np.ndarray, velocity: np.ndarray, angular_velocity: np.ndarray) -> None:
    """Write the velocities of a part into its row of frames.

    *frame*: of `FRAME`; *velocity*, *angular_velocity*: (3,).
    """
    frame["velocity"], frame["angular_velocity"] = velocity, angular_velocity


def write_surface(frame: np.ndarray, stiffness: float | None, damping: float) -> None:
    """Write the stiffness and damping of a part, rigid or deformable, into its row of frames.

    *frame*: of `FRAME`.
    """
    frame["surface"] = SURFACE_RIGID if stiffness is None else SURFACE_DEFORMABLE
    frame["stiffness"], frame["damping"] = stiffness or 0.0, damping


# Pending work on the static tree.
_RIGHT = 0
_THINNER = 1
_NEW = 2


class _Copy:
    """A copy of the moving parts' state at some version.

    It has rows of a model's tables and a region of its words.
    """

    __slots__ = ("frames", "owner", "packed", "parts", "region", "static", "version")

    def __init__(self, model: Model, frames: np.ndarray, parts: np.ndarray, region: int) -> None:
        self.frames, self.parts, self.region = frames, parts, region
        self.packed = packed(ModelArrays(model.reals, model.words, frames, parts))
        self.version = NEVER
        self.static = 0
        self.owner: weakref.ref[Model] | None = None

    @property
    def is_free(self) -> bool:
        """Whether no living model uses this copy."""
        return self.owner is None or self.owner() is None


class SceneState:
    """The present poses of a scene's parts, and the models made of them.

    Not thread-safe: the scene has a lock. A model may be queried from any thread.
    """

    current: Model | None  # None after a change, until a model is requested
    latest: Model  # the current one, or the last before the change
    changes: int  # number of changes
    versions: np.ndarray  # (P + 1,) int64, the value of *changes* when the row changed last
    _sort_steps: int  # largest number before the order along the curve is recomputed
    _is_whole: bool  # False during a change, and afterwards if it was interrupted

    def __init__(self, model: Model) -> None:
        self.current = self.latest = model
        self.epoch = model.epoch
        self.frames, self.parts = model.frames.copy(), model.parts.copy()
        self.changes = 0
        count = len(self.parts) - 1
        self.versions = np.zeros(count + 1, np.int64)
        self._boxes, self._boxes_version = np.empty((count, 6), np.float32), NEVER
        self._list_dynamic()
        # A model from a file may be any copy; a new one is the first.
        number, self._static = copies_in_use(self.parts)
        self._copies = [self._new_copy(k) for k in range(number)]
        own = _Copy(model, model.frames, model.parts, self._region(number))
        own.owner, own.version, own.static = weakref.ref(model), 0, self._static
        self._copies.append(own)
        self._tree = _RIGHT
        self._updates = 0
        self._is_whole = True

    # --- changes -----------------------------------------------------------------------------------------

    def move(
        self, rows: np.ndarray, matrices: np.ndarray, velocities: np.ndarray, angular_velocities: np.ndarray
    ) -> None:
        """Move parts and set their velocities. A part whose pose does not change does not become dynamic.

        *matrices*: (K, 4, 4); *velocities*, *angular_velocities*: (K, 3).
        """
        self._begin()
        freed = move_parts(
            self.frames, self.parts, self.versions, self.changes, rows, matrices, velocities,
            angular_velocities, EXACT_ENOUGH,
        )  # fmt: skip
        if freed:
            self._need(_THINNER)
        self._is_whole = True

    def set_surface(self, row: int, stiffness: float | None, damping: float) -> None:
        """Set the stiffness and damping of a part. A stiffness of None makes it rigid."""
        self._begin(row)
        write_surface(self.frames[row], stiffness, damping)
        self._is_whole = True

    def set_hidden(self, row: int, is_hidden: bool) -> bool:
        """Hide or show a part. Return whether its visibility has changed."""
        if self.parts["is_hidden"][row] == is_hidden:
            return False
        self._begin(row)
        self.epoch += 1
        self.parts["is_hidden"][row] = is_hidden
        if not self.parts["is_dynamic"][row]:
            self._need(_THINNER if is_hidden else _NEW)
        self._is_whole = True
        return True

    def writable_model(self) -> Model:
        """Return a model that shares the arrays of the present state, for changing the shape of a part."""
        latest = self.latest
        return finished(latest.reals, latest.words, self.frames, self.parts, self.epoch, latest.names)

    def reshape(self, row: int) -> None:
        """Update the state after the shape of a part has changed. The part becomes dynamic."""
        self._begin(row)
        self.epoch += 1
        update_box(self.frames, self.parts, row)
        if not self.parts["is_dynamic"][row]:
            self.parts["is_dynamic"][row], self.parts["is_fused"][row] = 1, 0
            self._need(_THINNER)
        self._is_whole = True

    @property
    def dynamic_rows(self) -> list[int]:
        """Rows of the dynamic parts, which have been moved or deformed separately."""
        return [int(row) for row in np.flatnonzero(self.parts["is_dynamic"][:-1])]

    def values(self, row: int) -> dict[str, Any]:
        """Return the present values of the fields of a part by their names."""
        frame = self.frames[row]
        velocity, angular_velocity = frame["velocity"].copy(), frame["angular_velocity"].copy()
        velocity.flags.writeable = angular_velocity.flags.writeable = False
        is_rigid = frame["surface"] == SURFACE_RIGID
        return {
            "pose": Pose.known(
                frame["rotation"].reshape(3, 3),
                frame["translation"],
            ),
            "velocity": velocity,
            "angular_velocity": angular_velocity,
            "is_hidden": bool(self.parts["is_hidden"][row]),
            "stiffness": None if is_rigid else float(frame["stiffness"]),
            "damping": float(frame["damping"]),
        }

    def _need(self, tree: int) -> None:
        if len(self.parts) > 2:
            self._tree = max(self._tree, tree)

    def _begin(self, row: int | None = None) -> None:
        """Begin a change of a row. Derived arrays may be inconsistent until `_is_whole` is set again.

        A signal may arrive between any two steps, and its handler may raise, as for Ctrl-C.
        """
        if not self._is_whole:
            self._start_over()
        self._is_whole = False
        self.current = None
        self.changes += 1
        if row is not None:
            self.versions[row] = self.changes

    def _start_over(self) -> None:
        """Recompute everything that is derived from the rows, after a change was interrupted."""
        self.current = None
        self.changes += 1
        self.versions[:] = self.changes
        self.epoch += 1
        for row in range(len(self.parts) - 1):
            update_box(self.frames, self.parts, row)
        self._boxes_version = NEVER
        for copy in self._copies:
            copy.version = NEVER
        self._list_dynamic()
        self._need(_NEW)

    # --- models ------------------------------------------------------------------------------------------

    def update(self) -> Model | None:
        """Return a model of the present state, or None if no copy or space is left to write it."""
        if not self._is_whole:
            self._start_over()
        self._is_whole = False
        model = self._updated()
        self._is_whole = True
        return model

    def _updated(self) -> Model | None:
        copy = self._free_copy()
        if copy is None or (self._tree != _RIGHT and not self._mend_tree()):
            return None
        reach = self._write(copy)
        if reach > 1.0:
            # A part has left the scene's frame.
            self._need(_NEW)
            if not self._mend_tree():
                return None
            reach = self._write(copy)
        self._updates += 1
        if reach < SMALLEST_REACH and self._updates > UPDATES_BEFORE_SHRINKING:
            self._need(_NEW)
        latest = self.latest
        model = Model(
            latest.reals, latest.words, copy.frames, copy.parts, copy.packed, self.epoch, latest.names
        )
        copy.owner = weakref.ref(model)
        self.latest = self.current = model
        return model

    def _free_copy(self) -> _Copy | None:
        for copy in self._copies:
            if copy.is_free:
                return copy
        if len(self._copies) == REGION_COPIES:
            return None
        self._copies.append(self._new_copy(len(self._copies)))
        return self._copies[-1]

    def _new_copy(self, number: int) -> _Copy:
        frames, parts = np.empty_like(self.frames), np.empty_like(self.parts)
        return _Copy(self.latest, frames, parts, self._region(number))

    def _region(self, number: int) -> int:
        return int(copy_offsets(self.parts, number)[2])

    def _write(self, copy: _Copy) -> float:
        reach = bring_up_to_date(
            self.latest.words, self.frames, self.parts, self.versions, self._boxes_version, self._boxes,
            self._dynamic, self._sort_steps, copy.region, copy.version, copy.frames, copy.parts,
        )  # fmt: skip
        if reach <= 1.0:
            copy.version, copy.static = self.changes, self._static
            self._boxes_version = self.changes
            self._sort_steps = SORT_STEPS * self._dynamic_count
        return float(reach)

    def _mend_tree(self) -> bool:
        """Bring the static tree up to date in an unused copy. Return False if there is no space."""
        in_use = {copy.static for copy in self._copies if not copy.is_free}
        unused = [static for static in range(STATIC_COPIES) if static not in in_use]
        if not unused:
            return False
        if self._tree == _THINNER:
            thin_static(self.latest.words, self.parts, unused[0])
        elif not self._make_tree(unused[0]):
            return False
        self._static, self._tree = unused[0], _RIGHT
        self._list_dynamic()
        return True

    def _make_tree(self, static: int) -> bool:
        if not make_static(self.latest.words, self.frames, self.parts, static):
            return False
        self._boxes_version = NEVER
        for copy in self._copies:
            copy.version = NEVER
        self._updates = 0
        return True

    def _list_dynamic(self) -> None:
        rows = np.flatnonzero(self.parts["is_dynamic"][:-1])
        self._dynamic_count = len(rows)
        self._dynamic = packed(DynamicParts(rows, np.arange(len(rows)), np.empty(len(rows), np.int64)))
        self._sort_steps = len(rows) ** 2


def first_unfit_move(matrices: np.ndarray, velocities: np.ndarray, angular_velocities: np.ndarray) -> int:
    """Return the first row of an invalid move, or -1 if all are valid.

    A valid move is a rigid transform that is neither too far nor too fast. *matrices*: (K, 4, 4);
    *velocities*, *angular_velocities*: (K, 3).
    """
    return int(
        first_unfit(
            matrices, velocities, angular_velocities, ORTHONORMAL_TOLERANCE, FARTHEST_MOVE, FASTEST_MOVE
        )
    )


def box_of_vertices(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and upper corner, (3,) m, of the smallest box around all parts of a model."""
    frames = model.frames[:-1]
    lowers, uppers = frames["box_lower"].copy(), frames["box_upper"].copy()
    # The kernels' box of a rotated part encloses its rotated box, which is larger.
    for row in np.flatnonzero(model.parts["is_turned"][:-1]):
        part, frame, turn = model.parts[row], frames[row], frames["rotation"][row].reshape(3, 3)
        local = model.reals[part["corners"] :][: 3 * part["corner_count"]].reshape(-1, 3)
        x, y, z = (local / frame["scale"] + frame["centre"]).T[:, :, None]
        points = x * turn[:, 0] + y * turn[:, 1] + z * turn[:, 2] + frame["translation"]  # as in C
        lowers[row], uppers[row] = points.min(axis=0), points.max(axis=0)
    return lowers.min(axis=0), uppers.max(axis=0)
