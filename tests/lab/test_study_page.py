"""The page of a study: what it says of factors, effects, the worst conditions, and what failed."""

import datetime
import re

import numpy as np
import pytest
from study_jobs import study_of

from proximity.errors import ServiceError
from proximity.lab.sweep.effects import NOT_USED, Rows, effect
from proximity.lab.sweep.row_files import MADE_BY, RowFiles, read_rows
from proximity.lab.sweep.study_page import shown, study_report
from proximity.lab.sweep.study_run import repeat

FACTORS = "number = [1, 2, 3, 4]\nspeed = [1, 2]\nwall = ['hard', 'soft']\nstiffness = [10, 20]"


def record(tmp_path, study, *, failing=()):
    """Write rows as a run would."""
    files = RowFiles(tmp_path, study.job)
    conditions = list(study.conditions)
    files.write_design((one.key for one in conditions), "/studies/some file.toml")
    for one in conditions:
        has_failed = one.values["number"] in failing
        number = float(one.values["number"])
        results = {} if has_failed else {"square": number**2, "cube": number * one.values["speed"]}
        files.add(
            {
                "key": one.key, "job": "count", "failure": "it was <late>" if has_failed else None,
                **one.values, **results, "seconds": 0.5, "attempts": 1,
                "finished": datetime.datetime(2026, 1, 31, tzinfo=datetime.UTC),
                **{name: f"{name}-1" for name in MADE_BY},
            }
        )  # fmt: skip
    files.flush()
    return conditions


def text_of(page):
    """The words of a page."""
    return " ".join(re.sub(r"<[^>]+>", " ", page.partition("<body>")[2]).split())


def test_page_has_factors_effects_worst_conditions_and_how_to_repeat_them(tmp_path):
    study = study_of(tmp_path, FACTORS)
    conditions = record(tmp_path, study)
    page = study_report(study, tmp_path).page
    words = text_of(page)

    assert "<h1>some file</h1>" in page
    assert "24 of 24 conditions have a row; they took 12 s of one core." in words
    assert "stiffness 10, 20, not used [N/m]" in words
    assert "Fixed: position 0, 0, 0" in words
    assert "square m² 1 3.25 6.5 10.75 16" in words
    assert "number 100%" in words  # the square is of the number alone
    assert "proximity study run &#39;/studies/some file.toml&#39; --only CONDITION" in page
    worst = words.partition("Worst conditions")[2].partition("Made by")[0]
    keys = {one.key for one in conditions if one.values["number"] == 4}
    assert {key for key in keys if key in worst} == keys
    assert "commit commit-1" in words
    assert page.count("<svg") == 2
    assert "http" not in page.replace("http-equiv", "")


@pytest.mark.parametrize(
    ("plot", "said"),
    [
        ('x = "speed"', "Points are medians of the conditions there; bands hold 80 % of them."),
        ('x = "speed"\npoints = "worst"', "Points are the worst of the conditions there."),
        ('x = "stiffness"', "bands hold 80 % of them. Dotted: wall hard."),
        ('x = "cube"\nmeasure = "square"', "A point is a condition."),
    ],
)
def test_first_plot_is_the_one_that_the_file_asks_for(tmp_path, plot, said):
    study = study_of(tmp_path, FACTORS, tail=f"[plot]\n{plot}")
    record(tmp_path, study)

    assert said in text_of(study_report(study, tmp_path).page)


def test_conditions_in_which_x_is_absent_have_a_line_of_their_own(tmp_path):
    factors = FACTORS.replace("[10, 20]", "['rigid', 10, 20]")
    study = study_of(tmp_path, factors, tail='[plot]\nx = "stiffness"')
    record(tmp_path, study)

    assert "Dotted: wall hard. Dashed: stiffness rigid." in text_of(study_report(study, tmp_path).page)


def test_what_failed_is_listed_and_counts_nowhere_else(tmp_path):
    study = study_of(tmp_path, FACTORS)
    record(tmp_path, study, failing=(4,))
    words = text_of(study_report(study, tmp_path).page)

    assert "24 of 24 conditions have a row, 6 of them failed" in words
    assert "it was &lt;late&gt;" in words
    assert "square m² 1 1 4 9 9" in words


def test_page_of_a_study_that_is_not_finished_says_so(tmp_path):
    study = study_of(tmp_path, "number = [1, 2]")
    record(tmp_path, study)
    more = study_of(tmp_path, "number = [1, 2, 3]")
    RowFiles(tmp_path, more.job).write_design((one.key for one in more.conditions), "x")

    assert "2 of 3 conditions have a row" in text_of(study_report(more, tmp_path).page)


def test_page_of_one_condition_has_no_plots_and_no_mistakes(tmp_path):
    study = study_of(tmp_path, "number = 2")
    record(tmp_path, study)

    page = study_report(study, tmp_path).page

    assert "<svg" not in page
    assert "<title>Study: some file</title>" in page


def test_page_of_nothing_is_refused(tmp_path):
    study = study_of(tmp_path, "number = 2")
    record(tmp_path, study)
    RowFiles(tmp_path, study.job).write_design(iter(["00" * 10]), "x")
    with pytest.raises(ServiceError, match="no condition is finished yet, run the study first"):
        study_report(study, tmp_path)


def test_effect_is_the_share_of_variance_between_levels(tmp_path):
    study = study_of(tmp_path, FACTORS)
    record(tmp_path, study)
    rows = Rows(study.job, read_rows(tmp_path).rows)
    cubes = rows.measure("cube")
    means = [cubes[np.array(rows.values("speed")) == speed].mean() for speed in (1.0, 2.0)]
    found = effect(rows, "speed", "cube")

    assert found.means == pytest.approx(means)
    assert found.share == pytest.approx(np.var(means) / cubes.var())
    assert effect(rows, "position", "cube") is None


def test_conditions_in_which_a_factor_does_not_matter_have_no_part_in_its_effect(tmp_path):
    study = study_of(tmp_path, FACTORS)
    record(tmp_path, study)
    rows = Rows(study.job, read_rows(tmp_path).rows)
    found = effect(rows, "stiffness", "cube")

    assert rows.values("stiffness").count(NOT_USED) == 8
    assert found.labels == ("10", "20")
    assert found.counts == (8, 8)
    assert found.share == pytest.approx(0.0)


def test_names_of_rows_have_no_effect_but_numbers_have_one(tmp_path):
    study = study_of(tmp_path, "number = [1, 2]")
    record(tmp_path, study)
    table = read_rows(tmp_path).rows
    numbers = Rows(study.job, table)
    named = Rows(
        study.job, table.set_column(table.schema.get_field_index("wall"), "wall", [["soft", "hard"]])
    )

    assert effect(numbers, "number", "square").share == pytest.approx(1.0)
    assert effect(named, "wall", "square") is None


def test_many_values_of_a_number_are_binned(tmp_path):
    study = study_of(tmp_path, "number = { from = 0, to = 99, count = 100 }")
    record(tmp_path, study)
    levels, ids = Rows(study.job, read_rows(tmp_path).rows).levels("number")

    assert len(levels) == 8
    assert np.bincount(ids).tolist() == pytest.approx([12.5] * 8, abs=1)


def test_values_are_shown_short():
    assert [shown(value) for value in (1.23456, None, float("nan"), 12, "soft", (1.0, 2.5))] == [
        "1.235", "–", "–", "12", "soft", "1, 2.5",
    ]  # fmt: skip
    assert [shown(value) for value in (43370.0, 1e12, -3.0)] == ["43370", "1e+12", "-3"]


def test_one_condition_is_repeated_beside_its_row(tmp_path):
    study = study_of(tmp_path, "number = [2, 3]")
    two, _ = record(tmp_path, study)
    (tmp_path / "empty").mkdir()
    found = repeat(study, tmp_path, two.key[:8])

    assert found.results == {"square": 4.0, "cube": 8.0}
    assert found.recorded["square"] == 4.0
    assert repeat(study, tmp_path / "empty", two.key).recorded is None
    with pytest.raises(
        ServiceError, match="no condition has a key that begins with 'xyz', expected the key of"
    ):
        repeat(study, tmp_path, "xyz")
    with pytest.raises(ServiceError, match="2 conditions have a key that begins with ''"):
        repeat(study, tmp_path, "")
