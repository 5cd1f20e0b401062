"""Scene files: valid contents, error messages, and the resulting settings."""

import inspect
import re
import shutil
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest
from project import MESHES

from proximity.errors import ServiceError
from proximity.pose import Pose
from proximity.scene.loader import load
from proximity.service.config import (
    FingerSettings,
    PartFiles,
    ServiceSettings,
    finger_count,
    make_tracker,
    place_recording,
    read_input,
    read_scene_file,
    scene_builder,
    scene_file_reader,
)
from proximity.service.config.toml_document import MAX_FILE_BYTES, MAX_LINES, Document
from proximity.tracker.tracker import Tracker
from proximity.tracker.tracker_arguments import DEFAULT_BUDGET

PART = '[[parts]]\nfile = "box.stl"\n'
POSES = '[input]\nposes = "mailbox:poses"\n'


@pytest.fixture
def folder(tmp_path):
    for name in ("box.stl", "sphere.stl", "assembly.glb", "hand.csv"):
        shutil.copy(MESHES / name, tmp_path)
    return tmp_path


@pytest.fixture
def read(folder):
    """Read a scene file with the given text or bytes."""

    def read_text(text):
        path = folder / "cell.toml"
        path.write_bytes(text if isinstance(text, bytes) else textwrap.dedent(text).encode())
        return read_scene_file(path)

    return read_text


@pytest.fixture
def refusal(read):
    """Error message for a scene file with the given text, without the folder."""

    def message_of(text):
        with pytest.raises(ServiceError) as refused:
            read(text)
        return str(refused.value).rpartition("/cell.toml:")[2]

    return message_of


def test_short_file_means_the_defaults(read, folder):
    settings = read(PART + POSES)

    assert settings.service == ServiceSettings()
    assert settings.service.publish == ("shm://proximity",)
    assert settings.service.period == 0.001
    assert settings.fingers == FingerSettings()
    (part,) = settings.parts
    assert (part.file, part.units, part.name) == (str(folder / "box.stl"), "mm", None)
    assert settings.input.poses == "mailbox:poses"
    assert settings.input.recording is settings.input.sensor is settings.input.moves is None


def test_files_of_addresses_lie_beside_the_scene_file(read, folder):
    settings = read(
        '[service]\npublish = ["udp://127.0.0.1:9100?key=frames.key", "shm://proximity"]\n'
        + PART
        + '[input]\nposes = "udp://127.0.0.1:9101?key=/keys/poses.key"\nmoves = "zenoh://m?config=m.json5"\n'
    )

    assert settings.service.publish == (f"udp://127.0.0.1:9100?key={folder}/frames.key", "shm://proximity")
    assert settings.input.poses == "udp://127.0.0.1:9101?key=/keys/poses.key"
    assert settings.input.moves == f"zenoh://m?config={folder}/m.json5"


def test_every_key_is_read(read, folder):
    settings = read("""
        [service]
        rate_hz = 250
        latency = 0.002
        valid_for = 0.01
        publish = "udp://127.0.0.1:9100"
        log = "run.frames"
        real_time = false
        core = 1
        [fingers]
        count = 2
        names = ["left", "right"]
        radius = [0.005, 0.006]
        budget = 40
        working_range = 0.2
        tolerance = 0.05
        horizon = 0.5
        max_speed = 4
        max_acceleration = 200
        [[parts]]
        file = "box.stl"
        units = "cm"
        name = "crate"
        position = [1, 2.5, -3]
        turn_degrees = [0, 90, 0]
        kind = "deformable"
        stiffness = 800
        damping = 2
        [input]
        recording = "hand.csv"
        repeat = true
        fast = true
        position = [0.1, 0.2, 0.3]
        turn_degrees = [10, 20, 30]
        scale = 0.5
        moves = "mailbox:moves"
        changes = "mailbox:changes"
        parts_from = "."
        """)

    service, fingers, (part,), recording = (
        settings.service, settings.fingers, settings.parts, settings.input.recording,
    )  # fmt: skip
    assert (service.period, service.latency, service.valid_for) == (0.004, 0.002, 0.01)
    assert service.publish == ("udp://127.0.0.1:9100",)
    assert (service.log, service.real_time, service.core) == (str(folder / "run.frames"), False, 1)
    assert fingers == FingerSettings(2, (0.005, 0.006), 40, 0.2, 0.05, 0.5, 4.0, 200.0, ("left", "right"))
    assert (part.units, part.name, part.kind) == ("cm", "crate", "deformable")
    assert (part.position, part.turn_degrees) == ((1.0, 2.5, -3.0), (0.0, 90.0, 0.0))
    assert (part.stiffness, part.damping) == (800.0, 2.0)
    assert recording.file == str(folder / "hand.csv")
    assert (recording.repeat, recording.fast, recording.fit) == (True, True, False)
    assert (recording.position, recording.turn_degrees) == ((0.1, 0.2, 0.3), (10.0, 20.0, 30.0))
    assert (recording.scale, settings.input.moves) == (0.5, "mailbox:moves")
    assert (settings.input.changes, settings.input.parts_from) == ("mailbox:changes", (f"{folder}/.",))


def test_sensor_needs_no_parts(read):
    settings = read('[fingers]\ncount = 2\n[input]\nsensor = "mailbox:sensor"\n')

    assert settings.parts == ()
    assert settings.input.sensor == "mailbox:sensor"


def test_what_windows_editors_write_is_read(read):
    settings = read(b"\xef\xbb\xbf" + (PART + POSES).replace("\n", "\r\n").encode())

    assert len(settings.parts) == 1


def test_sample_reads_and_names_every_key():
    text = (MESHES / "demo.toml").read_text(encoding="utf-8")

    settings = read_scene_file(MESHES / "demo.toml")

    assert settings.service == ServiceSettings()
    for keys in scene_file_reader.KEYS.values():
        for key in keys:
            assert f"\n{key} = " in text or f"\n#{key} = " in text, key


def test_sample_shows_the_defaults_where_it_says_so():
    """Commented-out lines in [service] and [fingers] show the default values."""
    text = (MESHES / "demo.toml").read_text(encoding="utf-8").split("\n[[parts]]")[0]
    shown = Document(re.sub(r"(?m)^#(?=\w+ = )", "", text), "demo.toml").data

    defaults = {**vars_of(ServiceSettings()), "budget": DEFAULT_BUDGET}
    defaults |= {
        name: parameter.default
        for name, parameter in inspect.signature(Tracker).parameters.items()
        if name in scene_file_reader.KEYS["fingers"] and name != "budget"
    }
    for key, value in {**shown["service"], **shown["fingers"]}.items():
        if key not in ("log", "core", "count", "names", "publish"):
            assert value == defaults[key], key


def vars_of(settings):
    return {name: getattr(settings, name) for name in settings.__dataclass_fields__}


SENSOR = '[input]\nsensor = "mailbox:sensor"\n'
RECORDED = '[input]\nrecording = "hand.csv"\n'
# A file, and the start of its error message: "\\n" ends a line; a name in braces is a table.
MISTAKES = r"""
rate = \n | 1: invalid TOML at column
\n[service\nrate_hz = 1\n | 2: invalid TOML at column
[service]\nlog = 'a\n | 2:
[service]\npublish = [1,\n\n | 2: the file ends too early:
[service]\nrate_hz = 1\nrate_hz = 2\n | 3: invalid TOML at column 12: Cannot overwrite a value
 | 1: the file is empty, expected a scene file in TOML
# nothing\n | 1: [[parts]] is missing, expected at least one (and 1 more mistake, on line 1)
{PART} | 1: [input] is missing, expected it to have recording, poses or sensor
{POSES} | 1: [[parts]] is missing, expected at least one
{PART}{POSES}[servise]\n | 5: the file has no key 'servise': did you mean service?
service = 3\n{PART}{POSES} | 1: service is 3, expected a table: [service]
[parts]\n{POSES} | 1: parts are not a list of tables, expected [[parts]] above each
{PART}{POSES}[service]\nlattency = 1\n | 6: [service] has no key 'lattency': did you mean latency?
{PART}{POSES}[service]\nrate_hz = 'fast'\n | 6: service.rate_hz is 'fast', expected a number from 1 to 100000
{PART}{POSES}[service]\nrate_hz = 100001\n | 6: service.rate_hz is 100001, expected a number
{PART}{POSES}[service]\nrate_hz = nan\n | 6: service.rate_hz is nan, expected a number
{PART}{POSES}[service]\nlatency = -0.001\n | 6: service.latency is -0.001, expected a number from 0 to 1 (s)
{PART}{POSES}[service]\nreal_time = 1\n | 6: service.real_time is 1, expected true or false
{PART}{POSES}[service]\ncore = 1.5\n | 6: service.core is 1.5, expected a whole number from 0 to 4095
{PART}{POSES}[service]\nlog = ''\n | 6: service.log is '', expected the file to write, as text in quotes
{PART}{POSES}[service]\npublish = 3\n | 6: service.publish is 3, expected an address such as shm://NAME, a
{PART}{POSES}[service]\npublish = [\n'mailbox:a',\n'decaff',\n]\nrate_hz = 0\n | 6: service.publish cannot be
{PART}{POSES}[service]\npublish = 'iox://a'\n | 6: service.publish is iox://a, but no transport is called 'io
{PART}{POSES}[service]\npublish = ['mailbox:a', 'mailbox:a']\n | 6: service.publish has an address twice, exp
{PART}{POSES}[fingers]\nradius = 0\n | 6: fingers.radius is 0, expected a number above 0 to 1e+06 (m)
{PART}{POSES}[fingers]\ncount = 3\nradius = [1, 2]\n | 7: fingers.radius has 2 numbers, expected 3 (m)
{PART}{POSES}[fingers]\nradius = []\n | 6: fingers.radius has 0 numbers, expected some (m)
{PART}{POSES}[fingers]\nradius = [0.007, 0]\n | 6: fingers.radius has 0 at index 1, expected a number above 0
[[parts]]\n{POSES} | 1: parts[0].file is missing, expected a file of parts, as text in quotes
[[parts]]\nfil = 'box.stl'\n{POSES} | 2: [parts[0]] has no key 'fil': did you mean file?
{PART}position = [1, 2]\n{POSES} | 3: parts[0].position has 2 numbers, expected 3 (m)
{PART}position = [1, 2, '3']\n{POSES} | 3: parts[0].position has '3' at index 2, expected a number from -1e+0
{PART}position = 1\n{POSES} | 3: parts[0].position is 1, expected 3 numbers (m) in brackets
{PART}units = 'furlong'\n{POSES} | 3: parts[0].units cannot be used: unknown unit 'furlong', expected one
{PART}kind = 'soft'\n{POSES} | 3: parts[0].kind is 'soft', expected "rigid" or "deformable"
{PART}kind = 'deformable'\n{POSES} | 1: parts[0].stiffness is missing, expected a number above 0 to 1e+12 (N/
{PART}stiffness = 100\n{POSES} | 3: parts[0].stiffness is for deformable parts, expected kind = "deformable"
{PART}name = 'a'\n{PART}name = 'a'\n{POSES} | 6: parts[1].name is 'a', as of the part on line 3, expected nam
{PART}[input]\n | 3: [input] has no source, expected recording, poses or sensor
{PART}{POSES}recording = 'hand.csv'\n | 4: input.poses is given together with input.recording, expected only
{PART}{SENSOR} | 1: [[parts]] cannot be used: distances come from input.sensor, without geometry
{SENSOR}moves = 'mailbox:moves'\n | 3: input.moves cannot be used: distances come from
{SENSOR}changes = 'mailbox:c'\n | 3: input.changes cannot be used: distances come from
{PART}{POSES}changes = 'mailbox:poses'\n | 5: input.changes is input.poses, expected another address
{PART}{POSES}parts_from = '.'\n | 5: input.parts_from requires input.changes
{SENSOR}[fingers]\nradius = 0.01\n | 4: fingers.radius cannot be used: distances come from
{PART}{POSES}repeat = true\n | 5: input.repeat requires input.recording
{PART}{RECORDED}fit = true\nposition = [0, 0, 0]\n | 6: input.position is given together with fit = true, exp
{PART}{POSES}[service]\npublish = 'mailbox:poses'\n | 4: input.poses is mailbox:poses, which is also in servi
{PART}{POSES}moves = 'mailbox:poses'\n | 5: input.moves is input.poses, expected another address
{PART}{RECORDED}[web]\nfeed = true\n | 6: web.feed is true, which requires input.poses or
[[parts]]\nfile = 'none.stl'\n{POSES} | 2: parts[0].file is 'none.stl', but {FOLDER}/none.stl is not there
[[parts]]\nfile = '.'\n{POSES} | 2: parts[0].file is '.', but {FOLDER}/. is a folder
{PART}[input]\nrecording = 'a.csv'\n | 4: input.recording is 'a.csv', but {FOLDER}/a.csv is not there
{TWO}radius = [0.007, 0.2]\n{BOX} | 3: fingers.radius is 0.2 m (200 mm), expected at most 0.1 m: was it
{TWO}working_range = 120\n{BOX} | 3: fingers.working_range is 120 m (120000 mm), expected at most 10 m: was
{HELD}publish = 'mailbox:h' | 6: held[0].part is missing, expected the name of a part
{HELD}part = 'pin' | 6: held[0].publish is missing
{HELD}part = 'pin'\npublish = 'mailbox:h'\nconnections = 17 | 9: held[0].connections is 17, expected a whole
{HELD}part = 'pin'\npublish = 'mailbox:h'\ntolerence = 0.1 | 9: [held[0]] has no key 'tolerence': did you mean
{HELD}part = 'pin'\npublish = 'shm://proximity' | 8: held[0].publish has shm://proximity, which is also in
{HELD}part = ['pin', 'pin']\npublish = 'mailbox:h' | 7: held[0].part has pin, which is also in held[0].part
{HELD}{PIN}[[held]]\npart = 'lid'\npublish = 'mailbox:h' | 11: held[1].publish has mailbox:h, which is also in
{SENSOR}[[held]]\n{PIN} | 3: [[held]] cannot be used: distances come from
{PART}{RECORDED}{FAST}[[held]]\n{PIN} | 7: [[held]] cannot be used together with input.fast
{PART}{POSES}[[held]]\n{PIN} | 5: [[held]] requires input.moves, where the poses of the part come in
"""
TABLES = {
    "PART": PART, "POSES": POSES, "SENSOR": SENSOR, "RECORDED": RECORDED,
    "FAST": "fast = true\nmoves = 'mailbox:m'\n", "PIN": "part = 'pin'\npublish = 'mailbox:h'\n",
    "TWO": "[fingers]\ncount = 2\n", "BOX": PART + POSES,
    "HELD": f"{PART}{POSES}moves = 'mailbox:m'\n[[held]]\n",
}  # fmt: skip
LARGE_MISTAKES = [
    (f"a = {'9' * 5000}\n", "1: Exceeds the limit"),
    ("a = " + "[" * 100_000, "1: brackets are nested too deeply"),
    (b"[service]\nlog = '\xff'\n", "2: not UTF-8, expected a scene file in TOML"),
    (PART + POSES + "[service]\nrate_hz = 0x" + "f" * 9999,
     "6: service.rate_hz is a number that is too large"),
    (f"[fingers]\ncount = 2\nradius = 7\n{PART}{POSES}",
     "3: fingers.radius is 7 m (7000 mm), expected at most 0.1 m: was it meant in millimetres?"),
]  # fmt: skip


@pytest.mark.parametrize("line", MISTAKES.strip("\n").splitlines())
def test_mistake_is_told_by_its_line(folder, refusal, line):
    text, _, message = line.partition(" | ")

    told = refusal(text.format(**TABLES).replace("\\n", "\n"))
    assert told.startswith(message.replace("{FOLDER}", str(folder)))


@pytest.mark.parametrize(("text", "message"), LARGE_MISTAKES, ids=[message for _, message in LARGE_MISTAKES])
def test_file_beyond_all_measure_is_told_by_its_line(refusal, text, message):
    assert refusal(text).startswith(message)


def test_first_mistake_by_line_is_told_and_others_are_counted_with_their_lines(refusal):
    told = refusal("[input]\nposes = 'x'\n[service]\nrate_hz = 0\nlatency = 7\n" + PART)

    assert told.startswith("2: input.poses cannot be used")
    assert told.endswith("(and 2 more mistakes, on lines 4 and 5)")


def test_lines_of_many_mistakes_are_not_all_named(refusal):
    told = refusal("[service]\n" + "".join(f"key{number} = 1\n" for number in range(20)) + PART + POSES)

    assert told.endswith("(and 19 more mistakes, on lines 3, 4, 5, 6, 7, 8, 9, 10 and others)")


def test_scene_file_that_cannot_be_read_is_named(tmp_path):
    large = tmp_path / "large.toml"
    large.write_bytes(b"#" * (MAX_FILE_BYTES + 1))

    with pytest.raises(ServiceError, match=r"^none\.toml: cannot be read \(No such file or directory\)$"):
        read_scene_file("none.toml")
    with pytest.raises(ServiceError, match=r"cannot be read \(Is a directory\)$"):
        read_scene_file(tmp_path)
    with pytest.raises(ServiceError, match=r"large\.toml: larger than 1 MiB, expected a scene file in TOML$"):
        read_scene_file(large)
    with pytest.raises(ServiceError, match=r"cannot be read \(embedded null byte\)$"):
        read_scene_file("a\0b")


TEXT = """\
# a comment = "with things in it"
[service]
publish = [   # [[parts]]
    "a",
    "b",
]
log = '''
[[parts]]
file = "no"
'''

[[parts]]
file = "a"
extra.deep = 1
[parts.more]
x = 1

[[parts]]
file = "b" # x
[["spaced out".'list']]
y = {inner = [1, {z = 2}]}
"""


@pytest.mark.parametrize(
    ("path", "line"),
    [
        ((), 1), (("service",), 2), (("service", "publish"), 3), (("service", "publish", 1), 3),
        (("service", "log"), 7), (("parts", 0), 12), (("parts",), 12), (("parts", 0, "file"), 13),
        (("parts", 0, "extra", "deep"), 14), (("parts", 0, "more", "x"), 16), (("parts", 1), 18),
        (("parts", 1, "file"), 19), (("spaced out", "list", 0, "y", "inner", 1, "z"), 21),
        (("parts", 1, "missing"), 18), (("parts", 5, "file"), 12), (("nothing", "here"), 1),
    ],
)  # fmt: skip
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_values_are_found_on_their_lines(path, line, ends):
    assert Document(TEXT.replace("\n", ends), "a").line_of(path) == line


def test_statement_that_is_too_long_ends_the_telling_of_lines():
    long = "a = [\n" + "1,\n" * (MAX_LINES + 1) + "]\nb = 1\n"

    assert Document("\nc = 1\n" + long, "a").line_of(("c",)) == 2
    assert Document(long, "a").line_of(("b",)) == 1


def test_parts_of_several_files_are_named_and_placed(read):
    scene = PartFiles().scene(
        read(
            PART
            + "[[parts]]\nfile = 'box.stl'\nname = 'turned'\nposition = [1, 0, 0]\n"
            + "turn_degrees = [0, 0, 90]\n"
            + "[[parts]]\nfile = 'assembly.glb'\nname = 'cell'\nposition = [0, 1, 0]\n"
            + POSES
        )
    )

    names = [part.name for part in scene.parts]
    assert names == ["box", "turned", "cell/pin_left", "cell/pin_right", "cell/base", "cell/lid"]
    lower, upper = (corner.copy() for corner in scene.part("box").solid.bounds)
    np.testing.assert_array_equal(scene.part("turned").pose.translation, [1, 0, 0])
    corner = [1.0 - upper[1] - 0.001, lower[0], lower[2]]  # a millimetre from the turned box
    assert scene.signed_distance(corner) == pytest.approx(0.001, abs=1e-12)
    assert scene.closest(corner).part == 1
    for part in load(MESHES / "assembly.glb").parts:
        moved = scene.part(f"cell/{part.name}").pose
        np.testing.assert_allclose(moved.matrix, Pose(translation=[0, 1, 0]).matrix @ part.pose.matrix)


def test_units_of_files_and_kinds_of_parts_are_taken(read):
    scene = PartFiles().scene(
        read(PART + "units = 'cm'\nkind = 'deformable'\nstiffness = 800\ndamping = 2\n" + POSES)
    )

    (part,) = scene.parts
    assert (part.stiffness, part.damping) == (800.0, 2.0)
    in_mm = PartFiles().scene(read(PART + POSES))
    np.testing.assert_allclose(scene.bounds[1], 10.0 * in_mm.bounds[1], rtol=1e-12)
    assert in_mm.parts[0].stiffness is None


def test_approximation_of_a_step_file_is_that_of_the_scene(read):
    path = (MESHES / "assembly.step").as_posix()

    scene = PartFiles().scene(read(f"[[parts]]\nfile = '{path}'\n" + POSES))

    assert scene.report.approximation == load(path).report.approximation > 0.0


@pytest.mark.parametrize(("kind", "stiffness"), [("", 500.0), ("kind = 'rigid'\n", None)])
def test_compiled_part_keeps_its_kind_unless_told(read, folder, kind, stiffness):
    scene = PartFiles().scene(read(PART + POSES))
    scene.set_surface("box", stiffness=500.0)
    scene.save(folder / "soft.prox")

    soft = PartFiles().scene(read("[[parts]]\nfile = 'soft.prox'\n" + kind + POSES))

    assert soft.parts[0].stiffness == stiffness


def test_part_that_moves_is_turned_with_its_velocities(read, folder):
    scene = PartFiles().scene(read(PART + POSES))
    scene.move("box", np.eye(4), velocity=(1.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 2.0))
    scene.save(folder / "moving.prox")

    turned = PartFiles().scene(read("[[parts]]\nfile = 'moving.prox'\nturn_degrees = [0, 90, 0]\n" + POSES))

    np.testing.assert_allclose(turned.parts[0].velocity, (0.0, 0.0, -1.0), atol=1e-15)
    np.testing.assert_allclose(turned.parts[0].angular_velocity, (2.0, 0.0, 0.0), atol=1e-15)


def test_two_files_with_one_name_are_refused_with_both_lines(read):
    settings = read(PART + "\n" + PART + POSES)

    with pytest.raises(
        ServiceError, match=r"cell\.toml:4: parts\[1\] has a part 'box', as the one on line 1 has"
    ):
        PartFiles().scene(settings)


def test_file_that_is_no_mesh_is_told_with_its_line(read, folder):
    (folder / "bad.stl").write_text("no mesh")
    settings = read(PART + "[[parts]]\nname = 'bad'\nfile = 'bad.stl'\n" + POSES)

    with pytest.raises(ServiceError, match=r"cell\.toml:5: parts\[1\]\.file: .*bad\.stl: "):
        PartFiles().scene(settings)


def test_unchanged_files_are_read_once(read, folder, monkeypatch):
    loaded = []

    def load_and_note(path, **options):
        loaded.append(Path(path).name)
        return load(path, **options)

    monkeypatch.setattr(scene_builder, "load", load_and_note)
    files = PartFiles()
    text = PART + "[[parts]]\nfile = 'box.stl'\nname = 'b'\n[[parts]]\nfile = 'sphere.stl'\n" + POSES

    files.scene(read(text))
    files.scene(read(text.replace("'b'", "'c'")))
    assert loaded == ["box.stl", "sphere.stl"]

    shutil.copy(MESHES / "sphere.stl", folder / "box.stl")
    scene = files.scene(read(text))
    assert loaded == ["box.stl", "sphere.stl", "box.stl"]
    assert scene.part("box").solid.mesh.face_count == scene.part("sphere").solid.mesh.face_count


def test_tracker_is_made_as_told(read):
    settings = read(
        PART + POSES + "[service]\nrate_hz = 500\nlatency = 0.003\n"
        "[fingers]\ncount = 2\nradius = [0.005, 0.006]\nworking_range = 0.2\nbudget = 40\n"
    )

    tracker = make_tracker(settings, PartFiles().scene(settings), finger_count(settings, None))

    assert len(tracker.contacts) == 2
    assert (tracker.period, tracker.latency) == (0.002, 0.003)
    top = float(tracker.scene.bounds[1][2])
    contacts = tracker.tick([[0.03, 0.02, top + 0.1], [0.03, 0.02, top + 0.1]], 0, 0)
    np.testing.assert_allclose(contacts["signed_distance"], [0.095, 0.094], atol=1e-12)


def test_radii_that_do_not_fit_the_fingers_are_told_with_their_line(read):
    settings = read(PART + POSES + "[fingers]\nradius = [0.005, 0.006]\n")
    scene = PartFiles().scene(settings)

    with pytest.raises(ServiceError, match=r"cell\.toml:6: fingers: .*one for each of 5 fingers"):
        make_tracker(settings, scene, finger_count(settings, None))


def test_fingers_are_those_of_the_recording(read):
    settings = read(PART + RECORDED)
    assert finger_count(settings, read_input(settings)) == 5

    settings = read(PART + RECORDED + "[fingers]\ncount = 3\n")
    with pytest.raises(
        ServiceError, match=r"cell\.toml:6: fingers\.count is 3, expected 5, as .*hand\.csv has"
    ):
        finger_count(settings, read_input(settings))


def test_recording_is_placed(read):
    settings = read(PART + RECORDED + "position = [1, 2, 3]\nturn_degrees = [0, 0, 90]\nscale = 2\n")
    recorded = read_input(settings)

    placed = place_recording(settings, recorded, PartFiles().scene(settings))

    x, y, z = np.moveaxis(recorded.positions, 2, 0)
    expected = np.stack((1 - 2 * y, 2 + 2 * x, 3 + 2 * z), axis=2)
    np.testing.assert_allclose(placed.positions, expected, atol=1e-12)


def test_recording_is_fitted_so_that_it_touches(read):
    settings = read(PART + RECORDED + "fit = true\n")
    scene = PartFiles().scene(settings)

    placed = place_recording(settings, read_input(settings), scene)

    share = (scene.signed_distance(placed.positions[placed.is_present]) <= 0.007).mean()
    assert 0.0 < share <= 0.11


def test_recording_that_cannot_be_used_is_told_with_its_line(read, folder):
    settings = read(PART + RECORDED)
    (folder / "hand.csv").write_text("time_s\n")

    with pytest.raises(ServiceError, match=r"cell\.toml:4: input\.recording: .*hand\.csv, line 1: no column"):
        read_input(settings)


@pytest.mark.parametrize(
    "text",
    ["{}.a = 1", "[{}.a]", "[[ {} . a ]]", "x = {{ b = 1, {} .a = 1 }}", "'q'.{}.a = 1", '"q" . {}.a = 1'],
)
def test_a_key_of_100_000_dots_is_refused_at_once(refusal, text):
    started = time.monotonic()
    keys = ".".join(["a"] * 100_000)
    assert refusal(f"[service]\n{text.format(keys)}\n") == "2: a key has more than 32 dots, expected fewer"
    assert time.monotonic() - started < 1.0


def test_dots_in_texts_and_a_long_file_are_no_such_key(read):
    dots = ".".join(["a"] * 40)
    read(f'# {dots}\n{PART}name = "{dots}"\n{POSES}{" " * 100_000}\n{chr(10) * 100_000}')
