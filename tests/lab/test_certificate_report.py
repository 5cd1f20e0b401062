"""What is told of a certificate: verdict, document, page and report. Times are made up, mostly."""

import json
import re
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from certificates import TICKS, ball_subject, certificate, found, loop, timing

from proximity import MissingLibraryError, ServiceError
from proximity.lab.certificate import measurement, report, wording
from proximity.lab.certificate.certification import check_request, load
from proximity.lab.certificate.deadlines import PERIODS, periods_of
from proximity.lab.certificate.document import document
from proximity.lab.certificate.report import page
from proximity.lab.figures import style
from proximity.recording import Recording
from proximity.tracker.replay import motions

VOID = {"meta", "br", "path", "use", "rect", "line", "circle"}
SURFACE = np.random.default_rng(1).uniform(-0.05, 0.05, (40, 3))


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
    """The gate goes by the shortest of three runs."""
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
    assert (told["kind"], told["schema"]) == ("proximity latency certificate", 1)
    assert list(told) == [
        "kind", "schema", "scene", "machine", "versions", "settings", "search", "cases", "loop", "feeling",
        "verdict", "machine_verdict",
    ]  # fmt: skip
    assert set(told["scene"]) == {"sha256", "files", "parts", "faces", "bounds"}
    assert re.fullmatch("[0-9a-f]{64}", told["scene"]["sha256"])
    assert told["scene"]["files"] == ["ball & <co>.stl"]
    assert set(told["machine"]) == {"processor", "cores", "system", "load", "date"}
    assert set(told["versions"]) == {"proximity", "python", "numpy", "kernels"}
    assert told["versions"]["proximity"] == "1.2.3"
    assert {"seed", "ticks", "fingers", "budget", "period_s", "gate_s"} <= set(told["settings"])
    assert set(told["search"][0]["places"][0]) == {
        "position", "work", "lower", "upper", "width", "origin", "start_work",
    }  # fmt: skip
    assert {"name", "counts", "ticks", "compute", "wall", "best", "periods", "tail"} <= set(told["cases"][0])
    assert {"missed", "missed_per_million", "missed_per_million_upper_95"} <= set(told["loop"])
    assert set(told["verdict"]) == {"period_s", "fits", "case", "measure", "time_ns", "sentence"}
    assert set(told["machine_verdict"]) == {"period_s", "kept", "missed", "due", "sentence"}


def test_shares_and_misses_are_of_the_period(told):
    row = told["cases"][1]["periods"][-1]

    assert row["period_s"] == 0.0002
    assert row["share"]["max"] == pytest.approx(2.0)
    assert row["missed"] == pytest.approx(TICKS / 2, abs=3)
    assert row["missed_per_million"] == pytest.approx(500_000, rel=0.01)
    assert row["missed_per_million_upper_95"] > row["missed_per_million"]
    late = told["loop"]["lateness"]
    assert late["p50"] == pytest.approx(20_000, rel=1 / 16)
    assert [each["missed"] for each in late["periods"]] == [0] * 6


def test_gate_of_its_own_is_among_the_periods(told):
    assert [row["period_s"] for row in told["cases"][0]["periods"]] == [
        0.04, 0.005, 0.003, 0.001, 0.0005, 0.0002,
    ]  # fmt: skip
    assert periods_of(0.001) == PERIODS


def test_delay_is_a_period_computing_and_waking(told):
    paper, *_, alone = told["feeling"]

    assert alone["delay_s"] == pytest.approx(400e-6 + 20e-6, rel=0.02)
    assert paper["delay_s"] == pytest.approx(0.04 + alone["delay_s"])
    assert [felt["speed"] for felt in paper["speeds"]] == [0.1, 0.5, 1.0]
    for felt in paper["speeds"]:
        assert felt["penetration"] == pytest.approx(felt["speed"] * paper["delay_s"])
        assert felt["force_error"] == pytest.approx(200.0 * felt["penetration"])


class Checked(HTMLParser):
    """Notes what a page asks for from outside, and whether its elements are closed in order."""

    def __init__(self):
        super().__init__()
        self.open, self.links, self.ids, self.text = [], [], [], []

    def handle_starttag(self, tag, attributes):
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attributes:
            if name == "id":
                self.ids.append(value)
            if name in ("src", "href", "xlink:href", "data") and not (value or "").startswith("#"):
                self.links.append(value)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def text(told):
    return page(told, SURFACE)


def test_page_parses_and_asks_for_nothing_from_outside(text):
    checked = Checked()
    checked.feed(text)
    checked.close()

    assert checked.open == [] and checked.links == []
    assert not re.search(r"https?:|//|@import|<script|url\((?!#)", text)
    assert len(checked.ids) == len(set(checked.ids)) > 100
    # What is referred to is there.
    assert set(re.findall(r'(?:href="#|url\(#)([^")]+)', text)) <= set(checked.ids)


def test_page_says_the_same_as_the_document(text, told):
    assert text.count("<svg ") == 2
    assert told["scene"]["sha256"] in text
    assert "took at most 400 µs (worst, passing: 80 % of it)" in text
    assert "<b>Fits.</b>" in text and "<b>Deadlines kept.</b>" in text
    assert told["machine_verdict"]["sentence"][1:] in text
    late = page(document(certificate(report=loop(missed=9000))), SURFACE)
    assert "<b>Fits.</b>" in late and "<b>Deadlines not kept.</b>" in late
    assert "ball &amp; &lt;co&gt;.stl" in text and "<co>" not in text
    assert "core: stays on &lt;1&gt;" in text
    assert "Does not fit" in page(document(certificate(), 0.0002), SURFACE)


def test_page_and_numbers_are_written_beside_each_other(told, tmp_path):
    written = report.write_report(tmp_path / "cell.html", told, ball_subject().scene)

    assert [path.name for path in written] == ["cell.html", "cell.json"]
    assert json.loads((tmp_path / "cell.json").read_text())["schema"] == 1
    assert (tmp_path / "cell.html").read_text().endswith("</html>\n")
    assert len(list(tmp_path.iterdir())) == 2


def test_numbers_are_written_even_without_matplotlib_or_jinja(told, tmp_path, monkeypatch):
    def missing():
        raise MissingLibraryError(
            'figures need matplotlib, which is not installed: pip install "cad-proximity[sim]", '
            'or in a checkout pip install -e ".[sim]"'
        )

    monkeypatch.setattr(style, "load_figure", missing)
    with pytest.raises(MissingLibraryError, match=r'pip install "cad-proximity\[sim\]", or in a'):
        report.write_report(tmp_path / "cell.html", told, ball_subject().scene)

    assert [path.name for path in tmp_path.iterdir()] == ["cell.json"]
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(MissingLibraryError, match=r"^pages need jinja2, which is not installed: pip install"):
        report.write_report(tmp_path / "cell.html", told, ball_subject().scene)
    assert report.write_report(tmp_path / "alone.json", told, ball_subject().scene)[0].name == "alone.json"


@pytest.mark.parametrize(
    ("name", "sentence"),
    [
        ("cell.pdf", r"cell\.pdf does not end in \.html or \.json"),
        ("no/cell.html", "there is no folder .*no"),
    ],
)
def test_report_that_cannot_be_written_is_refused_before_measuring(name, sentence, tmp_path):
    with pytest.raises(ServiceError, match=sentence):
        report.check_report_name(tmp_path / name)


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
    assert len(cases["recording"].thread_ns) == 320  # ticks in which somebody is there
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


def test_bound_on_misses_is_never_rounded_down():
    told = {"missed": 0, "missed_per_million": 0.0, "missed_per_million_upper_95": 149.78}

    assert wording.missed(told) == "0 a million (95 % bound: 150)"
    assert wording.missed({**told, "missed_per_million_upper_95": 150.1}, "") == "0 (95 % bound: 160)"
    seen = {"missed": 3, "missed_per_million": 1234.0, "missed_per_million_upper_95": 23_010.0}
    assert wording.missed(seen, "") == "1 200 (95 % bound: 24 000)"
    assert wording.missed({**seen, "missed_per_million": 1e6}) == "all"
