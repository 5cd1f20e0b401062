"""Digests of all queries of a scene or a solid: the bytes of every field, for calls of every size."""

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.digest.scenes import generator
from proximity import ProximityError, Scene, Solid

CLOSEST_FIELDS = (
    "signed_distance", "point", "gradient", "part", "face_id", "barycentric", "feature", "is_signed",
)  # fmt: skip
RAY_FIELDS = ("distance", "point", "normal", "part", "face_id", "barycentric")
SEGMENT_FIELDS = (
    "distance", "point_on_segment", "point_on_solid", "fraction", "part", "face_id", "barycentric",
)  # fmt: skip
QUERIES = {
    "closest": CLOSEST_FIELDS,
    "signed_distance": (),
    "distance": (),
    "contains": (),
    "cast": RAY_FIELDS,
    "cast_distance": (),
    "closest_to_segments": SEGMENT_FIELDS,
}
"""Fields of each query's result; an array if there are none."""
LIMITED = ("closest", "cast", "cast_distance", "closest_to_segments")  # they take max_distance
NEAR = 0.02  # standard deviation of the distance to the surface, in diagonals
LIMIT = 0.01  # max_distance, in diagonals
FINGERS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """Inputs of the queries of one scene or solid."""

    points: np.ndarray  # (N, 3) m
    origins: np.ndarray  # (R, 3) m
    directions: np.ndarray  # (R, 3)
    starts: np.ndarray  # (S, 3) m
    ends: np.ndarray  # (S, 3) m
    limit: float  # m

    def of(self, query: str) -> tuple[np.ndarray, ...]:
        """Return the arrays that *query* takes."""
        if query.startswith("cast"):
            return self.origins, self.directions
        return (self.starts, self.ends) if query == "closest_to_segments" else (self.points,)


def digests_of(
    name: str, target: Scene | Solid, triangles: np.ndarray, count: int, workers: int
) -> Iterator[tuple[str, str]]:
    """Yield ``name/query`` and the digest of its answers, for each query.

    *triangles*: (F, 3, 3) m, surface of *target*, near which points are placed; *count*: approximate number
    of points.
    """
    inputs = make_inputs(generator(name), triangles, count)
    for query, fields in QUERIES.items():
        digest = hashlib.sha256()
        for answer in answers_of(getattr(target, query), inputs, query, workers):
            add_answer(digest, answer, fields)
        yield f"{name}/{query}", digest.hexdigest()


def answers_of(ask: Callable[..., Any], inputs: Inputs, query: str, workers: int) -> Iterator[Any]:
    """Yield the answers to one query: one large call, limited ones, small calls, other shapes and layouts."""
    arrays = inputs.of(query)
    yield _answer(ask, *arrays, workers=workers)
    if query in LIMITED:
        for limit in (inputs.limit, 0.0):
            yield _answer(ask, *arrays, workers=workers, max_distance=limit)
    for size in (FINGERS, 40):
        for first in range(0, min(len(arrays[0]), 40 * size), size):
            yield _answer(ask, *(array[first : first + size].copy() for array in arrays))
    for row in range(0, len(arrays[0]), max(1, len(arrays[0]) // 40)):
        yield _answer(ask, *(array[row].tolist() for array in arrays))
    rows = len(arrays[0]) // 6 * 6
    yield _answer(ask, *(array[:rows].reshape(2, 3, -1, 3) for array in arrays))
    yield _answer(ask, *(np.asfortranarray(array[::-3]) for array in arrays))
    yield _answer(ask, *(array[:100].astype(np.float32) for array in arrays))
    yield _answer(ask, *(array[:0] for array in arrays))
    yield _answer(ask, *(np.zeros((1, 3)) for _ in arrays))  # a ray without a direction is an error


def _answer(ask, *arrays, **settings):
    """Return the answer, or the class of the raised error."""
    try:
        return ask(*arrays, **settings)
    except ProximityError as error:
        return type(error)


def add_answer(digest: Any, answer: Any, fields: tuple[str, ...]) -> None:
    """Add the shape and raw bytes of an answer to *digest*, or the name of an error."""
    if isinstance(answer, type):
        digest.update(answer.__name__.encode())
        return
    for column in [getattr(answer, field) for field in fields] or [answer]:
        array = np.ascontiguousarray(column)
        digest.update(str((np.shape(column), array.dtype.str)).encode())
        digest.update(array.tobytes())


def triangles_of(target: Scene | Solid) -> np.ndarray:
    """Return the corners of all faces, (F, 3, 3) m, in the frame of *target*'s queries."""
    if isinstance(target, Solid):
        return target.mesh.vertices[target.mesh.faces]
    found = []
    for part in target.parts:
        corners = part.solid.mesh.vertices[part.solid.mesh.faces]
        found.append(corners @ part.pose.rotation.T + part.pose.translation)
    return np.concatenate(found)


def make_inputs(rng: np.random.Generator, triangles: np.ndarray, count: int) -> Inputs:
    """Return points near a surface, around it, on vertices, edges, far away, not finite; rays; segments."""
    lower, upper = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    middle, reach = 0.5 * (lower + upper), upper - lower
    diagonal = float(np.sqrt((reach * reach).sum()))

    def around(size: float, rows: int) -> np.ndarray:
        return middle + size * reach * rng.uniform(-0.5, 0.5, (rows, 3))

    def on_faces(rows: int) -> np.ndarray:
        weights = rng.dirichlet(np.ones(3), rows)[:, :, None]
        return (weights * triangles[rng.integers(0, len(triangles), rows)]).sum(axis=1)

    def unit(rows: int) -> np.ndarray:
        directions = rng.normal(size=(rows, 3))
        return directions / np.sqrt((directions * directions).sum(axis=1))[:, None]

    some = triangles[rng.integers(0, len(triangles), count // 20)]
    near = on_faces(count) + NEAR * diagonal * rng.normal(size=(count, 1)) * unit(count)
    special = [some[:, 0], 0.5 * (some[:, 0] + some[:, 1]), some.mean(axis=1), on_faces(count // 20)]
    far = middle + 1e3 * diagonal * unit(20)
    broken = np.array([[np.nan, 0.0, 0.0], [np.inf, 0.0, 0.0], [0.0, -np.inf, np.nan]])
    points = np.concatenate(
        [near[:40], far, broken, *special, middle[None], around(1.5, count // 2), near[40:]]
    )

    outside = middle + diagonal * unit(count // 2)
    origins = np.concatenate([outside, around(1.2, count // 4), near[: count // 8], some[:, 0]])
    directions = np.concatenate(
        [around(1.0, count // 2) - outside, unit(count // 4), np.eye(3)[rng.integers(0, 3, count // 8)],
         unit(len(some))]
    )  # fmt: skip
    directions[7], origins[11] = np.nan, np.nan
    lengths = diagonal * rng.choice([0.0, 1e-6, 0.05, 1.0], (2 * (count // 4), 1))
    starts = np.concatenate([near[: count // 4], around(1.3, count // 4)])
    ends = starts + lengths * unit(len(starts))
    starts[5], ends[9] = np.nan, np.inf
    return Inputs(points, origins, directions, starts, ends, LIMIT * diagonal)
