"""The layout of messages for JavaScript: its offsets are NumPy's, and Node reads what Python wrote."""

import json
import shutil
import subprocess

import numpy as np
import pytest
from javascript_layouts import assert_is_where_numpy_has_it, constant

from proximity.message import FRAME, MOVES, PATH_POSES, Message
from proximity.message.c_header import KINDS, RECORDS
from proximity.message.fields import dtype_of
from proximity.web.layout import page_layout
from proximity.web.scene_page import PAGE
from proximity.web.slice_fields import SLICE_FIELDS

ALL = {name: fields for name, (_, fields) in RECORDS.items()} | {"slice_header": SLICE_FIELDS}


@pytest.mark.parametrize("name", ALL)
def test_every_field_is_where_numpy_has_it(name):
    assert_is_where_numpy_has_it(constant(page_layout(), "RECORDS")[name], dtype_of(ALL[name]))


def test_every_kind_is_there():
    reported = constant(page_layout(), "KINDS")

    for kind in KINDS:
        assert reported[kind.name]["magic"] == kind.magic
        records = constant(page_layout(), "RECORDS")
        assert records[reported[kind.name]["header"]]["size"] == kind.header_size
        assert records[reported[kind.name]["record"]]["size"] == kind.record_size


def node(folder, script, *words):
    """What a script of Node says, with the page's modules beside it."""
    program = shutil.which("node")
    if program is None:
        pytest.skip("there is no Node here: the layout is checked by its numbers alone")
    (folder / "layout.mjs").write_text(page_layout(), encoding="utf-8")
    text = (PAGE / "message.js").read_text(encoding="utf-8").replace("./layout.js", "./layout.mjs")
    (folder / "message.mjs").write_text(text, encoding="utf-8")
    (folder / "script.mjs").write_text(script, encoding="utf-8")
    done = subprocess.run(
        [program, folder / "script.mjs", *map(str, words)], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def filled(kind, count):
    """A message whose every byte is some number."""
    message = Message(kind, count)
    rng = np.random.default_rng(7)
    for array in (message.header, message.records):
        for name in array.dtype.names:
            if name in ("magic", "checksum", "version", "header_size", "size", "count", "name"):
                continue
            base = array.dtype[name].base
            shape = array[name].shape
            if base.kind == "f":
                array[name] = rng.normal(size=shape)
            else:
                array[name] = rng.integers(0, 2**31 if base.itemsize > 2 else 200, shape)
    if kind is MOVES:
        message.records["name"] = [f"part {k} ä".encode() for k in range(count)]
    return message


READ = """
import fs from "node:fs";
import { decode } from "./message.mjs";
const bytes = fs.readFileSync(process.argv[2]);
const read = decode(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
console.log(JSON.stringify(read, (key, value) => typeof value === "bigint" ? String(value) : value));
"""


@pytest.mark.parametrize("kind", [FRAME, PATH_POSES, MOVES], ids=lambda kind: kind.name)
def test_node_reads_what_python_wrote(kind, tmp_path):
    message = filled(kind, 3)
    (tmp_path / "bytes").write_bytes(message.seal(12345678901234567890, 3).tobytes())

    read = json.loads(node(tmp_path, READ, tmp_path / "bytes"))

    assert read["kind"] == kind.name
    same(read["header"], message.header)
    for found, record in zip(read["records"], message.records, strict=True):
        same(found, record)


def same(found, record):
    """Whether an object of JavaScript says what a record does."""
    for name in record.dtype.names:
        if name == "reserved":
            continue
        value = record[name]
        if record.dtype[name].kind == "S":
            assert found[name] == value.item().decode()
        elif record.dtype[name].base.str.endswith("8") and record.dtype[name].base.kind in "iu":
            assert int(found[name]) == int(value)
        else:
            np.testing.assert_array_equal(np.asarray(found[name]).reshape(np.shape(value)), value)


WRITE = """
import fs from "node:fs";
import { encode } from "./message.mjs";
const corners = Array.from({ length: 195 }, (_, k) => k / 7);
const records = [
  { finger: 3, pose_ns: 1234567890123456789n, position: [0.1, 0.2, 0.3], velocity: [NaN, NaN, NaN],
    bend: 0.5, corners },
];
fs.writeFileSync(process.argv[2], new Uint8Array(encode("path_poses", { send_ns: 5n }, records)));
const move = { name: "Rad ü", pose_ns: 7n, rotation: [1, 0, 0, 0, 1, 0, 0, 0, 1], translation: [1, 2, 3],
  velocity: [0, 0, 0], angular_velocity: [0, 0, 0] };
fs.writeFileSync(process.argv[3], new Uint8Array(encode("moves", { send_ns: 5n }, [move])));
"""


def test_python_takes_what_node_wrote(tmp_path):
    from proximity.message import parts_of, validate

    node(tmp_path, WRITE, tmp_path / "poses", tmp_path / "moves")

    data = np.frombuffer((tmp_path / "poses").read_bytes(), np.uint8)
    assert validate(data, PATH_POSES) is None
    header, records = parts_of(data, PATH_POSES)
    assert (header["send_ns"], records["finger"][0], records["pose_ns"][0]) == (5, 3, 1234567890123456789)
    np.testing.assert_array_equal(records["corners"][0].reshape(-1), np.arange(195) / 7)
    assert np.isnan(records["velocity"]).all()

    data = np.frombuffer((tmp_path / "moves").read_bytes(), np.uint8)
    assert validate(data, MOVES) is None
    assert parts_of(data, MOVES)[1]["name"][0].decode() == "Rad ü"
