"""Files that would read what is not theirs, or take time or memory without end: refused at once."""

import os

import mesh_files
import numpy as np
import pytest

import proximity
from proximity import formats
from proximity.errors import MeshFormatError
from proximity.recording import FrameLog, FrameReader, read_recording
from proximity.service.config import read_scene_file

VERTICES = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype=np.float64)
FACES = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]]
DOCUMENT, BLOB = mesh_files.gltf_document([[(VERTICES, FACES)]], [{"mesh": 0}])


def refusal(path):
    with pytest.raises(MeshFormatError) as caught:
        formats.read_geometries(path)
    return str(caught.value).removeprefix(f"{path}: ")


def write_gltf(path, uri, **changes):
    import json

    buffers = [{**DOCUMENT["buffers"][0], "uri": uri}]
    path.write_text(json.dumps({**DOCUMENT, **changes, "buffers": buffers}))
    return path


@pytest.mark.parametrize("uri", ["../secret.bin", "inner/../../secret.bin", "%2e%2e/secret.bin", "link.bin"])
def test_buffer_outside_the_folder_is_not_read(tmp_path, uri):
    (tmp_path / "secret.bin").write_bytes(b"secret " * 100)
    folder = tmp_path / "parts"
    (folder / "inner").mkdir(parents=True)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    message = refusal(write_gltf(folder / "part.gltf", uri))
    assert (
        message
        == f"buffer 0 is the file {uri!r}, which is not in the folder of this file or below: it is not read"
    )


@pytest.mark.parametrize("uri", ["/etc/passwd", "/dev/zero", "file:///etc/passwd"])
def test_buffer_with_a_whole_path_is_not_read(tmp_path, uri):
    assert refusal(write_gltf(tmp_path / "part.gltf", uri)).endswith(": it is not read")


def test_buffer_below_the_folder_is_read(tmp_path):
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "mesh 1.bin").write_bytes(BLOB)
    path = write_gltf(tmp_path / "part.gltf", "data/mesh%201.bin")
    assert len(formats.read_geometries(path).geometries[0].faces) == 4


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes of POSIX")
def test_pipe_as_buffer_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.bin")
    assert "is not a regular file" in refusal(write_gltf(tmp_path / "part.gltf", "pipe.bin"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="named pipes of POSIX")
@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("part.stl", proximity.load),
        ("part.prox", proximity.load),
        ("hand.csv", read_recording),
        ("run.frames", lambda path: list(FrameReader(path))),
        ("run.frames", FrameLog),
        ("scene.toml", read_scene_file),
    ],
)
def test_pipe_in_place_of_a_file_is_not_waited_for(tmp_path, name, read):
    os.mkfifo(tmp_path / name)
    with pytest.raises(proximity.ProximityError, match="is not a regular file"):
        read(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("part.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf " + "1 2 3 " * 70_000 + "\n"),
        ("part.off", "OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n210000 " + "0 1 2 " * 70_000 + "\n"),
    ],
)
def test_polygon_of_too_many_corners_is_refused_with_their_number(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    assert refusal(path).endswith("has 210000 corners, expected at most 20000")


def test_many_large_polygons_are_refused_with_their_number(tmp_path):
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + ("f " + "1 2 3 " * 6000 + "\n") * 12)
    assert (
        refusal(path)
        == "its polygons of more than 1000 corners have 216000 together, expected at most 200000"
    )


def test_nodes_nested_deeply_are_followed(tmp_path):
    count = 20_000
    nodes = [{"children": [k + 1], "translation": [0, 0, 0.5]} for k in range(count)] + [{"mesh": 0}]
    path = tmp_path / "part.glb"
    path.write_bytes(mesh_files.glb({**DOCUMENT, "nodes": nodes, "scenes": [{"nodes": [0]}]}, BLOB))
    (geometry,) = formats.read_geometries(path).geometries
    assert geometry.pose.translation.tolist() == [0, 0, count / 2]


def test_more_instances_than_anybody_means_are_refused_with_their_number(tmp_path):
    nodes = [{"mesh": 0}] * 100_000
    header = {**DOCUMENT, "nodes": nodes, "scenes": [{"nodes": list(range(len(nodes)))}]}
    path = tmp_path / "part.glb"
    path.write_bytes(mesh_files.glb(header, BLOB))
    assert refusal(path) == "it places 100000 parts, expected at most 20000"


def test_more_objects_than_anybody_means_are_refused_with_their_number(tmp_path):
    path = tmp_path / "part.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(f"o {k}\nf 1 2 3\n" for k in range(100_000)))
    assert refusal(path) == "it places 100000 parts, expected at most 20000"


PLY = (
    b"ply\nformat binary_little_endian 1.0\n"
    b"element vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
    b"element face %d\nproperty list uchar int vertex_indices\nend_header\n"
)


@pytest.mark.parametrize(
    ("name", "head", "message"),
    [
        (
            "part.stl",
            bytes(80) + (7).to_bytes(4, "little"),
            "its header says 7 faces: 434 bytes, but",
        ),
        (
            "part.glb",
            b"glTF" + bytes([2, 0, 0, 0, 99, 0, 0, 0]),
            "its header says 99 bytes, but the file",
        ),
        (
            "part.ply",
            PLY % (10**10, 9),
            "its header declares 10,000,000,009 rows of 120,000,000,009",
        ),
        ("part.ply", PLY % (10, 9), "its header declares 19 rows of 129 bytes or more, but "),
        ("part.obj", b"", "it is named like OBJ, a format of text, but holds zero bytes"),
        (
            "part.3mf",
            b"PK\3\4",
            "it has 10,600,000,000 bytes, expected at most 2,000,000,000 (unpacked_limit)",
        ),
    ],
)
def test_large_file_whose_header_lies_is_refused_unread(tmp_path, name, head, message):
    path = tmp_path / name
    path.write_bytes(head)
    os.truncate(path, 10_600_000_000)  # takes no room on the disk
    assert refusal(path).startswith(message)
