"""All contenders: this package, and other libraries with the same queries.

A library is imported when its contender is made; `available` says which are missing and why.
"""

from benchmarks.rivals.embreex import Embreex, EmbreexAll
from benchmarks.rivals.fcpw import Fcpw, FcpwContains
from benchmarks.rivals.interface import Contender
from benchmarks.rivals.libigl import Libigl, LibiglNormals
from benchmarks.rivals.open3d import Open3D
from benchmarks.rivals.ours import Proximity, ProximityLengths, ProximityTree
from benchmarks.rivals.trimesh import Trimesh
from benchmarks.rivals.warp import Warp, WarpParity, WarpVotes, WarpWinding

RIVALS: tuple[type[Contender], ...] = (
    Fcpw,
    FcpwContains,
    Open3D,
    Warp,
    WarpVotes,
    WarpParity,
    WarpWinding,
    Libigl,
    LibiglNormals,
    Trimesh,
    Embreex,
    EmbreexAll,
)
CONTENDERS: tuple[type[Contender], ...] = (Proximity, ProximityLengths, ProximityTree, *RIVALS)


def available(kinds: tuple[type[Contender], ...] = CONTENDERS) -> tuple[list[Contender], dict[str, str]]:
    """Return the importable ones, and by name the reason why the other rivals are missing."""
    found, missing = [], {}
    for kind in kinds:
        try:
            found.append(kind())
        except (ImportError, OSError) as reason:
            if issubclass(kind, Proximity):
                raise
            missing[kind.name] = f"{type(reason).__name__}: {reason}"
    return found, missing
