"""``proximity picture``."""

import sys

import pytest
import shapes
from PIL import Image
from project import MESHES

import proximity

pytest.importorskip("pyvista", reason="pictures need PyVista: pip install cad-proximity[picture]")

BOX = MESHES / "box.stl"
COMMAND = ("picture",)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_picture_is_written(run, tmp_path):
    (tmp_path / "points.csv").write_text("x,y,z\n20,15,25\n20,15,10\n")

    result = run(BOX, "--points", "points.csv", "--slice", "z=-3", "--size", "640x360", "-o", "box.png")

    assert (result.code, result.err) == (0, "")
    assert result.out.startswith("box.png: 640 x 360 pixels, ")
    with Image.open(tmp_path / "box.png") as image:
        assert (image.format, image.size) == ("PNG", (640, 360))


def test_distances_without_a_sign_are_noted(run, tmp_path):
    vertices, faces = shapes.open_box()
    proximity.Scene([proximity.Solid(0.01 * vertices, faces, name="tray")]).save(tmp_path / "tray.prox")

    result = run("tray.prox", "--slice", "z=5", "--size", "640x360", "-o", "tray.png")

    assert result.code == 0
    assert " ".join(result.err.split()) == (
        "proximity: note: parts without an inside: 1 of 1; "
        "distances from them have no sign, and `proximity check` gives the reason"
    )
    assert run("tray.prox", "--size", "640x360", "-o", "tray.png").err == ""  # without distances


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("-o", "box.png", "--view", "above"), "no view 'above', expected one of iso"),
        (("-o", "nowhere/box.png"), "nowhere/box.png: cannot be written"),
    ],
)
def test_what_cannot_be_drawn_is_refused(run, tmp_path, options, sentence):
    result = run(BOX, *options)
    assert (result.code, result.out) == (2, "") and sentence in result.words
    assert not list(tmp_path.glob("*.png"))


def test_missing_library_is_reported_before_the_file_is_read(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)

    result = run("none.stl", "-o", "none.png")

    assert (result.code, result.out) == (2, "")
    assert 'pip install "cad-proximity[picture]"' in result.words
