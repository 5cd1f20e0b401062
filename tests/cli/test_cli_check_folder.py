"""``proximity check FOLDER``: loaded, noted and refused files; a refused file does not end the run."""

import json
import os
import shutil
import sys
import time

import pytest
from project import MESHES

COMMAND = ("check",)


@pytest.fixture
def catalogue(tmp_path, monkeypatch):
    """A folder with two boxes, a file with a note, two refused for one reason, and one of another format."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "parts"
    (folder / "deep" / "er").mkdir(parents=True)
    (tmp_path / "empty").mkdir()
    shutil.copy(MESHES / "box.stl", folder / "b.stl")
    shutil.copy(MESHES / "box.stl", folder / "deep" / "er" / "A.STL")
    (folder / "noted.stl").write_bytes((MESHES / "box.stl").read_bytes() + b"12345")
    for name, count in (("short.stl", 3), ("deep/shorter.stl", 7)):
        (folder / name).write_bytes((MESHES / "box.stl").read_bytes()[:-count])
    (folder / "readme.txt").write_text("no parts")
    return folder


def test_a_folder_is_counted_by_kind_and_the_refused_are_named(transcript, catalogue):
    transcript("check_folder", "parts")


def test_a_folder_without_parts_is_refused(run, catalogue):
    refused = run("empty")
    assert refused.code == 2 and "empty contains no file of parts" in refused.words


def test_all_loaded_is_code_0_and_json_has_every_report(run, catalogue):
    for name in ("short.stl", "deep/shorter.stl"):
        (catalogue / name).unlink()
    result = run(catalogue, "--json")
    document = json.loads(result.out)

    assert result.code == 0
    assert [each["status"] for each in document["files"]] == ["loaded", "loaded", "noted"]
    assert document["files"][0]["report"]["total"]["face_count"] == 12
    assert document["counts"]["refused"] == {}


def test_one_file_that_takes_for_ever_does_not_stop_the_others(run, tmp_path, monkeypatch):
    reader, ended = tmp_path / "reader", tmp_path / "ended"
    sleeps = f"(sleep 4; touch {ended}) & wait"  # in a separate process, as readers of STEP
    answers = """echo '{"notes": [], "parts": []}'"""
    reader.write_text(f"#!/bin/sh\ncase $* in *slow*) {sleeps};; *) {answers};; esac\n")
    reader.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(reader))
    for name in ("a.stl", "slow.obj", "z.stl"):
        (tmp_path / name).touch()
    os.mkfifo(tmp_path / "pipe.stl")  # not a regular file: left out

    result = run(tmp_path, "--limit", 2)

    assert result.code == 1
    assert f"{tmp_path / 'slow.obj'}: it was not read within 2 s" in result.out
    assert "3 files, 1 refused" in result.out
    time.sleep(3)
    assert not ended.exists()
