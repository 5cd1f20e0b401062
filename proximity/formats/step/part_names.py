"""Names of parts: those of products, and of what is above a solid that has none of its own."""

import json
import re
from collections import Counter
from typing import Any

_TEXT = r"'((?:[^']|'')*)'"
_USE = re.compile(
    rf"=\s*NEXT_ASSEMBLY_USAGE_OCCURRENCE\s*\(\s*{_TEXT}\s*,\s*{_TEXT}\s*,[^;#]*#\d+\s*,\s*(#\d+)"
)
_DEFINITION = re.compile(
    r"(#\d+)\s*=\s*PRODUCT_DEFINITION(?:_FORMATION\w*|_WITH_ASSOCIATED_DOCUMENTS)?\s*\([^;#]*(#\d+)"
)
_PRODUCT = re.compile(rf"(#\d+)\s*=\s*PRODUCT\s*\(\s*{_TEXT}\s*,\s*{_TEXT}")
_NO_NAME = re.compile(
    r"\s*((SOLID|COMPOUND|COMPSOLID|SHELL|FACE|ASSEMBLY|NAUO)?[_ ]?\d*|=>\[[\d:]*\]|"
    r"Open CASCADE STEP translator.*)\s*"
)
"""Names that programs give where people gave none."""


def with_names_of_products(header: bytes, text: str) -> bytes:
    """Return the header of a GLB document in which nodes are named as people know them.

    The name of its product goes before a node's own, and both before those of the nodes above it.
    """
    document: dict[str, Any] = json.loads(header)
    nodes, meshes = document.get("nodes", []), document.get("meshes", [])
    is_named = all(_is_name(mesh.get("name")) for mesh in meshes)
    products = {} if is_named else _products_of_uses(text)
    children = {child for node in nodes for child in node.get("children", ())}
    waiting = [(row, "") for row in range(len(nodes)) if row not in children]
    while waiting:
        row, above = waiting.pop()
        node = nodes[row]
        own, mesh = node.get("name"), meshes[node["mesh"]] if "mesh" in node else {}
        names = mesh.get("name"), products.get(own), own, above
        node["name"] = next((name for name in names if _is_name(name)), "")
        waiting += [(child, node["name"]) for child in node.get("children", ())]
    for mesh in meshes:
        mesh.pop("name", None)
    return json.dumps(document).encode()


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and not _NO_NAME.fullmatch(name)


def _products_of_uses(text: str) -> dict[str | None, str]:
    """Names of products by the names of their uses in assemblies, where these differ."""
    above = dict(_DEFINITION.findall(text))
    names = {own: name or id_ for own, id_, name in _PRODUCT.findall(text)}
    uses = [
        (name or id_, names.get(above.get(above.get(part, ""), ""), ""))
        for id_, name, part in _USE.findall(text)
    ]
    counts = Counter(use for use, _ in uses)
    # A text with a backslash is encoded.
    return {use: name for use, name in uses if counts[use] == 1 and "\\" not in name}
