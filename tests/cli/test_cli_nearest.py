"""``proximity query --nearest`` and ``--cad``, on an assembly of four parts."""

import csv
import io
import json

import pytest
from project import MESHES

COMMAND = ("query",)
ASSEMBLY = MESHES / "assembly.glb"


def test_transcript(transcript, monkeypatch):
    monkeypatch.chdir(MESHES)
    transcript(
        "nearest",
        """
        assembly.glb 10 10 30 --nearest 3
        assembly.glb 10 10 30 --nearest 1
        assembly.glb 10 10 30 40 0 3 --nearest 2 --csv -
        assembly.glb 10 10 30 --nearest 2 --json
        assembly.glb --points - --nearest 9 < name,x,y,z,rank;A,1,2,3,7;B,nan,0,0,8
        assembly.glb 10 10 30 --nearest 2 --ray 0 0 1
        assembly.glb 10 10 30 --nearest 2 --within 1
        assembly.glb 10 10 30 --nearest 0
        """,
    )


def test_points_in_several_chunks_keep_their_numbers_and_columns(run, monkeypatch):
    monkeypatch.setattr("proximity.cli.parts.query.POINTS_PER_CHUNK", 2)
    points = "name,x,y,z,rank\n" + "".join(f"{name},{k},{k},40,{k}\n" for k, name in enumerate("ABCDE"))

    result = run(ASSEMBLY, "--points", "-", "--nearest", 2, "--csv", "-", stdin=points)

    rows = list(csv.DictReader(io.StringIO(result.out)))
    assert [row["name"] for row in rows] == list("AABBCCDDEE")
    assert [row["point_number"] for row in rows] == list("0011223344")
    assert [row["rank"] for row in rows] == list("1212121212")
    assert [row["given_rank"] for row in rows] == list("0011223344")
    assert [float(row["x_mm"]) for row in rows] == pytest.approx([0, 0, 1, 1, 2, 2, 3, 3, 4, 4])


def test_bounds_of_cad_surfaces_contain_the_distance(run):
    pytest.importorskip("cascadio")
    step = str(MESHES / "assembly.step")
    answer = json.loads(run(step, 10, 10, 30, "--cad", "--json").out)["answers"][0]
    names = list(answer)

    assert answer["lower"] < answer["signed_distance"] < answer["upper"]
    assert answer["upper"] - answer["lower"] < 0.1
    assert names[names.index("signed_distance") :][1:3] == ["lower", "upper"]
    assert "CAD surface, from" in run(step, 10, 10, 30, "--cad").out
    assert run(ASSEMBLY, 1, 2, 3, "--cad", "--nearest", 2).code == 2
    assert run(ASSEMBLY, 1, 2, 3, "--cad", "--within", 2).code == 2
