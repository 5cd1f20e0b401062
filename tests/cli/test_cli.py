"""Output and exit codes of the commands, on an analytic sphere instead of a file.

The sphere has radius 10 mm and its centre at the origin; `proximity.load` is replaced to avoid compiling.
"""

import io
import json
import re
import sys

import numpy as np
import pytest
from fake_scene import FakeScene
from rich.console import Console

import proximity
from proximity import cli
from proximity.cli import progress
from proximity.cli.parts import answer_text, query
from proximity.errors import MeshFormatError


@pytest.fixture
def loaded(monkeypatch):
    """Replace the functions that read files and compile."""
    replaced = {"load": lambda path, **options: FakeScene(), "kernels_are_cached": lambda: True}
    for name, value in replaced.items():
        monkeypatch.setitem(vars(proximity), name, value)


@pytest.fixture
def run(loaded, run):
    """Run the command line on the sphere, with an empty standard input by default."""
    return lambda *arguments, stdin="": run(*arguments, stdin=stdin)


@pytest.mark.parametrize(("option", "hint"), [("--format", False), ("--unit", True)])
def test_unknown_option_has_a_hint_only_if_one_is_alike(run, option, hint):
    result = run("query", "ball.stl", 1, 2, 3, option)
    assert ("ossible option" in result.words or "Did you mean" in result.words) == hint


def test_json_of_several_chunks_is_valid(run, monkeypatch):
    monkeypatch.setattr(query, "POINTS_PER_CHUNK", 2)
    result = run("query", "ball.stl", *range(15), "--json")
    assert [answer["query"][0] for answer in json.loads(result.out)["answers"]] == [0, 3, 6, 9, 12]


def test_scan_is_summed_up_and_passes_or_fails(run, tmp_path):
    path, scan = tmp_path / "scan.csv", ("query", "ball.stl", "--points")
    path.write_text("".join(f"{10 + k / 2} 0 0\n" for k in range(-1, 3)) + "nan 0 0\n", encoding="utf-8")
    document = json.loads(run(*scan, path, "--json").out)
    summary, expected = document["summary"], [row["signed_distance"] for row in document["answers"][:4]]

    assert (summary["count"], summary["not_answered"]) == (5, 1)
    assert [summary[key] for key in ("min", "max", "mean", "rms", "within_95_percent")] == pytest.approx(
        [
            min(expected),
            max(expected),
            np.mean(expected),
            np.sqrt(np.mean(np.square(expected))),
            np.max(np.abs(expected)),
        ],
        abs=1e-12,
    )
    table = run(*scan, path).out.splitlines()
    assert len(table) == 8 and table[-2].startswith("5 points, 1 not answered: ")
    assert table[-1] == "The worst is #3 at 11  0  0: 1 mm from ball."
    csv = run(*scan, path, "--csv", tmp_path / "answers.csv", "--within", 1)
    assert csv.code == 1  # nan is not near
    assert csv.out.splitlines()[0].endswith("; 80.0 % within ±1 mm, 1 farther.")
    path.write_text("9.5 0 0\n10.5 0 0\n", encoding="utf-8")
    assert run(*scan, path, "--within", 1).code == 0
    assert run(*scan, path, "--within", 1e-6).code == 1
    assert run("query", "ball.stl", 8, 0, 0, "--within", 1).code == 1
    assert run("query", "ball.stl", 9, 0, 0, "--within", 1, "--ray", 1, 0, 0).code == 2


def raised(error, cause=None):
    def load(path, units, **options):
        raise error from cause

    return load


@pytest.mark.parametrize(
    ("load", "code", "err"),
    [
        (raised(MeshFormatError("ball.stl: claims 900 faces,\n  but holds 899")), 2,
         "proximity: ball.stl: claims 900 faces, but holds 899\n"),
        (raised(KeyboardInterrupt()), 130, ""),
        # An imported compiled module turns it into its own error; that printed a traceback of 40 lines.
        (raised(ImportError("initialization failed"), KeyboardInterrupt()), 130, ""),
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", [("query", "ball.stl", 1, 2, 3), ("check", "ball.stl")])
def test_error_is_one_line_and_an_interrupt_none(run, monkeypatch, load, code, err, command):
    monkeypatch.setitem(vars(proximity), "load", load)
    result = run(*command)
    assert (result.code, result.out, result.err) == (code, "", err)


def test_our_own_mistake_keeps_its_traceback(loaded, monkeypatch):
    monkeypatch.setitem(vars(proximity), "load", raised(ZeroDivisionError("a mistake")))
    monkeypatch.setattr(sys, "argv", ["proximity", "check", "ball.stl"])
    with pytest.raises(ZeroDivisionError, match="a mistake"):
        cli.main()


def test_version_is_printed(run):
    assert run("--version").out == f"proximity {proximity.__version__}\n"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--help",), "--version"),
        (("query", "--help"), "shuf points.txt | proximity query bracket.stl --points - --workers -1"),
        (("check", "--help"), "With --strict it is 1 if a part has no inside"),
        (("-h",), "proximity COMMAND --help"),
    ],
)
def test_help_has_examples(run, arguments, words):
    result = run(*arguments)
    assert result.code == 0
    assert words in result.words


def test_help_fits_one_screen_and_names_every_command(run):
    lines = run("--help").out.splitlines()

    assert len(lines) <= 32 and max(map(len, lines)) <= 80
    names = [line[10:].split()[0] for line in lines if line[10:11].isalpha() and line[9:10] == " "]
    assert set(cli.COMMANDS) <= set(names)


def test_types_of_flags_and_arguments_are_not_shown(run):
    words = run("query", "--help").words
    assert (
        not {"<bool>", "<path>", "--install-completion"} & set(words.split())
        and "--step-tolerance MM" in words
    )


@pytest.mark.parametrize("word", [*cli.MEANT, "qurey"])
def test_unknown_command_names_the_right_one(run, word):
    result = run(word)

    expected = cli.MEANT.get(word, "query")
    assert (result.code, f"Did you mean '{expected}'?" in result.words) == (2, True)
    assert expected.split()[0] in cli.COMMANDS and word not in cli.COMMANDS


def test_slow_reading_names_the_command_that_avoids_it(run, monkeypatch):
    monkeypatch.setattr("proximity.cli.options.SLOW_S", -1.0)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)

    result = run("query", "ball.stl", 1, 2, 3)

    assert re.match(
        r"proximity: note: reading took \d+\.\d s; a file of `proximity compile ball\.stl`", result.err
    )


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
    """Return a stream that all consoles write to, as a terminal."""
    screen = io.StringIO()

    def console(**options):
        return Console(file=screen, force_terminal=True, width=width, color_system=None)

    monkeypatch.setattr(progress, "is_terminal", lambda: True)
    monkeypatch.setattr(answer_text.sys.stdout, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("proximity.cli.tables.Console", console)
    return screen


def seen(screen, *words):
    """Test whether a terminal shows the words within a minute."""
    ends = progress.time.monotonic() + 60.0
    while not all(each in screen.getvalue() for each in words) and progress.time.monotonic() < ends:
        progress.time.sleep(0.05)
    return all(each in screen.getvalue() for each in words)


@pytest.mark.parametrize("name", ["gears.step", "parts[/b].stl"])  # the second: a closing tag in Rich
def test_long_reading_shows_a_spinner_that_counts_on_a_terminal(name, monkeypatch):
    screen = terminal(monkeypatch)
    monkeypatch.setattr(progress, "ANNOUNCE_AFTER_S", 0.0)
    with progress.spinner(f"reading {name}") as count:
        assert seen(screen, f"reading {name}")
        assert list(progress.counted(["ab", "c"], count)) == ["ab", "c"]
        assert seen(screen, f"reading {name} 3")
        count(7, 12)
        assert seen(screen, f"reading {name} 7 of 12")


def test_count_without_a_terminal_shows_nothing(capsys):
    with progress.spinner("reading ball.stl") as count:
        count(1, 2)
    assert capsys.readouterr() == ("", "")


def test_short_reading_shows_nothing_and_long_measuring_a_bar(monkeypatch):
    screen = terminal(monkeypatch)
    with progress.spinner("reading ball.stl"):
        pass
    assert screen.getvalue() == ""
    monkeypatch.setattr(progress, "ANNOUNCE_AFTER_S", -1.0)
    with progress.bar("measuring [ticks]") as show:
        show(10, 25, "10 of 25")
    assert "measuring [ticks]" in screen.getvalue() and "10 of 25" in screen.getvalue()


def test_check_on_a_narrow_terminal_cuts_no_number(run, monkeypatch):
    # Regression: printed "1…" faces of a part with thousands.
    screen = terminal(monkeypatch, width=30)
    run("check", "ball.stl")
    assert "\N{HORIZONTAL ELLIPSIS}" not in screen.getvalue()


@pytest.mark.parametrize(
    ("width", "title", "left_out"),
    [
        (100, "# x_mm y_mm z_mm distance_mm side point_x point_y point_z part", ""),
        (83, "# x_mm y_mm z_mm distance_mm side point_x point_y point_z", "part"),
        (56, "# x_mm y_mm z_mm distance_mm side", "point_x, point_y, point_z, part"),
        (42, "# x_mm y_mm z_mm distance_mm", "side, point_x, point_y, point_z, part"),
    ],
)
def test_table_on_a_narrow_terminal_leaves_out_columns_and_cuts_no_number(
    run, monkeypatch, width, title, left_out
):
    """Regression: -0.004579 in one line, which looks complete, and 43201 in the next."""
    screen = terminal(monkeypatch, width=width)

    result = run("query", "ball.stl", 1, 1, 1, -1, 1, -1234)

    lines = screen.getvalue().splitlines()
    assert lines[0].split() == title.split()
    assert all(len(line.rstrip()) <= width for line in lines)
    assert lines[1].split()[4] == "-8.2679"
    assert (f"columns are left out ({left_out}); --csv FILE" in result.err) == bool(left_out)


def test_pipe_gets_all_columns_of_a_part_with_long_coordinates(run, monkeypatch):
    """Regression: a pipe lacked closest points and part, though the note said that a pipe shows all."""
    corners = np.full(3, 1e5), np.full(3, 1e5 + 1.0)  # m
    monkeypatch.setattr(FakeScene, "bounds", corners)

    result = run("query", "ball.stl", 1, 1, 1, 2, 2, 2)

    title = result.out.splitlines()[0]
    assert title.split()[-4:] == ["point_x", "point_y", "point_z", "part"] and len(title) > 100
    assert "narrow" not in result.err


def test_long_table_on_a_terminal_stops_and_says_so(run, monkeypatch):
    screen = terminal(monkeypatch, width=200)

    result = run("query", "ball.stl", *[0, 0, 1] * 101)

    assert len(screen.getvalue().splitlines()) == 1 + answer_text.TERMINAL_ROWS
    assert result.err == "proximity: these are 100 of 101; --csv FILE or a pipe shows all\n"


@pytest.mark.parametrize(
    ("width", "left_out"),
    [
        (120, ""),
        (90, "volume [mm³]"),
        (80, "volume [mm³], manifold3d"),
        (66, "shells, volume [mm³], manifold3d"),
    ],
)
def test_check_says_which_columns_a_narrow_terminal_leaves_out(run, monkeypatch, width, left_out):
    screen = terminal(monkeypatch, width=width)

    result = run("check", "ball.stl")

    title, row = (line for line in screen.getvalue().splitlines() if line.startswith(("part ", "ball ")))
    assert "watertight" in title and "oriented" in title
    assert "20 × 20 × 20" in row and "pseudo-normals" in row
    note = f"columns are left out ({left_out}); a wider one, a pipe or --json shows all"
    assert (note in result.err) == bool(left_out)
