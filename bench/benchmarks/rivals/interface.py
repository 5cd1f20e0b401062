"""The interface of a contender: a library, asked by the fastest calls that its package offers.

Arrays are converted to the library's own type and order before anything is timed, and answers are read out
after: a `Task` has the call alone. All run on one thread (`support.threads`, and arguments where a library
has them).
"""

import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

EVERYTHING = ("distance", "signed_distance", "closest", "contains", "cast")


@dataclass(frozen=True, slots=True)
class Task:
    """One prepared question. Only `run` is timed; `read` makes float64 or bool arrays of what it returned."""

    run: Callable[[], Any]
    read: Callable[[Any], np.ndarray]

    def answer(self) -> np.ndarray:
        """Ask once, and return the answer."""
        return self.read(self.run())


class Contender:
    """A library that answers questions about one mesh.

    `distance`, `signed_distance` and `cast` answer (N,) lengths (inf where a ray meets nothing), `closest`
    answers (N, 3) points, `contains` (N,) bool. Only those named in `questions` are there.
    """

    name: str
    package: str  # as PyPI knows it
    questions: tuple[str, ...] = EVERYTHING
    query_limit: int | None = None  # the slow ones are timed on fewer queries
    beside: str = "proximity"  # ours that answers no more than this one does: what its times are divided by

    def __init__(self) -> None:
        self.engine: Any = None

    @property
    def version(self) -> str:
        """Version of the package that answers."""
        return importlib.metadata.version(self.package)

    @property
    def memory_bytes(self) -> int | None:
        """Bytes that the structure holds; None where the library does not say."""
        return None

    @property
    def is_variant(self) -> bool:
        """Whether another contender builds the same structure, and this one asks it differently."""
        return type(self).__bases__[0] is not Contender and bool(self.questions)

    def builder(self, vertices: np.ndarray, faces: np.ndarray) -> Callable[[], Any]:
        """Return a call that makes the searchable structure, from arrays that are already converted."""
        raise NotImplementedError

    def build(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """Make the structure that is searched."""
        self.engine = self.builder(vertices, faces)()

    def distance(self, points: np.ndarray) -> Task:
        """Prepare the unsigned distances of *points*."""
        raise NotImplementedError

    def signed_distance(self, points: np.ndarray) -> Task:
        """Prepare the signed distances of *points*, negative inside."""
        raise NotImplementedError

    def closest(self, points: np.ndarray) -> Task:
        """Prepare the closest points of the surface, with all that comes along."""
        raise NotImplementedError

    def contains(self, points: np.ndarray) -> Task:
        """Prepare whether *points* are inside."""
        raise NotImplementedError

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Task:
        """Prepare the lengths of rays to the first hit."""
        raise NotImplementedError


def as_is(values):
    """Return *values*: nothing has to be read out."""
    return values


def as_float32(array):
    """A C-ordered float32 copy, or the array itself."""
    return np.ascontiguousarray(array, dtype=np.float32)


def inf_from(lengths, miss):
    """Lengths in which a miss is inf."""
    return np.where(lengths < miss, lengths, np.inf)
