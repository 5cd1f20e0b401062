"""Compiled scenes: loading restores the saved scene bit for bit, or fails."""

import dataclasses
import errno
import gc
import json
import os
import sys
import tempfile
import zlib
from pathlib import Path

import judging
import numpy as np
import pytest
import shapes
from project import MESHES

import proximity
from proximity import MeshFormatError, Part, Pose, Scene, SceneError, Solid
from proximity.errors import FileError
from proximity.kernels.scene.parts.part_trees import copies_in_use
from proximity.scene.queries import results
from proximity.scene.queries.queries import Queries
from proximity.scene.saved import archive, compiled_scene


def part(name, mesh, pose=None):
    own = Solid(*mesh, name=name)
    rows = np.random.default_rng(len(name)).permutation(own.mesh.face_count).astype(np.int32)
    return Part(name, own, Pose() if pose is None else pose, rows)


def one_solid():
    return Scene([Solid(*shapes.sphere(0.02, 2), name="ball")])


def parts_with_poses():
    places = np.random.default_rng(1).uniform(-0.1, 0.1, (20, 3))
    return Scene(
        [
            part(f"part {row}", shapes.torus(0.02, 0.006), Pose(shapes.rotation(row), place))
            for row, place in enumerate(places)
        ]
    )


def moved_parts():
    scene = parts_with_poses()
    for row in (3, 11):
        scene.move(f"part {row}", Pose(shapes.rotation(50 + row), (0.3, 0.1 * row, -0.2)))
    return scene


def parts_that_move_hide_and_give_way():
    scene = parts_with_poses()
    for row in (2, 7, 9, 15):
        scene.move(
            f"part {row}", Pose(shapes.rotation(row), (0.1, 0.0, 0.1 * row)), velocity=(0.1, -0.2, row)
        )
        scene.distance([0.0, 0.0, 0.0])
    scene.move("part 3", Pose(), angular_velocity=(0.0, 1e-3, 2.0))
    scene.hide("part 4")
    scene.hide("part 7")
    scene.set_surface("part 5", stiffness=0.1 + 0.2, damping=0.7)
    scene.remove("part 0")
    scene.move("part 9", Pose(shapes.rotation(3), (0.2, 0.2, 0.2)))
    return scene


def loose_part_alone():
    scene = Scene(parts_with_poses().parts[:2])
    scene.move("part 0", Pose(shapes.rotation(9), (0.1, 0.2, 0.3)))
    scene.remove("part 1")
    return scene


def every_kind_of_sign():
    vertices, faces = shapes.sphere(0.02, 3)
    lean = shapes.join(shapes.cube(0.02), shapes.moved(shapes.cube(0.02), (0.01, 0.01, 0.0)))
    return Scene(
        [
            part("closed", shapes.cube(0.01)),
            part("with a hole", shapes.moved((vertices, faces[1:]), (0.1, 0.0, 0.0))),
            part("meets itself", shapes.moved(lean, (0.0, 0.1, 0.0))),
            part("sheet", shapes.grid(), Pose(translation=(0.0, 0.0, 0.1))),
            part("inside out", shapes.inside_out(shapes.moved(shapes.cube(0.01), (1000.0, 0.0, 0.0)))),
        ]
    )


def solid_in_two_parts():
    own, rows = Solid(*shapes.octahedron(0.01)), np.arange(8, dtype=np.int32)
    return Scene(
        [Part(name, own, Pose(translation=(x, 0, 0)), rows) for name, x in (("a", 0.0), ("b", 0.05))]
    )


def bodies_of_a_mesh():
    mesh = shapes.join(shapes.cube(0.01), shapes.moved(shapes.hollow_cube(0.03, 0.01), (0.05, 0.0, 0.0)))
    return Scene.from_mesh(*shapes.soup(*mesh), name="pair")


def file_of_parts():
    return proximity.load(MESHES / "assembly.glb")


SCENES = [
    one_solid, parts_with_poses, moved_parts, parts_that_move_hide_and_give_way, loose_part_alone,
    every_kind_of_sign, solid_in_two_parts, bodies_of_a_mesh, file_of_parts,
]  # fmt: skip


def saved(scene, folder, name="cell.prox"):
    scene.save(folder / name)
    return folder / name


def bits(value):
    """Convert a value for bitwise comparison."""
    if dataclasses.is_dataclass(value):
        return {field.name: bits(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, results._Record):
        return bits(value._table)
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    return np.float64(value).tobytes() if isinstance(value, float) else value


def answers(asked, seed=5):
    """Results of every query about points near and far, as bits."""
    rng = np.random.default_rng(seed)
    lower, upper = asked.bounds
    points = rng.uniform(lower - 0.02, np.minimum(upper, lower + 0.4) + 0.02, (300, 3))
    told = {
        "bounds": bits(np.array(asked.bounds)),
        "closest": bits(asked.closest(points)),
        "near": bits(asked.closest(points, max_distance=0.01)),
        "distance": bits(asked.distance(points)),
        "cast": bits(asked.cast(points, rng.normal(size=(300, 3)))),
        "segments": bits(asked.closest_to_segments(points, points[::-1])),
    }
    for question in (asked.signed_distance, asked.contains):
        try:
            told[question.__name__] = bits(question(points))
        except proximity.NotWatertightError as refused:
            told[question.__name__] = str(refused)
    return told


OF_PARTS = (
    "name", "source_faces", "repairs", "velocity", "angular_velocity", "is_hidden", "stiffness", "damping",
)  # fmt: skip
OF_SOLIDS = (
    "name", "sign_method", "sign_reason", "is_watertight", "has_inside", "topology", "diagnosis", "bvh",
    "memory_bytes",
)  # fmt: skip


def described(scene):
    """All public data of the parts, as bits."""
    owners = {"part": OF_PARTS, "solid": OF_SOLIDS, "pose": ("rotation", "translation")}
    return [
        {
            f"{owner} {name}": bits(getattr(part if owner == "part" else getattr(part, owner), name))
            for owner, names in owners.items()
            for name in names
        }
        | {"mesh": (bits(part.solid.mesh.vertices), bits(part.solid.mesh.faces)), "text": repr(part.solid)}
        for part in scene.parts
    ]


def mapped_file(array):
    """The file mapped to an array's memory, or None."""
    while array is not None:
        if isinstance(array, np.memmap):
            return Path(array.filename)
        array = getattr(array, "base", None)
    return None


@pytest.mark.parametrize("make", SCENES)
def test_scene_comes_back_bit_for_bit_and_is_saved_as_the_same_file(make, tmp_path):
    scene = make()
    first = saved(scene, tmp_path)
    loaded = proximity.load(first)
    assert answers(loaded) == answers(scene)
    assert described(loaded) == described(scene)
    assert repr(loaded) == repr(scene)
    assert loaded.memory_bytes == scene.memory_bytes
    if make is not file_of_parts:
        first = saved(loaded, tmp_path, "with a report.prox")
    second = saved(proximity.load(first), tmp_path, "again.prox")
    assert second.read_bytes() == first.read_bytes()


def test_parts_of_a_loaded_scene_move(tmp_path):
    scene = parts_with_poses()
    path = saved(scene, tmp_path)
    before = path.read_bytes()
    loaded, other = proximity.load(path), proximity.load(path)
    for step in range(3):
        pose = Pose(shapes.rotation(step), (0.2 * step, 0.1, -0.1))
        scene.move(f"part {step}", pose)
        loaded.move(f"part {step}", pose)
        assert answers(loaded) == answers(scene)
    assert answers(other) == answers(parts_with_poses())
    assert path.read_bytes() == before


class Held(Queries):
    """Queries of a fixed snapshot of a scene."""

    def __init__(self, scene):
        self.model, self.bounds = scene.snapshot(), scene.bounds

    def snapshot(self):
        return self.model


def test_question_under_way_is_not_disturbed_by_a_loaded_scene_that_moves(tmp_path):
    """The saved scene uses a later copy of the moving parts and of the static tree."""
    scene = parts_with_poses()
    first = Held(scene)
    scene.move("part 0", Pose(translation=(0.1, 0.1, 0.0)))
    loaded = proximity.load(saved(scene, tmp_path))
    held = Held(loaded)
    before = answers(held)
    assert copies_in_use(first.model.parts) == (0, 0)
    assert copies_in_use(held.model.parts) == (1, 1)
    for step in range(4):
        loaded.move(f"part {step}", Pose(translation=(0.0, 0.1, 0.1 * step)))
        answers(loaded)
        assert answers(held) == before


def test_arrays_of_a_loaded_scene_are_read_only_and_mapped(tmp_path):
    path = saved(every_kind_of_sign(), tmp_path)
    loaded = proximity.load(path)
    for part in loaded.parts:
        shown = (part.solid.mesh.vertices, part.solid.mesh.faces, part.source_faces)
        for array in shown:
            assert not array.flags.writeable
            assert mapped_file(array) == path
        for array in (part.pose.rotation, part.pose.translation, part.velocity, part.angular_velocity):
            assert not array.flags.writeable
    for array in (loaded.snapshot().reals, loaded.snapshot().words):
        assert array.flags.writeable and array.ctypes.data % 64 == 0
        assert mapped_file(array) == path


def test_report_comes_back_and_scene_of_arrays_comes_from_the_file(tmp_path):
    scene = proximity.load(MESHES / "bracket.stl", units="cm")
    loaded = proximity.load(saved(scene, tmp_path))
    assert loaded.report == scene.report and loaded.report.path == str(MESHES / "bracket.stl")
    assert isinstance(loaded.report.notes, tuple)
    path = saved(one_solid(), tmp_path)
    report = proximity.load(path).report
    assert (report.path, report.format) == (str(path), "compiled scene")
    assert (report.units, report.units_declared) == ("m", True)


@pytest.mark.parametrize("end", ["removed", "saved over"])
def test_loaded_scene_outlives_its_file(tmp_path, end):
    scene = parts_with_poses()
    loaded = proximity.load(saved(scene, tmp_path))
    if end == "removed":
        os.unlink(tmp_path / "cell.prox")
        gc.collect()
    else:
        saved(one_solid(), tmp_path)
        assert len(proximity.load(tmp_path / "cell.prox").parts) == 1
    assert answers(loaded) == answers(scene)


def test_solid_in_two_parts_stays_one_and_odd_names_and_numbers_come_back(tmp_path):
    one, other = proximity.load(saved(solid_in_two_parts(), tmp_path)).parts
    assert one.solid is other.solid
    name = 'über "zwei"\n\udcff\x00 😀'
    repairs = proximity.load(MESHES / "bracket.stl").parts[0].repairs
    mended = dataclasses.replace(repairs, weld_distance=np.float64(0.1) + 0.2, turned_face_count=np.int64(3))
    scene = Scene([dataclasses.replace(part(name, shapes.cube()), repairs=mended)])
    (loaded,) = proximity.load(saved(scene, tmp_path)).parts
    assert loaded.name == loaded.solid.name == name
    assert loaded.repairs == mended and loaded.repairs.weld_distance == 0.30000000000000004


def test_every_field_of_a_part_is_saved():
    """A new field of `Part` must be added to `compiled._FIELDS`, unless it has an array or a list."""
    fields = {field.name for field in dataclasses.fields(Part)}
    assert fields == {
        *compiled_scene._FIELDS,
        "solid",
        "pose",
        "source_faces",
        "deviation",
        "deviation_by_face",
    }


@pytest.mark.parametrize("name", ["CELL.PROX", "cell.stl"])
def test_compiled_scene_is_recognised_by_its_first_bytes(name, tmp_path):
    path = saved(one_solid(), tmp_path).rename(tmp_path / name)
    assert answers(proximity.load(path)) == answers(one_solid())
    assert answers(proximity.load(str(path))) == answers(one_solid())


def test_folder_and_missing_file_are_told_as_for_any_file(tmp_path):
    (tmp_path / "folder.prox").mkdir()
    with pytest.raises(MeshFormatError, match=r"folder\.prox: it is a directory, expected a file$"):
        proximity.load(tmp_path / "folder.prox")
    with pytest.raises(MeshFormatError, match=r"none\.prox: there is no such file$"):
        proximity.load(tmp_path / "none.prox")
    with pytest.raises(proximity.MeshError, match=r"^the path is 5\.0, expected text or a path$"):
        proximity.load(5.0)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Bytes of a compiled scene of three parts."""
    scene = every_kind_of_sign()
    return saved(Scene(scene.parts[:3]), tmp_path_factory.mktemp("whole")).read_bytes()


@pytest.fixture
def refused(tmp_path):
    """Load bytes; return the error message without the file's name."""

    def load(data, name="cell.prox"):
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(MeshFormatError) as error:
            proximity.load(path)
        told = str(error.value)
        assert told.startswith(f"{path}: ") and "\n" not in told
        return told.removeprefix(f"{path}: ")

    return load


def document_of(data):
    text_bytes = archive.HEADER.unpack_from(data)[4]
    return json.loads(data[archive.HEADER.size : archive.HEADER.size + text_bytes])


def sections(data):
    """Name, first and last byte of every section of a file."""
    head = archive.HEADER.size + archive.HEADER.unpack_from(data)[4]
    arrays = document_of(data)["arrays"]
    starts = [0, archive.HEADER.size, *(entry["offset"] + head for entry in arrays)]
    names = ["header", "description", *(entry["name"] for entry in arrays)]
    return zip(names, starts, [*starts[1:], len(data)], strict=True)


def remade(data, *, header=None, document=None):
    """Replace header fields or the description of a file and update the checksums."""
    fields = list(archive.HEADER.unpack_from(data))
    text = data[archive.HEADER.size : archive.HEADER.size + fields[4]]
    rest = data[archive.HEADER.size + fields[4] :]
    if document is not None:
        text = json.dumps(document).encode()
        text = text.ljust(-(-(len(text) + archive.HEADER.size) // 4096) * 4096 - archive.HEADER.size)
        fields[3:6] = archive.HEADER.size + len(text) + len(rest), len(text), zlib.crc32(text)
    for position, value in (header or {}).items():
        fields[position] = value
    packed = archive.HEADER.pack(*fields[:-1], 0)[:-4]
    return packed + zlib.crc32(packed).to_bytes(4, sys.byteorder) + text + rest


def test_remade_file_is_a_file(whole, tmp_path):
    """Check the function that the tests below rely on: without changes its file is valid."""
    (tmp_path / "a.prox").write_bytes(remade(whole, document=document_of(whole)))
    assert remade(whole) == whole
    assert len(proximity.load(tmp_path / "a.prox").parts) == 3


def test_flipped_bit_is_found_wherever_it_is(whole, refused):
    rng = np.random.default_rng(11)
    seen = set()
    for name, start, end in sections(whole):
        count = end - start if name == "header" else 40
        chosen = rng.choice(np.arange(start, end), min(count, end - start), replace=False)
        positions = {start, end - 1, *chosen}
        for position in positions:
            changed = bytearray(whole)
            changed[position] ^= 1 << int(rng.integers(8))
            told = refused(bytes(changed))
            seen.add((name, told.split(" (")[0]))
            assert told == NOT_SUCH or told.endswith("; save the scene again with this version"), (name, told)
    again = "; save the scene again with this version"
    assert seen == {
        ("header", NOT_SUCH),
        ("header", f"it is damaged: the checksum of its header differs{again}"),
        ("description", f"it is damaged: the checksum of its description differs{again}"),
        *(
            (name, f"it is damaged: the checksum of {name!r} differs{again}")
            for name in ("reals", "words", "frames", "parts", "vertices", "faces", "source_faces", "poses")
        ),
    }


def described_anew(data, *path, to):
    """Replace one entry of a file's description (None removes it)."""
    document = entry = document_of(data)
    for key in path[:-1]:
        entry = entry[key]
    if to is None:
        del entry[path[-1]]
    else:
        entry[path[-1]] = to
    return remade(data, document=document)


def reshaped(data):
    """Double the count of a file's frames and halve their width."""
    (row,) = (k for k, entry in enumerate(document_of(data)["arrays"]) if entry["name"] == "frames")
    count, width = document_of(data)["arrays"][row]["shape"]
    return described_anew(data, "arrays", row, "shape", to=[2 * count, width // 2])


NOT_SUCH = "it is no compiled scene; `proximity compile` makes one of files of parts"
NO_TABLE = "its table of arrays does not fit it "
VERSIONS = f"version {proximity.__version__}, expected {proximity.__version__}"
TREES = f"it was saved by {VERSIONS}: the layout of trees differs"
CONTRADICTS, VERSION = "its contents are inconsistent ", archive.FORMAT_VERSION
DAMAGED = [
    (lambda data: b"", "it is empty, expected a compiled scene"),
    (lambda data: data[:1], NOT_SUCH),
    (lambda data: (MESHES / "box.stl").read_bytes(), NOT_SUCH),
    (lambda data: b"\n" * 5000, NOT_SUCH),
    (lambda data: data[:8], "it is cut off after 8 bytes"),
    (lambda data: data[:64], "it is cut off after 64 of {size} bytes"),
    (lambda data: data[:5000], "it is cut off after 5000 of {size} bytes"),
    (lambda data: data + b"\0", "there are 1 bytes after its end"),
    (lambda data: data[:8] + data[8:12][::-1] + data[12:],
     f"it was written on a machine of another byte order, expected {sys.byteorder}-endian"),
    (lambda data: remade(data, header={2: VERSION - 1}), f"it has format version {VERSION - 1}, expected"),
    (lambda data: remade(data, header={2: 2**32 - 1}), f"it has format version {2**32 - 1}, expected"),
    (lambda data: described_anew(data, "layout", "NODE_STRIDE", to=80), f"{TREES} (NODE_STRIDE is 80, "),
    (lambda data: described_anew(data, "layout", "MOMENT_STRIDE", to=None), f"{TREES} (MOMENT_STRIDE "),
    (lambda data: described_anew(data, "layout", "A_NEW_COLUMN", to=9), f"{TREES} (A_NEW_COLUMN is 9, "),
    (lambda data: described_anew(data, "arrays", 0, "dtype", to="object"), NO_TABLE + "('reals')"),
    (lambda data: described_anew(data, "arrays", 0, "offset", to=4096), NO_TABLE + "('reals')"),
    (lambda data: described_anew(data, "arrays", 2, "shape", to=[10**12, 48]), NO_TABLE + "('frames')"),
    (lambda data: described_anew(data, "arrays", 3, "shape", to=[-1, -4]), NO_TABLE + "('parts')"),
    (lambda data: described_anew(data, "arrays", -1, to=None), NO_TABLE + "(the end)"),
    (lambda data: remade(data, document=[]), "its description cannot be understood"),
    (lambda data: remade(data, document={"layout": compiled_scene.LAYOUT, "arrays": 3}),
     "its description cannot be understood"),
    (lambda data: described_anew(data, "metadata", "face_counts", to=[1, 2, 3]),
     CONTRADICTS + "(there are 1315 rows, but 6 are spoken of)"),
    (lambda data: described_anew(data, "metadata", "solid_of_part", to=[0, 1, 7]),
     CONTRADICTS + "(solid_of_part have 7, expected 0 to 2)"),
    (lambda data: described_anew(data, "metadata", "parts", to={}), CONTRADICTS + "('name'"),
    (reshaped, CONTRADICTS + "(frames are float64 of shape ("),
]  # fmt: skip


@pytest.mark.parametrize(("damage", "told"), DAMAGED, ids=range(len(DAMAGED)))
def test_file_that_is_not_as_it_was_saved_is_refused_with_the_reason(damage, told, whole, refused):
    reason = refused(damage(whole))
    assert reason.startswith(told.format(size=len(whole)))
    here = "on this machine" if "byte order" in told else "with this version"
    assert told == NOT_SUCH or reason.endswith(f"; save the scene again {here}")


def test_trees_of_fewer_parts_than_are_described_are_refused(refused, monkeypatch):
    write = archive.write_archive

    def with_a_part_less(path, metadata, arrays, layout):
        write(path, metadata, {**arrays, "parts": arrays["parts"][1:]}, layout)

    monkeypatch.setattr(compiled_scene, "write_archive", with_a_part_less)
    with tempfile.TemporaryDirectory() as folder:
        data = saved(solid_in_two_parts(), Path(folder)).read_bytes()
    assert refused(data).startswith(CONTRADICTS + "(there are 2 parts, but the trees of 1)")


def test_file_that_cannot_be_mapped_is_told(whole, refused, monkeypatch):
    def no_memory(*_):
        raise OSError(errno.ENOMEM, os.strerror(errno.ENOMEM))

    monkeypatch.setattr(np, "memmap", no_memory)
    assert refused(whole) == "it cannot be opened (Cannot allocate memory)"


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("trouble", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
@pytest.mark.parametrize("is_there", [True, False])
def test_what_goes_wrong_while_writing_leaves_everything_as_it_was(
    step, trouble, is_there, tmp_path, monkeypatch
):
    path = tmp_path / "cell.prox"
    if is_there:
        path.write_bytes(b"something else")

    def fails(*_):
        raise trouble

    monkeypatch.setattr(archive.os, step, fails)
    with pytest.raises((FileError, KeyboardInterrupt)) as error:
        one_solid().save(path)
    if isinstance(trouble, OSError):
        assert str(error.value) == f"{path}: cannot be written (No space left on device)"
    assert os.listdir(tmp_path) == ["cell.prox"] * is_there
    assert not is_there or path.read_bytes() == b"something else"


def test_place_where_no_file_can_be_is_told(tmp_path):
    (tmp_path / "folder.prox").mkdir()
    (tmp_path / "file").write_bytes(b"")
    for path, reason in (
        (tmp_path / "folder.prox", " (it is not a regular file)"),
        (tmp_path / "none" / "cell.prox", " (No such file or directory)"),
        (tmp_path / "file" / "cell.prox", " (Not a directory)"),
        ("a\0b.prox", "embedded null"),  # after "lstat: " since Python 3.13
    ):
        with pytest.raises(FileError) as error:
            one_solid().save(path)
        assert str(error.value).startswith(f"{path}: cannot be written (")
        assert reason in str(error.value)
    with pytest.raises(FileError, match=r"^the path is None, expected text or a path$"):
        one_solid().save(None)
    assert sorted(os.listdir(tmp_path)) == ["file", "folder.prox"]


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (np.arange(3), "int64 of shape (3,)"),
        (np.arange(12.0), "float64 of shape (12,)"),
        (np.arange(12) + 2**31, "int64 of shape (12,)"),
        (None, "object of shape ()"),
    ],
)
def test_source_faces_that_are_none_are_told(rows, told, tmp_path):
    scene = Scene([Part("lid", Solid(*shapes.cube()), Pose(), rows)])
    with pytest.raises(SceneError) as error:
        scene.save(tmp_path / "cell.prox")
    assert str(error.value) == (
        f"part 'lid' cannot be saved: its source_faces are {told}, expected int32 of shape (12,)"
    )


def test_scene_that_moves_while_it_is_saved_is_saved_as_it_stood(tmp_path, monkeypatch):
    """Later models are written next to the saved one, in the same memory."""
    scene = Scene(
        [Solid(*shapes.moved(shapes.cube(), (3.0 * row, 0.0, 0.0)), name=str(row)) for row in range(9)]
    )
    points = np.random.default_rng(5).uniform(-2.0, 30.0, (50, 3))
    scene.move("1", Pose(translation=(0.0, 5.0, 0.0)))
    before = scene.signed_distance(points)
    write = archive._write_all

    def write_later(*arguments):
        for step in range(30):
            scene.move(str(step % 9), Pose(translation=(0.0, 0.0, 1.0 + step)))
            scene.distance(points)
        write(*arguments)

    monkeypatch.setattr(archive, "_write_all", write_later)
    scene.save(tmp_path / "moving.prox")
    assert judging.same_bits(proximity.load(tmp_path / "moving.prox").signed_distance(points), before)


def test_a_scene_saved_as_part_stl_does_not_replace_the_mesh(tmp_path):
    path = tmp_path / "part.stl"
    path.write_bytes(b"precious")
    for name in (path, str(path), tmp_path / "part"):
        with pytest.raises(SceneError, match=r"part(\.stl)? does not end in \.prox, expected the name"):
            one_solid().save(name)
    assert path.read_bytes() == b"precious" and os.listdir(tmp_path) == ["part.stl"]
