"""Results of splitting: bodies, and the repairs that were made."""

from dataclasses import dataclass

import numpy as np

from proximity.mesh.topology import Topology
from proximity.mesh.triangle_mesh import TriangleMesh


@dataclass(frozen=True, slots=True)
class Repairs:
    """Changes that made one body of the faces given."""

    merged_vertex_count: int = 0  # vertices fewer because equal positions share one
    welded_vertex_count: int = 0  # vertices fewer because near ones were pulled together to close the body
    weld_distance: float = 0.0  # m, how far the farthest of them moved
    dropped_sliver_count: int = 0  # faces without area
    dropped_duplicate_count: int = 0  # faces that another one equals
    turned_face_count: int = 0  # faces turned so that all run one way
    is_turned_inside_out: bool = False  # every face turned, as the body had a negative volume

    def describe(self) -> str:
        """Return what was done as one sentence for people; empty if nothing was."""
        deeds = []
        if self.merged_vertex_count:
            deeds.append(f"merged {_counted(self.merged_vertex_count, 'equal vertex', 'equal vertices')}")
        if self.welded_vertex_count:
            what = _counted(self.welded_vertex_count, "near vertex", "near vertices")
            deeds.append(f"welded {what} at most {self.weld_distance:.2g} m apart to close the body")
        if self.dropped_sliver_count:
            what = _counted(self.dropped_sliver_count, "face without area", "faces without area")
            deeds.append(f"dropped {what}")
        if self.dropped_duplicate_count:
            what = _counted(self.dropped_duplicate_count, "duplicate face", "duplicate faces")
            deeds.append(f"dropped {what}")
        if self.turned_face_count:
            what = _counted(self.turned_face_count, "face", "faces")
            deeds.append(f"turned {what} to match the orientation of the others")
        if self.is_turned_inside_out:
            deeds.append("flipped the body, which was inside out")
        sentence = ", ".join(deeds)
        return sentence and sentence[0].upper() + sentence[1:] + "."


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """One body: its own mesh, and where the faces come from."""

    mesh: TriangleMesh  # only the vertices in use, one a position
    source_faces: np.ndarray  # (F,) int32, what each face is called where it comes from, read-only
    repairs: Repairs
    topology: Topology | None = None  # of the mesh, where splitting has found it


def _counted(count: int, one: str, many: str) -> str:
    return f"{count} {one if count == 1 else many}"
