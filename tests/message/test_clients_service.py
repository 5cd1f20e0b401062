"""Examples of the clients at a real service; garbage in C#; Windows and Unity, as far as compilers tell."""

import re
import sys
import time

import pytest
from client_programs import LANGUAGES, ask, build, driver_source, example_source
from compiling_c import WARNINGS, compiler, run
from ports import free_port
from project import MESHES
from wire import MS, frame, sealed

from proximity.message.clients import write_client
from proximity.service.hosting import start_service
from proximity.transport.message_key import write_key

SCENE = """\
[service]
publish = ["udp://127.0.0.1:{frames}?key=some.key"]
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
    """The bracket's foot is 4 mm thick there: a fingertip of 7 mm at 60 mm is 49 mm away."""
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
        float(found) for found in re.findall(r"OK age .* ms; finger 0: at (\S+) mm", "\n".join(lines))
    ]

    assert len(distances) > 20
    # It comes down at 5 mm a second from 49 mm, for four seconds.
    assert 28.0 < min(distances) < 45.0 and max(distances) < 49.001
    assert min(distances) < max(distances)
    assert re.fullmatch(r"received \d{3,}, lost \d+", lines[-1])


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


UNITY = """
namespace UnityEngine
{
    public struct Vector3 { public float x, y, z; }
    public class HideInInspectorAttribute : System.Attribute { }
    public class Transform
    {
        public Vector3 position;
        public Vector3 InverseTransformPoint(Vector3 point) { return point; }
    }
    public class MonoBehaviour { }
}
"""


def test_component_for_unity_compiles_against_names_of_unity(tmp_path):
    """Against stand-ins of what it uses of Unity, which is not here."""
    write_client("csharp", tmp_path)
    (tmp_path / "Unity.cs").write_text(UNITY)
    sources = [
        tmp_path / name for name in ("DecaffMessages.cs", "DecaffClient.cs", "DecaffHand.cs", "Unity.cs")
    ]

    options = ["-unsafe", "-nologo", "-warn:4", "-nowarn:0649", "-warnaserror", "-target:library"]
    run(compiler("mcs"), *options, "-define:UNITY_5_3_OR_NEWER", *sources, f"-out:{tmp_path / 'hand.dll'}")
