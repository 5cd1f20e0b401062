"""Results of queries: records of arrays with the leading shape S of the query's points.

One point gives scalars, a grid gives a grid. A missing answer is `NO_FACE`, `NO_PART`, distance inf, points
nan. Records are read-only views of an array that a kernel has filled.
"""

from enum import IntEnum
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from proximity.checks import shown_number
from proximity.kernels.layout import (
    FEATURE_EDGE,
    FEATURE_FACE,
    FEATURE_NONE,
    FEATURE_VERTEX,
    NO_FACE,
    NO_PART,
)
from proximity.scene.queries.html_table import html_table

Reals = npt.NDArray[np.float64]
Rows = npt.NDArray[np.int32]
"""Types of fields, for type checkers. A single query answers with NumPy's scalars, which have the methods of
arrays and count as numbers."""

__all__ = ["NO_FACE", "NO_PART", "ClosestPoints", "Feature", "RayCrossings", "RayHits", "SegmentHits"]


class Feature(IntEnum):
    """The feature of a face that contains the closest point."""

    NONE = FEATURE_NONE
    FACE = FEATURE_FACE
    EDGE = FEATURE_EDGE
    VERTEX = FEATURE_VERTEX


FEW_ROWS = 6
"""Largest number of answers that a record shows in full."""


class _Record:
    """Columns of a table, float64 followed by int32, in the shape of the query.

    Most callers read one or two columns, so each is computed on access. `_kept` is written out there: a call
    would take 0.1 µs. The creator of a record assigns its table: an `__init__` would take a twentieth of a
    call with five rays.
    """

    __slots__ = ("_table",)

    _table: np.ndarray  # S + (columns,)
    _fields: tuple[str, ...] = ()
    _choice_count = 2  # int32 columns

    def _real(self, column: int) -> Any:
        values = self._table[..., column]
        values.setflags(False)  # type: ignore[call-arg]
        return values if values.ndim else values[()]

    def _vector(self, column: int) -> Reals:
        values = self._table[..., column : column + 3]
        values.setflags(False)  # type: ignore[call-arg]
        return values

    def _choice(self, column: int) -> Any:
        return _kept(self._table.view(np.int32)[..., column - self._choice_count])

    @property
    def part(self) -> Rows:
        """S int32, index into ``scene.parts``; `NO_PART` without an answer."""
        return self._choice(0)

    @property
    def face_id(self) -> Rows:
        """S int32, row of that part's ``solid.mesh.faces``; `NO_FACE` without an answer."""
        return self._choice(1)

    def __repr__(self) -> str:
        shape = self._table.shape[:-1]
        if not shape:
            fields = ", ".join(f"{name}={_shown(name, getattr(self, name))}" for name in self._fields)
            return f"{type(self).__name__}({fields})"
        first = self._fields[0]
        values = np.array2string(getattr(self, first), threshold=FEW_ROWS, edgeitems=2, separator=", ")
        return f"{type(self).__name__}(shape={shape}, {first}={' '.join(values.split())})"

    def _repr_html_(self) -> str:
        shape = self._table.shape[:-1]
        columns = [(name, np.asarray(getattr(self, name))) for name in self._fields]
        rows = (
            [", ".join(map(str, index)), *(_shown(name, column[index]) for name, column in columns)]
            for index in np.ndindex(shape)
        )
        return html_table(type(self).__name__, ("", *self._fields), rows, prod(shape))


def _shown(name: str, value: Any) -> str:
    return Feature(value).name if name == "feature" else shown_number(value)


def _kept(column: np.ndarray) -> Any:
    """Return a column as read-only; for a single query, the number itself."""
    # By position, though stubs of NumPy want a keyword: it would take 0.1 µs, a fifth of reading a field.
    column.setflags(False)  # type: ignore[call-arg]
    return column if column.ndim else column[()]


class ClosestPoints(_Record):
    """Answers to point queries, in the frame of the scene or solid queried."""

    __slots__ = ()
    _choice_count = 4
    _fields = (
        "signed_distance",
        "point",
        "gradient",
        "part",
        "face_id",
        "barycentric",
        "feature",
        "is_signed",
    )

    @property
    def signed_distance(self) -> Reals:
        """S float64, m, negative inside; inf if no surface is within *max_distance*."""
        return self._real(0)

    @property
    def point(self) -> Reals:
        """S + (3,) float64, m, the closest point of the surface."""
        return self._vector(1)

    @property
    def gradient(self) -> Reals:
        """S + (3,) float64, unit, direction of steepest increase of signed distance; 0 if undefined."""
        return self._vector(4)

    @property
    def barycentric(self) -> Reals:
        """S + (3,) float64, weights of the corners of the face; at least 0, sum 1."""
        return self._vector(7)

    @property
    def feature(self) -> Rows:
        """S int32, a `Feature`: face, edge or vertex that contains the point."""
        return self._choice(2)

    @property
    def is_signed(self) -> npt.NDArray[np.bool_]:
        """S bool, False if the distance has no sign, since that part has no inside."""
        is_signed = self._choice(3) != 0
        return _kept(is_signed) if is_signed.ndim else is_signed


class RayHits(_Record):
    """First hits of rays, in the frame of the scene or solid queried."""

    __slots__ = ()
    _fields = ("distance", "point", "normal", "part", "face_id", "barycentric")

    @property
    def distance(self) -> Reals:
        """S float64, m along the ray; inf without a hit within *max_distance*."""
        return self._real(0)

    @property
    def point(self) -> Reals:
        """S + (3,) float64, m, the hit point."""
        return self._vector(1)

    @property
    def normal(self) -> Reals:
        """S + (3,) float64, unit, outward normal of the face."""
        return self._vector(4)

    @property
    def barycentric(self) -> Reals:
        """S + (3,) float64, weights of the corners of the face; at least 0, sum 1."""
        return self._vector(7)


class RayCrossings(_Record):
    """All crossings of rays, in the frame of the scene or solid that was asked.

    H crossings of all rays, one ray after the other, each in order of distance. S is the leading shape of the
    rays, R their number. ``crossings[k]`` has the crossings of one ray; k has as many indices as S has axes.
    """

    __slots__ = ("_is_valid", "_offsets", "_shape")
    _choice_count = 4
    _fields = ("distance", "point", "normal", "is_entering", "part", "face_id", "barycentric")

    _is_valid: np.ndarray
    _offsets: np.ndarray
    _shape: tuple[int, ...]

    @property
    def offsets(self) -> npt.NDArray[np.int64]:
        """R + 1 int64: the crossings of ray k are rows ``offsets[k]`` to ``offsets[k + 1]``."""
        return _kept(self._offsets)

    @property
    def ray(self) -> npt.NDArray[np.int64]:
        """H int64, the ray of each crossing: a row of the rays in one list."""
        return np.repeat(np.arange(len(self._offsets) - 1), np.diff(self._offsets))

    @property
    def count(self) -> npt.NDArray[np.int64]:
        """S int64, number of crossings of each ray."""
        return _kept(np.diff(self._offsets).reshape(self._shape))

    @property
    def is_valid(self) -> npt.NDArray[np.bool_]:
        """S bool, False for a ray that is not finite, or starts too far away: it has no crossings."""
        return _kept(self._is_valid.reshape(self._shape))

    @property
    def distance(self) -> Reals:
        """H float64, m along the ray."""
        return self._real(0)

    @property
    def point(self) -> Reals:
        """H x 3 float64, m, where the ray crosses the surface."""
        return self._vector(1)

    @property
    def normal(self) -> Reals:
        """H x 3 float64, unit, outward normal of the face."""
        return self._vector(4)

    @property
    def is_entering(self) -> npt.NDArray[np.bool_]:
        """H bool, True where the ray enters the part, against the normal; False where it leaves."""
        return _kept(self._choice(2) != 0)

    @property
    def part(self) -> Rows:
        """H int32, index into ``scene.parts``."""
        return self._choice(0)

    @property
    def face_id(self) -> Rows:
        """H int32, row of that part's ``solid.mesh.faces``."""
        return self._choice(1)

    @property
    def barycentric(self) -> Reals:
        """H x 3 float64, weights of the corners of the face; at least 0, sum 1."""
        return self._vector(7)

    def __len__(self) -> int:
        """Return the length of the first axis of the rays."""
        if not self._shape:
            raise TypeError("crossings of a single ray have no length; its distance has")
        return self._shape[0]

    def __getitem__(self, index: int | tuple[int, ...]) -> "RayCrossings":
        """Return the crossings of one ray."""
        row = np.arange(len(self._is_valid)).reshape(self._shape)[index]
        if np.ndim(row):
            raise IndexError(f"rays have shape {self._shape}: {index} is not the index of one ray")
        one, first, last = RayCrossings(), self._offsets[row], self._offsets[row + 1]
        one._table, one._offsets = self._table[first:last], np.array([0, last - first])
        one._is_valid, one._shape = self._is_valid[row : row + 1], ()
        return one


class SegmentHits(_Record):
    """Shortest connections between segments and surfaces, in the frame of the scene or solid queried."""

    __slots__ = ()
    _fields = ("distance", "point_on_segment", "point_on_solid", "fraction", "part", "face_id", "barycentric")

    @property
    def distance(self) -> Reals:
        """S float64, m, unsigned; 0 if the segment meets the surface, inf beyond the limit."""
        return self._real(0)

    @property
    def point_on_segment(self) -> Reals:
        """S + (3,) float64, m, this end of the shortest connection."""
        return self._vector(1)

    @property
    def point_on_solid(self) -> Reals:
        """S + (3,) float64, m, the other end."""
        return self._vector(4)

    @property
    def fraction(self) -> Reals:
        """S float64, position on the segment: 0 at its start, 1 at its end."""
        return self._real(7)

    @property
    def barycentric(self) -> Reals:
        """S + (3,) float64, weights of the corners of the face; at least 0, sum 1."""
        return self._vector(8)
