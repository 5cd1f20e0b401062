"""Words that the product does not use: the field has others, see docs/development.md."""

import io
import re
import tokenize

import pytest
from project import ROOT

INSTEAD = {
    "told": "given, reported",
    "foretell": "predict",
    "shelf": "model",
    "settled": "compiled",
    "loose": "dynamic",
    "holders": "containing parts",
    "wearing": "glove set",
    "doubt": "uncertainty, release",
    "room": "workspace, scratch, clearance",
    "sight": "distance sample",
    "ease": "tolerance",
    "patience": "adaptive tolerance",
    "fronts": "frontiers",
    "editing": "reload",
    "saying": "announcement",
    "making": "assembly",
    "door": "interface, adapter",
    "house": "package",
}
FILES = sorted((ROOT / "proximity").rglob("*.py"))


def words_of(name):
    """The words of an identifier, in lower case."""
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


def test_words_of_names_are_seen():
    assert words_of("_told_ns") == {"told", "ns"}
    assert words_of("ToldPart") == {"told", "part"}
    assert words_of("ROOM_SIZE") == {"room", "size"}
    assert words_of("follow") == {"follow"}
