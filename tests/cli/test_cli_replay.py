"""``proximity replay``: what it prints, writes and refuses, on the sample bracket and the generated hand."""

import json
import re

import make
import numpy as np
import pytest
from fake_tracker import FakeTracker

import proximity
from proximity.cli import output
from proximity.cli.lab import replay_report
from proximity.message import CONTACT

BRACKET = str(make.FOLDER / "bracket.stl")
HAND = str(make.FOLDER / "hand.csv")
AS_RECORDED = ("--place", 0, 0, 0)
SHORT = ("--limit", 0.1)


@pytest.fixture
def run(run, monkeypatch):
    """``proximity replay`` with a tracker that is none; the result has the trackers that were made."""
    trackers = []

    def make_tracker(scene, **settings):
        trackers.append(FakeTracker(scene, **settings, spoil=run_with.spoil))
        trackers[-1].all_settings = settings
        return trackers[-1]

    monkeypatch.setitem(vars(proximity), "Tracker", make_tracker)

    def run_with(*arguments):
        result = run("replay", *arguments)
        result.trackers = trackers
        return result

    run_with.spoil = None
    return run_with


def lines_of(text):
    """The labelled lines: a list of values for each label."""
    found = {}
    for line in text.splitlines():
        found.setdefault(line[:16].strip(), []).append(line[16:])
    return found


def test_hand_at_the_bracket_is_told_in_words(run, monkeypatch):
    monkeypatch.setattr(output, "WIDTH", 1000)  # lines are not wrapped
    result = run(BRACKET, HAND, *AS_RECORDED)

    lines = lines_of(result.out)
    assert result.code == 0
    assert result.err == ""
    assert lines["scene"] == [f"{BRACKET}: 1 part, 10620 faces"]
    assert lines["recording"] == [f"{HAND}: 5.194 s, 5 fingers of 1 hand, 2472 samples in 500 frames, 6 gaps"]
    assert lines["placement"] == ["origin at 0  0  0 mm, scale 1; as given"]
    assert lines["ticks"] == ["5194 at 1000 Hz, radius 7 mm, latency 1 ms"]
    assert re.fullmatch(r"p50 [\d.]+, p99 [\d.]+, p99.9 [\d.]+, max [\d.]+ µs a tick", lines["compute"][0])
    assert lines["answers"] == [
        "85.2 % exact, 0.0 % bounded, 14.8 % skipped (bounds from the last search); finger lost in 3.9 %"
    ]
    assert lines["nearest"] == ["little at 2.597 s: -2.867 mm from bracket"]
    assert [line.split(":")[0] for line in lines["touch"]] == ["thumb", "index", "middle", "ring", "little"]
    assert lines["touch"][0] == "thumb: 2 times, first at 1.638 s, 1.178 mm deep"
    assert lines["bounds"] == [
        "12483 of 12483 hold, checked against exact distances (a sample of the 24965 of all fingers)"
    ]
    assert re.fullmatch(
        r"\d+\.\d % within their bounds; median error .* µm, p95 .* µm", lines["predictions"][0]
    )
    assert re.fullmatch(
        r"(\d+) of \1 certified times held \(velocity constant within 5 %\)", lines["contact times"][0]
    )


def test_histogram_counts_every_tick(run):
    result = run(BRACKET, HAND, *AS_RECORDED, *SHORT)

    rows = re.findall(r"^ *[\d.]+ to [\d.]+ +µs +(\d+)( +#+)?$", result.out, re.MULTILINE)
    assert sum(int(count) for count, _ in rows) == 91
    assert all((int(count) > 0) == bool(bar) for count, bar in rows)
    assert max(len(bar.strip()) for _, bar in rows) == replay_report.BAR_WIDTH


def test_json_has_the_same_numbers(run):
    report = json.loads(run(BRACKET, HAND, *AS_RECORDED, "--json").out)

    assert report["recording"]["gap_count"] == 6
    assert report["placement"] == {
        "is_fitted": False, "position": [0.0, 0.0, 0.0], "turn_degrees": [0.0, 0.0, 0.0], "scale": 1.0,
    }  # fmt: skip
    assert report["ticks"]["tick_count"] == 5194
    assert report["nearest"]["signed_distance"] == pytest.approx(-2.867, abs=1e-3)
    assert report["touches"][0]["deepest"] == pytest.approx(1.178, abs=1e-3)
    assert report["bounds"] == {"checked_count": 12483, "broken_count": 0, "worst": 0.0, "first_broken": None}
    assert sum(count for _, _, count in report["compute_us"]["histogram"]) == 5194


def test_without_a_place_the_hand_still_touches(run):
    report = json.loads(run(BRACKET, HAND, "--json", "--rate", 200).out)

    assert report["placement"]["is_fitted"]
    assert report["touches"]
    assert report["ticks"]["tick_count"] == 1039


def test_units_hold_for_all_lengths(run):
    options = ("--place", -0.5, 0, "1e-1", "--turn", 0, 0, 90, "--scale", 0.5, "--radius", 4, "--range", 50)
    result = run(BRACKET, HAND, *SHORT, *options, "--units", "cm", "--json")

    report = json.loads(result.out)
    settings = result.trackers[-1].all_settings
    assert settings["radius"] == pytest.approx(0.004, rel=1e-15)
    assert settings["working_range"] == pytest.approx(0.05, rel=1e-15)
    assert report["placement"]["position"] == pytest.approx([-0.5, 0.0, 0.1], rel=1e-15)


def test_options_reach_the_tracker(run):
    result = run(BRACKET, HAND, *SHORT, "--rate", 500, "--latency", 2.5, "--budget", 40)

    (rehearsed, tracker) = result.trackers
    assert tracker.all_settings == rehearsed.all_settings
    assert tracker.all_settings == {
        "fingers": 5, "radius": 0.007, "period": 0.002, "latency": 0.0025, "budget": 40,
        "working_range": 0.12,
    }  # fmt: skip
    assert tracker.ticks[:2] == [(0, 2_500_000), (2_000_000, 4_500_000)]


@pytest.mark.parametrize("suffix", [".npz", ".csv"])
def test_contacts_are_written(run, tmp_path, suffix):
    path = tmp_path / f"contacts{suffix}"

    result = run(BRACKET, HAND, *SHORT, "--out", path)

    assert result.code == 0
    if suffix == ".npz":
        with np.load(path) as log:
            assert log["contacts"].shape == (91, 5)
            assert log["contacts"].dtype == CONTACT
            assert log["fingers"].tolist() == [[0, finger] for finger in range(5)]
    else:
        assert len(path.read_text().splitlines()) == 1 + 5 * 91


def test_broken_bound_is_said_and_ends_with_1(run, tmp_path):
    def spoil(contacts, tick):
        if tick == 7:
            contacts["lower"][1] += 0.011  # 10 mm of room there, out of range

    run.spoil = spoil
    result = run(BRACKET, HAND, *AS_RECORDED, *SHORT, "--out", tmp_path / "log.npy")

    assert result.code == 1
    assert result.err.startswith(
        "proximity: 1 of 455 bounds that were checked do not hold, the first: index at 0.006000 s: "
    )
    assert result.err.count("\n") == 1
    assert lines_of(result.out)["bounds"] == [
        "454 of 455 hold, checked against exact distances, the worst is off by 1 mm"
    ]
    assert (tmp_path / "log.npy").exists()


def test_broken_certified_time_is_said_and_ends_with_1(run):
    def spoil(contacts, tick):
        contacts["time_to_contact_lower"] *= 4.0

    run.spoil = spoil
    result = run(BRACKET, HAND, *AS_RECORDED)

    assert result.code == 1
    assert re.fullmatch(
        r"proximity: (\d+) of (\d+) certified times that were checked do not hold, the first: \w+ at .* s: "
        r"touched after .* s, certified .* s\n",
        result.err,
    )
    held, checked = map(int, re.findall(r"\d+", lines_of(result.out)["contact times"][0])[:2])
    assert held < checked


def test_bad_line_of_a_recording_is_named(run, tmp_path):
    path = tmp_path / "bad.csv"
    path.write_text("time_s,hand,finger,x_m,y_m,z_m\n0,0,0,1,2,3\n0,0,7,1,2,3\n")

    result = run(BRACKET, path)

    assert result.code == 2
    assert result.err == f"proximity: {path}, line 3: finger is 7, expected 0 (thumb) to 4 (little finger)\n"


def test_notes_of_a_recording_are_told(run, tmp_path):
    path = tmp_path / "odd.csv"
    path.write_text("time_s,hand,finger,x_m,y_m,z_m,grip\n0,0,0,0,0,0,1\n0.01,0,0,nan,0,0,1\n")

    lines = lines_of(run(BRACKET, path).out)

    assert lines["note"] == ["1 of 2 positions are nan: the finger is missing there", "ignored columns: grip"]
    assert lines["touch"] == ["thumb: 1 time, first at 0 s, 3.5 mm deep"]


def test_recording_that_may_be_cut_is_said_to_be(run, tmp_path):
    """The finger stays 20 mm off; what is cut puts it onto the part."""
    path = tmp_path / "cut.csv"
    path.write_text("time_s,hand,finger,x_m,y_m,z_m\n0,0,1,0.03,0.01,0.031\n0.01,0,1,0.03,0.01,0.0")

    lines = lines_of(run(BRACKET, path, *AS_RECORDED).out)

    assert lines["note"] == ["the last line has no line end: the file may be cut off"]


def test_times_of_a_calendar_are_told_since_the_recording_begins(run, tmp_path):
    path = tmp_path / "epoch.csv"
    rows = (f"{1732000000 + k / 100:.3f},0,1,0.03,0.01,{0.05 - 0.001 * k:.3f}" for k in range(45))
    path.write_text("time_s,hand,finger,x_m,y_m,z_m\n" + "\n".join(rows) + "\n")

    lines = lines_of(run(BRACKET, path, *AS_RECORDED).out)
    told = json.loads(run(BRACKET, path, *AS_RECORDED, "--json").out)

    assert lines["times"] == ["since the recording's first instant, its 1732000000.000000 s"]
    assert lines["nearest"][0].startswith("index at 0.44 s: ")
    first = told["touches"][0]["first_s"] - 1732000000
    assert 0.3 < first < 0.4 and lines["touch"] == [f"index: 1 time, first at {first:.3f} s, 5 mm deep"]
    assert told["recording"]["begins_s"] == 1732000000.0
    assert told["nearest"]["time_s"] == pytest.approx(1732000000.44, abs=1e-6)


@pytest.mark.filterwarnings("ignore::proximity.UnitsWarning")  # of the tracker that tests put there
def test_hand_out_of_reach_is_told(run, tmp_path):
    path = tmp_path / "far.csv"
    path.write_text("time_s,hand,finger,x_m,y_m,z_m\n0,0,0,9,9,9\n")

    lines = lines_of(run(BRACKET, path, *AS_RECORDED).out)

    assert lines["nearest"] == ["no finger came within the working range"]
    assert lines["touch"] == ["none"]
    assert "predictions" not in lines
    assert "contact times" not in lines


def test_nearest_approach_to_a_part_that_was_not_found_is_told_as_a_bound(run):
    """With a budget of one no face is met; that is not to be 45 mm away from no part."""

    def spoil(contacts, tick):
        contacts["part"] = -1

    run.spoil = spoil

    lines = lines_of(run(BRACKET, HAND, *AS_RECORDED, "--budget", 1).out)

    assert lines["nearest"] == ["little at 2.597 s: -2.867 mm at most, from an unknown part"]
