"""Words that the product does not use; the usual ones are in docs/design/layers.md."""

import ast
import io
import re
import tokenize

import pytest
from pages import PAGES
from project import ROOT

INSTEAD = {
    "told": "given, reported", "foretell": "predict", "shelf": "model", "settled": "compiled",
    "loose": "dynamic", "holders": "containing parts", "wearing": "glove set",
    "doubt": "uncertainty, release", "room": "workspace, scratch, clearance", "sight": "distance sample",
    "ease": "tolerance", "patience": "adaptive tolerance", "fronts": "frontiers", "editing": "reload",
    "saying": "announcement", "making": "assembly", "door": "interface, adapter", "house": "package",
}  # fmt: skip
INSTEAD_IN_ENGINE = {
    "place": "position, location, offset", "places": "positions, locations, offsets",
    "way": "path, direction, displacement", "ways": "paths, directions, displacements",
    "front": "coherent search, frontier", "top": "static tree, trees over parts", "folds": "folded faces",
    "crossings": "self-intersections", "bracket": "bounds",
}  # fmt: skip
ENGINE = {"errors.py", "checks.py", "pose.py", "system", "native", "kernels", "mesh", "scene", "tracker"}
PREFIXES = {"links": ("LINK_",)}
"""Tables of the kernels, and the prefixes of their columns."""
FILES = sorted((ROOT / "proximity").rglob("*.py"))


def words_of(name):
    """Return the words of an identifier, in lower case."""
    return {word.lower() for part in name.split("_") for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+", part)}


@pytest.mark.parametrize("folder", sorted({path.relative_to(ROOT).parts[1] for path in FILES}))
def test_retired_words_are_no_names(folder):
    found = []
    for path in FILES:
        if path.relative_to(ROOT).parts[1] != folder:
            continue
        for token in tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline):
            if token.type == tokenize.NAME and (retired := words_of(token.string) & INSTEAD.keys()):
                word = retired.pop()
                found.append(f"{path.name}:{token.start[0]}: {token.string}, write {INSTEAD[word]}")

    assert not found


def names_in(path):
    """Return the tokens of a file's identifiers, except imported ones."""
    tokens = list(tokenize.generate_tokens(io.StringIO(path.read_text(encoding="utf-8")).readline))
    imported = {
        alias.asname or alias.name
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    return [token for token in tokens if token.type == tokenize.NAME and token.string not in imported]


@pytest.mark.parametrize("folder", sorted(ENGINE))
def test_retired_words_are_no_names_in_the_engine(folder):
    found = [
        f"{path.name}:{token.start[0]}: {token.string}, write {INSTEAD_IN_ENGINE[word]}"
        for path in FILES
        if path.relative_to(ROOT).parts[1] == folder
        for token in names_in(path)
        for word in words_of(token.string) & INSTEAD_IN_ENGINE.keys()
    ]

    assert not found


def constants_of(path):
    """Return the names of a file's module-level constants."""
    return {
        name.id
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.Assign)
        for target in node.targets
        for name in ast.walk(target)
        if isinstance(name, ast.Name) and name.id.isupper()
    }


def test_glossary_of_the_documentation_is_sorted_and_names_what_there_is():
    rows = re.findall(r"^\| ([^|`]+) \| (`[^|]+`) \|", PAGES["reference/glossary.md"], re.MULTILINE)
    sources = "\n".join(path.read_text(encoding="utf-8") for path in FILES)
    there = {*re.findall(r"\w+", sources)}

    assert [term for term, _ in rows] == sorted((term for term, _ in rows), key=str.lower)
    assert len(rows) == PAGES["reference/glossary.md"].count("\n| ") - 1
    assert [name for _, names in rows for name in re.findall(r"`(\w+)`", names) if name not in there] == []


def test_a_constant_of_the_kernels_has_one_home():
    """Files share a constant instead of repeating it, and different numbers have different names."""
    homes = {}
    for path in sorted((ROOT / "proximity" / "kernels").rglob("*.py")):
        for name in constants_of(path):
            homes.setdefault(name, []).append(path.name)

    assert {name: files for name, files in homes.items() if len(files) > 1} == {}


def test_columns_carry_the_name_of_their_table():
    """E.g. ``links[LINK_LEFT]``: another table's column is a mistake."""
    found = [
        f"{path.name}:{node.lineno}: {name}"
        for path in sorted((ROOT / "proximity" / "kernels").rglob("*.py"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.Subscript) and table_of(node.value) in PREFIXES
        for name in columns_in(node.slice)
        if not name.startswith(PREFIXES[table_of(node.value)])
    ]

    assert not found


def table_of(node):
    """Return the name of the indexed array: ``links`` of ``tree.links[node, LINK_PARENT]``."""
    return node.attr if isinstance(node, ast.Attribute) else getattr(node, "id", "")


def columns_in(index):
    """Return the constants of an index, except in nested subscripts."""
    if isinstance(index, ast.Subscript):
        return set()
    if isinstance(index, ast.Name):
        return {index.id} if index.id.isupper() else set()
    return {name for child in ast.iter_child_nodes(index) for name in columns_in(child)}


def test_words_of_names_are_seen():
    assert words_of("_told_ns") == {"told", "ns"}
    assert words_of("ToldPart") == {"told", "part"}
    assert words_of("ROOM_SIZE") == {"room", "size"}
    assert words_of("follow") == {"follow"}


def test_columns_of_a_table_are_seen():
    node = ast.parse("tree.links[pair[PAIR_FIRST], LINK_PARENT + 1]", mode="eval").body

    assert table_of(node.value) == "links"
    assert columns_in(node.slice) == {"LINK_PARENT"}
