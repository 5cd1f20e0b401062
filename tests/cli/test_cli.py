"""What the commands print and how they end, on a sphere of formulas instead of a file.

The sphere has radius 10 mm and its centre at the origin; `proximity.load` is replaced, so nothing compiles.
"""

import csv
import io
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from fake_scene import RADIUS, FakeRepairs, FakeScene
from rich.console import Console

import proximity
from proximity import cli
from proximity.cli import progress
from proximity.cli.lengths import in_units
from proximity.cli.parts import answer_output, query
from proximity.errors import MeshFormatError
from proximity.pose import Pose


@pytest.fixture
def loaded(monkeypatch):
    """Replace what reads files and compiles; returns the calls of load."""
    calls = []

    def load(path, *, units="mm", **options):
        calls.append((path, units))
        return FakeScene()

    for name, value in {"load": load, "kernels_are_cached": lambda: True}.items():
        monkeypatch.setitem(vars(proximity), name, value)
    return calls


@pytest.fixture
def run(loaded, run):
    """The command line on the sphere, with an empty standard input unless a test gives one."""
    return lambda *arguments, stdin="": run(*arguments, stdin=stdin)


def load_with(monkeypatch, load):
    monkeypatch.setitem(vars(proximity), "load", load)


def block(text):
    """The labelled lines of a block."""
    return {line[:16].strip(): line[16:] for line in text.splitlines()}


def test_point_outside_is_told_in_words(run):
    result = run("query", "ball.stl", 0, 0, 12.5)

    assert result.code == 0
    assert result.err == ""
    assert block(result.out) == {
        "signed distance": "2.5 mm, outside",
        "closest point": "0  0  10 mm",
        "normal": "0  0  1",
        "part": "ball",
        "face": "107 of the file",
        "on": "an edge",
        "sign": "pseudo-normals: closed and oriented",
    }


@pytest.mark.parametrize(("x", "words"), [(4, "-6 mm, inside"), (10, "0 mm, on the surface")])
def test_side_of_a_point_is_told_in_words(run, x, words):
    assert block(run("query", "ball.stl", x, 0, 0).out)["signed distance"] == words


def test_unknown_side_is_told_in_words(run, monkeypatch):
    load_with(monkeypatch, lambda path, units, **options: FakeScene(has_inside=False))

    lines = block(run("query", "ball.stl", 4, 0, 0).out)

    assert lines["signed distance"] == "6 mm, which side is unknown"
    assert lines["sign"] == "none: it is an open sheet"


def test_point_that_is_not_finite_is_told_in_words(run):
    result = run("query", "ball.stl", "--points", "-", stdin="nan 0 -inf\n")

    assert result.code == 0
    assert block(result.out) == {"distance": "nan (the point is not finite)"}


def test_piped_output_has_no_colours(run):
    assert "\x1b" not in run("query", "ball.stl", 0, 0, 12.5).out


def test_name_of_a_part_cannot_command_the_terminal(run, monkeypatch):
    load_with(monkeypatch, lambda path, units, **options: FakeScene(name="a\x1b[2Jb [red]"))

    assert block(run("query", "ball.stl", 4, 0, 0).out)["part"] == "a?[2Jb [red]"


def test_negative_coordinates_may_follow_options(run):
    result = run("query", "ball.stl", "--json", "--units", "mm", "-1", "-.5", "-1E1")

    assert json.loads(result.out)["answers"][0]["query"] == [-1.0, -0.5, -10.0]


def test_negative_direction_is_numbers(run):
    result = run("query", "ball.stl", "--ray", "0", "0", "-1", "-6", "0", "20", "--json")

    (answer,) = json.loads(result.out)["answers"]
    assert answer["origin"] == [-6.0, 0.0, 20.0]
    assert answer["direction"] == [0.0, 0.0, -1.0]
    assert answer["distance"] == 12.0


def test_rounding_in_a_length_is_printed_as_zero_but_not_for_programs(run):
    words = ("query", "ball.stl", -6.9e-15, 0, 12)

    assert block(run(*words).out)["closest point"] == "0  0  10 mm"
    (answer,) = json.loads(run(*words, "--json").out)["answers"]
    assert answer["point"][0] == pytest.approx(-6.9e-15 / 1.2)


@pytest.mark.parametrize(("word", "unit"), [("MM", "mm"), ("inch", "in"), ("Inches", "in")])
def test_units_may_be_spelt_otherwise(run, word, unit):
    assert json.loads(run("query", "ball.stl", 0, 0, 12, "--units", word, "--json").out)["units"] == unit


def test_file_behind_the_point_is_a_usage_error_that_says_the_order(run, tmp_path):
    (tmp_path / "ball.stl").touch()

    result = run("query", 30, 10, 5, tmp_path / "ball.stl")

    assert result.code == 2
    assert "is not a number; FILE comes first, before X Y Z" in result.words


@pytest.mark.parametrize(("option", "hint"), [("--format", False), ("--unit", True)])
def test_unknown_option_has_a_hint_only_if_one_is_alike(run, option, hint):
    result = run("query", "ball.stl", 1, 2, 3, option)

    assert ("ossible option" in result.words or "Did you mean" in result.words) == hint


@pytest.mark.parametrize("option", ["--foo", "-x", "--1"])
def test_unknown_option_is_a_usage_error(run, option):
    result = run("query", "ball.stl", 1, 2, 3, option)

    assert result.code == 2
    assert "No such option" in result.words
    assert option[:2] in result.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((1, 2), "a point is three numbers, but 2 were given"),
        ((1, 2, "nan"), "'nan' is not finite, expected a number"),
        ((1, "-inf", 3), "'-inf' is not finite, expected a number"),
        ((1, "1e400", 3), "'1e400' is beyond 1.8e+308, the largest number"),
        ((1, 2, 3, "--ray", 0, "nan", 1), "'nan' is not finite, expected a number"),
        (("1,2,3",), "'1,2,3' is not a number; separate numbers by spaces only: 1 2 3"),
        (("1,5", 2, 3), "'1,5' has a decimal comma, expected a decimal point: 1.5"),
        ((), "give a point, or --points FILE"),
        ((1, 2, 3, "--points", "-"), "points are given as arguments already"),
        ((1, 2, 3, "--segment"), "points are taken in pairs (start, end), but there are 1"),
        ((1, 2, 3, "--segment", "--ray", 0, 0, 1), "give one of them, not both"),
        ((1, 2, 3, "--json", "--csv"), "give one of them, not both"),
        ((1, 2, 3, "--workers", 0), "0 threads: expected 1 or more, or -1"),
    ],
)
def test_wrong_use_is_a_usage_error(run, loaded, arguments, message):
    result = run("query", "ball.stl", *arguments)

    assert result.code == 2
    assert message in result.words
    assert "Usage: proximity query" in result.err
    assert result.out == ""
    assert loaded == []


def test_units_hold_for_coordinates_answers_and_the_file(run, loaded):
    result = run("query", "ball.stl", 0, 0, 1.5, "--units", "cm", "--json")

    (answer,) = json.loads(result.out)["answers"]
    assert loaded == [("ball.stl", "cm")]
    assert answer["query"] == [0.0, 0.0, 1.5]
    assert answer["signed_distance"] == pytest.approx(0.5, rel=1e-15)
    assert answer["point"] == [0.0, 0.0, 1.0]
    assert answer["gradient"] == [0.0, 0.0, 1.0]


def test_coordinate_too_large_for_metres_is_not_finite(run):
    result = run("query", "ball.stl", 1e308, 0, 0, "--units", "km", "--json")

    assert json.loads(result.out)["answers"][0]["signed_distance"] is None


def test_ray_that_hits_is_told(run):
    lines = block(run("query", "ball.stl", 0, 0, 50, "--ray", 0, 0, -1).out)

    assert lines == {
        "distance": "40 mm",
        "point": "0  0  10 mm",
        "normal": "0  0  1",
        "part": "ball",
        "face": "103 of the file",
    }


def test_ray_that_misses_is_told(run):
    result = run("query", "ball.stl", 0, 0, 50, "--ray", 0, 0, 1)

    assert result.code == 0
    assert block(result.out) == {"distance": "inf (nothing in that direction)"}


@pytest.mark.parametrize("options", [(), ("--ray", -1, 0, 0)])
def test_what_is_too_far_off_is_told_in_words(run, monkeypatch, options):
    scene = FakeScene()
    nothing = np.full(1, np.nan)
    hits = SimpleNamespace(
        **vars(scene.closest(np.array([[0.0, 0.0, np.nan]])))
        | {"distance": nothing, "normal": np.full((1, 3), np.nan)}
    )
    scene.closest = scene.cast = lambda *_, **__: hits
    load_with(monkeypatch, lambda path, units, **options: scene)

    lines = block(run("query", "ball.stl", 1e200, 0, 0, *options).out)

    assert lines == {"distance": "nan (too far away to be computed)"}


def test_segment_is_told(run):
    lines = block(run("query", "ball.stl", 0, 0, 12, 0, 0, 30, "--segment").out)

    assert lines == {
        "distance": "2 mm",
        "on segment": "0  0  12 mm",
        "on solid": "0  0  10 mm",
        "fraction": "0 of the segment",
        "part": "ball",
        "face": "107 of the file",
    }


def test_segment_that_touches_is_told(run):
    lines = block(run("query", "ball.stl", 0, 0, 0, 0, 0, 30, "--segment").out)

    assert lines["distance"] == "0 mm, touches the surface"


def test_segment_that_is_not_finite_is_told(run):
    stdin = "0 0 nan\n0 0 nan\n"

    lines = block(run("query", "ball.stl", "--points", "-", "--segment", stdin=stdin).out)

    assert lines == {"distance": "nan (the numbers given are not finite)"}


def test_segments_are_pairs_of_points(run):
    result = run("query", "ball.stl", *[0, 0, 12, 0, 0, 30], *[0, 15, 0, 0, 40, 0], "--segment", "--json")

    answers = json.loads(result.out)["answers"]
    assert [answer["start"] for answer in answers] == [[0, 0, 12], [0, 15, 0]]
    assert [answer["end"] for answer in answers] == [[0, 0, 30], [0, 40, 0]]
    assert [answer["distance"] for answer in answers] == pytest.approx([2.0, 5.0], rel=1e-14)


def test_many_points_make_an_aligned_table(run):
    result = run("query", "ball.stl", "--points", "-", stdin="0 0 12.5\n1 2 nan\n-4 0 0\n")

    lines = result.out.splitlines()
    assert lines[0].split()[:6] == ["#", "distance_mm", "side", "point_x_mm", "point_y_mm", "point_z_mm"]
    assert " ".join(lines[1].split()) == "0 2.5 outside 0 0 10 0 0 1 107 edge ball"
    assert " ".join(lines[2].split()) == "1 nan - nan nan nan nan nan nan - - -"
    assert " ".join(lines[3].split()) == "2 -6 inside -10 0 0 -1 0 0 107 edge ball"
    ends = {
        line.index(word) + len(word) for line, word in zip(lines, ("distance_mm", "2.5", "nan"), strict=False)
    }
    assert len(ends) == 1


@pytest.mark.parametrize(
    ("options", "first", "second"),
    [
        (("--ray", 0, 0, -1), "0 10 0 0 10 0 0 1 103 ball", "1 inf nan nan nan nan nan nan - -"),
        (("--segment",), "0 10 0 0 20 0 0 10 107 ball", None),
    ],
)
def test_rays_and_segments_make_a_table(run, options, first, second):
    result = run("query", "ball.stl", *[0, 0, 20, 90, 0, 20] * 2, *options)

    lines = result.out.splitlines()
    assert lines[1].split() == first.split()
    assert second is None or lines[2].split() == second.split()


def test_no_points_give_an_empty_answer(run):
    table, document, text = (
        run("query", "ball.stl", "--points", "-", *option, stdin="# none\n")
        for option in ((), ("--json",), ("--csv",))
    )

    assert table.code == document.code == text.code == 0
    assert len(table.out.splitlines()) == len(text.out.splitlines()) == 1
    assert json.loads(document.out)["answers"] == []


def refuse(word):
    raise AssertionError(f"{word} is not JSON")


def test_json_is_one_valid_document_with_every_digit(run):
    result = run("query", "ball.stl", "--points", "-", "--json", stdin="0.1 0.2 0.3\nnan 0 0\n")

    document = json.loads(result.out, parse_constant=refuse)
    first, second = document["answers"]
    direct = FakeScene().closest(np.array([[0.1, 0.2, 0.3]]) * 0.001)
    assert document["file"] == "ball.stl"
    assert document["units"] == "mm"
    assert document["mode"] == "closest"
    assert first["signed_distance"] == pytest.approx(direct.signed_distance[0] / 0.001, rel=1e-14)
    assert first["point"] == in_units(direct.point[0], 0.001).tolist()
    assert first["part"] == 0
    assert first["part_name"] == "ball"
    assert first["face"] == 107
    assert first["face_id"] == 7
    assert first["feature"] == "edge"
    assert "distance" not in first  # it would not be what `Scene.distance` calls so
    assert first["is_signed"] is True
    assert second["query"] == [None, 0.0, 0.0]
    for field in ("signed_distance", "part", "part_name", "face", "face_id", "feature"):
        assert second[field] is None
    assert second["point"] == [None, None, None]


def test_json_of_several_chunks_is_valid(run, monkeypatch):
    monkeypatch.setattr(query, "POINTS_PER_CHUNK", 2)

    result = run("query", "ball.stl", *range(15), "--json")

    assert [answer["query"][0] for answer in json.loads(result.out)["answers"]] == [0, 3, 6, 9, 12]


def test_csv_has_a_header_and_every_digit(run):
    result = run("query", "ball.stl", "--points", "-", "--csv", stdin="0.1 0.2 0.3\nnan 0 0\n")

    first, second = csv.DictReader(io.StringIO(result.out))
    direct = FakeScene().closest(np.array([[0.1, 0.2, 0.3]]) * 0.001)
    assert list(first)[:6] == ["x_mm", "y_mm", "z_mm", "signed_distance_mm", "is_signed", "point_x_mm"]
    assert float(first["signed_distance_mm"]) == pytest.approx(direct.signed_distance[0] / 0.001, rel=1e-14)
    point = [float(first[name]) for name in ("point_x_mm", "point_y_mm", "point_z_mm")]
    assert point == in_units(direct.point[0], 0.001).tolist()
    assert first["part_name"] == "ball"
    assert second["signed_distance_mm"] == "nan"
    assert second["face"] == ""


def test_points_come_from_a_file(run, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("x,y,z\n0,0,12.5\n", encoding="utf-8")

    assert block(run("query", "ball.stl", "--points", path).out)["signed distance"] == "2.5 mm, outside"


def test_bad_first_line_of_a_file_is_one_line_on_stderr(run, loaded, tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("0 0\n0 0 1\n", encoding="utf-8")

    result = run("query", "ball.stl", "--points", path, "--json")

    assert result.code == 2
    assert result.out == ""
    assert result.err == f"proximity: {path}, line 1: 2 values, expected 3\n"
    assert loaded == []


def test_library_error_is_one_line_and_exit_code_2(run, monkeypatch):
    def load(path, units, **options):
        raise MeshFormatError("ball.stl: claims 900 faces,\n  but holds 899")

    load_with(monkeypatch, load)

    for command in (("query", "ball.stl", 1, 2, 3), ("check", "ball.stl")):
        result = run(*command)
        assert result.code == 2
        assert result.out == ""
        assert result.err == "proximity: ball.stl: claims 900 faces, but holds 899\n"


def test_our_own_mistake_keeps_its_traceback(loaded, monkeypatch):
    def load(path, units, **options):
        raise ZeroDivisionError("a mistake")

    load_with(monkeypatch, load)
    monkeypatch.setattr(sys, "argv", ["proximity", "check", "ball.stl"])

    with pytest.raises(ZeroDivisionError, match="a mistake"):
        cli.main()


def test_interrupt_is_quiet_and_exits_with_130(run, monkeypatch):
    def load(path, units, **options):
        raise KeyboardInterrupt

    load_with(monkeypatch, load)

    result = run("query", "ball.stl", 1, 2, 3)

    assert result.code == 130
    assert result.out + result.err == ""


def test_interrupt_while_a_compiled_module_is_imported_is_quiet(run, monkeypatch):
    """Such a module tells it as an error of its own: a traceback of forty lines was shown."""

    def load(path, units, **options):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as interrupt:
            raise ImportError("initialization failed") from interrupt

    load_with(monkeypatch, load)
    result = run("query", "ball.stl", 1, 2, 3)

    assert (result.code, result.out + result.err) == (130, "")


def test_version_is_printed(run):
    assert run("--version").out == f"proximity {proximity.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--help",), "--version"),
        (("query", "--help"), "shuf points.txt | proximity query bracket.stl --points - --workers -1"),
        (("check", "--help"), "With --strict it is 1 if a part has no inside"),
        (("-h",), "Exit codes: 0: done. 1: the command ran, but the result is negative"),
    ],
)
def test_help_has_examples_and_exit_codes(run, arguments, words):
    result = run(*arguments)

    assert result.code == 0
    assert words in result.words


def test_first_compilation_is_announced_on_stderr(run, monkeypatch):
    compiled = []
    monkeypatch.setitem(vars(proximity), "kernels_are_cached", lambda: False)
    monkeypatch.setitem(vars(proximity), "warm_up", lambda: compiled.append("all"))

    result = run("query", "ball.stl", 0, 0, 12.5, "--json")

    assert compiled == ["all"]
    assert result.err == (
        "proximity: compiling the kernels for this processor; this happens once and takes a minute or two\n"
    )
    assert len(json.loads(result.out)["answers"]) == 1


def terminal(monkeypatch, width=200):
    """A terminal that can be read, in place of every console that is made."""
    screen = io.StringIO()

    def console(**options):
        return Console(file=screen, force_terminal=True, width=width, color_system=None)

    monkeypatch.setattr(progress, "_is_terminal", lambda: True)
    monkeypatch.setattr(answer_output.sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("proximity.cli.tables.Console", console)
    return screen


@pytest.mark.parametrize("name", ["ball.stl", "parts[/b].stl"])  # the second: Rich's mark that closes nothing
def test_long_reading_shows_a_spinner_on_a_terminal(name, monkeypatch):
    screen = terminal(monkeypatch)
    monkeypatch.setattr(progress, "ANNOUNCE_AFTER_S", 0.0)

    with progress.spinner(f"reading {name}"):
        for _ in range(100):
            if "reading" in screen.getvalue():
                break
            progress.time.sleep(0.05)

    assert f"reading {name}" in screen.getvalue()


def test_spinner_counts_what_is_done(monkeypatch):
    screen = terminal(monkeypatch)
    monkeypatch.setattr(progress, "ANNOUNCE_AFTER_S", 0.0)

    with progress.spinner("reading gears.step") as count:
        passed = list(progress.counted(["ab", "c"], count))
        ends = progress.time.monotonic() + 60.0
        while "reading gears.step 3" not in screen.getvalue() and progress.time.monotonic() < ends:
            progress.time.sleep(0.05)
        count(7, 12)
        while "7 of 12" not in screen.getvalue() and progress.time.monotonic() < ends:
            progress.time.sleep(0.05)

    assert passed == ["ab", "c"]
    assert "reading gears.step 3" in screen.getvalue() and "reading gears.step 7 of 12" in screen.getvalue()


def test_count_without_a_terminal_shows_nothing(capsys):
    with progress.spinner("reading ball.stl") as count:
        count(1, 2)

    assert capsys.readouterr() == ("", "")


def test_short_reading_shows_nothing(monkeypatch):
    screen = terminal(monkeypatch)

    with progress.spinner("reading ball.stl"):
        pass

    assert screen.getvalue() == ""


def test_many_queries_show_a_bar_on_a_terminal(monkeypatch):
    screen = terminal(monkeypatch)
    monkeypatch.setattr(progress, "ANNOUNCE_AFTER_S", -1.0)

    passed = list(progress.with_bar("abc", {"a": 10, "b": 10, "c": 5}.get, 25, is_shown=True))

    assert passed == ["a", "b", "c"]
    assert "25/25" in screen.getvalue()


def test_check_on_a_narrow_terminal_cuts_no_number(run, monkeypatch):
    # Was: "1…" faces of a part that has thousands.
    screen = terminal(monkeypatch, width=30)

    run("check", "ball.stl")

    assert "\N{HORIZONTAL ELLIPSIS}" not in screen.getvalue()


def test_table_on_a_narrow_terminal_leaves_out_normals_and_cuts_nothing(run, monkeypatch):
    screen = terminal(monkeypatch, width=80)

    result = run("query", "ball.stl", 0, 0, 12.3456789, 0, 0, 1)

    assert "normal_x" not in screen.getvalue()
    assert "2.3456789" in screen.getvalue()
    assert "…" not in screen.getvalue()
    assert result.err == (
        "proximity: note: the terminal is narrow: columns are left out (normal_x, normal_y, normal_z); "
        "--csv, --json or a pipe shows all\n"
    )


@pytest.mark.parametrize(
    ("width", "digits", "note"),
    [
        (110, "-8.26795", "numbers have 6 digits"),
        (62, "-8.26794919", "columns are left out (normal_x, normal_y, normal_z, face, on, part)"),
        (50, "-8.26795", "normal_z, face, on, part) and numbers have 6 digits"),
    ],
)
def test_table_on_a_narrow_terminal_breaks_no_number(run, monkeypatch, width, digits, note):
    """Was: -0.004579 in one line, which looks complete, and 43201 in the next."""
    screen = terminal(monkeypatch, width=width)

    result = run("query", "ball.stl", 1, 1, 1, -1, 1, -1)

    first, second = screen.getvalue().splitlines()[1:]
    assert first.split()[1] == second.split()[1] == digits
    assert note in result.err


def test_long_table_on_a_terminal_stops_and_says_so(run, monkeypatch):
    screen = terminal(monkeypatch)

    result = run("query", "ball.stl", *[0, 0, 1] * 101)

    assert len(screen.getvalue().splitlines()) == 1 + answer_output.TERMINAL_ROWS
    assert result.err == "proximity: these are 100 of 101; --csv, --json or a pipe shows all\n"


def test_check_tells_what_the_file_holds(run):
    result = run("check", "ball.stl")

    lines = block(result.out)
    assert result.code == 0
    assert lines["format"] == "STL binary"
    assert lines["units of file"] == "mm (assumed: the file declares none)"
    assert lines["parts"] == "1"
    assert lines["note"] == "2 names shared"
    assert lines["sign"] == "pseudo-normals: closed and oriented (ball)"
    assert lines["repaired"] == "4 vertices at equal positions merged (ball)"
    assert "ball 20 × 20 × 20 20 1 yes yes 4000 pseudo-normals solid" in " ".join(result.out.split())
    assert "volume [mm³]" in result.out


def test_check_tells_a_part_without_an_inside(run, monkeypatch):
    load_with(monkeypatch, lambda path, units, **options: FakeScene(has_inside=False))

    result = run("check", "ball.stl")

    assert result.code == 0
    assert block(result.out)["no inside"] == "distances are unsigned (ball)"
    assert block(result.out)["not closed"] == "3 edges, the first near 0  0  0 mm (ball)"
    assert "no: NotManifold" in result.out


def test_strict_check_fails_for_a_part_without_an_inside(run, monkeypatch):
    assert run("check", "ball.stl", "--strict").code == 0
    load_with(monkeypatch, lambda path, units, **options: FakeScene(has_inside=False))

    result = run("check", "ball.stl", "--strict", "--json")

    assert result.code == 1
    assert json.loads(result.out)["parts"][0]["has_inside"] is False


def test_check_says_the_same_of_many_parts_once(run, monkeypatch):
    scene = FakeScene()
    ball = scene.parts[0]
    scene.parts = tuple(SimpleNamespace(**{**vars(ball), "name": f"ball_{k}"}) for k in range(5))
    load_with(monkeypatch, lambda path, units, **options: scene)

    lines = block(run("check", "ball.stl").out)

    assert lines["sign"] == "pseudo-normals: closed and oriented (ball_0, ball_1, ball_2 and 2 more)"


def balls(count):
    """A scene of equal balls in a row along x, turned by a quarter about x, 30 mm apart."""
    scene = FakeScene()
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    ball = vars(scene.parts[0])
    poses = [Pose(turn, [0.030 * k, 0.0, 0.0]) for k in range(count)]
    scene.parts = tuple(SimpleNamespace(**{**ball, "name": f"b{k}", "pose": p}) for k, p in enumerate(poses))
    return scene


def test_check_shows_sizes_and_a_total(run, monkeypatch):
    load_with(monkeypatch, lambda path, units, **options: balls(3))

    result = run("check", "ball.stl", "--units", "cm")

    assert block(result.out)["size"] == "8 × 2 × 2 cm"
    lines = [" ".join(line.split()) for line in result.out.splitlines()]
    assert "part size [cm] faces shells watertight oriented volume [cm³] sign manifold3d" in lines
    assert "b1 2 × 2 × 2 20 1 yes yes 4 pseudo-normals solid" in lines
    assert "3 parts 8 × 2 × 2 60 3 3 of 3 3 of 3 12 3 of 3 3 of 3" in lines


def test_check_lists_twenty_parts_and_all_of_them_where_asked(run, monkeypatch):
    load_with(monkeypatch, lambda path, units, **options: balls(23))

    folded, whole = run("check", "ball.stl").out, run("check", "ball.stl", "--all").out

    assert "b19 " in folded and "b20 " not in folded and "b22 " in whole
    assert "These are the first 20 of 23 parts; --all lists all." in folded
    assert "--all" not in whole
    for text in folded, whole:
        assert "23 parts 680 × 20 × 20 460" in " ".join(text.split())
    assert len(json.loads(run("check", "ball.stl", "--json").out)["parts"]) == 23


def test_check_says_where_the_unit_is_from_and_prints_rounding_as_zero(run, monkeypatch):
    scene = FakeScene()
    scene.report.units = "in"
    scene.parts[0].pose = Pose(None, [RADIUS + 1e-17, 0.0, 0.0])
    load_with(monkeypatch, lambda path, units, **options: scene)

    lines = block(run("check", "ball.stl", "--units", "in").out)

    assert lines["units of file"] == "in (as --units says)"
    assert lines["from"].split()[0] == "0"


def test_check_does_not_range_what_all_samples_agree_with(run, monkeypatch):
    scene = balls(2)
    for part, count in zip(scene.parts, (260, 384), strict=True):
        words = f"closed; agrees with the winding number at {count} of {count} sample points"
        part.solid = SimpleNamespace(**{**vars(part.solid), "sign_reason": words})
    load_with(monkeypatch, lambda path, units, **options: scene)

    sign = block(run("check", "ball.stl").out)["sign"]

    assert sign == "pseudo-normals: closed; agrees with the winding number at all sample points (b0, b1)"


def test_check_says_what_differs_in_numbers_only_once(run, monkeypatch):
    scene = balls(3)
    for part, count in zip(scene.parts, (4, 28, 9), strict=True):
        part.repairs = FakeRepairs(count)
        part.repairs.describe = lambda count=count: f"Merged {count} of 30 vertices."
    load_with(monkeypatch, lambda path, units, **options: scene)

    assert block(run("check", "ball.stl").out)["repaired"] == "Merged 4 to 28 of 30 vertices. (b0, b1, b2)"


def test_check_as_json_has_sizes_and_a_total(run, monkeypatch):
    load_with(monkeypatch, lambda path, units, **options: balls(3))

    document = json.loads(run("check", "ball.stl", "--json").out)

    assert document["size"] == [80.0, 20.0, 20.0]
    assert [part["size"] for part in document["parts"]] == [[20.0] * 3] * 3
    assert document["total"] == {
        "part_count": 3, "face_count": 60, "vertex_count": 36, "shell_count": 3, "watertight_count": 3,
        "oriented_count": 3, "inside_count": 3, "solid_count": 3, "volume": 12000.0,
    }  # fmt: skip


@pytest.mark.parametrize(
    ("width", "left_out"),
    [(120, ""), (90, "volume"), (80, "volume, manifold3d"), (66, "volume, manifold3d, shells")],
)
def test_check_says_which_columns_a_narrow_terminal_leaves_out(run, monkeypatch, width, left_out):
    screen = terminal(monkeypatch, width=width)

    run("check", "ball.stl")

    lines = screen.getvalue().splitlines()
    title, row = (line for line in lines if line.startswith(("part ", "ball ")))
    assert "watertight" in title and "oriented" in title
    assert "20 × 20 × 20" in row and "pseudo-normals" in row
    sentence = f"The terminal is too narrow for: {left_out}. A wider one, a pipe or --json shows them."
    assert (sentence in " ".join(" ".join(lines).split())) == bool(left_out)


def test_check_as_json_has_every_figure(run, monkeypatch):
    document = json.loads(run("check", "ball.stl", "--json", "--units", "cm").out, parse_constant=refuse)

    (part,) = document["parts"]
    assert document["file_units"] == "mm"
    assert document["file_units_declared"] is False
    assert document["notes"] == ["2 names shared"]
    assert part["volume"] == pytest.approx(4.0, rel=1e-14)
    assert part["upper"] == [1.0, 1.0, 1.0]
    assert part["repairs"]["merged_vertex_count"] == 4
    assert (part["open_edge_count"], part["open_edge"]) == (0, None)
    assert part["manifold"] == {"is_solid": True, "status": "NoError"}
    load_with(monkeypatch, lambda path, units, **options: FakeScene(has_inside=False))
    (part,) = json.loads(run("check", "ball.stl", "--json").out)["parts"]
    assert (part["volume"], part["open_edge_count"], part["open_edge"]) == (None, 3, [0.0, 0.0, 0.0])
