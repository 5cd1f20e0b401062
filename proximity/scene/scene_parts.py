"""The parts of a scene by name, with their arrays.

They are replaced as a whole when a part is added or removed.
"""

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from difflib import get_close_matches
from operator import is_
from typing import Any

import numpy as np

from proximity.errors import ArgumentError, MeshError, SceneError
from proximity.mesh.bvh import LocalFrame
from proximity.scene.model.assembly import Model, adopt, assemble
from proximity.scene.model.scene_state import SceneState, write_motion, write_surface
from proximity.scene.part import Part, checked_part, deformed
from proximity.system.memory import return_free_memory

MANY_FACES = 100_000
"""Number of new faces from which on memory that their construction has freed is returned to the system."""


class SceneParts:
    """The parts of a scene, their rows by name, and the state of their arrays.

    Not thread-safe: the scene has a lock.
    """

    def __init__(self, parts: list[Part], state: SceneState) -> None:
        self.state = state
        self.row_of = {part.name: row for row, part in enumerate(parts)}
        self.solids = [part.solid for part in parts]
        self._parts = parts
        self._versions = state.versions.copy()  # of the rows in `_parts`
        self._last_rows: tuple[list[str], np.ndarray] = [], np.empty(0, np.int64)
        self._interrupted: tuple[int, LocalFrame] | None = None  # deformation: row, and its frame before

    @classmethod
    def of(
        cls, parts: list[Part], sources: list[Model], *, dynamic: Collection[int] = (), epoch: int = 0
    ) -> "SceneParts":
        """Assemble the arrays of parts from *sources*, and return the parts.

        *parts*: with distinct names, and solids that are in no other scene. *dynamic*: rows of the parts that
        have moved separately.
        """
        model = assemble(
            sources,
            [part.pose for part in parts],
            dynamic=dynamic,
            hidden=[row for row, part in enumerate(parts) if part.is_hidden],
            epoch=epoch,
            names=tuple(part.name for part in parts),
        )
        return cls._over(model, parts)

    @classmethod
    def _over(cls, model: Model, parts: list[Part]) -> "SceneParts":
        for row, part in enumerate(parts):
            part.solid._arrays.move_to(model, row)
            write_motion(model.frames[row], part.velocity, part.angular_velocity)
            write_surface(model.frames[row], part.stiffness, part.damping)
        return cls(parts, SceneState(model))

    @classmethod
    def of_new(cls, parts: list[Part]) -> "SceneParts":
        """Return validated parts, and take over the arrays of their solids, which no other owner may use.

        *parts*: as for `checked_parts`. The list is emptied, so that their arrays are freed early.
        """
        own, sources = with_arrays(checked_parts(parts))
        parts.clear()
        if len(own) == 1:  # the scene takes the memory of its solid
            model = adopt(sources[0], own[0].pose, is_hidden=own[0].is_hidden, name=own[0].name)
            scene_parts = cls._over(model, own)
        else:
            scene_parts = cls.of(own, sources)
        del own, sources
        if scene_parts.face_count > MANY_FACES:
            return_free_memory()
        return scene_parts

    def __len__(self) -> int:
        return len(self._parts)

    def __iter__(self) -> Iterator[Part]:
        """Iterate over the parts in their present state."""
        return (self[row] for row in range(len(self._parts)))

    def __getitem__(self, row: int) -> Part:
        """Return a part with its present values. It is made on access, not when the part moves."""
        self.mend()
        version = self.state.versions[row]
        if version != self._versions[row]:
            self._parts[row] = replace(self._parts[row], **self.state.values(row))
            self._versions[row] = version
        return self._parts[row]

    @property
    def face_count(self) -> int:
        """Number of faces of all parts."""
        return sum(part.solid.mesh.face_count for part in self._parts)

    @property
    def memory_bytes(self) -> int:
        """Number of bytes of all meshes and trees."""
        solids = {part.solid for part in self._parts}  # one may be in several parts
        return self.state.latest.memory_bytes + sum(solid._mesh_bytes for solid in solids)

    def find(self, name: str | int) -> int:
        """Return the row of the part with a name or an index. Raise a `SceneError` if there is none."""
        if isinstance(name, int | np.integer) and 0 <= name < len(self._parts):  # -1 is `NO_PART`
            return int(name)
        try:
            return self.row_of[name]  # type: ignore[index]
        except (KeyError, TypeError):
            raise SceneError(f"no part is named {name!r}; {self._hint(name)}") from None

    def _hint(self, name: object) -> str:
        """Return a hint with the most similar name of a part, or with some of the names."""
        if isinstance(name, str) and (close := get_close_matches(name, self.row_of, 1)):
            return f"did you mean {close[0]!r}?"
        known = ", ".join(repr(known) for known in list(self.row_of)[:10])
        more = "" if len(self.row_of) <= 10 else f" and {len(self.row_of) - 10} more"
        return f"the scene has {known}{more}"

    def rows_of(self, names: list[str]) -> np.ndarray:
        """Return the rows of the named parts. Raise a `SceneError` if a name is unknown or repeated."""
        last, rows = self._last_rows
        if len(last) == len(names) and all(map(is_, last, names)):  # the usual case
            return rows
        rows = np.array([self.find(name) for name in names], np.int64)
        if len(set(names)) < len(names):
            twice = next(name for row, name in enumerate(names) if name in names[:row])
            raise SceneError(f"part {twice!r} is named twice, expected names that differ")
        self._last_rows = names, rows
        return rows

    def with_part(self, part: Part) -> "SceneParts":
        """Return these parts followed by another one."""
        parts, pieces = self._parts_and_arrays(range(len(self)))
        added, arrays = with_arrays([part])
        return self.of(
            parts + added, pieces + arrays, dynamic=self.state.dynamic_rows, epoch=self.state.epoch + 1
        )

    def without(self, removed: int) -> "SceneParts":
        """Return these parts without the one in a given row."""
        kept = [row for row in range(len(self)) if row != removed]
        dynamic = [new for new, row in enumerate(kept) if row in self.state.dynamic_rows]
        remaining = self.of(*self._parts_and_arrays(kept), dynamic=dynamic, epoch=self.state.epoch + 1)
        solid = self._parts[removed].solid
        if all(part.solid is not solid for part in remaining):
            solid._arrays.leave_scene(solid.mesh)
        return remaining

    def in_new_memory(self) -> "SceneParts":
        """Return the same parts, with their arrays in new memory."""
        kept = self._parts_and_arrays(range(len(self)))
        return self.of(*kept, dynamic=self.state.dynamic_rows, epoch=self.state.epoch)

    def _parts_and_arrays(self, rows: Sequence[int]) -> tuple[list[Part], list[Model]]:
        parts = [self[row] for row in rows]
        model = self.state.writable_model()
        return parts, [model.part_alone(row) for row in rows]

    def updated(self) -> Model | None:
        """Return a model of the present state, or None if no memory is left to write it to."""
        self.mend()
        return self.state.current or self.state.update()

    def deform(self, row: int, vertices: Any) -> None:
        """Change the shape of a part. If this is interrupted, `mend` completes or reverts it later.

        *vertices*: (V, 3) m, part's frame.
        """
        from proximity.scene.deformation import deform_part  # few scenes need it

        part, state = self._parts[row], self.state
        state.current, self._interrupted = None, (row, LocalFrame.read(state.frames[row]))
        try:
            solid = deform_part(state.writable_model(), row, part.solid, vertices, part.name)
        except (ArgumentError, MeshError):  # before any change
            self._interrupted = None
            raise
        self._parts[row], self.solids[row] = deformed(part, solid), solid
        state.reshape(row)
        self._interrupted = None

    def mend(self) -> None:
        """Complete or revert an interrupted deformation, so that the part has the shape of its solid."""
        if self._interrupted is not None:
            row, frame = self._interrupted
            frame.write(self.state.frames[row])
            self.deform(row, self._parts[row].solid.mesh.vertices)


class ClosedParts:
    """The parts of a closed scene: every use raises."""

    def _refuse(self, *_: object) -> Any:
        raise SceneError("the scene is closed, expected an open one: load or make it again")

    __getattr__ = __getitem__ = __iter__ = __len__ = _refuse


def checked_parts(given: Iterable[Any]) -> list[Part]:
    """Return validated parts for a scene, or raise an error if names are equal or there is no part."""
    parts = [checked_part(part) for part in given]
    if not parts:
        raise SceneError("a scene has no parts, expected at least one")
    row_of: dict[str, int] = {}
    for row, part in enumerate(parts):
        if not isinstance(part.name, str):
            raise SceneError(f"part {row} is named {part.name!r}, expected text")
        if part.name in row_of:
            raise SceneError(
                f"parts {row_of[part.name]} and {row} are both named {part.name!r}, "
                "expected names that differ"
            )
        row_of[part.name] = row
    return parts


def with_arrays(parts: list[Part]) -> tuple[list[Part], list[Model]]:
    """Return parts for a new scene, with separate solids, and the arrays of each part."""
    solids = {id(part.solid): part.solid._for_scene() for part in parts}
    own = [replace(part, solid=solids[id(part.solid)]) for part in parts]
    return own, [part.solid.snapshot() for part in own]
