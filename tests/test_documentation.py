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

import pytest
import typer
from pages import PAGES, README
from ports import free_port
from project import MESHES, ROOT
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from proximity import cli

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


def commands_of(line):
    """The words of each call of the program in a line."""
    words = shlex.split(line, comments=True)
    breaks = [-1, *(at for at, word in enumerate(words) if word in {"|", "&&", ">", ";", "&"}), len(words)]
    calls = [words[start + 1 : end] for start, end in pairwise(breaks)]
    return [call for call in calls if call[:1] == ["proximity"]]


def test_bridge_for_a_page_passes_on_what_comes(tmp_path):
    """The program of the page on hands, with ports of its own."""
    (code,) = re.findall(r"```py\n(.*?)```", PAGES["guide/hands.md"], re.DOTALL)
    frames, poses, live = (str(free_port()) for _ in range(3))
    for shown, own in (("9100", frames), ("9101", poses), ("8765", live)):
        code = re.sub(rf"\b{shown}\b", own, code)
    (tmp_path / "bridge.py").write_text(code)
    with (
        socket.socket(type=socket.SOCK_DGRAM) as service,
        subprocess.Popen([sys.executable, "bridge.py"], cwd=tmp_path) as bridge,
    ):
        try:
            service.bind(("127.0.0.1", int(poses)))
            service.settimeout(60)
            with connected(f"ws://127.0.0.1:{live}", origin="http://localhost:5173") as page:
                page.send(b"pose")
                assert service.recv(100) == b"pose"
                service.sendto(b"frame", ("127.0.0.1", int(frames)))
                assert page.recv(60) == b"frame"
            with pytest.raises(InvalidStatus, match="403"):
                connect(f"ws://127.0.0.1:{live}", origin="http://elsewhere")
        finally:
            bridge.kill()


def connected(url, **options):
    """A connection, as soon as somebody listens."""
    for _ in range(600):
        try:
            return connect(url, **options)
        except OSError:
            time.sleep(0.1)
    raise AssertionError(f"nobody listens at {url}")


@pytest.mark.slow
def test_program_of_the_first_hour_of_a_vr_author_reads_distances(tmp_path):
    """The scene file and the program of the page, with addresses of their own."""
    page = PAGES["start/vr-author.md"]
    (tmp_path / "meshes").symlink_to(MESHES)
    for kind, name in (("toml", "cell.toml"), ("py", "vr.py")):
        (block,) = re.findall(rf"```{kind}\n(.*?)```", page, re.DOTALL)
        (tmp_path / name).write_text(block.replace("iox2://cell", f"iox2://first-hour-{os.getpid()}"))

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
