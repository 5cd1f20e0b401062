"""Verdicts and bounds against formulas: cubes without a deviation, and spheres approximated by triangles."""

import json
from dataclasses import replace
from math import inf, sqrt

import numpy as np
import pytest
import shapes
from project import MESHES, SHARED_DATA
from requirement_files import approximated_sphere, requirement, save_cubes, write_file
from step_text import ball_step, box_step

import proximity
from proximity import LoadReport, Pose, Scene, Solid, Verdict, verify
from proximity.requirements import measurements
from proximity.requirements.measurements import Kind, Measured
from proximity.requirements.receipts import check_receipt, write_receipt
from proximity.requirements.records import Limits

MM = 1e-3
HOLDS, VIOLATED, UNDECIDED = Verdict
BOTH = 'between = ["base", "near"]\n'
POSE = "pose = {{ slide = {{ direction = {}, end = {} }} }}"
SLIDE = "motion = {{ slide = {{ direction = {}, start = {}, end = {} }} }}"
HINGE = "{ point = [-5, 5, 0], axis = [0, 0, 2], end = -90 }"
BACK = 'between = ["near", "base"]\n'
DEEP = 'between = ["base", "deep"]\n'


@pytest.fixture
def folder(tmp_path):
    save_cubes(tmp_path)
    return tmp_path


def only(folder, text, **options):
    """Verify one requirement; return it."""
    (found,) = verify(write_file(folder, text, **options)).requirements
    return found


@pytest.mark.parametrize(
    ("text", "verdict", "lower", "upper"),
    [
        (BOTH + "gap = { least = 1.9 }", HOLDS, 2.0, 2.0),
        (BOTH + "gap = { least = 2.0 }", HOLDS, 2.0, 2.0),  # equal to the limit up to rounding
        (BOTH + "gap = { greatest = 2.0 }", HOLDS, 2.0, 2.0),
        (BOTH + "gap = { least = 2.0, greatest = 2.0 }", HOLDS, 2.0, 2.0),
        (BOTH + "gap = { least = 2.000001 }", VIOLATED, 2.0, 2.0),
        (BOTH + "gap = { greatest = 1.999999 }", VIOLATED, 2.0, 2.0),
        (DEEP + "gap = { least = 0.001 }", VIOLATED, 0.0, 0.0),
        (DEEP + "gap = { greatest = 0 }", HOLDS, 0.0, 0.0),
        ('between = ["core", "base"]\ngap = { least = 0.001 }', VIOLATED, 0.0, 0.0),
        (BACK + "along = [0, -3, 0]\ngap = { least = 2 }", HOLDS, 2.0, 2.0),
        (BACK + "along = [0, -3, 0]\ngap = { least = 2.1 }", VIOLATED, 2.0, 2.0),
        ('between = ["deep", "base"]\nalong = [-1, 0, 0]\ngap = { least = -1.1 }', HOLDS, -1.01, -0.99),
        ('between = ["deep", "base"]\nalong = [-1, 0, 0]\ngap = { least = 0 }', VIOLATED, -1.01, -0.99),
        (BACK + "along = [0, 1, 0]\ngap = { least = 1 }", UNDECIDED, inf, inf),
        (BACK + "along = [0, 1, 0]\ngap = { greatest = 1 }", VIOLATED, inf, inf),
        (BACK + "along = [0, 1, 0]\ngap = { least = 1, greatest = 9 }", VIOLATED, inf, inf),
        (DEEP + "clash = { deepest = 1.01 }", HOLDS, 0.99, 1.01),
        (DEEP + "clash = { deepest = 0.98 }", VIOLATED, 0.99, 1.01),
        ('between = ["core", "base"]\nclash = { deepest = 3.9 }', VIOLATED, 3.99, 6.01),
        (BOTH + "clash = { deepest = 0 }", HOLDS, 0.0, 0.0),
        (BOTH + "gap = { least = 5 }\n" + POSE.format("[0, -1, 0]", 3), HOLDS, 5.0, 5.0),
        (BOTH + f"gap = {{ least = 1.99 }}\npose = {{ hinge = {HINGE} }}", HOLDS, 2.0, 2.0),
        (BOTH + "clash = { deepest = 1 }\n" + POSE.format("[0, 1, 0]", 4), VIOLATED, 1.99, 2.01),
        (BOTH + "gap = { least = 1.99 }\n" + SLIDE.format("[1, 0, 0]", -30, 30), HOLDS, 1.9, 2.0),
        (BOTH + "gap = { least = 2.1 }\n" + SLIDE.format("[1, 0, 0]", -30, 30), VIOLATED, 1.9, 2.1),
        (BOTH + "gap = { least = 2 }\n" + SLIDE.format("[0, 1, 0]", 0, 5), VIOLATED, 0.0, 0.0),
    ],
)  # fmt: skip
def test_cubes_have_the_lengths_of_formulas(folder, text, verdict, lower, upper):
    found = only(folder, text)
    (pair,) = found.pairs

    assert pair.verdict is found.verdict is verdict
    assert lower * MM - 1e-10 <= pair.lower <= pair.upper <= upper * MM + 1e-10
    assert pair.deviation == 0.0
    assert bool(pair.reason) == (verdict is UNDECIDED)


def test_both_points_are_on_the_parts(folder):
    (pair,) = only(folder, BOTH + "gap = { least = 1 }").pairs
    assert (pair.point_on_first[1], pair.point_on_second[1]) == pytest.approx((0.005, 0.007))
    (pair,) = only(folder, DEEP + "clash = { deepest = 2 }").pairs
    assert 0.0039 <= pair.point_on_first[0] <= 0.0051


def test_units_are_those_of_the_file(folder):
    text = BOTH + "gap = { least = 0.199, greatest = 0.201 }"
    assert only(folder, text, head='model = "cubes.prox"\nunits = "cm"').verdict is HOLDS
    found = verify(folder / "fit.toml")
    assert (found.units, found.settings["units"]) == ("cm", "cm")


def test_pose_of_one_requirement_does_not_affect_the_next(folder):
    moved = BOTH + "gap = { least = 5 }\npose = { slide = { direction = [0, -1, 0], end = 3 } }"
    found = verify(write_file(folder, moved, BOTH + "gap = { least = 2, greatest = 2 }", moved))
    assert found.holds and [each.verdict for each in found.requirements] == [HOLDS] * 3
    assert str(found) == "r0: holds\nr1: holds\nr2: holds"


def test_hidden_parts_are_measured_and_named(tmp_path):
    save_cubes(tmp_path, hidden=("deep", "near"))
    found = verify(write_file(tmp_path, "clash = { deepest = 0.5 }", BOTH + "gap = { least = 3 }"))
    assert [each.verdict for each in found.requirements] == [VIOLATED, VIOLATED]
    assert any("near, deep" in note for note in found.notes)
    text = BOTH + "gap = { least = 1 }\n" + SLIDE.format("[0, 1, 0]", 0, 5)
    assert only(tmp_path, text).verdict is VIOLATED


def test_every_pair_of_patterns_is_measured_once_and_the_worst_is_first(folder):
    found = only(folder, 'between = ["*", "*"]\ngap = { least = 1.5 }')
    pairs = [frozenset((pair.first, pair.second)) for pair in found.pairs]
    assert len(pairs) == len({*pairs}) == 6
    assert [pair.verdict for pair in found.pairs] == sorted(
        (pair.verdict for pair in found.pairs), key=[VIOLATED, UNDECIDED, HOLDS].index
    )
    assert found.pairs[-1].lower > found.pairs[-2].lower
    along = only(folder, 'between = ["*e*r", "?a*e"]\nalong = [0, 1, 0]\ngap = { greatest = 100 }')
    assert {(pair.first, pair.second) for pair in along.pairs} == {("near", "base")}


def test_allowed_pairs_are_left_out_and_counted(folder):
    text = 'clash = { deepest = 0.1 }\nallowed = [["deep", "b*"], ["core", "base"]]'
    found = only(folder, text)
    assert (found.verdict, found.allowed_count, len(found.pairs)) == (HOLDS, 2, 4)


def test_poses_of_a_file_are_a_motion(folder):
    rows = ["position,x,y,z,qx,qy,qz,qw", "0,0,30,0,0,0,0,1", "2,0,12,0,0,0,0,1"]
    (folder / "near.csv").write_text("\n".join(rows))
    text = 'between = ["near", "base"]\nmotion = { poses = "near.csv" }\n'
    found = verify(write_file(folder, text + "gap = { least = 1.9 }", text + "gap = { least = 2.1 }"))
    first, second = found.requirements
    assert (first.verdict, second.verdict) == (HOLDS, VIOLATED)
    assert first.pairs[0].position == pytest.approx(2.0)
    assert str(folder / "near.csv") in found.files


# Deviations of triangles from curved surfaces


@pytest.mark.parametrize("seed", range(48))
def test_bounds_contain_the_lengths_of_true_spheres(tmp_path, seed):
    rng = np.random.default_rng(seed)
    radii, levels = rng.uniform(4e-3, 9e-3, 2), rng.integers(1, 4, 2)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    aside = np.cross(direction, [0.0, 0.0, 1.0])
    aside *= float(rng.choice([0.0, 0.5, 0.9, 0.97])) * radii.sum() / np.linalg.norm(aside)
    reach = sqrt(radii.sum() ** 2 - float(aside @ aside))  # distance along the axis at which they touch
    distance = float(reach + rng.choice([-2e-3, -1e-4, 1e-4, 2e-3]))
    is_inside = rng.integers(0, 2, 2).astype(bool)
    meshes = [
        approximated_sphere(radius, level, is_inside=inside)
        for radius, level, inside in zip(radii, levels, is_inside, strict=True)
    ]
    deviation = max(mesh[2] for mesh in meshes)
    solids = [Solid(*mesh[:2], name=name) for mesh, name in zip(meshes, "ab", strict=True)]
    scene = Scene(solids, report=LoadReport("a.step", "STEP", "mm", True, (), deviation))
    start = distance * direction + aside
    scene.move("b", Pose(shapes.rotation(seed), start))
    scene.save(tmp_path / "spheres.prox")
    apart = float(np.linalg.norm(start)) - radii.sum()
    towards = ", ".join(f"{-each:.17g}" for each in direction)
    depth = max(-apart, 0.0)
    along = distance - reach
    names = 'between = ["b", "a"]\n'
    passing = f"motion = {{ slide = {{ direction = [{towards}], start = -1, end = 60 }} }}\n"
    nearest = max(float(np.linalg.norm(aside)) - radii.sum(), 0.0)
    cases = [
        (names + "gap = { least = 1 }", max(apart, 0.0)),
        (names + f"along = [{towards}]\ngap = {{ least = 1 }}", along),
        (names + passing + "gap = { least = 1 }", nearest),
        ("clash = { deepest = 1 }", depth),
    ]
    found = verify(write_file(tmp_path, *(text for text, _ in cases), head='model = "spheres.prox"'))

    for each, (text, truth) in zip(found.requirements, cases, strict=True):
        (pair,) = each.pairs
        assert pair.deviation == pytest.approx(2.0 * deviation)
        assert pair.lower - 1e-12 <= truth <= pair.upper + 1e-12, text
        true_verdict = each.limits.judge(truth, truth, 0.0)
        assert each.verdict in (true_verdict, UNDECIDED), text


@pytest.mark.parametrize(
    ("least", "verdict"), [(1.97, HOLDS), (1.981, UNDECIDED), (2.019, UNDECIDED), (2.021, VIOLATED)]
)
@pytest.mark.parametrize("more", ["", "along = [0, 1, 0]\n"])
def test_limit_within_the_deviation_cannot_be_decided(tmp_path, least, verdict, more):
    save_cubes(tmp_path, deviation=1e-5)
    (pair,) = only(tmp_path, BOTH + more + f"gap = {{ least = {least} }}").pairs
    slack = 0.002 if more else 0.0  # bounds along an axis are a twentieth of the deviation wider
    if verdict is VIOLATED and more:
        verdict = UNDECIDED if least < 2.02 + slack else VIOLATED
    assert pair.verdict is verdict
    assert (pair.tolerance is not None) == (verdict is UNDECIDED)


def test_touching_parts_may_clash_by_their_deviation(tmp_path):
    save_cubes(tmp_path, deviation=1e-5)
    for gap, limit, verdict in ((2.0, 0.019, UNDECIDED), (2.0, 0.021, HOLDS), (1.985, 0.006, HOLDS)):
        text = BOTH + f"pose = {{ slide = {{ direction = [0, 1, 0], end = {gap} }} }}\n"
        assert only(tmp_path, text + f"clash = {{ deepest = {limit} }}").verdict is verdict


def test_deviation_of_meshes_is_zero_beside_a_step_file(tmp_path):
    save_cubes(tmp_path, deviation=1e-5)
    vertices, faces = shapes.cube(0.01, (0.0, 0.0, 0.05))
    Scene([Solid(vertices, faces, name="mesh")]).save(tmp_path / "mesh.prox")
    text = 'between = ["*", "mesh"]\ngap = { least = 1 }'
    found = only(tmp_path, text, head='model = ["cubes.prox", "mesh.prox"]')
    assert {pair.deviation for pair in found.pairs} == {1e-5}


def test_limits_compare_bounds():
    limits = Limits(1.0, 2.0)
    assert limits.judge(1.0, 2.0, 0.0) is HOLDS
    assert limits.judge(0.5, 1.5, 0.0) is limits.judge(1.5, 2.5, 0.0) is UNDECIDED
    assert limits.judge(0.0, 0.9, 0.0) is limits.judge(2.1, 3.0, 0.0) is VIOLATED
    assert limits.judge(float("nan"), float("nan"), 0.0) is UNDECIDED
    assert limits.judge(0.999, 1.0, 0.001) is HOLDS


def test_kind_is_added_by_its_entry_in_the_table(folder, monkeypatch):
    """A kind of single parts, such as a thickness."""

    def measure(subject):
        size = float(np.ptp(subject.scene.part(subject.first).solid.mesh.vertices))
        return Measured((size, size), size, size, (np.zeros(3), np.zeros(3)))

    kind = Kind("size", {"least": "least"}, (), measure, names="part")
    monkeypatch.setitem(measurements.KINDS, "size", kind)
    found = only(folder, 'part = ["c*", "base"]\nsize = { least = 5 }')
    assert [(pair.first, pair.second, pair.verdict) for pair in found.pairs] == [
        ("core", "", VIOLATED), ("base", "", HOLDS),
    ]  # fmt: skip


def test_least_thickness_is_that_of_each_part(folder):
    found = only(folder, 'part = ["c*", "base"]\nthickness = { least = 5 }')
    assert [(pair.first, pair.second, pair.verdict) for pair in found.pairs] == [
        ("core", "", VIOLATED), ("base", "", HOLDS),
    ]  # fmt: skip
    for pair in found.pairs:
        assert pair.lower <= pair.upper <= pair.lower + 1e-9
        length = np.linalg.norm(np.subtract(pair.point_on_first, pair.point_on_second))
        assert length == pytest.approx(pair.upper)


# Files


@pytest.mark.processes
def test_step_tolerance_that_is_proposed_decides(tmp_path):
    (tmp_path / "ball.step").write_text(ball_step(10.0))
    (tmp_path / "box.step").write_text(box_step((40.0, 40.0, 40.0)))
    to = np.array([-10.2, 20.0, 20.0])
    pose = f"pose = {{ slide = {{ direction = {to.tolist()}, end = {np.linalg.norm(to)} }} }}\n"
    text, head = (
        f'between = ["ball", "box"]\n{pose}gap = {{ least = 0.15 }}',
        'model = ["ball.step", "box.step"]\n',
    )
    tolerance, verdict = 5e-4, UNDECIDED
    for _ in range(4):  # the deviation is not in proportion to the tolerance
        found = only(tmp_path, text, head=f"{head}step_tolerance = {1e3 * tolerance}")
        verdict, pair = found.verdict, found.pairs[0]
        if verdict is not UNDECIDED:
            break
        assert f"step_tolerance = {1e3 * pair.tolerance:g} (mm)" in pair.reason and pair.tolerance < tolerance
        tolerance = pair.tolerance
    assert verdict is HOLDS and tolerance < 5e-4


def test_unknown_deviation_decides_nothing(folder):
    parts = [
        replace(
            part,
            source_faces=np.zeros(len(part.solid.mesh.faces), np.int32),
            deviation=inf,
            deviation_by_face=np.array([inf]),
        )
        for part in proximity.load(folder / "cubes.prox").parts
    ]
    Scene(parts).save(folder / "cubes.prox")
    for text in (
        "gap = { least = 0.001 }",
        "along = [0, 1, 0]\ngap = { greatest = 1000 }",
        "clash = { deepest = 50 }",
    ):
        found = only(folder, BOTH + text)
        assert found.verdict is UNDECIDED and "not known" in found.pairs[0].reason
    write_receipt(folder / "receipt.json", verify(folder / "fit.toml"))
    assert check_receipt(folder / "receipt.json").differences == ()


@pytest.mark.processes
def test_public_assembly_has_each_verdict(tmp_path):
    path = SHARED_DATA / "assemblies" / "as1-oc-214.stp"
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    entries = [
        'between = ["*_1/l-bracket", "*_2/l-bracket"]\ngap = { least = 69, greatest = 71 }',
        'between = ["*/nut", "plate"]\ngap = { least = 5 }',
        'between = ["rod", "plate"]\ngap = { greatest = 35.01 }',
        "clash = { deepest = 0.05 }",
    ]
    found = verify(write_file(tmp_path, *entries, head=f"model = {json.dumps(str(path))}"))
    assert [each.verdict for each in found.requirements] == [HOLDS, VIOLATED, UNDECIDED, HOLDS]
    assert len(found.requirements[3].pairs) == 153
    assert found.requirements[2].pairs[0].deviation < 2e-5


@pytest.mark.processes
def test_scene_file_is_a_model(tmp_path):
    (tmp_path / "box.stl").write_bytes((MESHES / "box.stl").read_bytes())
    entry = '[[parts]]\nfile = "box.stl"\nname = "{}"\nposition = [0, 0, {}]\n'
    scene = entry.format("low", 0) + entry.format("high", 1) + '[input]\nposes = "mailbox:a"\n'
    (tmp_path / "cell.toml").write_text(scene)
    found = verify(
        write_file(tmp_path, 'between = ["low", "high"]\ngap = { least = 1 }', head='model = "cell.toml"')
    )
    height = float(np.subtract(*proximity.load(MESHES / "box.stl").bounds[::-1])[2])
    assert found.requirements[0].pairs[0].lower == pytest.approx(1.0 - height)
    assert {str(tmp_path / name) for name in ("cell.toml", "box.stl")} < {*found.files}


def test_names_of_requirements_are_shown_by_an_assertion(folder):
    found = verify(write_file(folder, requirement(BOTH + "gap = { least = 3 }", "near clears base")))
    assert not found.holds and repr(found).endswith("fit.toml', 1 is violated)")
    assert str(found) == "near clears base: is violated"


@pytest.mark.processes
@pytest.mark.parametrize("tolerance", [0.5, 0.1, 0.01])
def test_bounds_of_step_files_contain_the_true_gap_of_a_ball_and_a_box(tmp_path, tolerance):
    (tmp_path / "ball.step").write_text(ball_step(10.0))
    (tmp_path / "box.step").write_text(box_step((40.0, 40.0, 40.0)))
    head = f'model = ["ball.step", "box.step"]\nstep_tolerance = {tolerance}'
    for gap in (0.003, 0.2, 3.0):
        to = np.array([-10.0 - gap, 20.0, 20.0])  # centre of the ball; the box is from 0 to 40
        pose = f"pose = {{ slide = {{ direction = {to.tolist()}, end = {np.linalg.norm(to)} }} }}\n"
        names = 'between = ["ball", "box"]\n' + pose
        entries = [names + "gap = { least = 1 }", names + "along = [1, 0, 0]\ngap = { least = 1 }"]
        for each in verify(write_file(tmp_path, *entries, head=head)).requirements:
            (pair,) = each.pairs
            assert pair.lower <= gap * MM <= pair.upper and pair.upper - pair.lower <= 10 * tolerance * MM
            assert 0.0 < pair.deviation <= tolerance * MM
