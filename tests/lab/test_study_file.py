"""Study files: what they may say, the conditions that follow, and one sentence for each mistake."""

import numpy as np
import pytest
from project import ROOT
from study_jobs import JOBS, study_of

from proximity.cli.lab.study import _jobs
from proximity.errors import ServiceError
from proximity.lab.sweep.study_file import read_study


def conditions(*arguments, **options):
    """The conditions of a study as their factors."""
    return [condition.values for condition in study_of(*arguments, **options).conditions]


def complaint(tmp_path, *arguments, **options):
    """What is said of a file that cannot be used."""
    with pytest.raises(ServiceError) as refused:
        study_of(tmp_path, *arguments, **options)
    return str(refused.value).replace(f"{tmp_path}/", "")


def test_grid_has_every_combination_once(tmp_path):
    found = conditions(tmp_path, "number = [1, 2, 3]\nspeed = [0.5, 1.5]")

    assert sorted((one["number"], one["speed"]) for one in found) == [
        (number, speed) for number in (1, 2, 3) for speed in (0.5, 1.5)
    ]


def test_span_has_both_ends_and_even_steps(tmp_path):
    linear = conditions(tmp_path, "number = 1\nspeed = { from = 1, to = 3, count = 5 }")
    log = conditions(tmp_path, 'number = 1\nspeed = { from = 0.1, to = 10, count = 3, spacing = "log" }')

    assert [one["speed"] for one in linear] == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert [one["speed"] for one in log] == pytest.approx([0.1, 1.0, 10.0])
    assert log[-1]["speed"] == 10.0


def test_conditions_that_differ_only_in_what_does_not_matter_are_one(tmp_path):
    found = conditions(tmp_path, 'number = 1\nwall = ["hard", "soft"]\nstiffness = ["rigid", 100, 200]')

    assert [(one["wall"], one["stiffness"]) for one in found] == [
        ("hard", None), ("soft", None), ("soft", 100.0), ("soft", 200.0),
    ]  # fmt: skip


def test_list_has_its_rows_with_every_combination_of_the_others(tmp_path):
    rows = "[[conditions]]\nnumber = 1\nspeed = 2\n[[conditions]]\nnumber = 3"
    found = conditions(tmp_path, 'wall = ["hard", "soft"]', head='design = "list"', tail=rows)

    assert [(one["number"], one["speed"], one["wall"]) for one in found] == [
        (1, 2.0, "hard"), (1, 2.0, "soft"), (3, 1.0, "hard"), (3, 1.0, "soft"),
    ]  # fmt: skip


def test_latin_hypercube_has_one_sample_in_each_stratum_of_each_factor(tmp_path):
    head = 'design = "latin-hypercube"\nsamples = 20\nseed = 3'
    factors = "number = { from = 0, to = 1000000 }\nspeed = { from = 0, to = 2 }"
    found = conditions(tmp_path, factors, head=head)
    strata = np.sort([int(10 * one["speed"]) for one in found])

    assert strata.tolist() == list(range(20))
    assert found == conditions(tmp_path, factors, head=head)


def test_exclusions_leave_out_what_is_all_of_that(tmp_path):
    tail = "[[exclude]]\nnumber = [1, 2]\nspeed = { above = 1 }\n[[exclude]]\nnumber = 3"
    found = conditions(tmp_path, "number = [1, 2, 3, 4]\nspeed = [1.0, 2.0]", tail=tail)

    assert [(one["number"], one["speed"]) for one in found] == [(1, 1.0), (2, 1.0), (4, 1.0), (4, 2.0)]


def test_points_are_values_of_their_own(tmp_path):
    (one,) = conditions(tmp_path, "number = 1\nposition = [1, 2, 3]")
    both = conditions(tmp_path, "number = 1\nposition = [[1, 2, 3], [4, 5, 6]]")

    assert one["position"] == (1.0, 2.0, 3.0)
    assert [each["position"] for each in both] == [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]


def test_key_is_of_the_condition_and_the_content_of_its_file(tmp_path):
    (tmp_path / "a.stl").write_text("one")
    first = list(study_of(tmp_path, 'scene = "*.stl"', job="draw").conditions)
    again = list(study_of(tmp_path, 'colour = 0\nscene = ["a.stl"]', job="draw").conditions)
    (tmp_path / "a.stl").write_text("another")
    changed = list(study_of(tmp_path, 'scene = "*.stl"', job="draw").conditions)

    assert [one.key for one in again] == [one.key for one in first]
    assert changed[0].key != first[0].key


def test_conditions_of_one_file_follow_each_other(tmp_path):
    for name in ("a.stl", "b.stl"):
        (tmp_path / name).write_text(name)
    found = conditions(tmp_path, 'colour = [1, 2]\nscene = "*.stl"', job="draw")

    assert [one["scene"] for one in found] == ["a.stl", "a.stl", "b.stl", "b.stl"]


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ("number = 1\nspeeed = 2", "some.toml:6: [factors] has no key 'speeed': did you mean speed?"),
        ("number = 1\ncolour = 2", "some.toml:6: colour is a factor of the job draw, but not of count"),
        ("number = 1\nspeed = 20", "some.toml:6: speed is 20, expected a number from 0 to 10 (m/s)"),
        ("number = [1, 2.5]", "some.toml:5: number is 2.5, expected a whole number from 0 to 1e+06"),
        ("number = []", "some.toml:5: number is an empty list, expected at least one value"),
        ("number = [1, 1]", "some.toml:5: number has a value twice, expected values that differ"),
        ("speed = 1", "some.toml:4: factors.number is missing: the job count needs it in every condition"),
        ('number = 1\nwall = "hart"', 'some.toml:6: wall is \'hart\', expected "hard" or "soft"'),
        ('number = 1\nwall = "soft"\nstiffness = "rigit"',
         "some.toml:7: stiffness is 'rigit', expected a number from 0 to 1e+06 (N/m) or \"rigid\""),
        ("number = 1\nposition = [1, 2]", "some.toml:6: position is a list, expected three numbers (m)"),
        ("number = 1\nspeed = { from = 0, to = 1 }",
         "some.toml:6: factors.speed.count is missing, expected a whole number from 1 to 1e+06"),
        ('number = 1\nspeed = { from = 0, to = 1, count = 3, spacing = "log" }',
         'some.toml:6: factors.speed.spacing is "log", expected from and to above zero'),
    ],
)  # fmt: skip
def test_factor_that_cannot_be_used_is_one_sentence(tmp_path, factors, said):
    assert complaint(tmp_path, factors) == said


def test_pattern_that_matches_nothing_and_file_that_is_not_there(tmp_path):
    assert complaint(tmp_path, 'scene = "parts/*.stl"', job="draw").startswith(
        "some.toml:5: scene: 'parts/*.stl' matches no file in "
    )
    assert complaint(tmp_path, 'scene = "a.stl"', job="draw").startswith(
        "some.toml:5: scene: 'a.stl' is not there in "
    )


@pytest.mark.parametrize(
    ("head", "tail", "said"),
    [
        ('design = "gird"', "", "some.toml:3: study.design is 'gird', expected \"grid\" or"),
        ('design = "list"', "", 'some.toml:3: study.design is "list", expected [[conditions]] as well'),
        ("samples = 5", "", "some.toml:3: study.samples is of a Latin hypercube, expected design ="),
        ('design = "latin-hypercube"', "", "some.toml:1: study.samples is missing, expected a whole number"),
        ('measures = ["squares"]', "",
         "some.toml:3: study.measures has 'squares', expected some of square, cube"),
        ("", "[[conditions]]\nnumber = 2",
         'some.toml:6: study.design is "grid", expected design = "list" as well'),
        ("", "[[exclude]]", "some.toml:6: [[exclude]] is empty, expected factors and their values"),
        ("", "[[exclude]]\nnumbr = 2", "some.toml:7: [exclude[0]] has no key 'numbr': did you mean number?"),
        ("", "[exclude]\nnumber = 2",
         "some.toml:6: exclude is no list of tables, expected [[exclude]] above each"),
        ("", '[plot]\nx = "spede"', "some.toml:7: plot.x is 'spede', expected "),
        ("", "[plots]", "some.toml:6: the file has no key 'plots': did you mean plot?"),
    ],
)  # fmt: skip
def test_table_that_cannot_be_used_is_one_sentence(tmp_path, head, tail, said):
    assert complaint(tmp_path, "number = 1", head=head, tail=tail).startswith(said)


def test_row_of_a_list_says_each_factor_once(tmp_path):
    head = 'design = "list"'
    twice = complaint(tmp_path, "speed = 1", head=head, tail="[[conditions]]\nnumber = 1\nspeed = 2")
    several = complaint(tmp_path, "speed = 1", head=head, tail="[[conditions]]\nnumber = [1, 2]")

    assert twice == "some.toml:8: speed is in [factors] too, expected it once"
    assert several == "some.toml:7: number has several values, expected one a row"


def test_file_without_a_job_or_with_none_that_is_known(tmp_path):
    path = tmp_path / "some.toml"
    path.write_text("[factors]\nnumber = 1\n")
    with pytest.raises(ServiceError, match=r'study.job is missing, expected "count" or "draw"'):
        read_study(path, JOBS)
    path.write_text('[study]\njob = "cuont"\n')
    with pytest.raises(ServiceError, match=r"some.toml:2: study.job is 'cuont', expected \"count\" or"):
        read_study(path, JOBS)
    path.write_text("")
    with pytest.raises(ServiceError, match="the file is empty, expected a study in TOML"):
        read_study(path, JOBS)


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ("stiffness = [500, 8000]", "stiffness is a number, but damping is tuned"),
        ('damping = { from = 1, to = 3, count = 3 }\nstiffness = "tuned"',
         "damping is a number, but stiffness is"),
    ],
)  # fmt: skip
def test_gain_of_a_coupled_wall_without_the_other_is_one_sentence(tmp_path, factors, said):
    path = tmp_path / "walls.toml"
    path.write_text(f'[study]\njob = "press"\n[factors]\nwall = "coupled"\n{factors}\n')
    with pytest.raises(ServiceError) as refused:
        read_study(path, _jobs())

    assert str(refused.value).startswith(f"{path}:5: {said}")
    assert str(refused.value).endswith(
        "stiffness and damping belong together, expected both as numbers or neither"
    )


def test_gain_in_a_row_without_the_other_is_named_by_its_line(tmp_path):
    path = tmp_path / "walls.toml"
    both, one = "[[conditions]]\nstiffness = 734\ndamping = 4.4\n", "[[conditions]]\nstiffness = 500\n"
    path.write_text('[study]\njob = "press"\ndesign = "list"\n[factors]\nwall = "coupled"\n' + both + one)
    with pytest.raises(ServiceError, match=r"walls.toml:10: stiffness is a number, but damping is tuned"):
        read_study(path, _jobs())
    path.write_text(path.read_text().replace(one, "[[conditions]]\nspeed = 0.2\n"))
    assert len(list(read_study(path, _jobs()).conditions)) == 2


@pytest.mark.parametrize("job", _jobs().values(), ids=lambda job: job.name)
def test_page_of_the_documentation_names_every_factor_with_its_default(job):
    page = (ROOT / "docs" / "guide" / "studies.md").read_text(encoding="utf-8")

    assert f"**`{job.name}`**" in page
    for name in job.factors:
        assert f"`{name}`" in page or f"`{name} = " in page, name


def test_studies_that_are_shipped_can_be_read():
    folder = ROOT / "bench" / "studies"
    read = {path.stem: read_study(path, _jobs(), with_files=False) for path in folder.glob("*.toml")}

    assert {name: study.job.name for name, study in read.items()} == {
        "certificate": "certificate", "force-error": "press", "hunting": "press", "presses": "press",
    }  # fmt: skip
    assert sum(1 for _ in read["force-error"].conditions) == 5 * 4 * (9 + 1)
