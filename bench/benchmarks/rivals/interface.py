"""Interface of a contender: a library, called by the fastest functions that its package offers.

Arrays are converted to the library's type and order before timing, and answers are read after it: a `Task`
has the call alone. All run on one thread (`support.threads`, and arguments for libraries that have them).
"""

import importlib.metadata
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

EVERYTHING = ("distance", "signed_distance", "closest", "contains", "cast")


@dataclass(frozen=True, slots=True)
class Task:
    """One prepared query. Only `run` is timed; `read` converts its result to float64 or bool arrays."""

    run: Callable[[], Any]
    read: Callable[[Any], np.ndarray]

    def answer(self) -> np.ndarray:
        """Run once, and return the answer."""
        return self.read(self.run())


class Contender:
    """A library with queries of one mesh.

    `distance`, `signed_distance` and `cast` return (N,) lengths (inf for a miss), `closest` returns (N, 3)
    points, `contains` (N,) bool. Only those named in `questions` exist.
    """

    name: str
    package: str  # as PyPI knows it
    questions: tuple[str, ...] = EVERYTHING
    query_limit: int | None = None  # the slow ones are timed on fewer queries
    beside: str = "proximity"  # the row of ours with the same fields, by which its times are divided

    def __init__(self) -> None:
        self.engine: Any = None

    @property
    def version(self) -> str:
        """Version of the package."""
        return importlib.metadata.version(self.package)

    @property
    def memory_bytes(self) -> int | None:
        """Size of the structure; None if the library does not report it."""
        return None

    @property
    def is_variant(self) -> bool:
        """True if another contender builds the same structure, and this one queries it differently."""
        return type(self).__bases__[0] is not Contender and bool(self.questions)

    def builder(self, vertices: np.ndarray, faces: np.ndarray) -> Callable[[], Any]:
        """Return a call that builds the search structure, from converted arrays."""
        raise NotImplementedError

    def build(self, vertices: np.ndarray, faces: np.ndarray) -> None:
        """Build the search structure."""
        self.engine = self.builder(vertices, faces)()

    def distance(self, points: np.ndarray) -> Task:
        """Prepare the unsigned distances of *points*."""
        raise NotImplementedError

    def signed_distance(self, points: np.ndarray) -> Task:
        """Prepare the signed distances of *points*, negative inside."""
        raise NotImplementedError

    def closest(self, points: np.ndarray) -> Task:
        """Prepare the closest points of the surface, with all further fields."""
        raise NotImplementedError

    def contains(self, points: np.ndarray) -> Task:
        """Prepare whether *points* are inside."""
        raise NotImplementedError

    def cast(self, origins: np.ndarray, directions: np.ndarray) -> Task:
        """Prepare the lengths of rays to the first hit."""
        raise NotImplementedError


def as_is(values):
    """Return *values*, which need no conversion."""
    return values


def as_float32(array):
    """Return a C-ordered float32 copy, or the array itself."""
    return np.ascontiguousarray(array, dtype=np.float32)


def inf_from(lengths, miss):
    """Return lengths with inf for misses."""
    return np.where(lengths < miss, lengths, np.inf)
