"""Designs of experiments: their files, and the plans that follow from them."""

from collections import Counter
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from experiments import SHIPPED, SMALL, write_design

from proximity.errors import ServiceError
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.display import interval_of, trial_at
from proximity.lab.experiment.observers import DISTANCE_RATE, Observer, unstable_walls
from proximity.lab.experiment.plan import PlannedTrial, Stage, Text, latin_square, minutes, plan, trials_of
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

    assert [round(minutes(design, steps)) for steps in plans] == [42] * 12
    assert [one.latency for one in design.conditions if one.wall == "coupled"] == [0.001, 0.003, 0.010]
    first = Counter(trials_of(steps)[4].condition for steps in plans)
    assert set(first.values()) == {3} and len(first) == 4


@pytest.mark.slow
def test_coupled_walls_of_the_shipped_design_are_tuned_as_those_of_simulate():
    for one in read_design(SHIPPED).conditions:
        if one.wall == "coupled":
            best = best_coupled_wall(Hand(), DISTANCE_RATE, one.latency)
            assert one.stiffness == pytest.approx(best.stiffness, rel=1e-3)
            assert one.damping == pytest.approx(best.damping, rel=2e-3)


def test_plan_is_the_same_every_time_and_differs_between_participants():
    design = read_design(SHIPPED)

    assert plan(design, 3) == plan(design, 3) != plan(design, 7)  # of the same row


def test_levels_and_intervals_are_balanced_in_every_block():
    design = read_design(SHIPPED)
    trials = [one for one in trials_of(plan(design, 5)) if one.task == "stiffness"]
    own = [one for one in trials if one.condition == "decaff" and one.stage != Stage.PRACTICE]

    levels = Counter(one.level for one in own if one.stage == Stage.MAIN)
    assert set(levels.values()) == {5} and set(levels) == set(design.task("stiffness").levels)
    assert Counter(one.stage for one in own) == {Stage.MAIN: 40, Stage.CATCH: 4}
    for run in (1, 2):
        assert Counter(one.odd for one in own if one.run == run) == {0: 11, 1: 11}


def test_steps_come_in_order(tmp_path):
    steps = plan(read_design(write_design(tmp_path)), 0)

    assert isinstance(steps[0], Text) and steps[0].name == "consent"
    assert [one.key for one in (steps[1], steps[-2])] == ["hours", "hand"]
    assert steps[-1] == Text("goodbye", "Thanks.")
    assert [one.number for one in trials_of(steps)] == list(range(len(trials_of(steps))))
    real = {one.condition for one in steps if isinstance(one, PlannedTrial) and one.task == "which"}
    assert real == {"late"}  # the real wall is not compared with itself


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("participants = 2", "participants = 3",
         r"design.toml:4: participants is 3, which cannot be balanced: the Latin square of 2 conditions "
         r"has 2 rows, expected a multiple of 2"),
        ("trials = 8", "trials = 9",
         r"design.toml:27: .* cannot be balanced over 4 levels, expected a multiple"),
        ("seed = 7", "sede = 7", r"design.toml:3: the file has no key 'sede': did you mean seed\?"),
        ("latency = 0.003", "latncy = 0.003",
         r"design.toml:18: \[conditions\[1\]\] has no key 'latncy': did you mean latency\?"),
        ("latency = 0.003", "latency = 3",
         r"design.toml:18: conditions\[1\].latency is 3, expected a number"),
        ('wall = "coupled"', 'wall = "springy"',
         r'conditions\[1\].wall is \'springy\', expected "real" or "coupled" or "decaff"'),
        ("stiffness = 1500.0\n", "", r"conditions\[1\].stiffness is missing, expected a number above 0"),
        ("damping = 2.0\n", "", r"conditions\[1\].damping is missing, expected a number from 0"),
        ('wall = "coupled"', 'wall = "decaff"',
         r"design.toml:19: conditions\[1\].stiffness is a gain of a coupled wall, and this one is decaff: "
         r"expected it in a task"),
        ('wall = "coupled"', "", r"conditions\[1\].wall is missing"),
        ('name = "late"', 'name = "real"', r"conditions\[1\] is called 'real', as an earlier one is"),
        ('name = "late"', 'name = "late 3 ms"', r"is 'late 3 ms', expected letters and digits"),
        ("force = 4.0", "force = 40.0", r"limits.force is 40, expected a number above 0 to 20 \(N\)"),
        ("levels = [0.1, 0.2, 0.4, 0.8]", "", r"tasks\[0\].levels are missing"),
        ("stiffness = 200.0", "", r"expected tasks.stiffness beside them"),
        ('kind = "real"\n', 'kind = "real"\nmethod = "quest+"\n', r'tasks\[1\].method is "quest\+"'),
        ('kind = "real"\n', 'kind = "real"\ncatch = 2\n', r'tasks\[1\].catch is of tasks of kind "stiffer"'),
        ('choices = ["right", "left"]', "choices = 3", r"questions\[1\].choices is 3"),
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
        (SMALL[: SMALL.index("[[questions]]")] + '[questions]\nkey = "hours"\n',
         r"questions are not a list of tables, expected \[\[questions\]\]"),
        ("title='t'\nseed=1\nparticipants=1\nconsent='c'\n",
         r"\[\[conditions\]\] is missing, expected at least one"),
        ("\n", "the file is empty, expected a design in TOML"),
    ],
)  # fmt: skip
def test_file_that_is_no_design_is_refused(tmp_path, text, sentence):
    with pytest.raises(ServiceError, match=sentence):
        read_design(write_design(tmp_path, text))


def test_every_display_of_the_shipped_design_has_the_same_surface():
    """Damping varied together with the display: 1.0 against 4.74, 4.40 and 1.70 N s/m."""
    design = read_design(SHIPPED)
    task = design.task("stiffness")
    surfaces = {interval_of(task, one, 0.19)[1:3] for one in design.conditions}

    assert surfaces == {(100.0 * 1.19, 1.0)}


@pytest.mark.parametrize("odd", [0, 1])
def test_interval_that_differs_is_where_the_plan_has_it(odd):
    design = read_design(SHIPPED)
    stiffer = trial_at(design, PlannedTrial(0, 1, "stiffness", "decaff", Stage.MAIN, odd, 0.5), 0.5)
    real = trial_at(design, PlannedTrial(0, 1, "real", "decaff", Stage.MAIN, odd, 0.0), 0.0)

    assert [one.stiffness for one in stiffer.intervals] == [150.0, 100.0][:: 1 - 2 * odd]
    assert [one.wall for one in real.intervals] == ["real", "decaff"][:: 1 - 2 * odd]
    assert stiffer.record(odd + 1, [])["is_right"] and not stiffer.record(2 - odd, [])["is_right"]


@pytest.mark.parametrize(("name", "least", "most"), [("decaff", 0.5, 0.9), ("coupled10ms", 0.97, 1.0)])
def test_simulated_participant_tells_the_real_wall_by_what_the_hand_feels(name, least, most):
    """A hard wall is the real one; that the design expects the opposite of it changes nothing."""
    design = read_design(SHIPPED)
    misled = tuple(replace(one, correct=0.0, threshold=99.0) for one in design.conditions)
    design = replace(design, conditions=misled)
    right = []
    for number in range(60):
        planned = PlannedTrial(number, 1, "real", name, Stage.MAIN, number % 2, 0.0)
        observer, trial = Observer(design, 0), trial_at(design, planned, 0.0)
        felt = []
        for index, interval in enumerate(trial.intervals):
            observer.wait_ready(trial, index)
            felt.append(observer.present(interval, 6.0, 8.0))
        right.append(observer.answer(trial, felt) == planned.odd + 1)

    assert least <= np.mean(right) <= most
