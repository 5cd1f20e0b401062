"""Reading hostile text costs at most a multiple of an ordinary file of its size.

Regression: 28 kB after the end of a STEP file took hours, without reacting to Ctrl-C.
"""

import time
from contextlib import suppress
from functools import cache

import numpy as np
import pytest
import step_text
from mesh_files import obj, off, ply_ascii, stl_ascii

from proximity import formats
from proximity.errors import MeshFormatError
from proximity.formats import file_reader, libraries
from proximity.formats.step import conversion, product_structure
from proximity.formats.step.step_records import StepText

SIZES = [1 << power for power in (8, 9, 12, 14, 16, 18, 20)]
"""Bytes; small sizes first, so that quadratic time is found quickly."""
MULTIPLE, MIN_S = 100, 0.02

BOX = step_text.box_step((1, 2, 3))
HEAD, TAIL = BOX[: BOX.index("DATA;\n") + 6], "ENDSEC;\nEND-ISO-10303-21;\n"
REFERRING = "#1=APPLIED_DOCUMENT_REFERENCE(#2,'',(#3));\n"
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
PLY = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n{}"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n{}0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
)
BINARY_PLY = PLY.replace("ascii", "binary_little_endian")


def repeated(unit, size, before="", behind=""):
    """Return a text of about *size* bytes; {} in the unit is its number."""
    count = size // len(unit) + 1
    units = (unit.format(k) for k in range(count)) if "{}" in unit else [unit] * count
    return before + "".join(units) + behind


CASES = [
    # After the end
    *(("step", unit, BOX, "x") for unit in ("SIGNATURE ENDSEC;\n", " ", "SIGNATURE ")),
    # Records
    *(
        ("step", unit, HEAD + before, TAIL)
        for before in ("", REFERRING)
        for unit in (
            "#1=( LENGTH_UNIT ", "#1=(", "#1=A", "#1", "#1=PRODUCT_DEFINITION_SHAPE(", "#1=PRODUCT('''",
            "'''#1=CLOSED_SHELL('''", "#1=CLOSED_SHELL('',(", "#1=SHAPE_REPRESENTATION(#1,#2)",
            "#1=NEXT_ASSEMBLY_USAGE_OCCURRENCE('','',#1", "GLOBAL_UNIT_ASSIGNED_CONTEXT((",
            "SPHERICAL_SURFACE(", "/*", "'", "1.", "#1=DOCUMENT_FILE(", "#1=DOCUMENT_FILE('", ";/*", " ",
        )
    ),
    # Formats without a signature
    *((kind, unit, "", "") for kind in ("obj", "stl") for unit in (" ", " \n", "#\n", "\v")),
    *(("obj", unit, "", "") for unit in ("o\n", "mtllib \n", "v ", "v 0 0 0\n")),
    *(("obj", unit, TRIANGLE, "") for unit in ("\\\n", "1 \\\n", "f 1 2 3\\\n", "f 1/ /", "q\n")),
    *(("stl", unit, "solid\n", "\nendsolid\n") for unit in ("end ", "vertex 1 ", "nan(", "facet ", "x ")),
    ("stl", "solid\nendsolid\n", "", ""),
    *(("off", unit, "", "") for unit in ("#\n", "OFF", "OFF\n", " ")),
    ("off", "0 ", "OFF\n3 1 0\n", "x"),
    ("ply", "property float a{}\n", *PLY.format("\t", "").split("\t")),
    ("ply", "property list uchar int a{}\n", *BINARY_PLY.format("\t", "\0" * 1_000_000).split("\t")),
    ("ply", "element a{} 0\n", *PLY.format("\t", "").split("\t")),
    ("ply", " ", *PLY.format("", "\t").split("\t")),
    ("ply", "\nend_header x", "ply\n", ""),
]  # fmt: skip


@pytest.fixture(autouse=True)
def no_library(monkeypatch):
    """Make the libraries refuse; they have separate processes and limits."""

    def refuse(*_, **__):
        raise MeshFormatError("no library reads it")

    monkeypatch.setattr(libraries, "run_library", refuse)
    monkeypatch.setattr(conversion.Library, "run", refuse)


def seconds(path, text):
    """Return the processor time of reading."""
    path.write_bytes(text.encode("latin-1"))
    start = time.process_time()
    with suppress(MeshFormatError):
        formats.read_geometries(path)
    return time.process_time() - start


@cache
def ordinary(kind, size):
    if kind == "step":
        points = "".join(f"#{k}=CARTESIAN_POINT('',({k}.25,0.,1.5E1));\n" for k in range(100, size // 40))
        return BOX.replace(TAIL, points + TAIL)
    vertices = np.random.default_rng(7).normal(size=(max(size // 60, 3), 3))
    faces = np.arange(len(vertices) // 3 * 3).reshape(-1, 3)
    return {"obj": obj, "off": off, "ply": ply_ascii, "stl": stl_ascii}[kind](vertices, faces).decode()


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case[0]} {case[1]!r} after {case[2][-9:]!r}")
def test_hostile_text_costs_a_multiple_of_an_ordinary_file(tmp_path, case):
    kind, unit, before, behind = case
    path = tmp_path / f"part.{kind}"
    for size in SIZES:
        usual = seconds(path, ordinary(kind, size))
        spent = seconds(path, repeated(unit, size, before, behind))
        assert spent < MULTIPLE * max(usual, MIN_S), f"{spent:.2f} s for {size} bytes, usually {usual:.3f}"


def test_names_of_blanks_are_looked_at_once():
    """An assembly may name a part by a million blanks."""
    start = time.process_time()
    header = b'{"meshes": [{"name": "' + b" " * 1_000_000 + b'x"}]}'
    product_structure.with_names_of_products(header, StepText(""))
    assert time.process_time() - start < MULTIPLE * MIN_S


def test_numbered_names_are_found_without_trying_all():
    """The numbered names are already in use."""
    names = ["a"] * 10_000 + [f"a_{k}" for k in range(2, 10_000)]
    start = time.process_time()
    unique, _ = file_reader.unique_names(names)
    assert len(set(unique)) == len(names)
    assert time.process_time() - start < MULTIPLE * MIN_S


def test_lines_that_a_backslash_continues_keep_their_numbers(tmp_path):
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 \\\n0\nv 1 \\\n \\\n0 0\nv 0 1 0\ng a\\\nf 1 \\\n 2 3\nv 1 x 1\n")
    with pytest.raises(MeshFormatError, match=r"line 10 \(vertex 4\) has 'x'"):
        formats.read_geometries(path)
    path.write_text(path.read_text().replace("v 1 x 1\n", ""))
    (part,) = formats.read_geometries(path, units="m").geometries
    assert part.vertices.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
