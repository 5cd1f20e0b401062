"""The command line, run in this process: one fixture for all commands."""

import io
import os
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
    """Run the command line; returns exit code, stdout, stderr, and the words of both without Rich's frames.

    What a test file names as ``COMMAND`` stands before the arguments.
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
    """Compare a text with a file of ``texts``, or write it there where PROXIMITY_UPDATE_TEXTS is set."""

    def compare(name, text):
        path = Path(__file__).parent / "texts" / f"{name}.txt"
        if os.environ.get("PROXIMITY_UPDATE_TEXTS"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(text, encoding="utf-8")
        assert text == path.read_text(encoding="utf-8")

    return compare
