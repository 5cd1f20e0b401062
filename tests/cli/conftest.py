"""The command line, run in this process: one fixture for all commands."""

import io
import sys
from types import SimpleNamespace

import pytest

from proximity import cli

TERMINAL_SETTINGS = (
    "FORCE_COLOR",
    "NO_COLOR",
    "GITHUB_ACTIONS",
    "COLUMNS",
    "TERMINAL_WIDTH",
    "TTY_COMPATIBLE",
    "TTY_INTERACTIVE",
)


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
