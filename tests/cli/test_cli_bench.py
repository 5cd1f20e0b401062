"""``proximity bench``: output, files, errors and exit codes, with made-up times."""

import json
import re
import sys
from types import SimpleNamespace

import make
import pytest
from certificates import certificate, loop, timing

from proximity.lab.certificate import certification, worst_positions

CERTIFY = certification.certify
BRACKET, HAND, DEMO = (str(make.FOLDER / name) for name in ("bracket.stl", "hand.csv", "demo.toml"))


@pytest.fixture
def run(run, monkeypatch, tmp_path):
    """Run ``proximity bench`` with a made-up certificate; the result has the arguments of `certify`."""
    asked = []

    def certify(subject, **settings):
        asked.append(SimpleNamespace(subject=subject, **settings))
        return certificate(**run_with.given)

    monkeypatch.setattr(certification, "certify", certify)
    monkeypatch.chdir(tmp_path)

    def run_with(*arguments):
        result = run("bench", *arguments)
        result.asked = asked
        return result

    run_with.given = {}
    return run_with


def test_certificate_is_told_in_tables(run, tmp_path):
    result = run(BRACKET)

    assert (result.code, result.err) == (0, "")
    assert re.search(r"cold, within the budget +508", result.out)
    assert re.search(r"worst, passing +200 +396 +400 +400 +40 % +0", result.out)
    assert re.search(r"service: woken late +20\.\d", result.out)
    words = " ".join(result.out.split())
    assert "scene verdict the scene fits 1 ms: 99.9 % of the ticks of every motion" in words
    assert "400 µs (worst, passing: 40 % of it)" in words
    assert "A drum: exact at a part at rest" in words
    assert "machine verdict this machine kept 1 ms: 0 of 2000 deadlines missed" in words
    assert "not measured" not in words and list(tmp_path.iterdir()) == []


def test_picture_and_numbers_are_written(run, tmp_path):
    assert run(BRACKET, "--out", "cell.png").err == "proximity: wrote cell.png\n"
    assert run(BRACKET, "--out", "cell.json").err == "proximity: wrote cell.json\n"

    assert (tmp_path / "cell.png").read_bytes().startswith(b"\x89PNG")
    assert json.loads((tmp_path / "cell.json").read_text())["schema"] == 2


def test_certificate_names_the_inputs_that_it_does_not_measure(run):
    run.given = {"not_measured": ("parts that move", "held parts")}
    assert "not measured    parts that move, held parts, which make" in run(BRACKET).out


def test_gate_that_is_not_met_exits_with_1_and_one_sentence(run):
    result = run(BRACKET, "--gate", "5kHz", "--out", "cell.json")

    assert result.code == 1
    last = result.err.splitlines()[-1]
    assert last.startswith("proximity: the scene does not fit 0.2 ms: 99.9 % of the ticks of every motion")
    assert "400 µs (worst, passing: 200 % of it)" in last
    assert len(result.err.splitlines()) == 2  # the other line names the written files


def test_machine_that_wakes_late_fails_no_scene(run):
    run.given = {"report": loop(late_us=4000, missed=6000)}

    result = run(BRACKET, "--gate", "1ms", "--out", "cell.json")

    assert result.code == 0
    assert "did not keep 1 ms: 6000 of 8000 deadlines missed" in " ".join(result.out.split())


def test_without_a_gate_the_exit_code_is_0(run):
    run.given = {"timings": [timing("random", 9000)]}

    result = run(BRACKET, "--out", "cell.json")

    assert result.code == 0
    assert "the scene does not fit 1 ms" in result.out


def test_json_is_one_document_and_nothing_is_written(run, tmp_path):
    result = run(BRACKET, "--json", "--gate", "200us")

    document = json.loads(result.out)
    assert result.code == 1
    assert document["schema"] == 2 and document["verdict"]["fits"] is False
    assert document["settings"]["gate_s"] == pytest.approx(0.0002)
    assert list(tmp_path.iterdir()) == []


def test_picture_that_cannot_be_drawn_is_refused_before_anything_is_measured(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)

    result = run(BRACKET, "--gate", "1ms", "--out", "cell.png")

    assert (result.code, result.asked, list(tmp_path.iterdir())) == (2, [], [])
    assert "figures need matplotlib, which is not installed" in result.err


def test_scene_file_says_how_it_is_ticked(run):
    result = run(DEMO, "--out", "cell.json", "--seed", 3, "--ticks", 1234, "--limit", 0.5)

    asked = result.asked[0]
    assert (asked.tick_count, asked.seconds, asked.seed) == (1234, 0.5, 3)
    assert asked.subject.files == (DEMO, BRACKET, HAND)
    assert asked.subject.settings == {"radius": 0.007, "working_range": 0.12}
    assert len(asked.subject.recording.times_ns) == 5194


def test_recording_is_given_or_a_sample(run):
    given = run(BRACKET, "--out", "a.json", "--recording", HAND, "--fingers", 3).asked[-1].subject
    sample = run(BRACKET, "--out", "a.json").asked[-1].subject

    assert given.fingers == 3 and sample.fingers == 5
    assert given.files == sample.files == (BRACKET, HAND)
    assert given.recording.positions.shape == (5194, 5, 3)


def test_all_of_it_runs_on_a_box(run, monkeypatch):
    """A short run of the actual search, timing and loop, without limits on the times."""
    monkeypatch.setattr(worst_positions, "START_COUNTS", (30, 30, 8))
    monkeypatch.setattr(worst_positions, "CLIMBS", 2)
    monkeypatch.setattr(certification, "certify", CERTIFY)
    box = str(make.FOLDER / "box.stl")

    result = run(box, "--ticks", 1000, "--limit", 0.05, "--no-realtime", "--json")

    document = json.loads(result.out)
    assert result.code == 0 and result.err == ""
    assert document["scene"]["faces"] == 12
    assert [each["name"] for each in document["cases"]][:2] == ["recording", "random"]
    for goal in document["search"]:
        assert goal["places"][0]["work"] >= goal["typical_work"] > 0
    assert document["loop"]["ticks"] <= 50
