"""The examples, run as by a user, compared with the output in docs/examples.md."""

import contextlib
import ctypes
import os
import re
import runpy
import shutil
import subprocess
import sys
import uuid
from types import SimpleNamespace

import nbclient
import nbformat
import numpy as np
import pytest
import shapes
from compiling_c import c_compiler, run
from pages import PAGES
from ports import free_port
from project import MESHES, ROOT

import oracle
import proximity
from proximity.message.envelope import parts_of
from proximity.service.config import read_scene_file
from proximity.service.config.scene_builder import PartFiles, finger_count, make_tracker
from proximity.transport import Reading, open_inlet

EXAMPLES = ROOT / "examples"
PROGRAMS = (".py", ".toml", ".c", ".h", ".ipynb")
FILES = sorted(
    path for path in EXAMPLES.rglob("*") if path.suffix in PROGRAMS and path.parent.name != "motors"
)
"""Programs to run; drivers of motors are tested against simulated ones."""
ENVIRONMENT = {
    **os.environ,
    "MPLBACKEND": "Agg",
    "PYTHONPATH": os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]),
    "XR_RUNTIME_JSON": "/nowhere/runtime.json",  # no OpenXR runtime, even if one is installed
}
PATIENCE = 300.0  # s
NUMBER = re.compile(r"-?\d+(?:\.\d+)?")
TIME = re.compile(r"\d+(?:\.\d+)?(?= (?:µs|s:))")
POINT = re.compile(r"\([^)]*\)")


def printed(program, *words, folder, notes=r""):
    """Run an example in an empty folder; return its output without *notes*, lines of a loaded machine."""
    command = [sys.executable, str(program), *map(str, words)]
    done = subprocess.run(
        command,
        cwd=folder,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=PATIENCE,
    )
    assert done.returncode == 0 and re.fullmatch(notes, done.stderr), done.stderr
    return done.stdout


def shown(name):
    """Return the page's output of an example: the text block in the section with its code."""
    (section,) = (part for part in PAGES["examples.md"].split("\n## ") if f"(../examples/{name})" in part)
    (block,) = re.findall(r"```text\n(.*?)```", section, re.DOTALL)
    return block


def assert_shown(name, output):
    """Assert that the output matches the page: words equal, numbers nearly, times any."""
    found, expected = (TIME.sub("TIME", text) for text in (output, shown(name)))
    assert NUMBER.sub("#", found) == NUMBER.sub("#", expected)
    numbers = [[float(number) for number in NUMBER.findall(text)] for text in (found, expected)]
    assert numbers[0] == pytest.approx(numbers[1], rel=0.01, abs=0.0011)


def copied(folder, *names, replacing=()):
    """Copy files of an example with other addresses, so that two can run at the same time."""
    for name in names:
        text = (EXAMPLES / name).read_text(encoding="utf-8")
        for old, new in (("../../meshes", MESHES.as_posix()), ("../meshes", MESHES.as_posix()), *replacing):
            text = text.replace(old, new)
        (folder / name.rpartition("/")[2]).write_text(text, encoding="utf-8")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_example_is_short_and_listed(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    if path.suffix == ".ipynb":
        cells = nbformat.reads("\n".join(lines), 4).cells
        assert all(not cell.get("outputs") for cell in cells)  # outputs would hold an address with its token
        lines = [line for cell in cells for line in cell.source.splitlines()]
    folder = path.relative_to(EXAMPLES).parts[0]

    assert len(lines) <= 80
    assert f"`{folder}`" in (EXAMPLES / "README.md").read_text(encoding="utf-8")
    assert f"(../examples/{path.relative_to(EXAMPLES).as_posix()})" in PAGES["examples.md"]


@pytest.mark.parametrize("path", [path for path in FILES if path.suffix == ".py"], ids=lambda path: path.name)
def test_docstring_says_how_to_start_and_what_is_printed(path):
    documentation = path.read_text(encoding="utf-8").split('"""')[1]

    assert f"python examples/{path.name}" in documentation or f"python {path.name}" in documentation
    assert "Start it" in documentation and "It prints" in documentation


def test_clearances_are_a_table(tmp_path):
    output = printed(EXAMPLES / "clearances.py", folder=tmp_path)

    # Parts touch in a whole face, so the reported points are arbitrary.
    gaps = [line[:22] for line in output.splitlines()]
    assert gaps == [line[:22] for line in shown("clearances.py").splitlines()]
    for line in output.splitlines()[1:-2]:
        begin, end = (np.array([float(x) for x in NUMBER.findall(point)]) for point in POINT.findall(line))
        assert np.linalg.norm(begin - end) == pytest.approx(float(line.split()[2]), abs=0.1)


def test_clearances_name_the_parts_that_overlap(tmp_path):
    """Two cubes of 10 mm; the second begins 8 mm along x and 5 mm along z."""
    cube = shapes.cube(0.01, [0.005] * 3)
    scene = proximity.Scene([proximity.Solid(*cube, name="a"), proximity.Solid(*cube, name="b")])
    scene.move("b", proximity.Pose(None, [0.008, 0.0, 0.005]))
    scene.save(tmp_path / "scene.prox")
    output = printed(EXAMPLES / "clearances.py", "scene.prox", folder=tmp_path)

    assert output.endswith(
        "\na and b overlap by 100.000 mm3, in a box of 2.000 x 10.000 x 5.000 mm\npairs that overlap: 1\n"
    )


def test_point_cloud_becomes_a_table_and_a_picture(tmp_path):
    assert_shown("point_cloud.py", printed(EXAMPLES / "point_cloud.py", folder=tmp_path))

    table = np.loadtxt(tmp_path / "deviations.csv", delimiter=",", skiprows=1)
    length = np.linalg.norm(table[:, :3] - table[:, 4:], axis=1)
    np.testing.assert_allclose(abs(table[:, 3]), length, atol=2e-4)
    dented = table[table[:, 3] < -0.2]
    assert len(dented) > 20 and (np.linalg.norm(dented[:, :2] - [35, 20], axis=1) < 6.0).all()
    assert (tmp_path / "deviations.png").read_bytes().startswith(b"\x89PNG")


def test_point_cloud_takes_files_of_its_user(tmp_path):
    output = printed(
        EXAMPLES / "point_cloud.py", MESHES / "bracket.stl", MESHES / "points.csv", folder=tmp_path
    )

    assert output.startswith("6 points against 1 part\n")
    deviations = np.loadtxt(tmp_path / "deviations.csv", delimiter=",", skiprows=1)[:, 3]
    assert deviations[5] == pytest.approx(-2.0)  # (30, 10, 2), as in README.md


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["clearances.py", MESHES / "assembly.glb"], "pin_left  pin_right  38.000"),
        (["distance_field.py", MESHES / "gear.stl", 2], "0 of 10000 points are off by more than 1.732 mm"),
    ],
    ids=["clearances", "distance_field"],
)
def test_other_examples_take_files_too(words, line, tmp_path):
    assert line in printed(EXAMPLES / words[0], *words[1:], folder=tmp_path)


def test_soft_part_answers_with_its_spring_and_damper(tmp_path):
    output = printed(EXAMPLES / "soft_part.py", folder=tmp_path)

    assert_shown("soft_part.py", output)
    rows = [[float(word) for word in line.split()] for line in output.splitlines()[1:6]]
    assert [force for _, force in rows] == pytest.approx(
        [800.0e-3 * depth + 2.0 * 0.020 for depth, _ in rows], abs=2e-3
    )


def test_distance_field_is_within_what_its_grid_allows(tmp_path):
    assert_shown("distance_field.py", printed(EXAMPLES / "distance_field.py", folder=tmp_path))

    field, mesh = np.load(tmp_path / "field.npz"), proximity.load(MESHES / "bracket.stl").parts[0].solid.mesh
    row = (3, 40, 50)
    point = field["origin"] + field["spacing"] * np.array(row)
    expected = oracle.closest(mesh.vertices, mesh.faces, point).distance
    assert field["distance"][row] == pytest.approx(expected, rel=1e-6)


def test_lid_of_the_vr_loop_stops_before_it_touches_a_finger(tmp_path):
    output = printed(EXAMPLES / "vr_loop.py", folder=tmp_path)

    assert_shown("vr_loop.py", output)
    before, stop, after = output.partition("  the lid stops: the left thumb would touch it within 10 ms\n")
    assert stop
    assert "left thumb" in after and not re.search(r"left .* (?:-|touches)", before + after)


def test_service_of_a_vr_program_answers_hands_and_lid(tmp_path):
    copied(
        tmp_path,
        "vr_service.py",
        "vr_service.toml",
        replacing=[("shm://box", f"shm://box-{uuid.uuid4().hex}")],
    )

    # At the end, and if pictures come too slowly, the lid is no longer reported.
    notes = r"(\S+/moves: '[^']+' stands still: no move for 100 ms\n)?"
    *lines, counts = printed(tmp_path / "vr_service.py", folder=tmp_path, notes=notes).splitlines()

    seen = [
        re.fullmatch(r"OK, *([\d.]+) ms old: finger (\d) is *(-?[\d.]+) mm from lid", line) for line in lines
    ]
    distances = [float(found[3]) for found in seen]
    # Hands descend at 10 mm/s and the lid rises at 5 mm/s; a loaded machine draws fewer pictures a second.
    assert len(distances) >= 2 and (np.diff(distances) < -2.0).all(), lines
    assert re.fullmatch(r"\d+ received, \d+ lost.*", counts)


def test_controller_in_c_has_the_drum_where_the_finger_touches(tmp_path):
    frames, poses = free_port(), free_port()
    copied(
        tmp_path,
        *(f"controller_in_c/{name}" for name in ("scene.toml", "hand.py", "main.c", "board.h")),
        replacing=[("127.0.0.1:9100", f"127.0.0.1:{frames}"), ("127.0.0.1:9101", f"127.0.0.1:{poses}")],
    )
    run(sys.executable, "-m", "proximity", "controller", "--out", tmp_path / "controller")
    sources = [
        tmp_path / name for name in ("main.c", "controller/decaff_controller.c", "controller/decaff_glove.c")
    ]
    strict = ["-std=c99", "-O2", "-Wall", "-Wextra", "-Werror", "-Wpedantic", "-Wconversion"]
    run(c_compiler(), *strict, f"-I{tmp_path / 'controller'}", *sources, "-lm", "-o", tmp_path / "main")

    with subprocess.Popen([tmp_path / "main", str(frames)], stdout=subprocess.PIPE, text=True) as controller:
        try:
            printed(tmp_path / "hand.py", folder=tmp_path)
            output, _ = controller.communicate(timeout=PATIENCE)
        finally:
            controller.kill()

    *lines, used = output.splitlines()
    states = [line.split()[0] for line in lines]
    assert states[0] == "APPROACH" and "CONTACT_POSITION" in states and states[-1] == "RETRACTED"
    found, expected = (_at_touch(text) for text in (output, shown("controller_in_c/main.c")))
    assert found == pytest.approx(expected, abs=0.005)
    assert int(used.split()[0]) > 100


def test_hand_of_the_controller_in_c_says_in_a_copy_which_file_is_missing(tmp_path):
    for name in ("scene.toml", "hand.py"):
        shutil.copy(EXAMPLES / "controller_in_c" / name, tmp_path)
    done = subprocess.run(
        [sys.executable, "hand.py"],
        cwd=tmp_path,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "scene.toml:10: parts[0].file is '../../meshes/box.stl', but" in done.stderr


def _at_touch(output):
    """Return the bend and the drum's angle at the first touch."""
    line = next(line for line in output.splitlines() if line.startswith("CONTACT_POSITION"))
    return [float(number) for number in NUMBER.findall(line)[1:]]


class OpenXrRuntime:
    """A stand-in for an OpenXR runtime in pyopenxr's structures: logs calls, returns given session states."""

    def __init__(self, xr, monkeypatch):
        self.xr, self.came, self.states, self._patch = xr, [], [], monkeypatch
        answers = {
            "create_instance": lambda info: (
                self.came.append([*info.enabled_extension_names]) or xr.Instance()
            ),
            "get_system": lambda instance: 1,
            "create_session": lambda instance, info: xr.Session(),
            "create_hand_tracker_ext": self._tracker,
            "poll_event": self._event,
            "begin_session": lambda session, info: self.came.append("begin"),
            "end_session": lambda session: self.came.append("end"),
            "destroy_instance": lambda instance: self.came.append("destroyed"),
        }
        self.answer(**answers)

    def answer(self, **answers):
        """Replace functions of pyopenxr by ones that return these values."""
        for name, answer in answers.items():
            self._patch.setattr(self.xr, name, answer)

    def _tracker(self, session, info):
        tracker = ctypes.cast(ctypes.c_void_p(int(info.hand)), self.xr.HandTrackerEXT)
        tracker.instance = None
        return tracker

    def _event(self, _instance):
        xr = self.xr
        changed = xr.EventDataSessionStateChanged(state=self.states.pop(0)) if self.states else None
        if changed is None or changed.state == xr.SessionState.UNKNOWN:
            raise xr.EventUnavailable()
        buffer = xr.EventDataBuffer()
        ctypes.memmove(ctypes.byref(buffer), ctypes.byref(changed), ctypes.sizeof(changed))
        return buffer


@pytest.fixture
def runtime(monkeypatch):
    return OpenXrRuntime(pytest.importorskip("xr", reason="calls of OpenXR need pyopenxr"), monkeypatch)


def test_hands_by_openxr_are_sent_where_the_part_hangs(runtime, capsys):
    """A left index fingertip 1 mm above the part's foot, y up."""
    xr, came = runtime.xr, runtime.came
    runtime.states += [xr.SessionState.READY, xr.SessionState.STOPPING, xr.SessionState.EXITING]

    def locate(tracker, info, locations):
        joints = locations.contents._joint_locations
        locations.contents.is_active = ctypes.cast(tracker, ctypes.c_void_p).value == xr.HandEXT.LEFT.value
        joints[10].location_flags = 0b1111
        place = joints[10].pose.position
        place.x, place.y, place.z = 0.030, 1.005, -0.310  # (30, 10, 5) mm of the bracket, as in README.md
        return 0

    function = xr.functions.PFN_xrLocateHandJointsEXT(locate)
    runtime.answer(
        create_reference_space=lambda session, info: xr.Space(),
        get_instance_proc_addr=lambda *_: ctypes.cast(function, xr.PFN_xrVoidFunction),
        convert_timespec_time_to_time_khr=lambda instance, at: xr.Time(at.tv_sec * 10**9 + at.tv_nsec),
    )
    address = f"mailbox:openxr-{uuid.uuid4().hex}"
    inlet, room = open_inlet(address), np.zeros(5000, np.uint8)
    runpy.run_path(str(EXAMPLES / "openxr_hands.py"))["main"](address)

    assert came[1:] == ["begin", "end", "destroyed"] and b"XR_EXT_hand_tracking" in came[0]
    assert "1 fingers are tracked" in capsys.readouterr().out
    _, records = parts_of(room[: inlet.receive(room)], proximity.POSES)
    settings = read_scene_file(EXAMPLES / "openxr_hands.toml")
    scene, count = PartFiles().scene(settings), finger_count(settings, None)
    contacts = make_tracker(settings, scene, count).tick(records["position"], 10**9, 10**9 + 1)
    assert np.flatnonzero(contacts["flags"] & 1).tolist() == [1]
    assert contacts["signed_distance"][1] == pytest.approx(0.001 - 0.007)


def reading_of(state=proximity.State.OK, **fields):
    """Return a reading of two fingers; the first touches at bend 0.6, the second has no contact."""
    contacts = np.zeros(2, proximity.CONTACT)
    contacts["flags"] = proximity.ContactFlag.TRACKED | proximity.ContactFlag.CONTACT_FOUND
    contacts["signed_distance"], contacts["contact_bend"] = 0.01, (0.6, np.nan)
    for name, value in fields.items():
        contacts[name] = value
    return Reading(state, False, 0, -1, None, contacts)


def test_curl_limits_reach_the_runtime_and_are_taken_back(runtime, monkeypatch, capsys):
    """0 is free curling, 1 extended: a touch at bend 0.6 gives 0.4; late, stale and the end give 0."""
    xr, came, states = runtime.xr, runtime.came, runtime.xr.SessionState

    def apply(tracker, locations):
        given = locations.contents
        assert given.type == xr.StructureType.FORCE_FEEDBACK_CURL_APPLY_LOCATIONS_MNDX
        assert [each.location.value for each in given.locations] == [0, 1, 2, 3, 4]  # thumb to little finger
        hand = ctypes.cast(tracker, ctypes.c_void_p).value
        came.append((hand, [round(each.value, 3) for each in given.locations]))
        return 0

    function = xr.PFN_xrApplyForceFeedbackCurlMNDX(apply)
    monkeypatch.setattr(
        xr.functions, "get_instance_proc_addr", lambda *_: ctypes.cast(function, xr.PFN_xrVoidFunction)
    )
    runtime.states += [states.READY, *5 * [states.UNKNOWN], states.STOPPING, states.EXITING]
    readings = [
        reading_of(),
        reading_of(signed_distance=-1e-3, contact_bend=0.65),  # the finger yields, but its limit does not
        reading_of(proximity.State.LATE),
        reading_of(flags=proximity.ContactFlag.TRACKED),  # an unconfirmed touch
        reading_of(contact_bend=-0.1),
        reading_of(proximity.State.STALE),
        reading_of(),
    ]
    frames = SimpleNamespace(read=lambda: readings.pop(0))
    monkeypatch.setattr(proximity, "open_subscriber", lambda address: contextlib.nullcontext(frames))

    runpy.run_path(str(EXAMPLES / "curl_limits.py"))["main"]("shm://proximity")

    extensions, begin, *calls, end_of_use = came
    assert (begin, end_of_use) == ("begin", "destroyed")
    assert b"XR_MNDX_force_feedback_curl" in extensions
    calls.remove("end")
    assert [hand for hand, _ in calls] == [1, 2] * 8
    assert all(values == [0.0] * 5 for _, values in calls[1::2])
    assert [values[:2] for _, values in calls[::2]] == [
        [0.4, 0.0], [0.4, 0.35], [0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [0.0, 0.0], [0.4, 0.0], [0.0, 0.0],
    ]  # fmt: skip
    assert capsys.readouterr().out.startswith("0.40 0.00 0.00")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::RuntimeWarning")
def test_notebook_runs_and_shows_the_page(tmp_path, monkeypatch):
    monkeypatch.setenv("PYTHONPATH", ENVIRONMENT["PYTHONPATH"])
    for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(tmp_path / name))
    notebook = nbformat.read(EXAMPLES / "notebook.ipynb", 4)

    nbclient.NotebookClient(
        notebook, timeout=PATIENCE, kernel_name="python3", resources={"metadata": {"path": str(EXAMPLES)}}
    ).execute()

    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    said = "".join(output.text for output in outputs if output.output_type == "stream")
    assert said == shown("notebook.ipynb")
    kinds = [kind for output in outputs for kind in output.get("data", ())]
    assert "image/png" in kinds
    assert outputs[-1].data["text/html"].startswith('<iframe src="http://127.0.0.1:')


def test_study_of_latency_is_a_table_and_a_picture(tmp_path):
    assert_shown("latency_study.py", printed(EXAMPLES / "latency_study.py", folder=tmp_path))

    columns = np.loadtxt(tmp_path / "latency.csv", delimiter=",", skiprows=1).T
    assert (np.diff(columns[1:3]) > 0.0).all()  # a spring and the naive drum get worse with latency
    assert np.ptp(columns[3]) < 0.5  # the time-stamped drum does not
    assert (tmp_path / "latency.png").read_bytes().startswith(b"\x89PNG")
