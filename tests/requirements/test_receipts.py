"""Receipts: confirmed where nothing differs, otherwise a sentence for each difference."""

import json
import shutil

import pytest
from requirement_files import save_cubes, write_file

from proximity import ServiceError, verify
from proximity.requirements.receipts import check_receipt, write_receipt

ENTRIES = (
    'between = ["base", "near"]\ngap = { least = 1 }',
    'between = ["near", "base"]\nalong = [0, 1, 0]\ngap = { least = 1 }',
    'clash = { deepest = 0.5 }\nallowed = [["core", "base"]]',
)


@pytest.fixture
def receipt(tmp_path):
    folder = tmp_path / "author"
    folder.mkdir()
    save_cubes(folder)
    write_receipt(folder / "receipt.json", verify(write_file(folder, *ENTRIES)))
    return folder / "receipt.json"


def change(receipt, *keys, value):
    """Change a value in a receipt."""
    content = json.loads(receipt.read_text())
    table = content
    for key in keys[:-1]:
        table = table[key]
    table[keys[-1]] = value
    receipt.write_text(json.dumps(content))


def test_receipt_is_confirmed_also_in_another_folder(receipt, tmp_path):
    assert check_receipt(receipt).differences == ()
    shutil.copytree(receipt.parent, tmp_path / "reader")
    shutil.rmtree(receipt.parent)
    checked = check_receipt(tmp_path / "reader" / "receipt.json")
    assert (checked.differences, checked.notes) == ((), ())
    assert str(checked.verification.verdict) == "is violated"


def test_receipt_names_files_relative_to_its_folder(receipt):
    content = json.loads(receipt.read_text())
    assert content["requirements"] == "fit.toml" and {*content["files"]} == {"fit.toml", "cubes.prox"}
    assert content["results"]["r1"]["pairs"]["'near' and 'base'"]["bounds"] == [None, None]  # infinite
    assert len(content["geometry"]) == len(content["program"]) == 64


def test_receipt_is_checked_against_a_file_elsewhere(receipt, tmp_path):
    shutil.move(receipt, tmp_path / "receipt.json")
    with pytest.raises(ServiceError, match=r"fit\.toml"):
        check_receipt(tmp_path / "receipt.json")
    assert check_receipt(tmp_path / "receipt.json", receipt.parent / "fit.toml").differences == ()


@pytest.mark.parametrize(
    ("keys", "value", "words"),
    [
        (("verdict",), "holds", "verdict is holds in the receipt, and is violated now"),
        (("results", "r2", "verdict"), "holds", "results: r2: verdict is holds in the receipt"),
        (
            ("results", "r2", "pairs", "'base' and 'deep'", "bounds"),
            [0.1, 0.2],
            "'base' and 'deep': bounds is 0.1 in",
        ),
        (("results", "r0", "pairs", "'base' and 'near'", "verdict"), "is violated", "r0: pairs: 'base' and"),
        (("results", "r0", "limits"), [0.0001, None], "results: r0: limits is 0.0001 in the receipt"),
        (("results", "r9"), {}, "results: r9 is present in the receipt, and missing now"),
        (("settings", "step_tolerance"), 1.0, "settings: step_tolerance is 1.0 in the receipt, and 0.01 now"),
        (("files", "cubes.prox"), "0", "files: cubes.prox is 0 in the receipt"),
        (("geometry",), "0", "geometry is 0 in the receipt"),
        (("results",), [], "results is present in the receipt, and present now"),
    ],
)
def test_changed_receipt_is_not_confirmed(receipt, keys, value, words):
    change(receipt, *keys, value=value)
    found = check_receipt(receipt).differences
    assert len(found) == (2 if keys[-1] == "bounds" else 1) and words in found[0]


def test_another_program_is_a_note(receipt):
    change(receipt, "version", value="0.0.9")
    checked = check_receipt(receipt)
    assert checked.differences == () and checked.notes[0].startswith("version is 0.0.9 in the receipt")


def test_changed_model_has_another_hash_geometry_and_bounds(receipt):
    save_cubes(receipt.parent, deviation=1e-5)
    found = check_receipt(receipt).differences
    assert any(each.startswith("files: cubes.prox") for each in found)
    assert any("bounds" in each for each in found) and not any("geometry" in each for each in found)


def test_rounding_of_bounds_is_no_difference(receipt):
    content = json.loads(receipt.read_text())
    bounds = content["results"]["r0"]["pairs"]["'base' and 'near'"]["bounds"]
    change(
        receipt,
        "results",
        "r0",
        "pairs",
        "'base' and 'near'",
        "bounds",
        value=[b * (1 + 1e-12) for b in bounds],
    )
    assert check_receipt(receipt).differences == ()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "has no key 'requirements'"),
        ('{"receipt": 1}', "has no key 'requirements'"),
        ('{"receipt": 9, "requirements": "fit.toml"}', "has format 9, expected 1"),
    ],
)
def test_file_that_is_not_a_receipt_is_named(tmp_path, text, words):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(ServiceError, match=f"a.json: {words}"):
        check_receipt(tmp_path / "a.json")
    with pytest.raises(ServiceError, match=r"none\.json: cannot be read"):
        check_receipt(tmp_path / "none.json")
