"""``proximity query --ray --all`` and ``--min-distance``, on a box with a cavity."""

import csv
import io
import json

from project import MESHES

COMMAND = ("query",)
HOLLOW = MESHES / "hollow_box.stl"


def test_transcript(transcript, monkeypatch):
    monkeypatch.chdir(MESHES)
    transcript(
        "crossings",
        """
        hollow_box.stl 10 10 50 --ray 0 0 -1 --all
        hollow_box.stl 10 10 50 90 0 0 --ray 0 0 -1 --all --json
        hollow_box.stl 10 10 50 --ray 0 0 -1 --min-distance 45
        hollow_box.stl 10 10 50 --ray 0 0 1 --all
        hollow_box.stl --points - --ray 0 0 -1 --all < name,x,y,z,ray;A,90,0,0,7;B,10,10,50,8
        """,
    )


def test_rays_without_crossings_have_no_row_and_the_others_keep_their_columns(run):
    points = "name,x,y,z,ray\nA,90,0,0,7\nB,10,10,50,8\nC,nan,0,0,9\n"

    result = run(HOLLOW, "--points", "-", "--ray", "0", "0", "-1", "--all", "--csv", "-", stdin=points)

    rows = list(csv.DictReader(io.StringIO(result.out)))
    assert {(row["name"], row["ray"], row["given_ray"]) for row in rows} == {("B", "1", "8")}
    assert [row["crossing"] for row in rows] == ["enters", "leaves"] * (len(rows) // 2)


def test_min_distance_is_in_the_unit_of_the_points(run):
    asked = HOLLOW, 10, 10, 50, "--ray", 0, 0, -1, "--units", "cm", "--json"

    every, rest = (
        json.loads(run(*asked, *options).out)["answers"]
        for options in (["--all"], ["--all", "--min-distance", "40"])
    )

    assert rest == [each for each in every if each["distance"] >= 40.0]
    assert 0 < len(rest) < len(every)
