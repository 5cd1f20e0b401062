"""The scene graph of a glTF document: which nodes are in the scene, in the order of the file."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from proximity.errors import MeshFormatError
from proximity.formats import text_rows
from proximity.formats.contents import check_part_count
from proximity.formats.gltf.accessors import read_matrices
from proximity.formats.gltf.buffers import Document, entries, extension, integer, numbers

NO_MESH = -1
_MAX_NODES = 200_000
_MAX_LEVELS = 16  # maximum, whose names are kept for a part, 60 letters of each
_JOINT_ROUNDING = 1e-5  # of the largest entry: chains of joints are written in single precision
_Above = tuple[np.ndarray, bool, tuple[str, ...]]
"""State inherited by a node's children: placement, whether it is hidden, names down to it."""
_TRANSFORMS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}


@dataclass(slots=True, eq=False)
class Node:
    """A node that is in the scene."""

    index: int
    name: str  # of the node, else of its mesh, else ""
    mesh: int  # or NO_MESH
    weights: tuple[float, ...]  # of morph targets: of the node, else of its mesh
    is_hidden: bool  # itself, or a node above it
    matrix: np.ndarray  # (4, 4) float64, world from node; of its skin if it has one
    above: tuple[str, ...] = ()  # names of the named nodes above it
    is_bent: bool = False  # by its skin, which is not applied

    @property
    def label(self) -> str:
        """Return the name of the node in messages."""
        return text_rows.shortened(self.name, 60) if self.name else f"node {self.index}"


def walk(document: Document) -> list[Node]:
    """Return the nodes of the default scene, parents before children, in the order of the file."""
    given = entries(document.json, "nodes")
    check_part_count(sum(isinstance(node, dict) and "mesh" in node for node in given))
    if len(given) > _MAX_NODES:
        raise MeshFormatError(f"it has {len(given)} nodes, expected at most {_MAX_NODES}")
    nodes: list[Node] = []
    seen: set[int] = set()
    top = np.eye(4), False, ()
    waiting: list[tuple[int, _Above]] = [(index, top) for index in reversed(_roots(document))]
    while waiting:
        index, (world_from_parent, is_hidden, above) = waiting.pop()
        if index in seen:
            raise MeshFormatError(f"node {index} occurs in the scene twice, expected a tree")
        seen.add(index)
        entry = document.entry("nodes", index)
        node = _node(document, entry, index, world_from_parent)
        is_shown = extension(entry, "KHR_node_visibility", f"node {index}").get("visible") is not False
        node.is_hidden, node.above = is_hidden or not is_shown, above
        nodes.append(node)
        children = [integer(child, f"the children of node {index}") for child in entries(entry, "children")]
        own = node.matrix, node.is_hidden, (*above, node.name[:60])[-_MAX_LEVELS:] if node.name else above
        waiting += [(child, own) for child in reversed(children)]
    joints = {node.index: node.matrix for node in nodes}
    for node in nodes:
        if "skin" in (entry := document.entry("nodes", node.index)):
            skin = integer(entry["skin"], f"the skin of node {node.index}")
            node.matrix, node.is_bent = _skin_placement(document, skin, joints)
    return nodes


@np.errstate(over="ignore", invalid="ignore")  # infinities are found and named later
def _skin_placement(document: Document, index: int, joints: dict[int, np.ndarray]) -> tuple[np.ndarray, bool]:
    """Return the first joint's matrix, which places a mesh instead of its node, and whether others differ."""
    skin, place = document.entry("skins", index), f"skin {index}"
    given = [integer(joint, f"the joints of {place}") for joint in entries(skin, "joints")]
    placed = np.array([joints.get(joint, np.eye(4)) for joint in given or [-1]])
    if skin.get("inverseBindMatrices") is not None:
        bind = integer(skin["inverseBindMatrices"], f"the matrices of {place}")
        mesh_to_joint = read_matrices(document, bind, place)
        if len(mesh_to_joint) < len(placed):
            raise MeshFormatError(f"{place} has {len(placed)} joints, but {len(mesh_to_joint)} matrices")
        placed = placed @ mesh_to_joint[: len(placed)]
    return placed[0], bool(np.abs(placed - placed[0]).max() > _JOINT_ROUNDING * np.abs(placed).max())


def _roots(document: Document) -> list[int]:
    if entries(document.json, "scenes"):
        scene = document.entry("scenes", integer(document.json.get("scene", 0), "the default scene"))
        return [integer(node, "the nodes of the scene") for node in entries(scene, "nodes")]
    # Without scenes every node without a parent counts.
    count = len(entries(document.json, "nodes"))
    children = {
        integer(child, f"the children of node {k}")
        for k in range(count)
        for child in entries(document.entry("nodes", k), "children")
    }
    return [k for k in range(count) if k not in children]


def _node(document: Document, entry: dict[str, Any], index: int, world_from_parent: np.ndarray) -> Node:
    given = {
        key: numbers(entry[key], length, f"the {key} of node {index}")
        for key, length in _TRANSFORMS.items()
        if entry.get(key) is not None
    }
    if "rotation" in given and not any(given["rotation"]):
        raise MeshFormatError(f"the rotation of node {index} is zero, expected a unit quaternion")
    mesh = NO_MESH if entry.get("mesh") is None else integer(entry["mesh"], f"the mesh of node {index}")
    of_mesh = {} if mesh == NO_MESH else document.entry("meshes", mesh)
    names = [entry.get("name"), of_mesh.get("name")]
    name = next((str(name) for name in names if isinstance(name, str) and name.strip()), "")
    matrix = world_from_parent @ _local_matrix(given) if given else world_from_parent
    weights = entries(entry, "weights") or entries(of_mesh, "weights")
    weights = numbers(weights, len(weights), f"the weights of node {index}")
    return Node(index, name, mesh, tuple(weights), False, matrix)


def _local_matrix(given: dict[str, list[float]]) -> np.ndarray:
    """Return the matrix parent from node: given, or made of scale, then rotation, then translation."""
    if "matrix" in given:
        return np.array(given["matrix"], dtype=np.float64).reshape(4, 4).T  # column after column
    matrix = np.eye(4)
    if "rotation" in given:
        x, y, z, w = np.array(given["rotation"], dtype=np.float64) / math.hypot(*given["rotation"])
        matrix[:3, :3] = (
            (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
            (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
            (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
        )
    if "scale" in given:
        matrix[:3, :3] *= given["scale"]
    matrix[:3, 3] = given.get("translation", 0.0)
    return matrix
