"""Designs of experiments: their files and plans."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from experiments import SHIPPED, SMALL, write_design

from proximity.errors import ServiceError
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.display import interval_of, intervals_of
from proximity.lab.experiment.observers import DISTANCE_RATE, Observer, unstable_walls
from proximity.lab.experiment.plan import Stage, Text, Trial, latin_square, minutes, plan, trials_of
from proximity.lab.experiment.visit import row_of
from proximity.lab.simulation.devices import Hand
from proximity.lab.simulation.sweeps import best_coupled_wall


@pytest.mark.parametrize("count", range(1, 8))
def test_each_condition_follows_each_other_equally_often(count):
    rows = latin_square(count)
    pairs = Counter((a, b) for row in rows for a, b in pairwise(row))

    assert all(sorted(row) == list(range(count)) for row in rows)
    assert {n for column in zip(*rows, strict=True) for n in Counter(column).values()} == {len(rows) // count}
    assert len(pairs) == count * (count - 1) and len(set(pairs.values())) <= 1


def test_shipped_design_takes_45_minutes_and_is_balanced():
    design = read_design(SHIPPED)
    plans = [plan(design, slot) for slot in range(design.participants)]

    assert {round(minutes(design, steps)) for steps in plans} == {43}
    first = Counter(trials_of(steps)[4].condition.name for steps in plans)
    assert set(first.values()) == {8} and len(first) == 4
    tasks = Counter((trials_of(steps)[0].task.name, trials_of(steps)[4].condition.name) for steps in plans)
    assert set(tasks.values()) == {4} and len(tasks) == 8  # equally often first, in each condition


def test_gains_of_the_shipped_design_are_equal_and_the_best_for_the_late_wall():
    coupled = [one for one in read_design(SHIPPED).conditions if one.wall == "coupled"]
    best = best_coupled_wall(Hand(), DISTANCE_RATE, max(one.latency for one in coupled))

    assert len({one.latency for one in coupled}) == 2
    assert {(one.stiffness, one.damping) for one in coupled} == {(232.0, 1.7)}
    assert best.stiffness == pytest.approx(232.0, rel=1e-3) and best.damping == pytest.approx(1.7, rel=2e-3)


def test_plan_is_the_same_every_time_and_differs_between_participants():
    design = read_design(SHIPPED)

    assert plan(design, 3) == plan(design, 3) != plan(design, 11)  # these have the same orders


def test_levels_and_intervals_are_balanced_and_equal_pairs_are_among_them():
    design = read_design(SHIPPED)
    trials = [one for one in trials_of(plan(design, 5)) if one.task.name == "stiffness"]
    own = [one for one in trials if one.condition.name == "decaff1ms" and one.stage != Stage.PRACTICE]

    levels = Counter(one.level for one in own if one.stage == Stage.MAIN)
    assert set(levels.values()) == {6} and set(levels) == set(design.tasks[0].levels)
    assert Counter(one.stage for one in own) == {Stage.MAIN: 48, Stage.CATCH: 4}
    for run in (1, 2):
        assert Counter(one.odd for one in own if one.run == run) == {0: 2, 1: 12, 2: 12}
    for task in ("stiffness", "real"):
        catch = [
            one for one in trials_of(plan(design, 5)) if one.stage == Stage.CATCH and one.task.name == task
        ]
        assert catch and all(len(set(intervals_of(one))) == 1 for one in catch)


def test_steps_come_in_order(tmp_path):
    design = read_design(write_design(tmp_path))
    steps = plan(design, 0)

    assert steps[0] == Text("welcome", "Press.") and steps[-1] == Text("goodbye", "Thanks.")
    assert [one.number for one in trials_of(steps)] == list(range(len(trials_of(steps))))
    assert {one.condition.name for one in trials_of(steps) if one.task.name == "which"} == {"late"}
    first = [trials_of(plan(design, slot))[0].task.name for slot in range(4)]
    assert first == ["stiffness", "stiffness", "which", "which"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("participants = 4", "participants = 6",
         r"design.toml:4: participants is 6, which cannot be balanced: 2 conditions and 2 tasks "
         r"have 4 orders"),
        ("trials = 8", "trials = 9",
         r"design.toml:28: .* cannot be balanced over 4 levels, expected a multiple"),
        ("seed = 7", "sede = 7", r"design.toml:3: the file has no key 'sede': did you mean seed\?"),
        ("latency = 0.003", "latncy = 0.003",
         r"design.toml:19: \[conditions\[1\]\] has no key 'latncy': did you mean latency\?"),
        ("latency = 0.003", "latency = 3",
         r"design.toml:19: conditions\[1\].latency is 3, expected a number"),
        ('wall = "coupled"', 'wall = "springy"',
         r'conditions\[1\].wall is \'springy\', expected "real" or "coupled" or "decaff"'),
        ("stiffness = 1500.0\n", "", r"conditions\[1\].stiffness is missing, expected a number above 0"),
        ("damping = 2.0\n", "", r"conditions\[1\].damping is missing, expected a number from 0"),
        ('wall = "coupled"', 'wall = "decaff"',
         r"design.toml:20: conditions\[1\].stiffness is a gain of a coupled wall, and this one is decaff: "
         r"expected it in a task"),
        ('wall = "coupled"', "", r"conditions\[1\].wall is missing"),
        ('name = "late"', 'name = "real"', r"conditions\[1\] is called 'real', as an earlier one is"),
        ('name = "late"', 'name = "late 3 ms"', r"is 'late 3 ms', expected letters and digits"),
        ("force = 4.0", "force = 40.0", r"limits.force is 40, expected a number above 0 to 20 \(N\)"),
        ("levels = [0.1, 0.2, 0.4, 0.8]", "", r"tasks\[0\].levels is missing, expected 2 or more"),
        ("stiffness = 200.0", "", r"expected tasks.stiffness beside them"),
        ("levels = [0.1, 0.2, 0.4, 0.8]", "levels = [0.1]", r"levels has 1 level, expected 2 or more"),
        ("catch = 1", 'comparisons = ["late against soft"]',
         r"comparisons has 'late against soft', expected \"A against B\" of real, late"),
        ('consent = "You press."', "", r"consent is missing"),
    ],
)  # fmt: skip
def test_mistake_is_named_by_its_line(tmp_path, old, new, sentence):
    assert old in SMALL
    with pytest.raises(ServiceError, match=sentence):
        read_design(write_design(tmp_path, SMALL.replace(old, new, 1)))


def test_coupled_walls_that_shake_are_named(tmp_path):
    stiff = SMALL.replace("stiffness = 1500.0", "stiffness = 5e5")
    calm = SMALL.replace("stiffness = 1500.0\ndamping = 2.0", "stiffness = 734.0\ndamping = 4.4")
    assert unstable_walls(read_design(SHIPPED)) == []
    twice = SHIPPED.read_text().replace("stiffness = 100.0", "stiffness = 200.0")
    shipped = unstable_walls(read_design(write_design(tmp_path, twice)))

    assert unstable_walls(read_design(write_design(tmp_path, calm))) == []
    assert unstable_walls(read_design(write_design(tmp_path, stiff))) == [
        "late in which is unstable at 500000 N/m with 2 N s/m, 3 ms late at 1000 Hz, under a simulated hand: "
        "it shakes, and limits may end its trials"
    ]
    assert [sentence.partition(" with")[0] for sentence in shipped] == [
        "coupled10ms in stiffness is unstable at 320 N/m"
    ]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (SMALL[: SMALL.index("[[tasks]]")] + '[tasks]\nname = "which"\n',
         r"tasks are not a list of tables, expected \[\[tasks\]\]"),
        ("title='t'\nseed=1\nparticipants=1\nconsent='c'\n",
         r"\[\[conditions\]\] is missing, expected at least one"),
        ("\n", "the file is empty, expected a design in TOML"),
    ],
)  # fmt: skip
def test_file_that_is_no_design_is_refused(tmp_path, text, sentence):
    with pytest.raises(ServiceError, match=sentence):
        read_design(write_design(tmp_path, text))


def test_every_display_of_the_shipped_design_has_the_same_surface():
    design = read_design(SHIPPED)
    surfaces = {interval_of(design.tasks[0], one, 0.19)[1:3] for one in design.conditions}

    assert surfaces == {(100.0 * 1.19, 1.0)}


def trial_of(design, task, name, odd, level, number=0):
    condition = next(one for one in design.conditions if one.name == name)
    return Trial(number, 1, design.tasks[task], condition, Stage.MAIN, odd, level)


@pytest.mark.parametrize("odd", [1, 2])
def test_interval_that_differs_is_where_the_plan_has_it(odd):
    design = read_design(SHIPPED)
    stiffer = trial_of(design, 0, "decaff1ms", odd, 0.5)
    real = intervals_of(trial_of(design, 1, "decaff1ms", odd, 0.0))

    assert [one.stiffness for one in intervals_of(stiffer)] == [150.0, 100.0][:: 3 - 2 * odd]
    assert [one.wall for one in real] == ["real", "decaff"][:: 3 - 2 * odd]
    assert row_of(stiffer, [], odd, 1.0)["is_right"] == 1
    assert row_of(stiffer, [], 3 - odd, 1.0)["is_right"] == 0


@pytest.mark.parametrize(("name", "least", "most"), [("decaff1ms", 0.5, 0.9), ("coupled10ms", 0.97, 1.0)])
def test_simulated_participant_tells_the_real_wall_by_what_the_hand_feels(name, least, most):
    """A hard wall is identified as the real one; a wrong expectation in the design has no effect."""
    design = read_design(SHIPPED)
    misled = tuple(replace(one, correct=0.0, threshold=99.0) for one in design.conditions)
    design = replace(design, conditions=misled)
    right = []
    for number in range(60):
        observer, trial = Observer(design, 0), trial_of(design, 1, name, 1 + number % 2, 0.0, number)
        felt = []
        for index, interval in enumerate(intervals_of(trial)):
            observer.wait_ready(trial, index)
            felt.append(observer.present(interval, 6.0, 8.0))
        right.append(observer.answer(trial, felt) == trial.odd)

    assert least <= np.mean(right) <= most
