"""The geometry of a scene as a GLB file, made from what was loaded: any format is shown, and by its parts.

A part is a node with the part's name and pose; below it are its faces and its edges about its own centre, so
that single precision is enough however far from the origin the part is. ``extras`` say what the page tells
of it: how many faces there are and how many are drawn.
"""

import json
import struct
from typing import Any

import numpy as np

from proximity.scene.part import Part
from proximity.scene.scene import Scene
from proximity.web.display_mesh import coarser, display_mesh

MOST_FACES = 500_000
"""Of a scene, that are drawn: a browser turns as many smoothly."""
FEWEST_FACES = 200
"""Of a part of a larger scene."""
COLOURS = (
    (0.32, 0.42, 0.55), (0.62, 0.38, 0.18), (0.22, 0.47, 0.41), (0.50, 0.29, 0.41),
    (0.40, 0.46, 0.20), (0.27, 0.36, 0.62), (0.58, 0.46, 0.24), (0.33, 0.34, 0.36),
)  # fmt: skip
"""Of parts, in turn, as linear red, green and blue; alike in lightness, so that shading is what is seen."""
EDGE_COLOUR = (0.03, 0.035, 0.05)

_FLOAT, _UNSIGNED = 5126, 5125
_VERTICES, _INDICES = 34962, 34963
_LINES, _TRIANGLES = 1, 4
_HEADER = struct.Struct("<III")
_CHUNK = struct.Struct("<II")


def scene_glb(scene: Scene, *, most_faces: int = MOST_FACES) -> bytes:
    """Return a scene as GLB, metres, in the scene's own axes (z up).

    *most_faces*: that are drawn; a larger scene is made coarser, each part by its share.
    """
    total = sum(part.solid.mesh.face_count for part in scene.parts)
    share = min(1.0, most_faces / total)
    made = _Glb()
    shown = 0
    for number, part in enumerate(scene.parts):
        target = part.solid.mesh.face_count
        if share < 1.0:
            target = max(int(share * target), FEWEST_FACES)
        shown += made.add_part(number, part, target)
    return made.data({"face_count": total, "shown_count": shown, "part_count": len(scene.parts)})


class _Glb:
    """The document as it grows."""

    def __init__(self) -> None:
        self._chunks: list[bytes] = []
        self._size = 0
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []
        self._nodes: list[dict[str, Any]] = []
        self._roots: list[int] = []

    def add_part(self, number: int, part: Part, target: int) -> int:
        """Add a part with at most *target* faces, or nearly; how many they are."""
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
            self._meshes.append({"name": f"{part.name} {name}", "primitives": [shape]})
            self._nodes.append(
                {
                    "name": f"{part.name} {name}",
                    "mesh": len(self._meshes) - 1,
                    "translation": drawn.centre.tolist(),
                }
            )
            below.append(len(self._nodes) - 1)
        self._nodes.append(
            {
                "name": part.name,
                "children": below,
                "matrix": part.pose.matrix.T.reshape(-1).tolist(),  # column by column
                "extras": {
                    "part": number,
                    "name": part.name,
                    "face_count": mesh.face_count,
                    "shown_count": len(drawn.faces),
                    "is_hidden": part.is_hidden,
                    "is_deformable": part.stiffness is not None,
                },
            }
        )
        self._roots.append(len(self._nodes) - 1)
        return len(drawn.faces)

    def data(self, extras: dict[str, Any]) -> bytes:
        """The whole file."""
        document = {
            "asset": {"version": "2.0", "generator": "proximity"},
            "scene": 0,
            "scenes": [{"nodes": self._roots, "extras": extras}],
            "nodes": self._nodes,
            "meshes": self._meshes,
            "materials": [*map(_material, COLOURS), _material(EDGE_COLOUR)],
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._size}],
        }
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        binary = b"".join(self._chunks)
        size = _HEADER.size + 2 * _CHUNK.size + len(text) + len(binary)
        return b"".join(
            [
                _HEADER.pack(0x46546C67, 2, size),
                _CHUNK.pack(len(text), 0x4E4F534A),
                text,
                _CHUNK.pack(len(binary), 0x004E4942),
                binary,
            ]
        )

    def _vertices(self, rows: np.ndarray) -> int:
        bounds = {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self._add(
            rows, _VERTICES, {"componentType": _FLOAT, "count": len(rows), "type": "VEC3"} | bounds
        )

    def _indices(self, rows: np.ndarray) -> int:
        return self._add(rows, _INDICES, {"componentType": _UNSIGNED, "count": rows.size, "type": "SCALAR"})

    def _add(self, rows: np.ndarray, target: int, accessor: dict[str, Any]) -> int:
        data = np.ascontiguousarray(rows).tobytes()  # 4 bytes a number: the next one is aligned
        view = {"buffer": 0, "byteOffset": self._size, "byteLength": len(data), "target": target}
        self._views.append(view)
        self._chunks.append(data)
        self._size += len(data)
        self._accessors.append({"bufferView": len(self._views) - 1, **accessor})
        return len(self._accessors) - 1


def _material(colour: tuple[float, float, float]) -> dict[str, Any]:
    metal = {"baseColorFactor": [*colour, 1.0], "metallicFactor": 0.15, "roughnessFactor": 0.55}
    return {"pbrMetallicRoughness": metal, "doubleSided": True}
