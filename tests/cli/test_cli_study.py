"""``proximity study``: from a file to rows and a page, and what it says of mistakes."""

import pytest

from proximity.lab.sweep import study_run
from proximity.lab.sweep.study_run import Progress

COMMAND = ("study",)
PRESSES = """
[study]
name = "a few presses"
job = "press"
measures = ["force_error", "peak"]

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
def test_study_runs_reports_and_repeats(run, presses):
    results = presses.with_suffix(".results")
    first = run("run", presses, "--cores", 1)
    second = run("run", presses, "--cores", 1)
    reported = run("report", results)
    page = (results / "study.html").read_text()
    key = page.partition("<tr><td><code>")[2].partition("<")[0]
    repeated = run("run", presses, "--only", key)
    now, recorded = next(
        line.split()[1:] for line in repeated.out.splitlines() if line.startswith("force_error")
    )

    assert (first.code, second.code, reported.code, repeated.code) == (0, 0, 0, 0)
    assert first.out.startswith(f"{results}: 4 conditions in ")
    assert f"proximity study report {results}" in first.words
    assert second.out == f"{results}: 4 conditions (4 of them earlier)\n"
    assert "4 of 4 conditions" in page and "a few presses" in page
    assert now == recorded
    beside = {path.name for path in results.glob("study-*")}
    assert beside == {
        f"study-{plot}.{form}" for plot in ("main", "effects") for form in ("png", "pdf", "csv")
    }
    assert "speed [m/s]" in (results / "study-main.csv").read_text().splitlines()[0]


def test_interrupted_study_says_what_is_kept(run, presses, monkeypatch):
    def interrupted(study, out, *, watch, **options):
        watch(Progress(1800, 300, 38, 0, 1.0))
        raise KeyboardInterrupt

    monkeypatch.setattr(study_run, "run_study", interrupted)
    found = run("run", presses)

    assert (found.code, found.out) == (130, "")
    assert found.err == "proximity: stopped: 338 of 1800 conditions are kept; the same command goes on\n"


def test_help_names_the_extra_that_is_needed(run):
    assert "pip install 'cad-proximity[study]'" in run("run", "--help").words


def test_mistake_in_a_study_has_its_line(run, presses):
    presses.write_text(PRESSES.replace("speed", "sped"))
    found = run("run", presses)

    assert found.code == 2
    assert f"{presses}:9: [factors] has no key 'sped': did you mean speed?" in found.words
