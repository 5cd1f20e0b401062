"""The README, held against the program."""

import contextlib
import io
import re
import shlex
from pathlib import Path

import pytest
from test_layering import LAYERS

from proximity import cli

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.mark.parametrize("code", blocks("python"), ids=["questions", "ticks"])
def test_python_example_prints_what_the_readme_shows(code, monkeypatch):
    monkeypatch.chdir(ROOT)
    printed = io.StringIO()

    with contextlib.redirect_stdout(printed):
        exec(compile(code, "README.md", "exec"), {})

    assert printed.getvalue() in blocks("text")


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
    (setup,) = (block for block in blocks("sh") if "pip install -e ." in block and "bench" not in block)

    assert setup.splitlines() == [
        "python -m pip install -e . && proximity demo",
        'python -m pip install -e ".[test]" && python -m pytest',
    ]


def test_picture_of_the_layers_is_the_one_that_is_tested():
    (picture,) = (block for block in blocks("text") if "queries · sign" in block)
    units = [re.split(r"\s{3,}", line.strip())[0] for line in picture.splitlines()]

    assert units == LAYERS.split("\n")[1:-1]


def test_every_file_named_is_there():
    for name in re.findall(r"`((?:tests|bench|kernels|meshes)/[\w./]*)`", README):
        assert (ROOT / name).exists() or (ROOT / "proximity" / name).exists(), name
