"""Fixtures that run the command line in this process."""

import io
import json
import os
import shlex
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from proximity import cli

TERMINAL_SETTINGS = (
    "FORCE_COLOR", "NO_COLOR", "GITHUB_ACTIONS", "COLUMNS", "TERMINAL_WIDTH", "TTY_COMPATIBLE",
    "TTY_INTERACTIVE",
)  # fmt: skip


@pytest.fixture
def run(request, monkeypatch, capsys):
    """Run the command line; return exit code, stdout, stderr, and the words of both without Rich's frames.

    The test file's ``COMMAND`` precedes the arguments.
    """
    for name in TERMINAL_SETTINGS:
        monkeypatch.delenv(name, raising=False)
    command = getattr(request.module, "COMMAND", ())

    def run_with(*arguments, stdin=None):
        monkeypatch.setattr(sys, "argv", ["proximity", *command, *map(str, arguments)])
        if stdin is not None:
            monkeypatch.setattr(sys, "stdin", io.StringIO(stdin))
        with pytest.raises(SystemExit) as end:
            cli.main()
        out, err = capsys.readouterr()
        unframed = "".join(" " if letter in "╭╮╰╯─│" else letter for letter in f"{out} {err}")
        return SimpleNamespace(code=end.value.code or 0, out=out, err=err, words=" ".join(unframed.split()))

    return run_with


@pytest.fixture
def recorded():
    """Compare a text with a file of ``texts``, or write the file if PROXIMITY_UPDATE_TEXTS is set."""

    def compare(name, text):
        path = Path(__file__).parent / "texts" / f"{name}.txt"
        if os.environ.get("PROXIMITY_UPDATE_TEXTS"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        assert text == path.read_text(encoding="utf-8")

    return compare


@pytest.fixture
def transcript(run, recorded):
    """Run commands, one per line with ``< lines;of;input``, and compare their output with ``texts``."""

    def compare(name, commands, stdin=""):
        text = ""
        for command in filter(None, map(str.strip, commands.splitlines())):
            words, _, given = command.partition(" < ")
            result = run(*shlex.split(words), stdin=given.replace(";", "\n") + "\n" if given else stdin)
            ending = f"[{result.code}]\n" if result.code else ""
            text += f"$ {command}\n{result.out}{result.err}{ending}\n"
            if "--json" in words and result.code < 2:
                json.loads(result.out, parse_constant=_refuse_constant)
        recorded(name, text)
        assert "\x1b" not in text

    return compare


def _refuse_constant(word):
    raise AssertionError(f"{word} is not JSON")
