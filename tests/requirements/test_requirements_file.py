"""Mistakes in files of requirements: each names the line, the key and the expected value."""

import re

import pytest
import shapes
from requirement_files import save_cubes, write_file

from proximity import Scene, ServiceError, Solid, verify

GAP = "gap = { least = 1 }\n"
BOTH = 'between = ["base", "near"]\n'
HINGE = "motion = {{ hinge = {{ point = [0, 0, 0], axis = {}, end = {} }} }}\n"
MISTAKES = [  # text of an entry, line in it, words of the message
    ("gap = { least = 1 }", 1, "require[0].between is missing"),
    (BOTH, 1, "has no limits, expected gap or clash or thickness"),
    (BOTH + 'part = "base"\nthickness = { least = 1 }', 3, "between cannot be used together with thickness"),
    ("thickness = { least = 1 }", 1, "require[0].part is missing"),
    (BOTH + "gap = 3", 4, "require[0].gap is 3, expected a table"),
    (BOTH + "gap = {}", 4, "require[0].gap has no limit, expected least or greatest"),
    (BOTH + "gap = { lest = 1 }", 4, "no key 'lest': did you mean least?"),
    (BOTH + "gap = { least = 0 }", 4, "require[0].gap.least is 0, expected a number above 0"),
    (BOTH + "gap = { least = nan }", 4, "require[0].gap.least is nan"),
    (BOTH + 'gap = { least = "1" }', 4, "require[0].gap.least is '1'"),
    (BOTH + "gap = { greatest = -1 }", 4, "require[0].gap.greatest is -1"),
    (BOTH + "gap = { least = 2, greatest = 1 }", 4, "least length above the greatest"),
    (BOTH + "clash = { deepest = -1 }", 4, "require[0].clash.deepest is -1"),
    (BOTH + GAP + "clash = { deepest = 1 }", 5, "require[0].clash cannot be used together with gap"),
    (BOTH + "clash = { deepest = 1 }\nalong = [0, 0, 1]", 5, "along cannot be used together with clash"),
    (BOTH + "clash = { deepest = 1 }\n" + HINGE.format("[0, 0, 1]", 5), 5, "motion cannot be used together"),
    (BOTH + GAP + "color = 1", 5, "no key 'color'"),
    (BOTH + GAP + "along = [0, 0]", 5, "along has 2 numbers, expected 3"),
    (BOTH + GAP + "along = [0, 0, 0]", 5, "along has no length, expected three numbers, not all 0"),
    (BOTH + GAP + "along = [0, 0, 1e-320]", 5, "along has no length"),
    (BOTH + GAP + "along = [1e300, 0, 0]", 5, "along has 1e+300 at index 0"),
    (BOTH + GAP + "motion = { slide = { direction = [0, 0, 1], end = 1e300 } }", 5, "slide.end is 1e+300"),
    (BOTH + GAP + "along = [0, 0, 1]\n" + HINGE.format("[0, 0, 1]", 5), 6, "motion cannot be used"),
    (BOTH + GAP + "motion = {}", 5, "motion has 0 motions, expected one of hinge, slide, poses"),
    (BOTH + GAP + HINGE.format("[0, 0, 0]", 5), 5, "motion.hinge cannot be used: axis is"),
    (BOTH + GAP + HINGE.format("[0, 0, 1]", 0), 5, "motion.hinge cannot be used: the motion is from"),
    (BOTH + GAP + "motion = { hinge = { axis = [0, 0, 1], end = 5 } }", 5, "hinge.point is missing"),
    (BOTH + GAP + "pose = { slide = { direction = [0, 0, 1] } }", 5, "pose.slide.end is missing"),
    (BOTH + GAP + 'motion = { poses = "none.csv" }', 5, "none.csv is not there"),
    (BOTH + GAP + 'motion = { poses = "fit.toml" }', 5, "expected CSV with the columns position, x"),
    (BOTH + "gap = { greatest = 1 }\n" + HINGE.format("[0, 0, 1]", 5), 4, "greatest cannot be used over a"),
    (BOTH + GAP + 'part = "base"', 5, "part cannot be used together with gap, expected between"),
    ('between = "base"\n' + GAP, 3, "between has 1 names, expected two"),
    ('between = ["base", "near", "deep"]\n' + GAP, 3, "between has 3 names"),
    ('between = ["bass", "near"]\n' + GAP, 3, "between: no part is named 'bass'; did you mean 'base'?"),
    ('between = ["x*", "near"]\n' + GAP, 3, "between: no part is named 'x*'"),
    ('between = ["base", "base"]\n' + GAP, 3, "'base' is the only part, expected pairs of different parts"),
    (BOTH + GAP + 'allowed = ["base", "near"]', 5, "allowed is not a list of pairs"),
    (BOTH + GAP + 'allowed = ["ab"]', 5, "allowed is not a list of pairs"),
    (BOTH + GAP + 'allowed = [["base", 1]]', 5, "allowed is not a list of pairs"),
    (BOTH + GAP + "allowed = []", 5, "allowed is not a list of pairs"),
    (BOTH + GAP + 'allowed = [["base", "nothing"]]', 5, "allowed: no part is named 'nothing'"),
    (BOTH + GAP + 'allowed = [["base", "deep"]]', 5, "'base' and 'deep' are not a pair of this requirement"),
    (BOTH + GAP + 'allowed = [["*", "*"]]', 5, "all pairs are allowed, expected one or more to measure"),
    ('between = ["*", "near"]\n' + GAP + HINGE.format("[0, 0, 1]", 5), 5, "'*' names 4 parts, expected one"),
]  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    save_cubes(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("text", "line", "words"), MISTAKES)
def test_mistake_is_named_with_line_and_key(folder, text, line, words):
    path = write_file(folder, text)
    with pytest.raises(ServiceError) as refused:
        verify(path)
    assert str(refused.value).startswith(f"{path}:{line + 1}: ") and words in str(refused.value)


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        ("", 1, "model is missing"),
        ('model = "cubes.prox"\n', 1, "[[require]] is missing, expected one or more"),
        ('model = "none.stl"\n', 1, "none.stl is not there"),
        ('model = "cubes.prox"\nunits = "lines"\n', 2, "units cannot be used"),
        ('model = "cubes.prox"\nstep_tolerance = 0\n', 2, "step_tolerance is 0"),
        ('model = "cubes.prox"\nscale = 2\n', 1, "model: "),
        ('model = "bad.stl"\n', 1, "model: "),
        ('modell = "cubes.prox"\n', 1, "the file has no key 'modell': did you mean model?"),
        ("model = \n", 1, "invalid TOML"),
    ],
)
def test_mistake_in_the_head_is_named(folder, text, line, words):
    (folder / "bad.stl").write_text("solid")
    entry = "" if "[[require]]" in words else '[[require]]\nname = "a"\n' + BOTH + GAP
    (folder / "fit.toml").write_text(text + entry)
    with pytest.raises(ServiceError, match=rf"fit\.toml:{line}: .*{re.escape(words)}"):
        verify(folder / "fit.toml")


def test_names_must_differ(folder):
    entry = '[[require]]\nname = "a"\n' + BOTH + GAP
    with pytest.raises(ServiceError, match=r"fit\.toml:7: require\[1\]\.name is 'a', as on line 3"):
        verify(write_file(folder, entry, entry))


def test_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ServiceError, match=r"none\.toml"):
        verify(tmp_path / "none.toml")


# Open parts


def test_part_that_may_be_inside_an_open_part_is_refused(tmp_path):
    save_cubes(tmp_path, closed=False)
    for text, words in (
        ('between = ["core", "base"]\n' + GAP, "whether 'core' is inside it is unknown"),
        ('between = ["deep", "base"]\nclash = { deepest = 1 }', "how deep 'deep' is in it is unknown"),
        ("clash = { deepest = 9 }", "part 'base' is not closed and has no inside"),
        (BOTH + GAP + HINGE.format("[0, 0, 1]", 5), "which this requirement needs"),
    ):
        with pytest.raises(
            ServiceError, match=r"fit\.toml:\d: require\[0\]\.(gap|clash): part 'base' is not"
        ) as no:
            verify(write_file(tmp_path, text))
        assert words in str(no.value)


def test_gap_to_an_open_part_is_measured_if_no_part_can_be_inside(tmp_path):
    save_cubes(tmp_path, closed=False)
    both = [BOTH + "gap = { least = 2, greatest = 2 }", BOTH + "clash = { deepest = 0 }"]
    assert verify(write_file(tmp_path, *both)).holds


def test_two_open_parts_of_equal_boxes_are_refused(tmp_path):
    vertices, faces = shapes.open_box()
    Scene([Solid(vertices, faces, name="a"), Solid(vertices, faces[::-1], name="b")]).save(
        tmp_path / "cubes.prox"
    )
    with pytest.raises(ServiceError, match="is not closed"):
        verify(write_file(tmp_path, 'between = ["a", "b"]\ngap = { least = 1 }'))
