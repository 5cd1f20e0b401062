"""Clients for other languages: their examples with a service, and their layout compared with NumPy's."""

import re
import sys
import time

import numpy as np
import pytest
from client_programs import LANGUAGES, ask, build, driver_source, example_source
from compiling_c import WARNINGS, compiler, run
from javascript_layouts import assert_is_where_numpy_has_it, constant
from ports import free_port
from project import MESHES
from wire import MS, frame, sealed

import proximity
from proximity.clients import EXAMPLES, client_files, write_client
from proximity.message.c_header import ENUMS, KINDS, RECORDS
from proximity.message.csharp_layout import csharp_enum, csharp_layout, pascal
from proximity.message.fields import dtype_of
from proximity.message.javascript_layout import layout_module, record_name
from proximity.service.hosting import start_service
from proximity.transport.message_key import write_key

SCENE = """\
[service]
publish = ["udp://127.0.0.1:{frames}?key=some.key"]
valid_for = 0.030
real_time = false
[fingers]
count = 1
[[parts]]
file = "{mesh}"
[input]
poses = "udp://127.0.0.1:{poses}?key=some.key"
"""
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="clients are built on POSIX systems only")


@POSIX
@pytest.mark.slow
@pytest.mark.parametrize("language", LANGUAGES)
def test_example_follows_a_finger_at_a_service(language, tmp_path):
    """It descends from 60 mm at 5 mm/s for four seconds, to 40 mm; the example writes ten lines a second."""
    folder = tmp_path / "client"
    write_client(language, folder)
    program = build(language, folder, example_source(language, folder), "example")
    ports = {"frames": free_port(), "poses": free_port()}
    write_key(str(tmp_path / "some.key"))
    scene = tmp_path / "cell.toml"
    scene.write_text(SCENE.format(mesh=MESHES / "bracket.stl", **ports))
    with start_service(scene):
        lines = ask(program, ports["frames"], ports["poses"], 4, tmp_path / "some.key").splitlines()
    distances = [
        float(found)
        for found in re.findall(r"^OK; finger 0: at (\S+) mm, pose \d+\.\d ms old$", "\n".join(lines), re.M)
    ]

    assert 10 < len(distances) <= 40 and len(lines) == 41
    scene = proximity.load(MESHES / "bracket.stl")
    first, last = 1e3 * (scene.signed_distance([[0.050, 0.020, 0.060], [0.050, 0.020, 0.040]]) - 0.007)
    assert last - 0.001 <= min(distances) < max(distances) <= first + 0.001
    assert (np.diff(distances) <= 0.0).all()
    assert re.fullmatch(r"received \d{3,}, lost \d+; not used: unverified 0(, refused 0)?", lines[-1])


@POSIX
@pytest.mark.parametrize("language", LANGUAGES)
def test_example_without_a_service_says_so(language, tmp_path):
    """Regression: it wrote STALE and an age of -0.0 ms, also with a key other than the service's."""
    program = build(language, tmp_path, example_source(language, tmp_path), "example")

    lines = ask(program, free_port(), free_port(), 0.5).splitlines()

    assert lines[:-1] == ["no frame yet"] * 5
    assert re.fullmatch(r"received 0, lost 0; not used: unverified 0(, refused 0)?", lines[-1])


@POSIX
@pytest.mark.parametrize("language", LANGUAGES)
def test_example_without_words_says_what_it_expects(language, tmp_path, capfd):
    write_client(language, tmp_path)
    program = build(language, tmp_path, example_source(language, tmp_path), "example")
    with pytest.raises(AssertionError, match="example: expected FRAMES_PORT POSES_PORT SECONDS"):
        ask(program, code=2)


@POSIX
def test_frames_and_poses_make_no_garbage_in_csharp(tmp_path):
    program = build("csharp", tmp_path, driver_source("csharp"), "driver")
    now = time.monotonic_ns()
    (tmp_path / "frame").write_bytes(sealed(frame(now, valid_for=MS)))

    told = ask(program, "garbage", free_port(), tmp_path / "frame", now)

    found = re.fullmatch(r"collections (\d+) refused (\d+) offered (\d+)\n", told)
    assert found[1] == "0"
    assert int(found[2]) > 100_000 and int(found[3]) == 200_100


def test_cpp_client_compiles_for_windows(tmp_path):
    write_client("cpp", tmp_path)
    cross = compiler("x86_64-w64-mingw32-g++", "x86_64-w64-mingw32-g++-posix")

    run(cross, "-std=c++20", *WARNINGS, tmp_path / "example.cpp", "-lws2_32", "-o", tmp_path / "example.exe")


@pytest.mark.parametrize("name", RECORDS)
def test_every_field_of_javascript_is_where_numpy_has_it(name):
    assert_is_where_numpy_has_it(constant(layout_module(), "RECORDS")[name], dtype_of(RECORDS[name][1]))


def test_every_kind_and_member_of_javascript_is_that_of_python():
    kinds, enums = constant(layout_module(), "KINDS"), constant(layout_module(), "ENUMS")

    for kind in KINDS:
        assert kinds[kind.name]["magic"] == kind.magic
        assert kinds[kind.name]["header"] == record_name(kind.header)
        assert dtype_of(RECORDS[kinds[kind.name]["record"]][1]).itemsize == kind.record_size
    for values in ENUMS.values():
        assert enums[values.__name__] == {member.name: int(member) for member in values}


SIZES = {
    "byte": 1,
    "ushort": 2,
    "uint": 4,
    "int": 4,
    "ulong": 8,
    "long": 8,
    "double": 8,
    "ProximityVector": 24,
}


@pytest.mark.parametrize("name", RECORDS)
def test_every_field_of_csharp_is_where_numpy_has_it(name):
    """Parses the source text, so it runs without a compiler."""
    text, dtype = csharp_layout(), dtype_of(RECORDS[name][1])
    sizes = SIZES | {enum: SIZES[number] for enum, number in re.findall(r"public enum (\w+) : (\w+)", text)}
    size, body = re.search(
        rf"Size = (\d+)\)\]\n    public unsafe struct Proximity{pascal(name)}\n    {{\n(.*?)\n    }}",
        text,
        re.S,
    ).groups()
    fields = re.findall(r"\[FieldOffset\((\d+)\)\] public (?:fixed )?(\w+) (\w+)(?:\[(\d+)\])?;", body)

    assert int(size) == dtype.itemsize
    assert [field[2] for field in fields] == [pascal(key) for key in dtype.names if key != "reserved"]
    for offset, kind, field, count in fields:
        part, expected = next(dtype.fields[key][:2] for key in dtype.names if pascal(key) == field)
        assert int(offset) == expected
        assert sizes[kind] * int(count or 1) == part.itemsize, field


def test_every_member_of_csharp_is_that_of_python():
    for values in ENUMS.values():
        body = re.search(rf"enum {csharp_enum(values)} : \w+\n    {{\n(.*?)\n    }}", csharp_layout(), re.S)[
            1
        ]
        found = dict(re.findall(r"^        (\w+) = (\d+),", body, re.M))
        expected = {pascal(member.name): str(int(member)) for member in values}
        assert found | expected == found and set(found) - set(expected) <= {"None"}


@pytest.mark.parametrize("language", ["csharp", "javascript", "cpp"])
def test_examples_are_short(language):
    examples = {name: text for name, text in client_files(language).items() if name in EXAMPLES}

    assert examples
    for name, text in examples.items():
        assert text.count("\n") <= 70, name
