"""``proximity client``: what it writes, what it leaves alone, and how it refuses."""

import sys

import pytest

from proximity import cli
from proximity.message.clients import EXAMPLES, client_files


@pytest.fixture
def run(monkeypatch, capsys):
    """Run the command in this process; returns exit code, stdout and stderr."""

    def run_with(*arguments):
        monkeypatch.setattr(sys, "argv", ["proximity", "client", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            cli.main()
        written = capsys.readouterr()
        return end.value.code or 0, written.out, written.err

    return run_with


@pytest.mark.parametrize("language", ["csharp", "javascript", "cpp"])
def test_files_are_written_and_examples_are_left_alone(run, language, tmp_path):
    folder = tmp_path / "a" / "b"
    code, out, err = run(language, "--out", folder)
    files = {path.name: path.read_text(encoding="utf-8") for path in folder.iterdir()}
    assert (code, err, files) == (0, "", client_files(language))
    assert out.splitlines() == [f"{folder / name}: written" for name in client_files(language)]

    for path in folder.iterdir():
        path.write_text("mine")
    _, out, _ = run(language, "--out", folder)

    kept = {path.name for path in folder.iterdir() if path.read_text(encoding="utf-8") == "mine"}
    assert kept == EXAMPLES & set(files)
    assert all(f"{folder / name}: left alone, it is there already" in out.splitlines() for name in kept)


def test_file_that_cannot_be_written_is_told(run, tmp_path):
    (tmp_path / "decaff_client.hpp").mkdir()

    code, _, err = run("cpp", "--out", tmp_path)

    assert code == 2
    assert err == f"proximity: {tmp_path}/decaff_client.hpp: cannot be written (it is no regular file)\n"
