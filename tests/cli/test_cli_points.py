"""Parsing of points and formatting of lengths."""

import io
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from proximity.cli.output import in_unit, in_units
from proximity.cli.parts.points import parse_points, read_points
from proximity.errors import ArgumentError


def points_of(text, units="mm"):
    chunks = parse_points(text.splitlines(keepends=True), "points.csv", units)
    return [value for chunk in chunks for value in chunk.coordinates]


def read(path):
    return [value for chunk in read_points(path) for value in chunk.coordinates]


@pytest.mark.parametrize(
    "text",
    [
        "1 2 -3e1\n",
        "1, 2, -30.0\n",
        "1\t2\t-30\n",
        "  1   2  -30  \r\n",
        "# a comment\n\n1 2 -30 # another\n",
        "east,north,up\n1,2,-30\n",
        "\ufeffx;y;z\n1;2;-30\n",
        '"x","y","z"\n"1","2","-30"\n',
        '"x","y","z","part"\n1,2,-30,"lid, upper"\n',
        "Z [mm],Y [mm],X [mm]\n-30,2,1\n",
        "x,y,z,x_in\n1,2,-30,0\n",
        "x,y,z,remark\n1,2,-30,\n",
        "x,y,z,part\n1,2,-30,lid#2 # a comment\n",
    ],
)
def test_text_is_read_as_people_write_it(text):
    assert points_of(text) == [1.0, 2.0, -30.0]


@pytest.mark.parametrize("header", ["x_in,y_in,z_in", "x (in),y (in),z (in)", "%,°,µ", "x in Inch,y,z"])
def test_columns_may_be_in_the_unit_that_was_said(header):
    assert points_of(f"{header}\n1,2,3", "in") == [1.0, 2.0, 3.0]


@pytest.mark.parametrize("text", ["", "\n\n", "# nothing\n", "x,y,z\n", "x,y,z\n1,2,3\n", "1 2 3\n"])
def test_text_without_points_is_no_error_and_is_noted(text):
    said = []
    (chunk,) = parse_points(text.splitlines(), "points.csv", note=said.append)
    assert list(chunk.coordinates) == ([1.0, 2.0, 3.0] if "3" in text else []) and chunk.kept == {}
    assert said == ([] if "3" in text else ["points.csv contains no points"])


def test_points_come_in_chunks_and_the_last_is_shorter():
    chunks = list(parse_points([f"{k} 0 0\n" for k in range(7)], "points.csv", limit=3))
    assert [list(chunk.coordinates[::3]) for chunk in chunks] == [[0.0, 1.0, 2.0], [3.0, 4.0, 5.0], [6.0]]


def test_points_before_a_bad_line_come_before_the_error():
    chunks = parse_points(["1 2 3\n"] * 4 + ["4 5\n"], "points.csv", limit=3)
    assert [len(next(chunks)), len(next(chunks))] == [3, 1]
    with pytest.raises(ArgumentError, match=r"^points\.csv, line 5: 2 values, expected 3$"):
        next(chunks)


def test_other_columns_of_points_are_kept():
    text = 'z,Name,y,Id,x\n3,"a, b #1",2,7,1\n6,,5,8,4\n9,c#2,8,9,7\n'

    first, second = parse_points(text.splitlines(), "points.csv", limit=2)

    assert first.kept == {"name": ["a, b #1", ""], "Id": ["7", "8"]}
    assert second.kept == {"name": ["c#2"], "Id": ["9"]}
    assert list(second.coordinates) == [7.0, 8.0, 9.0]


def test_text_without_an_end_of_line_is_refused_and_not_kept(monkeypatch):
    class Endless(io.StringIO):
        def readline(self, size=-1):
            assert size > 0, "a line of any length is read"
            return "1" * size

    monkeypatch.setattr(sys, "stdin", Endless())
    with pytest.raises(ArgumentError, match=r"^standard input, line 1: has 1000000 characters or more"):
        list(read_points("-"))


def test_points_that_are_not_finite_are_read():
    first, second, third = points_of("nan -inf Infinity\n")
    assert first != first
    assert (second, third) == (float("-inf"), float("inf"))


@given(st.lists(st.tuples(*[st.floats(allow_nan=False)] * 3)))
def test_numbers_come_back_exactly(rows):
    text = "".join(f"{x!r},{y!r},{z!r}\n" for x, y, z in rows)
    assert points_of(text) == [value for row in rows for value in row]


# A file, with "\n" and "\t" for line ends and tabs, and the error after its name.
BAD_LINES = r"""
1 2 3\n1 2\n | line 2: 2 values, expected 3
1,2,3,A\n | line 1: 4 values, expected 3; a first line such as x,y,z,name allows names
1,5;2,5;3,5\n | line 1: '1,5' has a decimal comma, expected a decimal point: 1.5
name;x;y;z\nA;1,5;2;3\n | line 2: '1,5' has a decimal comma, expected a decimal point: 1.5
1,5\t2\t3\n | line 1: '1,5' has a decimal comma, expected a decimal point: 1.5
x,y,z\n1,2,1e400\n | line 2: '1e400' is beyond 1.8e+308, the largest number
1 2 3#4\n | line 1: '3#4' is not a number
x y z\na b c\n | line 2: 'a' is not a number
a,x,y,z\n1,2,3\n | line 2: 3 values, expected 4
a,x,y,z\n1,2,3,\n | line 2: '' is not a number
1.0f 2.0f 3.0f\n | line 1: '1.0f' is not a number
solid box\n | line 1: 'solid box' {NEITHER}
id,x,y\n7,1,2\n | line 1: 'id x y' {NEITHER}
x,x,y,z\n1,2,3,4\n | line 1: 'x x y z' {NEITHER}
time_s,hand,finger,x_m,y_m,z_m\n0,0,1,0.1,0.2,0.3\n | line 1: column 'x_m' is in m, {UNITS} m
x [inch],y [inch],z [inch]\n1,2,3\n | line 1: column 'x [inch]' is in inches, {UNITS} in
x [µm],y,z\n1,2,3\n | line 1: column 'x [µm]' is in um, {UNITS} um
x (m) raw,y,z\n1,2,3\n | line 1: column 'x (m) raw' is in m, {UNITS} m
1 2 {NINES}z\n | line 1: '{SHORT_NINES}...' is not a number
1 2 3\n{NO_TEXT} 1 2\n | line 2: not text in UTF-8, expected a text file with three numbers on each line
{LONG}\n | line 1: has 1000000 characters or more, expected three numbers
1,2,3\n"{LARGE}",1,2\n | line 2: field larger than field limit (131072), expected three numbers
"""
NAMED = {
    "NEITHER": "is neither a point nor a header, expected three numbers or columns named x, y and z",
    "UNITS": "expected mm; add --points-units", "NINES": "9" * 50, "SHORT_NINES": "9" * 37,
    "NO_TEXT": "\udcff", "LONG": "1" * 1_000_001, "LARGE": "0" * 200_000,
}  # fmt: skip


@pytest.mark.parametrize("line", BAD_LINES.strip().splitlines())
def test_line_that_is_no_point_is_named(line):
    """Regressions: headers without z or with two x, infinity, metres and inches read as mm."""
    text, _, message = line.partition(" | ")
    with pytest.raises(ArgumentError) as refusal:
        points_of(text.replace("\\n", "\n").replace("\\t", "\t").format(**NAMED))
    assert str(refusal.value) == f"points.csv, {message.format(**NAMED)}"


def test_standard_input_that_is_closed_is_named(monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)  # as in Python after <&-
    with pytest.raises(ArgumentError, match=r"^standard input is closed, expected lines of three numbers$"):
        list(read_points("-"))


def test_file_is_read(tmp_path):
    path = tmp_path / "points.txt"
    path.write_text("1 2 3\n4 5 6\n", encoding="utf-8")
    assert read(str(path)) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]


def test_file_that_is_missing_is_refused(tmp_path):
    with pytest.raises(ArgumentError, match=r"absent\.csv: cannot be read \(No such file or directory\)$"):
        read(str(tmp_path / "absent.csv"))


def test_file_in_another_encoding_is_refused(tmp_path):
    path = tmp_path / "points.csv"
    path.write_bytes("größe,1,2\n".encode("utf-16"))
    with pytest.raises(ArgumentError, match=r"points\.csv, line 1: not text in UTF-8, expected a text file "):
        read(str(path))


def test_three_millimetres_are_three():
    # Regression: 3.000000000000001.
    assert in_unit(0.0030000000000000005, 0.001) == 3.0
    assert in_units(np.array([[-0.0130000000000000012, 0.0, -0.0]]), 0.001).tolist() == [[-13.0, 0.0, 0.0]]


def test_distance_ends_where_its_coordinates_end():
    x = np.array([-13.0, -11.0, -10.7, 10.1, 10.0001, 12.34, 10.0, np.nan, np.inf])
    nothing = np.zeros(len(x))
    points = np.column_stack((x * 0.001, nothing, nothing))
    surface = np.column_stack((np.sign(x) * 0.01, nothing, nothing))
    distances = np.abs(points[:, 0]) - np.abs(surface[:, 0])
    distances[-1] = np.inf

    result = in_units(distances, 0.001, points, surface)

    np.testing.assert_array_equal(result, [3.0, 1.0, 0.7, 0.1, 0.0001, 2.34, 0.0, np.nan, np.inf])


def test_distance_of_small_parts_keeps_its_digits():
    points = np.array([[1.23e-9, 0.0, 0.0]])
    assert in_units(np.array([1.2e-10]), 1.0, points, np.zeros((1, 3))).tolist() == [1.2e-10]


def test_zero_has_no_sign():
    assert [str(value) for value in in_units(np.array([-0.0, 0.0]), 1.0).tolist()] == ["0.0", "0.0"]


def test_length_beyond_the_range_of_the_unit_is_infinite():
    assert in_unit(1e308, 0.001) == np.inf


@given(st.floats(allow_nan=False, allow_infinity=False, max_value=1e308, min_value=-1e308))
def test_rounded_number_is_near_and_short(value):
    (result,) = in_units(np.array([value]), 1.0).tolist()
    assert float(f"{result:.15g}") == result
    assert result == pytest.approx(value, rel=5.1e-15, abs=1e-323)


@pytest.mark.parametrize("faces", ["", "element face 1\nproperty list uchar int vertex_indices\n"])
def test_vertices_of_a_ply_file_are_points(tmp_path, faces):
    rows = "1 0 2 3 7\n4 0 5 6 7\n7 0 8 9 7\n" + ("3 0 1 2\n" if faces else "")
    properties = "".join(f"property float {name}\n" for name in ("x", "red", "y", "z", "quality"))
    path = tmp_path / "scan.PLY"
    path.write_text(f"ply\nformat ascii 1.0\nelement vertex 3\n{properties}{faces}end_header\n{rows}")

    chunks = list(read_points(str(path), limit=2))

    assert [list(chunk.coordinates) for chunk in chunks] == [[1, 2, 3, 4, 5, 6], [7, 8, 9]]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("ply\nformat ascii 1.0\nend_header\n", "its header declares no vertices"),
        ("1 2 3\n", "not a PLY file"),
    ],
)
def test_ply_without_points_is_refused(tmp_path, text, why):
    path = tmp_path / "scan.ply"
    path.write_text(text)
    with pytest.raises(ArgumentError, match=rf"scan\.ply: .*{why}"):
        list(read_points(str(path)))
