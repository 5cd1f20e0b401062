"""The scene graph of a glTF document: which nodes are in the scene, in the order of the file."""

from dataclasses import dataclass
from typing import Any

from proximity.errors import MeshFormatError
from proximity.meshio.gltf_buffers import Document, entries, integer, numbers

_TRANSFORMS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}


@dataclass(slots=True, eq=False)
class Node:
    """A node that is in the scene."""

    label: str  # unique, what trimesh knows it by
    name: str  # of the node, else of its mesh, else ""
    mesh: int | None
    is_root: bool
    has_skin: bool
    reduced: dict[str, Any]  # label, transform and children (renumbered), as trimesh shall see it


def walk(document: Document, *, named_after_meshes: bool = False) -> list[Node]:
    """Return the nodes of the default scene, parents before children, in the order of the file.

    Parameters
    ----------
    document : Document
        The file.
    named_after_meshes : bool
        The name of its mesh goes before a node's own.

    Raises
    ------
    MeshFormatError
        If nodes refer to what is not there, to one another in a circle, or have a wrong transform.
    """
    nodes: list[Node] = []
    rows: dict[int, int] = {}
    waiting: list[tuple[int, int | None]] = [(index, None) for index in reversed(_roots(document))]
    while waiting:
        index, parent = waiting.pop()
        if index in rows:
            raise MeshFormatError(f"node {index} hangs in the scene twice, expected a tree")
        entry = document.entry("nodes", index)
        rows[index] = len(nodes)
        nodes.append(_node(document, entry, index, parent is None, named_after_meshes))
        if parent is not None:
            nodes[parent].reduced["children"].append(rows[index])
        children = [integer(child, f"the children of node {index}") for child in entries(entry, "children")]
        waiting += [(child, rows[index]) for child in reversed(children)]
    return nodes


def _roots(document: Document) -> list[int]:
    if entries(document.json, "scenes"):
        scene = document.entry("scenes", integer(document.json.get("scene", 0), "the default scene"))
        return [integer(node, "the nodes of the scene") for node in entries(scene, "nodes")]
    # Without scenes everything that is nobody's child counts.
    count = len(entries(document.json, "nodes"))
    children = {
        integer(child, f"the children of node {k}")
        for k in range(count)
        for child in entries(document.entry("nodes", k), "children")
    }
    return [k for k in range(count) if k not in children]


def _node(
    document: Document, entry: dict[str, Any], index: int, is_root: bool, mesh_name_first: bool
) -> Node:
    reduced: dict[str, Any] = {"name": f"node{index}", "children": []}
    for key, length in _TRANSFORMS.items():
        if entry.get(key) is None:
            continue
        reduced[key] = numbers(entry[key], length, f"the {key} of node {index}")
    if "rotation" in reduced and not any(reduced["rotation"]):
        raise MeshFormatError(f"the rotation of node {index} is zero, expected a unit quaternion")
    mesh = None if entry.get("mesh") is None else integer(entry["mesh"], f"the mesh of node {index}")
    names = [entry.get("name"), None if mesh is None else document.entry("meshes", mesh).get("name")]
    if mesh_name_first:
        names.reverse()
    name = next((str(name) for name in names if isinstance(name, str) and name.strip()), "")
    return Node(f"node{index}", name, mesh, is_root, entry.get("skin") is not None, reduced)
