"""The README and the documentation, compared with the program."""

import contextlib
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from queue import SimpleQueue

import numpy as np
import pytest
from fake_service import filled
from pages import PAGES, README, ROOT
from test_layering import PICTURES
from wire import MS, frame

import proximity
from proximity import cli
from proximity.service import ChangesInput, MessageInput, MovesInput, SensedContacts


def blocks(language, text=README):
    return re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)


@pytest.mark.parametrize(
    ("code", "text"), [(code, text) for text in (README, *PAGES.values()) for code in blocks("python", text)]
)
def test_python_example_prints_what_the_page_shows(code, text, monkeypatch):
    monkeypatch.chdir(ROOT)
    printed = io.StringIO()

    with contextlib.redirect_stdout(printed):
        exec(compile(code, "README.md", "exec"), {})

    assert printed.getvalue() in blocks("text", text)


def test_first_command_prints_what_the_readme_shows(monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    (shown,) = (block for block in blocks("text") if block.startswith("$ "))
    command, _, expected = shown.removeprefix("$ ").partition("\n")

    monkeypatch.setattr("sys.argv", shlex.split(command))

    with pytest.raises(SystemExit) as left:
        cli.main()

    assert left.value.code in (0, None)
    assert capsys.readouterr().out == expected


def test_two_commands_set_everything_up():
    (setup,) = (block for block in blocks("sh") if "proximity demo" in block and "pip install" in block)

    assert setup.splitlines() == [
        'python -m pip install -e ".[service]" && proximity demo',
        "python -m pip install -U pip && python -m pip install -e . --group test && python -m pytest",
    ]


def test_sender_of_poses_as_the_readme_shows_it_is_understood():
    _, sender = blocks("py", PAGES["guide/service.md"])
    source = MessageInput("mailbox:readme/poses", 5)
    tips = np.arange(15.0).reshape(5, 3)

    exec(
        compile(sender.replace("shm://proximity/poses", "mailbox:readme/poses"), "README.md", "exec"),
        scope := {"tips": tips},
    )

    (hands,) = source.poll(time.monotonic_ns())
    np.testing.assert_array_equal(hands.positions, tips)
    assert (hands.pose_ns == scope["message"].header["send_ns"]).all() and hands.pose_ns[0] > 0
    assert source.notes == []


def test_reader_of_frames_as_the_readme_shows_it_follows_and_retreats(monkeypatch):
    reader, _ = blocks("py", PAGES["guide/service.md"])
    told = []

    class Running:
        """A service that ends after two polls."""

        def __init__(self, path):
            self.looks = [True, True, False]

        @property
        def is_running(self):
            is_running = self.looks.pop(0)
            if len(self.looks) == 1:
                sender.publish(frame(time.monotonic_ns(), count=2, valid_for=900 * MS))
            return is_running

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

    monkeypatch.setattr(proximity, "start_service", Running, raising=False)
    with proximity.open_publisher("mailbox:readme") as sender:
        exec(
            compile(reader.replace("shm://proximity", "mailbox:readme"), "README.md", "exec"),
            {
                "proximity": proximity,
                "follow": lambda *of: told.append(("follow", *map(len, of))),
                "retreat": lambda *of: told.append(("retreat", *map(len, of))),
            },
        )

    assert told == [("retreat", 0, 0), ("follow", 2, 2, 2)]


def test_moves_as_the_guide_shows_them_move_a_part():
    code, _ = blocks("py", PAGES["guide/moving-parts.md"])
    source, scene = MovesInput("mailbox:guide/moves"), proximity.load(ROOT / "meshes/assembly.step")

    exec(compile(code.replace("shm://proximity/moves", "mailbox:guide/moves"), "moving-parts.md", "exec"), {})
    source.take(scene, time.monotonic_ns())

    assert scene.part("lid").pose.translation[2] >= 0.010
    np.testing.assert_array_equal(scene.part("lid").velocity, [0.0, 0.0, 0.1])
    assert source.notes == []


def test_changes_as_the_guide_shows_them_hide_and_deform_parts(monkeypatch):
    monkeypatch.chdir(ROOT)
    _, code = blocks("py", PAGES["guide/moving-parts.md"])
    source = ChangesInput("mailbox:guide/changes", SimpleQueue())
    scene = proximity.load("meshes/assembly.step")
    exec(
        compile(code.replace("shm://proximity/changes", "mailbox:guide/changes"), "moving-parts.md", "exec"),
        {},
    )
    source.apply(scene)

    assert [part.name for part in scene.parts if part.is_hidden] == ["pin", "pin_2"]
    _, upper = scene.part("lid").solid.bounds
    assert upper[2] == pytest.approx(0.9 * 0.004)
    assert source.notes == []


def test_measurements_as_the_guide_shows_them_become_contacts():
    (code,) = blocks("py", PAGES["guide/teleoperation.md"])
    source, contact_source = MessageInput("mailbox:guide/sensor", 1, is_measured=True), SensedContacts(1)

    exec(
        compile(code.replace("udp://127.0.0.1:9200", "mailbox:guide/sensor"), "teleoperation.md", "exec"), {}
    )
    now_ns = time.monotonic_ns()
    (measured,) = source.poll(now_ns)
    contact = filled(contact_source, measured, now_ns)[0]

    known = [contact[name] for name in ("signed_distance", "lower", "upper")]
    np.testing.assert_allclose(known, [0.012, 0.0115, 0.0125], rtol=1e-12)
    assert (
        contact["surface"] == proximity.Surface.RIGID and contact["source"] == proximity.Source.TELEOPERATION
    )
    assert source.notes == []


def test_processes_as_the_guide_shows_them_share_a_scene(tmp_path):
    (code,) = blocks("py", PAGES["guide/threads.md"])
    (tmp_path / "pool.py").write_text(code, encoding="utf-8")
    (tmp_path / "meshes").mkdir()
    shutil.copy(ROOT / "meshes/bracket.stl", tmp_path / "meshes")

    run = subprocess.run(
        [sys.executable, "pool.py"], cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip

    assert (run.stdout, run.stderr) == ("20000 answers\n", "")


def test_picture_of_the_layers_is_the_one_that_is_tested():
    (picture,) = (block for block in blocks("text", PAGES["design/layers.md"]) if " cli " in block)
    units = [re.split(r"\s{3,}", line.strip())[0] for line in picture.splitlines()]

    assert units == PICTURES["proximity"].strip().split("\n")


@pytest.mark.parametrize("text", [README, *PAGES.values()], ids=["README.md", *PAGES])
def test_every_file_named_is_there(text):
    for name in re.findall(r"`((?:tests|bench|kernels|scene|meshes)/[\w./]*)`", text):
        assert (ROOT / name).exists() or (ROOT / "proximity" / name).exists(), name


def test_links_of_the_readme_lead_to_files():
    """Those of the documentation are checked by its build."""
    for target in re.findall(r'(?:\]\(|src=")([^)"\s]+)', README):
        if not target.startswith("https:"):
            assert (ROOT / target.partition("#")[0]).exists(), target


def test_readme_is_short():
    assert len(README.encode()) <= 10_000


def test_functions_of_the_flows_are_where_the_page_says():
    flows = PAGES["design/flows.md"].split("\n## ")[1:]
    hops = [re.findall(r"^\d+\. `([\w/.]+)`: `(\w+)`", flow, re.MULTILINE) for flow in flows]

    assert [len(flow) <= most for flow, most in zip(hops, (10, 14, 12), strict=True)] == [True] * 3
    assert sum(map(len, hops)) == len(re.findall(r"^\d+\. ", PAGES["design/flows.md"], re.MULTILINE))
    for path, function in (hop for flow in hops for hop in flow):
        source = (ROOT / "proximity" / path).read_text(encoding="utf-8")
        assert re.search(rf"^( *def|static \w+) {function}\(", source, re.MULTILINE), f"{path}: {function}"
