"""Read the products of a STEP file, check and count their uses in assemblies, and find their names.

OpenCASCADE silently ignores a use without a placement, and puts a shape without a product at the origin. So
products and their uses are read here, from a few kinds of records. Files that place shapes in another way
(mapped items) are not checked.
"""

import graphlib
import json
import re
from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from proximity.errors import MeshFormatError
from proximity.formats.step.step_records import StepText

_USE = "NEXT_ASSEMBLY_USAGE_OCCURRENCE"
_PLACEMENT = "CONTEXT_DEPENDENT_SHAPE_REPRESENTATION"
_SHAPE = "SHAPE_DEFINITION_REPRESENTATION"
_RELATION = "SHAPE_REPRESENTATION_RELATIONSHIP"
_OF = ("PRODUCT_DEFINITION_SHAPE", "PROPERTY_DEFINITION")
_BODIES = ("MANIFOLD_SOLID_BREP", "BREP_WITH_VOIDS", "FACETED_BREP", "SHELL_BASED_SURFACE_MODEL")
_OTHER_PLACEMENTS = ("MAPPED_ITEM", "INVISIBILITY")
"""Records that place shapes in another way, or omit them on purpose."""

_PRODUCT = "PRODUCT_DEFINITION(?:_WITH_ASSOCIATED_DOCUMENTS)?"
_KINDS = (_USE, _PLACEMENT, _SHAPE, _RELATION, *_OF, *_BODIES, _PRODUCT, r"\w*SHAPE_REPRESENTATION")
_SHAPE_GIVING = ("SHAPE_DEFINITION_REPRESENTATION", "REPRESENTATION_RELATIONSHIP")
"""Ends of the names of records that assign shapes to products. Shapes, colours and texts belong to them."""

_NO_NAME = re.compile(
    r"((SOLID|COMPOUND|COMPSOLID|SHELL|FACE|ASSEMBLY|NAUO)?[_ ]?\d*|=>\[[\d:]*\]|"
    r"Open CASCADE STEP translator.*)"
)
"""Pattern of default names that programs write."""


@dataclass(slots=True)
class _Records:
    """Records about products in a file, by their numbers."""

    uses: dict[str, tuple[str, str]] = field(default_factory=dict)  # use -> definitions of assembly and part
    placements: list[tuple[str, str]] = field(default_factory=list)  # relation of shapes, placement
    shapes: list[tuple[str, str]] = field(default_factory=list)  # owner, representation
    links: dict[str, str] = field(default_factory=dict)  # owner of a shape -> record that links it
    products: set[str] = field(default_factory=set)
    owners: dict[str, str] = field(default_factory=dict)  # product definition shape -> its use or product
    relations: dict[str, list[str]] = field(default_factory=dict)  # relation -> two representations
    contents: dict[str, list[str]] = field(default_factory=dict)  # representation -> items
    bodies: set[str] = field(default_factory=set)


def count_bodies(text: StepText) -> int:
    """Return the minimum number of meshes in the assemblies of a file, or 0 if unknown."""
    if _USE not in text.blank or any(word in text.blank for word in _OTHER_PLACEMENTS):
        return 0
    records = _read(text)
    placed = {records.owners.get(placement) for _, placement in records.placements}
    shapes = defaultdict(list)
    for of, shape in records.shapes:
        if of in records.owners:
            shapes[records.owners[of]].append(shape)
    children = defaultdict(list)
    for use, (assembly, part) in records.uses.items():
        # A part without any shape, as in lists of material, need not be placed.
        if part in shapes and use not in placed:
            raise MeshFormatError(f"{_USE} {use} has no {_PLACEMENT}: a part of the assembly has no position")
        for product in (assembly, part):
            if use in placed and product not in shapes:
                raise MeshFormatError(
                    f"PRODUCT_DEFINITION {product} is part of an assembly, but has no {_SHAPE}: "
                    "its shape is missing"
                )
        children[assembly].append(part)
    return _count(records, shapes, children)


@dataclass(frozen=True, slots=True)
class Products:
    """Products of a file that have a shape, by the numbers of their definitions."""

    shapes: dict[str, tuple[str, str]]  # product -> its link to the shape, representation
    links: dict[str, str]  # link -> record that gives it the representation
    assemblies: set[str]
    roots: list[str]  # products with a shape that are not a part of another
    has_bodies: Callable[[str], bool]


def products_of(text: StepText) -> Products:
    """Return the products in the text of a file."""
    records = _read(text)
    # Properties, like the volume for a check, have shapes too: these belong to an aspect, not to a product.
    owners = {of: own for of, own in records.owners.items() if own in records.products}
    shapes = {owners[of]: (of, shape) for of, shape in records.shapes if of in owners}
    parts = {part for _, part in records.uses.values()}
    linked = _linked(records)
    return Products(
        shapes=shapes,
        links=records.links,
        assemblies={assembly for assembly, _ in records.uses.values()},
        roots=[product for product in shapes if product not in parts],
        has_bodies=lambda product: _has_body(records, linked, [shapes[product][1]]),
    )


def used_records(text: StepText) -> set[str]:
    """Return the numbers of the records that belong to a product or to a relation of shapes."""
    records = {record.own: record for record in text.records(r"\w*+")}
    waiting = [
        record.own
        for record in records.values()
        if (record.kind or record.arguments.partition("(")[0].strip()).endswith(_SHAPE_GIVING)
    ]
    used = set(waiting)
    while waiting:
        record = records.get(waiting.pop())
        new = [other for other in (record.references if record else ()) if other not in used]
        used.update(new)
        waiting += new
    return used


def _read(text: StepText) -> _Records:
    """Read the records about products and sort them by kind."""
    records = _Records()
    for record in text.records(*_KINDS):
        own_id, kind, references = record.own, record.kind, record.references
        if kind in _BODIES:
            records.bodies.add(own_id)
        elif kind in _OF:
            records.owners[own_id] = references[-1] if references else ""
        elif kind.startswith("PRODUCT_DEFINITION"):
            records.products.add(own_id)
        elif len(references) < 2:
            continue
        elif kind == _USE:
            records.uses[own_id] = (references[0], references[1])
        elif kind == _PLACEMENT:
            records.placements.append((references[0], references[1]))
        elif kind == _SHAPE:
            records.shapes.append((references[0], references[1]))
            records.links[references[0]] = own_id
        elif kind == _RELATION:
            records.relations[own_id] = references[:2]
        else:
            records.contents[own_id] = references
    return records


def _count(records: _Records, shapes: dict[str, list[str]], children: dict[str, list[str]]) -> int:
    """Return the number of bodies that the root products contain, including repeated uses."""
    try:
        order = list(graphlib.TopologicalSorter(children).static_order())  # parts before their assemblies
    except graphlib.CycleError as reason:
        raise MeshFormatError(
            f"PRODUCT_DEFINITION {reason.args[1][0]} is part of itself, expected a tree"
        ) from None
    linked = _linked(records)
    counts: dict[str, int] = {}
    for product in order:
        counts[product] = _has_body(records, linked, shapes.get(product, [])) + sum(
            counts[part] for part in children.get(product, ())
        )
    parts = {part for held in children.values() for part in held}
    return sum(count for product, count in counts.items() if product not in parts)


def _linked(records: _Records) -> dict[str, list[str]]:
    """Return the representations that belong to the same product, such as axes and solids.

    Relations that place a part are omitted.
    """
    placements = {relation for relation, _ in records.placements}
    linked = defaultdict(list)
    for relation, (first, second) in records.relations.items():
        if relation not in placements:
            linked[first].append(second)
            linked[second].append(first)
    return linked


def _has_body(records: _Records, linked: dict[str, list[str]], shapes: list[str]) -> bool:
    waiting = list(shapes)
    seen = set(waiting)
    while waiting:
        shape = waiting.pop()
        if not records.bodies.isdisjoint(records.contents.get(shape, ())):
            return True
        new = [other for other in linked.get(shape, ()) if other not in seen]
        seen.update(new)
        waiting += new
    return False


def with_names_of_products(header: bytes, text: StepText) -> bytes:
    """Return the JSON of a GLB document in which nodes are named after products.

    The name of its product is preferred to a node's own name, and both are preferred to the names of the
    nodes above it. An assembly keeps its own name, because two assemblies of one product differ in it.
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
        name = next((str(name) for name in names if _is_name(name)), "")
        node["name"] = own if not mesh and _is_name(own) else name
        waiting += [(child, name) for child in node.get("children", ())]
    for mesh in meshes:
        mesh.pop("name", None)
    return json.dumps(document).encode()


def _is_name(name: Any) -> bool:
    return isinstance(name, str) and not _NO_NAME.fullmatch(name.strip())


def _products_of_uses(text: StepText) -> dict[str | None, str]:
    """Return the names of products by the names of their uses in assemblies.

    Names of several uses are omitted.
    """
    above: dict[str, str] = {}  # definition -> formation, and formation -> product
    names: dict[str, str] = {}
    uses: list[tuple[str, str]] = []  # name, definition of the part
    for record in text.records(_USE, _PRODUCT, r"PRODUCT_DEFINITION_FORMATION\w*+", "PRODUCT"):
        own_name = next((string for string in record.strings[1::-1] if string), "")
        if record.kind == "PRODUCT":
            names[record.own] = own_name
        elif record.kind == _USE:
            uses += [(own_name, part) for part in record.references[1:2]]
        elif record.references:
            above[record.own] = record.references[0]
    named = [(use, names.get(above.get(above.get(part, ""), ""), "")) for use, part in uses]
    counts = Counter(use for use, _ in named)
    # A text with a backslash is encoded and is not decoded here.
    return {use: name for use, name in named if counts[use] == 1 and "\\" not in name}
