"""``proximity study``: from a file to rows and a figure, and errors in the file."""

import pytest

from proximity.lab.study import study_run
from proximity.lab.study.study_run import Progress

COMMAND = ("study",)
PRESSES = """
[study]
name = "a few presses"
job = "press"

[factors]
wall = ["coupled", "decaff"]
speed = [0.5, 1.0]
"""


@pytest.fixture
def presses(tmp_path):
    """A study of four presses."""
    path = tmp_path / "presses.toml"
    path.write_text(PRESSES)
    return path


@pytest.mark.slow
def test_study_runs_and_is_drawn(run, presses):
    results = presses.with_suffix(".results")
    empty = run("report", presses)
    first = run("run", presses, "--cores", 1)
    second = run("run", presses, "--cores", 1)
    reported = run("report", presses)

    assert empty.code == 2 and "no results of this study" in empty.words
    assert (first.code, second.code, reported.code) == (0, 0, 0)
    assert first.out.startswith(f"{results}: 4 conditions in ")
    assert second.out == f"{results}: 4 conditions (4 of them earlier)\n"
    assert reported.out == f"{results / 'study.png'}: 4 of 4 conditions\n"
    assert (results / "study.png").read_bytes().startswith(b"\x89PNG")
    assert len((results / "rows.csv").read_text().splitlines()) == 5


def test_interrupted_study_says_what_is_kept(run, presses, monkeypatch):
    def interrupted(study, out, *, watch, **options):
        watch(Progress(1800, 300, 38, 0, 1.0))
        raise KeyboardInterrupt

    monkeypatch.setattr(study_run, "run_study", interrupted)
    found = run("run", presses)

    assert (found.code, found.out) == (130, "")
    assert (
        found.err
        == "proximity: stopped: 338 of 1800 conditions are kept; the same command continues from there\n"
    )


def test_help_names_the_extra_that_is_needed(run):
    assert "pip install 'cad-proximity[study]'" in run("run", "--help").words


def test_mistake_in_a_study_has_its_line(run, presses):
    presses.write_text(PRESSES.replace("speed", "sped"))
    found = run("run", presses)

    assert found.code == 2
    assert f"{presses}:8: [factors] has no key 'sped': did you mean speed?" in found.words
