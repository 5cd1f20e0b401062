"""The benchmarks run: all installed contenders answer the smallest case correctly.

Times are not checked, and rivals are optional.
"""

import json
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pairs
import pytest
import report
import ticks

from benchmarks.queries import agreement, cases, results
from benchmarks.rivals import registry
from benchmarks.rivals.embreex import Embreex, EmbreexAll
from benchmarks.support.verdicts import at_most
from benchmarks.ticks import motions, timing

BENCH = Path(__file__).resolve().parents[2] / "bench"
QUERY_COUNT = 40
PATTERNS = ("near", "scattered", "center", "path", "rays")
QUESTIONS = {
    "cast": "rays", "distance": "near", "signed_distance": "near", "closest": "near", "contains": "near",
}  # fmt: skip

# Warnings of the rivals do not matter; Warp and Open3D print when imported.
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.mark.parametrize("kind", registry.CONTENDERS, ids=lambda kind: kind.name)
def test_contender_agrees_with_brute_force_on_the_smallest_case(kind):
    try:
        contender = kind()
    except (ImportError, OSError) as reason:
        if kind.name.startswith("proximity"):
            raise
        pytest.skip(f"{kind.name} is not installed: {reason}")
    for question in contender.questions:
        case = cases.make_case(f"ball/{QUESTIONS[question]}", QUERY_COUNT)
        contender.build(case.vertices, case.faces)
        for by_fives in (False, True):
            found = agreement.check_all(case, question, [contender], by_fives=by_fives)[kind.name]
            assert (found.off_count, found.wrong_sign_count) == (0, 0), f"{question}, fives: {by_fives}"


@pytest.mark.parametrize("pattern", PATTERNS)
def test_case_is_the_same_on_every_call(pattern):
    first, second = (cases.make_case(f"ball/{pattern}", QUERY_COUNT) for _ in range(2))

    assert first.points.shape == (QUERY_COUNT, 3)
    assert np.array_equal(first.points, second.points)
    assert (first.directions is not None) == (pattern == "rays")


def test_every_suite_runs_each_of_its_cases_once(tmp_path):
    """In a subprocess: the suites limit theirs to one core."""
    report = tmp_path / "out.xml"
    words = ["-m", "pytest", "bench", "--small", "-p", "no:cacheprovider", f"--junit-xml={report}"]

    done = subprocess.run([sys.executable, *words], cwd=BENCH.parent, capture_output=True, text=True)

    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
    cases = ElementTree.parse(report).iter("testcase")
    assert {case.get("classname") for case in cases} == {
        ".".join(suite.relative_to(BENCH.parent).with_suffix("").parts) for suite in BENCH.rglob("bench_*.py")
    }
    for skipped in ElementTree.parse(report).iter("skipped"):
        message = skipped.get("message")
        assert " is left out: " in message or "for a look" in message


@pytest.mark.internals
def test_single_kernels_agree_with_the_textbook():
    words = ["-m", "pytest", "bench/benchmarks/kernels", "--small", "-p", "no:cacheprovider"]

    done = subprocess.run([sys.executable, *words], cwd=BENCH.parent, capture_output=True, text=True)

    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-2000:]
    assert " skipped" not in done.stdout.splitlines()[-1]


def test_pairs_and_the_assembly_are_measured(capsys, monkeypatch):
    """Answers of installed rivals are compared."""
    for name, value in {"COLUMNS": 2, "ROUNDS": 1, "POSES": 10, "MOVED_POSES": 5, "FOLLOWED": ({},)}.items():
        monkeypatch.setattr(pairs, name, value)
    monkeypatch.setattr(pairs, "PAIRS", {"small": pairs.free_pair(6, 8, 0.002)})

    pairs.main([])

    printed = capsys.readouterr().out
    assert "small: 144 x 256 faces" in printed
    assert "assembly: 32 parts, 164096 faces" in printed
    assert printed.count("proximity  ") == 3  # in a loop, after other work, the assembly
    assert printed.count("bounds 0.0% (0.0%) apart") >= 4


def test_mesh_that_is_not_here_is_named(monkeypatch):
    monkeypatch.setattr(cases, "SHARED_PARTS", BENCH / "nowhere")
    cases.load_mesh.cache_clear()

    with pytest.raises(cases.MissingMeshError, match=r"cycloidal\.ply is not here"):
        cases.make_case("cycloidal/near")


def test_wrong_lengths_and_wrong_signs_are_counted():
    case = cases.make_case("ball/near", 4)
    expected, answers = np.array([1.0, -1.0, 1.0, np.inf]), np.array([1.0, 1.0, 1.5, 1.0])

    found = agreement.compare(case, answers, expected, "oracle")

    assert (found.checked_count, found.off_count, found.wrong_sign_count) == (4, 2, 1)


def test_requirement_is_held_against_the_fastest_rival():
    times = {"proximity": 1.0, "Warp": 2.0, "Open3D": 8.0}
    rows = [
        results.Row(results.POINTS, "ball/near", name, "1", "µs a query", time, time, time, time, 1, time)
        for name, time in times.items()
    ]

    (verdict,) = results.judge(rows)

    assert verdict.measured == "2.00 times as fast as Warp"
    assert not verdict.is_met


def test_unknown_case_is_refused_with_the_list(capsys):
    with pytest.raises(SystemExit):
        report.main(["--cases", "ball/nowhere"])

    assert "no such case: ball/nowhere; there are featuretype/near" in capsys.readouterr().err


def test_report_writes_tables_and_json(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "RIVALS", (Embreex, EmbreexAll))
    found, _ = registry.available(registry.RIVALS)
    if not found:
        pytest.skip("embreex is not installed")
    path = tmp_path / "out.json"
    words = ["--without-us", "--rounds", "2", "--queries", "20", "--cases", "ball/rays"]

    exit_code = report.main([*words, "--json", str(path)])

    document = json.loads(path.read_text(encoding="utf-8"))
    assert exit_code == 0
    assert {row["section"] for row in document["rows"]} == {"build", "rays", "five rays"}
    assert "five rays, ball/rays  [µs a call]" in capsys.readouterr().out


def test_ticks_of_small_scenes_write_a_table_and_json(capsys, tmp_path):
    path = tmp_path / "out.json"
    words = ["fingers", "moving", "skin", "cavity", "warm", "prediction", "open", "deform"]

    exit_code = ticks.main([*words, "--small", "--json", str(path)])

    document = json.loads(path.read_text(encoding="utf-8"))
    cases = [row["case"] for row in document["rows"]]
    verdicts = [verdict for row in document["rows"] for verdict in row["verdicts"]]
    assert exit_code == 0
    assert {name.partition("/")[0].partition(":")[0] for name in cases} == set(words)
    held = [each for each in verdicts if "brackets hold" in each["requirement"]]
    assert len(held) == 4 and all(each["is_met"] for each in held)
    out = capsys.readouterr().out
    assert "fingers/plate" in out and "requirements are not checked" in out


def test_tick_requirement_that_is_not_met_is_an_exit_code(monkeypatch, capsys):
    for limit, expected in ((10.0, 0), (1.0, 1)):
        row = timing.TickRow("slow", 1, 12, 5, 1, verdicts=(at_most("slow: p50", limit, 5.0),))
        monkeypatch.setitem(ticks.CASES, "prediction", lambda _, row=row: [row])

        assert ticks.main(["prediction"]) == expected
        assert f"slow: p50 at most {limit:g} µs" in capsys.readouterr().out


def test_recordings_that_are_not_here_are_named(monkeypatch):
    monkeypatch.setattr(motions, "SHARED_HANDS", BENCH / "nowhere")

    assert [hand.name for hand in motions.hands()] == ["generated"]
    assert "two-hands.csv" in motions.missing_hands()


def test_ticks_are_timed_from_call_to_answer(monkeypatch):
    class Clock:
        """A clock that advances 1 µs of wall time and 0.1 µs of thread time per reading."""

        now = 0

        def perf_counter_ns(self):
            self.now += 1000
            return self.now

        def thread_time_ns(self):
            return self.now // 10

    clock, log = Clock(), timing.TickLog()
    monkeypatch.setattr(timing, "time", clock)

    def call():
        clock.now += 7000

    timing.time_calls([call, call], log)

    assert log.wall_ns == [8000, 8000]
    assert log.thread_ns == [900, 900]
