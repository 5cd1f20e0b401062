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
    "bracket": "bounds",
}  # fmt: skip
PUBLIC = {"thin_places"}
"""Names that users expect, from the words of their trade."""
ENGINE = {"errors.py", "checks.py", "pose.py", "system", "native", "kernels", "mesh", "scene", "tracker"}
PHRASES = {
    "nobody, whoever": (r"(?:nobody|somebody|anybody|whoever|whatever|everybody)", 8, "the caller, any"),
    "what is": (r"what (?:is|was|are|has|have|comes|stands|lies|it|they|may|can|does|holds)", 40, "the noun"),
    "is no": (r"(?:is|are|was|be) no (?!longer|more\b)\w+", 20, "is not a, has no, without"),
    "is asked": (r"(?:is|are|was|were|be|been|being|has|have|had) asked|asks? (?:of|for)", 6, "requests"),
    "goes on": (r"(?:goes|go|went|going) (?:on|out|in|away|ahead)", 8, "continues, leaves, enters"),
    "anew": (r"(?:anew|for ever|give or take|at once|once more)", 10, "again, forever, within, immediately"),
    "so much": (r"(?:so|as|that) (?:much|many|few|far|long|often)(?! as possible)", 30, "the quantity"),
    "of its own": (r"of (?:its|their) own|by (?:itself|themselves)", 20, "own, separate, alone"),
    "told": (r"(?:told|tells|tell|said of|says of|say of|speaks?|spoken)", 6, "reported, given, states"),
    "looks at": (r"look(?:s|ed|ing)? (?:at|for|into|after|up|behind)", 15, "search, inspect, read"),
    "stands in": (r"(?:stands?|lies|stood) (?:for|in|on|at|there|behind|beside|before)", 12, "is"),
    "is meant": (r"(?:is|are|was) meant", 6, "is for, denotes"),
    "of which": (r"(?:of which|of whom|of those|of these|of such|such that|but for)", 30, "whose, except"),
    "meanwhile, beside": (r"(?:meanwhile|besides?|thereby|therein|hence|thus|wherein|lest)", 25, "next to"),
    "something, nothing": (r"(?:things?|something|anything|everything|nothing)", 70, "its name"),
}  # fmt: skip
"""Phrases of prose: pattern, hits allowed in 100 000 words, and what to write instead."""
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
        if token.string not in PUBLIC
        for word in words_of(token.string) & INSTEAD_IN_ENGINE.keys()
    ]

    assert not found


def prose_of(path):
    """Docstrings, comments and sentences of a source file, or the text of a page without its code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return re.sub(r"^```.*?^```|<!--.*?-->", "", text, flags=re.DOTALL | re.MULTILINE)
    if path.suffix != ".py":
        comments = re.findall(r"/\*.*?\*/|//[^\n]*", text, re.DOTALL)
        return re.sub(r"\n\s*(?:\*|//)?", " ", "\n".join(comments))
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return " ".join(
        re.sub(r"\s+", " ", token.string.lstrip("# "))
        for token in tokens
        if token.type == tokenize.COMMENT or (token.type == tokenize.STRING and len(token.string.split()) > 3)
    )


def hits_of(name, prose):
    return re.findall(rf"\b(?:{PHRASES[name][0]})\b", prose, re.IGNORECASE)


@pytest.fixture(scope="module")
def prose():
    suffixes = {".py", ".c", ".h", ".hpp", ".cs", ".js", ".ts", ".in", ".md"}
    folders = [ROOT / name for name in ("proximity", "docs", "bench", "tools")]
    files = [path for folder in folders for path in folder.rglob("*")]
    pages = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")]
    kept = [path for path in files if path.suffix in suffixes and "vendor" not in path.parts]
    return "\n".join(prose_of(path) for path in [*pages, *kept])


@pytest.mark.parametrize("name", PHRASES)
def test_phrases_that_have_a_plainer_word_are_rare(name, prose):
    _, limit, instead = PHRASES[name]
    assert len(hits_of(name, prose)) <= limit * 1e-5 * len(prose.split()), f"write {instead}"


def test_phrases_are_seen(tmp_path):
    path = tmp_path / "module.py"
    path.write_text('"""Whoever asks\n    for it is told what is left."""\nx = 1  # at once\n', "utf-8")

    found = prose_of(path)

    assert [name for name in PHRASES if hits_of(name, found)] == [
        "nobody, whoever", "what is", "is asked", "anew", "told",
    ]  # fmt: skip


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
