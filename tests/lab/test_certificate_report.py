"""Reports of a certificate: verdict, document and picture, mostly with made-up times."""

import json
import re

import numpy as np
import pytest
from certificates import TICKS, ball_subject, certificate, found, loop, timing
from project import MESHES

from proximity import ServiceError
from proximity.lab.certificate import measurement, motions, report
from proximity.lab.certificate.certification import check_request, load
from proximity.lab.certificate.report import document
from proximity.lab.certificate.subject import read_subject
from proximity.recording import Recording


def test_scene_fits_as_long_as_its_slowest_motion_does():
    slow = certificate([timing("random", 100), timing("worst, cold start", 999)])

    verdict = slow.verdict(0.001)

    assert verdict["fits"] and not slow.verdict(0.0009)["fits"]
    assert verdict["case"] == "worst, cold start"
    assert verdict["sentence"] == (
        "the scene fits 1 ms: 99.9 % of the ticks of every motion, in the best of three runs, took at most "
        "998 µs (worst, cold start: 100 % of it), half of the loop's 100 µs; 0 of 6000 took longer"
    )
    assert slow.verdict(0.0005)["sentence"].startswith("the scene does not fit 0.5 ms: ")


def test_motion_without_a_budget_does_not_judge_the_scene():
    unlimited = timing("worst, exact", 80_000, counts=False)

    assert certificate([timing("random", 100), unlimited]).verdict(0.001)["fits"]


def test_interruptions_of_one_run_do_not_fail_a_scene():
    """The gate uses the shortest of three runs."""
    timed = timing("random", 100)
    timed.thread_ns[-200:] = 5_000_000

    verdict = certificate([timed]).verdict(0.001)

    assert verdict["fits"] and "; 0 of " in verdict["sentence"]


def test_loop_that_computes_too_long_fails_a_scene_and_waking_late_does_not():
    assert not certificate(report=loop(compute_us=1500)).verdict(0.001)["fits"]
    assert certificate(report=loop(late_us=5000, missed=9000)).verdict(0.001)["fits"]


@pytest.mark.parametrize(
    ("missed", "kept", "sentence"),
    [
        (0, True, "this machine kept 1 ms: 0 of 2000 deadlines missed, at most 0.1 % allowed"),
        (2, True, "this machine kept 1 ms: 2 of 2002 deadlines missed, at most 0.1 % allowed"),
        (3, False, "this machine did not keep 1 ms: 3 of 2003 deadlines missed, at most 0.1 % allowed"),
    ],
)
def test_deadlines_of_the_machine_are_a_verdict_of_their_own(missed, kept, sentence):
    verdict = certificate(report=loop(missed=missed)).machine_verdict()

    assert verdict == {
        "period_s": 0.001, "kept": kept, "missed": missed, "due": 2000 + missed, "sentence": sentence,
    }  # fmt: skip


def test_where_so_few_ticks_tell_no_tail_the_longest_counts():
    found = load("short", np.array([1000, 2000, 9_000_000]), 0.001)

    assert (found.measure, found.tail_ns, found.over_count) == ("max", 9e6, 1)


@pytest.mark.parametrize(
    ("request_", "sentence"),
    [
        ((999, 1.0, 0), r"999 ticks are too few for p99\.9"),
        ((1000, 0.0, 0), "the loop cannot run for 0 s, expected up to 3600 s"),
        ((1000, float("nan"), 0), "the loop cannot run for nan s"),
        ((1000, 1.0, -1), "-1 is not a seed, expected a whole number of 0 or more"),
    ],
)
def test_what_cannot_be_measured_is_refused(request_, sentence):
    with pytest.raises(ServiceError, match=sentence):
        check_request(*request_)


@pytest.fixture(scope="module")
def told():
    return document(certificate(), 0.0005, version="1.2.3")


def test_document_has_what_its_schema_says(told):
    assert (told["kind"], told["schema"]) == ("proximity latency certificate", 2)
    assert list(told) == [
        "kind", "schema", "scene", "machine", "versions", "settings", "search", "cases", "loop",
        "at_the_finger", "verdict", "machine_verdict",
    ]  # fmt: skip
    assert set(told["scene"]) == {"sha256", "files", "parts", "faces", "bounds"}
    assert re.fullmatch("[0-9a-f]{64}", told["scene"]["sha256"])
    assert told["scene"]["files"] == ["ball & <co>.stl"]
    assert set(told["machine"]) == {"processor", "cores", "system", "load", "date"}
    assert set(told["versions"]) == {"proximity", "python", "numpy", "kernels"}
    assert told["versions"]["proximity"] == "1.2.3"
    assert {"seed", "ticks", "fingers", "budget", "period_s", "gate_s"} <= set(told["settings"])
    assert set(told["search"][0]["places"][0]) == {
        "position", "work", "lower", "upper", "origin", "start_work",
    }  # fmt: skip
    assert {"name", "counts", "ticks", "compute", "wall", "best"} <= set(told["cases"][0])
    assert set(told["verdict"]) == {"period_s", "fits", "case", "measure", "time_ns", "sentence"}
    assert set(told["machine_verdict"]) == {"period_s", "kept", "missed", "due", "sentence"}


def test_ticks_over_the_period_are_counted():
    case = document(certificate(), 0.0002)["cases"][1]["compute"]

    assert case["max"] == pytest.approx(400e3) and case["over_period"] == pytest.approx(TICKS / 2, abs=3)
    assert case["tail"][0][1] == TICKS


def test_delay_is_computing_and_waking(told):
    found = told["at_the_finger"]

    assert found["delay_s"] == pytest.approx(400e-6 + 20e-6, rel=0.02)
    assert [each["speed"] for each in found["speeds"]] == [0.1, 0.5, 1.0]
    for each in found["speeds"]:
        assert each["penetration"] == pytest.approx(each["speed"] * found["delay_s"])
        assert each["force_error"] == pytest.approx(200.0 * each["penetration"])


def test_picture_shows_all_motions_and_worst_positions(told, tmp_path):
    report.write_report(tmp_path / "cell.svg", told, ball_subject().scene)
    drawn = (tmp_path / "cell.svg").read_text()

    for words in (
        "worst, passing",
        "service: woken late",
        "cold, within the budget",
        "moves, exact",
        "x [mm]",
    ):
        assert words in drawn


def test_numbers_are_written_as_json_without_nan(told, tmp_path):
    odd = told | {"search": [{"typical_work": float("nan")}]}
    report.write_report(tmp_path / "cell.json", odd, ball_subject().scene)

    assert json.loads((tmp_path / "cell.json").read_text())["search"] == [{"typical_work": None}]


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("cell.html", r"cell\.html does not end in \.json or \.png, \.svg, \.pdf"),
        ("no/cell.png", "no folder .*no"),
    ],
)
def test_report_that_cannot_be_written_is_refused_before_measuring(name, sentence, tmp_path):
    with pytest.raises(ServiceError, match=sentence):
        report.check_report(tmp_path / name)


def test_inputs_that_are_not_measured_are_named(tmp_path):
    path = tmp_path / "cell.toml"
    text = '[[parts]]\nfile = "{}"\n[input]\n'.format(MESHES / "box.stl")
    path.write_text(text + 'poses = "mailbox:p"\nmoves = "mailbox:m"\n')

    assert read_subject(path).not_measured == ("paths of fingers", "parts that move")
    assert read_subject(MESHES / "held.toml").not_measured[-1] == "held parts"
    assert read_subject(MESHES / "box.stl").not_measured == ()


def test_motions_are_timed_with_as_many_ticks_as_asked_for():
    positions = np.full((50, 2, 3), 0.06)
    positions[10:20] = np.nan
    hand = Recording(np.arange(50) * 1_000_000, positions, ((0, 1), (0, 2)), "hand.csv")

    cases = {
        each.name: each
        for each in measurement.measure(ball_subject(recording=hand, fingers=3), found(), 400, 1)
    }

    assert list(cases) == [
        "recording", "random", "worst, at rest", "worst, passing", "worst, cold start", "worst, exact",
    ]  # fmt: skip
    assert [each.counts for each in cases.values()] == [True] * 5 + [False]
    assert cases["recording"].fingers == 2 and cases["random"].fingers == 3
    assert len(cases["recording"].thread_ns) == 320  # ticks with a hand
    assert len(cases["worst, cold start"].thread_ns) == 400
    for each in cases.values():
        assert (each.best_ns <= each.thread_ns).all()
        assert sum(each.shares.values()) == pytest.approx(1.0)


def test_fingers_that_pass_go_through_their_places_at_the_speed_said():
    places = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])

    way = motions.passing(places, 5, 4000, np.random.default_rng(2))
    speeds = np.linalg.norm(np.diff(way, axis=0), axis=2) * 1000.0

    assert speeds.max() == pytest.approx(motions.PASSING_SPEED, rel=0.01)
    assert np.linalg.norm(way - places[[0, 1, 0, 1, 0]], axis=2).min(axis=0).max() < 1e-4


def test_recording_in_which_nobody_is_seen_is_refused():
    hand = Recording(np.arange(3) * 1_000_000, np.full((3, 1, 3), np.nan), ((0, 1),), "empty.csv")

    with pytest.raises(ValueError, match=r"empty\.csv: no finger is tracked at any tick"):
        measurement.measure(ball_subject(recording=hand), found(), 1000, 1)


def test_loop_runs_as_long_as_said_and_counts_computing_apart():
    report = measurement.run_loop(ball_subject(real_time=False), found(), 0.05, 3)

    assert report.ticks + report.missed >= 50 and report.ticks <= 50
    assert report.compute.count == report.lateness.count == report.ticks
    assert report.publish_failures == {measurement.ADDRESS: 0}
