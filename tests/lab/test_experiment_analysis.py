"""Analysis of experiments: thresholds, comparisons, exclusions, the report, and power."""

import csv
import math
import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from experiments import SHIPPED, SMALL, simulate, write_design
from scipy import integrate, stats

from proximity.errors import MissingLibraryError
from proximity.lab.experiment.analysis.comparison import bayes_factor_none, compare, mixed_model, within_f
from proximity.lab.experiment.analysis.findings import Score, counts_of, exclude, find, scores_of
from proximity.lab.experiment.analysis.psychometric import Shape, fit, shared_shape, threshold_mean
from proximity.lab.experiment.analysis.report import draw_plots, write_report
from proximity.lab.experiment.analysis.simulation import (
    false_positives,
    power,
    recovery,
    simulated_trials,
    with_effect,
)
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.design import Procedure
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.observers import Observer

LEVELS = (0.06, 0.09, 0.13, 0.19, 0.28, 0.41, 0.60, 0.88)


@pytest.fixture(scope="module")
def shipped():
    return read_design(SHIPPED)


@pytest.fixture(scope="module")
def entries(shipped):
    return [entry for slot in range(12) for entry in simulated_trials(shipped, slot)]


def asked(rng, threshold, count, *, width=0.6, lapse=0.02):
    """Answers of an observer, by level, whose function is written down here once more."""
    counts = {}
    for level in LEVELS:
        z = (math.log10(level) - math.log10(threshold)) / (width / (2 * stats.norm.ppf(0.95)))
        counts[level] = (int(rng.binomial(count, 0.5 + (0.5 - lapse) * stats.norm.cdf(z))), count)
    return counts


def test_library_that_is_missing_is_named_with_what_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "psignifit", None)
    with pytest.raises(
        MissingLibraryError, match=r"experiments need psignifit, .* pip install .*\[experiment\]"
    ):
        fit({0.1: (1, 2)}, LEVELS, Shape(0.6, 0.02))


def test_threshold_and_shape_are_found_again():
    rng = np.random.default_rng(7)
    true = 0.3 * 10.0 ** (0.1 * rng.standard_normal(20))
    cells = [asked(rng, threshold, 50) for threshold in true]
    shape = shared_shape(cells, LEVELS, 0.4)
    functions = [fit(counts, LEVELS, shape) for counts in cells]

    assert shape.width == pytest.approx(0.6, rel=0.15) and shape.lapse == pytest.approx(0.02, abs=0.02)
    off = [math.log10(one.threshold / threshold) for one, threshold in zip(functions, true, strict=True)]
    assert abs(np.mean(off)) < 0.02 and np.std(off) < 0.08
    covered = sum(one.lower <= threshold <= one.upper for one, threshold in zip(functions, true, strict=True))
    assert covered >= 17


def test_fast_threshold_is_that_of_psignifit():
    rng, shape = np.random.default_rng(8), Shape(0.6, 0.02)
    one_level = {0.28: (6, 8)}  # psignifit alone ended in a traceback
    for counts in (one_level, *(asked(rng, threshold, 5) for threshold in (0.1, 0.3, 0.8))):
        expected = math.log10(fit(counts, LEVELS, shape).threshold)
        assert threshold_mean(counts, LEVELS, shape) == pytest.approx(expected, abs=0.003)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["staircase", "quest+"])
def test_thresholds_of_adaptive_methods_are_not_biased(shipped, method):
    """Adaptive trials do not tell the shape: with a free one, thresholds may be 0.14 too low in log10."""
    task = replace(shipped.task("stiffness"), method=Procedure(method))
    design = replace(shipped, tasks=(task,))
    off = []
    for slot in range(8):
        found = scores_of(design, exclude(design, simulated_trials(design, slot))[0])
        true = Observer(design, slot).thresholds
        off += [score.value - true[score.condition] for score in found]

    assert abs(np.mean(off)) < 0.06
    assert np.std(off) < 0.17


@pytest.mark.parametrize(("t", "count"), [(0.0, 12), (1.5, 12), (3.0, 8), (-4.0, 30)])
def test_bayes_factor_is_the_integral_over_the_noncentral_t(t, count):
    def weight(size):
        return stats.nct.pdf(t, count - 1, size * math.sqrt(count)) * stats.cauchy.pdf(size, scale=0.5**0.5)

    some = integrate.quad(weight, -6.0, 6.0, limit=200)[0]
    assert bayes_factor_none(t, count) == pytest.approx(stats.t.pdf(t, count - 1) / some, rel=0.02)


def test_mixed_model_is_the_analysis_of_variance_where_nothing_is_missing():
    from statsmodels.stats.anova import AnovaRM

    rng = np.random.default_rng(7)
    tables = rng.normal(0, 0.1, (4, 12, 4)) + rng.normal(0, 0.1, (4, 12, 1)) + [0, 0, 0.05, 0.1]
    for table in tables:
        import pandas

        rows = [(i, j, value) for (i, j), value in np.ndenumerate(table)]
        frame = pandas.DataFrame(rows, columns=["who", "on", "score"])
        expected = AnovaRM(frame, "score", "who", within=["on"]).fit().anova_table
        f, df, p = mixed_model(table)
        assert df == (3, 33)
        assert f == pytest.approx(expected["F Value"].iloc[0], rel=1e-3)
        assert p == pytest.approx(expected["Pr > F"].iloc[0], rel=1e-2)
    np.testing.assert_allclose(within_f(tables), [mixed_model(table)[2] for table in tables], rtol=1e-2)


def test_fast_p_is_the_models_where_participants_do_not_differ():
    rng = np.random.default_rng(3)
    tables = rng.normal(0, 0.1, (6, 8, 3))
    tables -= tables.mean(axis=-1, keepdims=True)  # all participants have one mean

    np.testing.assert_allclose(within_f(tables), [mixed_model(table)[2] for table in tables], rtol=1e-2)


def test_comparison_says_what_was_put_in():
    rng = np.random.default_rng(7)
    own = rng.normal(0, 0.2, 12)
    scores = [
        Score(f"p{i}", "t", name, own[i] + shift + 0.05 * rng.standard_normal(), 40)
        for i in range(12)
        for name, shift in (("a", 0.0), ("b", 0.0), ("c", 0.3))
    ]
    found = compare("t", ["a", "b", "c", "unused"], scores)

    assert found.p < 1e-6 and found.df == (2, 22)
    assert [one.condition for one in found.means] == ["a", "b", "c"]
    ab, ac, _ = found.differences
    assert ab.bayes_factor_none > 1.0 and ab.lower < 0.0 < ab.upper
    assert ac.bayes_factor_none < 1e-3 and ac.value == pytest.approx(0.3, abs=0.05) and ac.p < 1e-4
    assert compare("t", ["a", "b"], scores[:6]) is None


def test_known_thresholds_are_recovered_within_their_intervals(shipped):
    """Twelve observers on four conditions: of 48 intervals of 95 % two or three miss, six at most."""
    found = recovery(shipped)

    assert found.count == 48
    assert found.covered >= 42
    assert abs(found.bias) < 0.08


def test_means_of_the_report_hold_the_true_ones(shipped, entries):
    found = find(shipped, entries).comparisons["stiffness"]
    true = {name: np.mean([Observer(shipped, slot).thresholds[name] for slot in range(12)])
            for name in (one.name for one in shipped.conditions)}  # fmt: skip

    assert all(mean.lower <= true[mean.condition] <= mean.upper for mean in found.means)


def test_no_difference_is_found_where_there_is_none(shipped):
    """`proximity experiment check` does 100: here, of 16 tests at 5 %, five are not by chance."""
    found = false_positives(shipped, 8)

    assert set(found) == {"stiffness", "real"}
    assert sum(found.values()) * 8 <= 4


def test_false_positives_would_be_seen(shipped):
    """The counterpart: with thresholds twice as high, nearly every experiment finds that."""
    twice = with_effect(shipped, 2.0)
    scores = scores_of(twice, [one for slot in range(12) for one in simulated_trials(twice, slot)])
    assert compare("stiffness", [one.name for one in twice.conditions], scores).p < 0.05


def test_power_rises_with_participants_and_is_5_percent_without_an_effect(shipped):
    shares = {(one.comparison, one.participants): one.share for one in power(shipped, (4, 12), 400, pool=50)
              if one.task == "stiffness"}  # fmt: skip
    counted = []
    none = [one.share for one in power(with_effect(shipped, 1.0), (12,), 400, pool=60,
                                       watch=lambda *count: counted.append(count))]  # fmt: skip

    assert shares["any difference", 12] > 0.9 > shares["any difference", 4]
    assert shares["coupled10ms against decaff", 12] > shares["coupled1ms against decaff", 12]
    assert counted == [(done, 60) for done in range(1, 61)]
    assert all(share < 0.2 for share in none)  # a pool has a chance difference of its own


def test_what_is_real_is_tested_against_chance_with_holms_adjustment():
    rng = np.random.default_rng(5)
    columns = {"a": rng.normal(0.0, 0.5, 12), "b": rng.normal(1.5, 0.5, 12), "c": np.full(12, 3.0)}
    scores = [
        Score(f"{i:02d}", "t", name, float(value), 16)
        for name, values in columns.items()
        for i, value in enumerate(values)
    ]
    found = {one.condition: one.p for one in compare("t", list(columns), scores).means}

    alone = {name: stats.ttest_1samp(columns[name], 0.0).pvalue for name in ("a", "b")}
    assert found["b"] == pytest.approx(2.0 * alone["b"]) and found["b"] < 1e-4
    assert found["a"] == pytest.approx(alone["a"]) and found["a"] > 0.05
    assert math.isnan(found["c"])  # all alike: nothing to test by


def altered(entries, condition, **changes):
    return [entry | changes if condition(entry) else entry for entry in entries]


@pytest.mark.parametrize(
    ("which", "changes", "expected"),
    [
        (lambda e: e["participant"] == "3" and e["stage"] == "catch", {"is_right": False},
         ("3", None, "0% of the catch trials right, the rule is 75% or more")),
        (lambda e: e["participant"] == "0" and e["number"] % 2 == 0, {"stopped": "x"},
         ("0", None, "limits ended 50% of the trials, the rule is 20% or fewer")),
        (lambda e: e["participant"] == "2" and e["number"] == 100, {"response_time": 31.0},
         ("2", 100, "answered after more than 30 s")),
        (lambda e: e["number"] == 101, {"stopped": "emergency stop"}, None),
    ],
    ids=["catch trials", "limits", "late", "stopped"],
)  # fmt: skip
def test_rules_leave_out_participants_and_trials(shipped, entries, which, changes, expected):
    kept, left_out = exclude(shipped, altered(entries, which, **changes))

    assert [(one.participant, one.trial, one.why) for one in left_out] == [expected] * (expected is not None)
    assert {entry["stage"] for entry in kept} == {"main"}
    if expected is not None and expected[1] is None:
        assert expected[0] not in {entry["participant"] for entry in kept}
    else:
        assert not [entry for entry in kept if which(entry)]


def test_condition_whose_trials_were_all_ended_is_named(shipped, entries, tmp_path):
    lenient = replace(shipped.exclusions, stopped_trials=1.0)
    shipped = replace(shipped, tasks=(shipped.task("real"),), exclusions=lenient)
    entries = [entry for entry in entries if entry["task"] == "real"]
    of_real = [entry for entry in entries if entry["condition"] == "coupled1ms"]
    limit = {"stopped": "4.3 N are beyond the limit of 4 N", "is_right": None}
    all_of_them = [entry | limit if entry in of_real else entry for entry in entries]
    some = altered(all_of_them, lambda e: e["participant"] not in ("3", "7"), stopped="", is_right=True)
    undone = [entry for entry in entries if entry not in of_real or entry["participant"] != "3"]

    assert find(shipped, entries).missing == []
    assert [str(one) for one in find(shipped, undone).missing] == [
        "coupled1ms in real of 3; none of its trials was done"
    ]
    assert [str(one) for one in find(shipped, some).missing] == [
        "coupled1ms in real of 3, 7; all its trials were ended by a limit"
    ]
    found = find(shipped, all_of_them)
    write_report(found, tmp_path)
    sentence = "Not analysed: coupled1ms in real; all its trials were ended by a limit."
    methods = (tmp_path / "methods.txt").read_text()
    assert found.comparisons["real"].df[0] == 2  # three of four conditions
    assert sentence in methods and "All did all" not in methods
    page = (tmp_path / "report.html").read_text()
    assert sentence in page and "By the rules of the design, nothing." in page
    assert (tmp_path / "not_analysed.csv").read_text() == (
        "task,condition,participants,why\nreal,coupled1ms,all,all its trials were ended by a limit\n"
    )


def test_condition_that_was_asked_at_one_level_is_reported(shipped, entries, tmp_path):
    """As adaptive trials may be: it was a traceback of psignifit."""
    task = replace(shipped.task("stiffness"), method=Procedure.QUEST)
    entries = altered([entry for entry in entries if entry["task"] == "stiffness"],
                      lambda entry: entry["condition"] == "decaff" and entry["participant"] == "3",
                      level=task.levels[-1], is_right=True)  # fmt: skip
    found = find(replace(shipped, tasks=(task,)), entries)

    write_report(found, tmp_path)

    function = found.functions["3", "stiffness", "decaff"]
    assert function.lower < function.threshold < min(function.upper, task.levels[-1])
    assert "\n3,stiffness,decaff," in (tmp_path / "thresholds.csv").read_text()


def test_simulated_participant_is_the_same_on_every_run(shipped, entries):
    own = [entry for entry in entries if entry["participant"] == "1"]

    assert simulated_trials(shipped, 1) == own != simulated_trials(shipped, 1, seed=1)


def test_right_answers_are_counted_by_level():
    rows = [{"level": level, "is_right": right} for level, right in ((0.1, True), (0.1, False), (0.2, True))]

    assert counts_of(rows) == {0.1: (1, 2), 0.2: (1, 1)}


OTHER_TASKS = """
[[tasks]]
name = "rate"
kind = "rating"
trials = 4
levels = [0.2, 0.8]
stiffness = 200.0

[[tasks]]
name = "touch"
kind = "contact"
trials = 2

[[tasks]]
name = "free"
kind = "free"
trials = 1
"""


def test_findings_of_people_are_not_called_simulated(shipped, entries):
    entries = [entry for entry in entries if entry["task"] == "real"]
    people = altered(entries, lambda entry: True, is_simulated=False)
    some = altered(entries, lambda entry: entry["participant"] != "3", is_simulated=False)

    assert find(shipped, people).simulated_note == ""
    count = len({entry["participant"] for entry in entries})
    assert find(shipped, some).simulated_note == f"1 of {count} participants are simulated observers."


def test_report_has_page_plots_tables_and_methods(tmp_path):
    text = SMALL.replace("participants = 2", "participants = 4").replace(
        "[[questions]]", OTHER_TASKS + "[[questions]]", 1
    )
    dataset = Dataset(tmp_path / "data", read_design(write_design(tmp_path, text)))
    for name in ("p01", "p02", "p03", "p04"):
        simulate(dataset, name)
    files = write_report(find(dataset.design, dataset.trials()), tmp_path / "report")

    names = {path.name for path in files}
    tables = {f"{name}.csv" for name in ("thresholds", "scores", "means", "differences", "exclusions")}
    plots = {"stiffness_functions.pdf", "touch_scores.png", "free_scores.png", "rate_scores.png"}
    assert names >= {"report.html", "methods.txt"} | tables | plots
    with (tmp_path / "report" / "means.csv").open() as stream:
        means = {(row["task"], row["condition"]): float(row["mean"]) for row in csv.DictReader(stream)}
        stream.seek(0)
        p_chance = {row["task"]: row["p_chance"] for row in csv.DictReader(stream)}
    assert p_chance["rate"] == "" and p_chance["which"] != ""
    assert 240.0 < means["rate", "real"] < 360.0  # N/m: what simulated observers say
    assert means["touch", "late"] > means["touch", "real"]  # ms: the coupled wall is late
    methods = (tmp_path / "report" / "methods.txt").read_text()
    assert methods.startswith(
        "All 4 participants are simulated observers. 4 of 4 planned participants compared 2 conditions: "
        "real (a real surface); late (a coupled spring-damper wall, forces 3 ms late, a rigid surface by "
        "1500 N/m and 2 N s/m, another one by its own stiffness and the same damping)."
    )
    assert (
        re.search(r"Stiffness: F\(1, 3\) = [\d.]+, p", methods)
        and "  " not in methods
        and " ." not in methods
    )
    page = (tmp_path / "report" / "report.html").read_text()
    assert "All 4 participants are simulated observers. Nothing here is about people." in page
    assert (
        page.count("data:image/png") == 6
        and page.count("<th>p against chance</th>") == 1
        and "Bayes" in page
        and "{{" not in page
    )
    drawn = draw_plots(find(dataset.design, dataset.trials()), "svg")
    assert len(drawn) == 6
    assert all(b"All 4 participants are simulated observers." in content for content in drawn.values())
    # "Which was real" has the coupled wall only.
    assert page.count("there is no other to compare it with") == 1
    assert "= nan" not in page + methods
