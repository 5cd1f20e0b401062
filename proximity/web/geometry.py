"""Convert a scene to a GLB file, whatever the formats of its parts.

A part is a node with its name and pose. Below it are its faces and its edges relative to its centre, so that
single precision is enough at any distance from the origin. ``extras`` contain the numbers of faces and of
drawn faces for the page.
"""

import json
import struct
from typing import Any

import numpy as np

from proximity.scene.part import Part
from proximity.scene.scene import Scene
from proximity.web.display_mesh import coarser, display_mesh

MAX_FACES = 500_000
"""Maximum number of faces of a scene that a browser can turn smoothly."""
MIN_FACES = 200
"""Minimum number of faces to which a part of a large scene is simplified."""
COLOURS = (
    (0.32, 0.42, 0.55), (0.78, 0.31, 0.07), (0.10, 0.49, 0.29), (0.56, 0.19, 0.52), (0.61, 0.59, 0.09),
    (0.26, 0.23, 0.77), (0.17, 0.62, 0.73), (0.19, 0.32, 0.09), (0.86, 0.48, 0.64), (0.08, 0.21, 0.42),
    (0.38, 0.18, 0.04), (0.24, 0.24, 0.24),
)  # fmt: skip
"""Colours that parts have in turn, as linear red, green and blue. Red is reserved for crossing parts."""
EDGE_COLOUR = (0.03, 0.035, 0.05)

_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_LINES, _TRIANGLES = 1, 4
_HEADER = struct.Struct("<III")
_CHUNK = struct.Struct("<II")


def scene_glb(scene: Scene, *, max_faces: int = MAX_FACES) -> bytes:
    """Return a scene as a GLB file, in metres and in the scene's axes (z up).

    *max_faces*: maximum number of faces; in a larger scene all parts are simplified by the same factor.
    """
    total = sum(part.solid.mesh.face_count for part in scene.parts)
    share = min(1.0, max_faces / total)
    made = _Glb()
    shown = 0
    for number, part in enumerate(scene.parts):
        target = part.solid.mesh.face_count
        if share < 1.0:
            target = max(int(share * target), MIN_FACES)
        shown += made.add_part(number, part, target)
    return made.data({"face_count": total, "shown_count": shown, "part_count": len(scene.parts)})


class _Glb:
    """A GLB file under construction."""

    def __init__(self) -> None:
        self._binary = bytearray()
        self._roots: list[int] = []
        names = ("nodes", "meshes", "accessors", "bufferViews")
        self._lists: dict[str, list[dict[str, Any]]] = {name: [] for name in names}

    def add_part(self, number: int, part: Part, target: int) -> int:
        """Add a part with about *target* faces at most. Return their number."""
        mesh = part.solid.mesh
        drawn = display_mesh(*coarser(mesh.vertices, np.asarray(mesh.faces, np.int64), target))
        attributes = {"POSITION": self._vertices(drawn.positions), "NORMAL": self._vertices(drawn.normals)}
        material = number % len(COLOURS)
        faces = self._indices(drawn.faces)
        shapes = [{"attributes": attributes, "indices": faces, "mode": _TRIANGLES, "material": material}]
        names = ["faces"]
        if len(drawn.edges):
            lines = self._indices(drawn.edges)
            only = {"POSITION": attributes["POSITION"]}
            shapes.append({"attributes": only, "indices": lines, "mode": _LINES, "material": len(COLOURS)})
            names.append("edges")
        below = []
        for name, shape in zip(names, shapes, strict=True):
            title = f"{part.name} {name}"
            at = self._add("meshes", name=title, primitives=[shape])
            below.append(self._add("nodes", name=title, mesh=at, translation=drawn.centre.tolist()))
        matrix = part.pose.matrix.T.reshape(-1).tolist()  # column by column
        extras = {
            "part": number,
            "name": part.name,
            "face_count": mesh.face_count,
            "shown_count": len(drawn.faces),
            "is_hidden": part.is_hidden,
            "is_deformable": part.stiffness is not None,
        }
        self._roots.append(self._add("nodes", name=part.name, children=below, matrix=matrix, extras=extras))
        return len(drawn.faces)

    def data(self, extras: dict[str, Any]) -> bytes:
        """Return the bytes of the complete file."""
        document = {
            "asset": {"version": "2.0", "generator": "proximity"},
            "scene": 0,
            "scenes": [{"nodes": self._roots, "extras": extras}],
            **self._lists,
            "materials": [*map(_material, COLOURS), _material(EDGE_COLOUR)],
            "buffers": [{"byteLength": len(self._binary)}],
        }
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = _CHUNK.pack(len(text), 0x4E4F534A) + text
        chunks += _CHUNK.pack(len(self._binary), 0x004E4942) + self._binary
        return _HEADER.pack(0x46546C67, 2, _HEADER.size + len(chunks)) + chunks

    def _vertices(self, rows: np.ndarray) -> int:
        bounds = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        view = self._view(rows, _VERTICES)
        return self._add(
            "accessors", bufferView=view, componentType=_FLOAT, count=len(rows), type="VEC3", **bounds
        )

    def _indices(self, rows: np.ndarray) -> int:
        view = self._view(rows, _INDICES)
        return self._add(
            "accessors", bufferView=view, componentType=_UNSIGNED, count=rows.size, type="SCALAR"
        )

    def _view(self, rows: np.ndarray, target: int) -> int:
        """Add an array of 4-byte numbers as a buffer view, and return its index.

        The next array stays aligned.
        """
        data, offset = np.ascontiguousarray(rows).tobytes(), len(self._binary)
        self._binary += data
        return self._add("bufferViews", buffer=0, byteOffset=offset, byteLength=len(data), target=target)

    def _add(self, kind: str, **values: Any) -> int:
        self._lists[kind].append(values)
        return len(self._lists[kind]) - 1


def _material(colour: tuple[float, float, float]) -> dict[str, Any]:
    metal = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.15, "roughnessFactor": 0.55}
    return {"pbrMetallicRoughness": metal, "doubleSided": True}
