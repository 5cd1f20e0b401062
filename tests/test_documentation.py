"""Commands of the README and the documentation, run as a reader would.

Blocks marked ``sh`` are run in a folder with the sample meshes; a block of ``text`` right below has what
they print, where a line with ``…`` alone stands for any lines. Blocks marked ``shell`` need more than the
samples (a network, a device, a minute) and are compared with the program's options only.
"""

import os
import re
import shlex
import socket
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import typer
from pages import PAGES, README
from ports import free_port
from project import MESHES, ROOT
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

import proximity
from proximity import cli
from proximity.recording.frame_bytes import frame_type

TEXTS = {"README.md": README, **PAGES}
BLOCK = re.compile(r"```(sh|shell)\n(.*?)```\n(?:\n```text\n(.*?)```)?", re.DOTALL)


def blocks(*kinds):
    return [
        pytest.param(code, printed, id=f"{page}-{number}")
        for page, text in TEXTS.items()
        for number, (kind, code, printed) in enumerate(BLOCK.findall(text))
        if kind in kinds
    ]


def runnable():
    """All blocks but those that install something; the README's is run by continuous integration."""
    return [each for each in blocks("sh") if "pip install" not in each.values[0]]


@pytest.mark.slow
@pytest.mark.parametrize(("code", "printed"), runnable())
def test_commands_print_what_the_page_shows(code, printed, tmp_path):
    (tmp_path / "meshes").symlink_to(MESHES)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    paths = [str(Path(sys.executable).parent), os.environ["PATH"]]
    environment = {**os.environ, "PATH": os.pathsep.join(paths), "COLUMNS": "100", "PYTHONPATH": str(ROOT)}

    done = subprocess.run(
        ["bash", "-ec", code], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=300
    )

    assert done.returncode == 0, done.stderr
    if printed:
        expected = ".*".join(re.escape(part) for part in re.split(r"(?m)^…$", printed))
        assert re.fullmatch(expected, done.stdout, re.DOTALL), done.stdout


@pytest.mark.parametrize(("code", "printed"), blocks("sh", "shell"))
def test_options_in_commands_are_those_of_the_program(code, printed):
    group = typer.main.get_command(cli.app)
    for line in code.replace("\\\n", " ").splitlines():
        for words in commands_of(line):
            command, at = group, 1
            while hasattr(command, "commands") and at < len(words) and not words[at].startswith("-"):
                assert words[at] in command.commands, line
                command, at = command.commands[words[at]], at + 1
            known = {name for each in command.params for name in (*each.opts, *each.secondary_opts)}
            known |= {"--help", "-h", "--install-completion"}
            used = {word.partition("=")[0] for word in words[at:] if re.match(r"--?[a-z]", word)}
            assert used <= known, f"{line}: {sorted(used - known)}"


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_to_files_of_the_checkout(name):
    """Pages are read on a code host as well, where nothing that a build makes is there."""
    prose = re.sub(r"```.*?```", "", PAGES[name], flags=re.DOTALL)
    targets = [target for target in re.findall(r"\]\(([^)#\s]+)", prose) if "://" not in target]

    assert [target for target in targets if not (ROOT / "docs" / name).parent.joinpath(target).exists()] == []
    assert "--8<--" not in PAGES[name]


@pytest.mark.parametrize("name", PAGES)
def test_links_lead_to_headings_of_the_checkout(name):
    prose = re.sub(r"```.*?```", "", PAGES[name], flags=re.DOTALL)
    for target, heading in re.findall(r"\]\(([^)#\s]*)#([^)\s]+)\)", prose):
        if "://" not in target:
            page = (ROOT / "docs" / name).parent.joinpath(target) if target else ROOT / "docs" / name
            text = re.sub(r"```.*?```", "", page.resolve().read_text(encoding="utf-8"), flags=re.DOTALL)
            assert heading in {slug(title) for title in re.findall(r"(?m)^#+ (.*)$", text)}, (target, heading)


def slug(title):
    """The anchor of a heading, as mkdocs and code hosts make it."""
    title = re.sub(r"\[([^]]*)\]\([^)]*\)|`", r"\1", title)
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower())


def commands_of(line):
    """The words of each call of the program in a line."""
    words = shlex.split(line, comments=True)
    breaks = [-1, *(at for at, word in enumerate(words) if word in {"|", "&&", ">", ";", "&"}), len(words)]
    calls = [words[start + 1 : end] for start, end in pairwise(breaks)]
    return [call for call in calls if call[:1] == ["proximity"]]


@pytest.mark.slow
def test_page_of_ones_own_needs_no_program_but_the_service(tmp_path):
    """The scene file of the page on hands, with a port of its own."""
    (scene,) = re.findall(r"```toml\n(\[service\].*?)```", PAGES["guide/hands.md"], re.DOTALL)
    (tmp_path / "meshes").symlink_to(MESHES)
    url = f"ws://127.0.0.1:{free_port(kind=socket.SOCK_STREAM)}"
    (tmp_path / "page.toml").write_text(scene.replace("ws://127.0.0.1:8765", url))
    message = proximity.Message(proximity.POSES, 1)
    message.records["position"] = [0.030, 0.010, 0.061]

    with (
        proximity.start_service(tmp_path / "page.toml") as service,
        connect(url, origin="http://localhost:5173") as page,
    ):
        distance = np.inf
        for sequence in range(2000):
            message.header["send_ns"] = message.records["pose_ns"] = time.monotonic_ns()
            page.send(message.seal(1, sequence).tobytes())
            data = np.frombuffer(page.recv(60), np.uint8)
            if data[:4].tobytes() == proximity.FRAME.magic.to_bytes(4, "little"):
                distance = data.view(frame_type(len(data)))[0]["contacts"]["signed_distance"][0]
            if distance < 1.0:
                break
        expected = (
            proximity.load(MESHES / "bracket.stl").signed_distance(message.records["position"][0]) - 0.007
        )
        assert distance == pytest.approx(expected, abs=1e-9)
        assert service.beginning["part_names"] == ["bracket"]
        with pytest.raises(InvalidStatus, match="403"), connect(url, origin="http://elsewhere"):
            pass


@pytest.mark.slow
def test_program_of_the_first_hour_of_a_vr_author_reads_distances(tmp_path):
    """The scene file and the program of the page, with addresses of their own."""
    page = PAGES["start/vr-author.md"]
    (tmp_path / "meshes").symlink_to(MESHES)
    for kind, name in (("toml", "cell.toml"), ("py", "vr.py")):
        (block,) = re.findall(rf"```{kind}\n(.*?)```", page, re.DOTALL)
        (tmp_path / name).write_text(block.replace("shm://cell", f"shm://first-hour-{os.getpid()}"))

    done = subprocess.run(
        [sys.executable, "vr.py"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
    )

    assert done.returncode == 0, done.stderr
    assert re.search(r"^\d+\.\d mm$", done.stdout, re.MULTILINE), done.stdout
