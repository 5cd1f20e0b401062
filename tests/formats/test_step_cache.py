"""A single process converts STEP files, on demand, and its results are cached."""

import subprocess

import numpy as np
import pytest
import step_text
from mesh_reading import write

from proximity import formats
from proximity.errors import MeshFormatError
from proximity.formats import libraries
from proximity.formats.step import conversion
from proximity.system.file_cache import FOLDER_VARIABLE

BALL = step_text.ball_step(5.0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty cache."""
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache" / "step"


@pytest.fixture
def started(monkeypatch):
    """The started processes."""
    processes = []

    class Counted(subprocess.Popen):
        def __init__(self, *arguments, **options):
            super().__init__(*arguments, **options)
            processes.append(self)

    monkeypatch.setattr(libraries.subprocess, "Popen", Counted)
    return processes


def same(one, other):
    assert one.notes == other.notes and one.units == other.units
    for first, second in zip(one.geometries, other.geometries, strict=True):
        assert first.name == second.name
        for name in ("vertices", "faces", "source_faces"):
            assert np.array_equal(getattr(first, name), getattr(second, name))


def test_one_process_converts_as_often_as_needed(tmp_path, folder, started, monkeypatch):
    # Regression: three processes, each of which imported OpenCASCADE.
    monkeypatch.setattr(conversion, "MAX_FACE_TRIANGLES", 15_000)
    runs = []
    run = libraries.Library.run
    monkeypatch.setattr(
        libraries.Library, "run", lambda *given, **more: runs.append(1) or run(*given, **more)
    )
    contents = formats.read_geometries(write(tmp_path, "part.step", step_text.ball_step(1000.0)))
    assert len(runs) > 1 and len(started) == 1
    assert "not 0.01 mm" in contents.notes[0] and started[0].returncode is not None
    same(contents, formats.read_geometries(tmp_path / "part.step"))
    assert len(started) == 1


def test_one_process_converts_several_files_and_starts_again_after_a_crash(tmp_path, folder, started):
    with conversion.converter():
        for number in (1, 2, 3):
            formats.read_geometries(write(tmp_path, f"{number}.step", step_text.box_step((1, 2, number))))
        assert len(started) == 1
        started[0].kill()
        with pytest.raises(MeshFormatError, match="OpenCASCADE crashed on it"):
            formats.read_geometries(write(tmp_path, "4.step", step_text.box_step((1, 2, 4))))
        formats.read_geometries(write(tmp_path, "5.step", step_text.box_step((1, 2, 5))))
    assert len(started) == 2 and all(process.returncode is not None for process in started)


def test_second_time_nothing_is_converted(tmp_path, folder, started):
    path = write(tmp_path, "part.step", BALL)
    first = formats.read_geometries(path)
    same(first, formats.read_geometries(path))
    moved = formats.read_geometries(write(tmp_path, "again.step", BALL))
    assert len(started) == 1 and len(moved.geometries[0].faces) == len(first.geometries[0].faces)
    coarser = formats.read_geometries(path, step_tolerance=1e-4)
    assert len(started) == 2 and len(coarser.geometries[0].faces) < len(first.geometries[0].faces)


def test_cache_is_left_alone_where_the_caller_says_so(tmp_path, folder, started):
    path = write(tmp_path, "part.step", BALL)
    first = formats.read_geometries(path, cache=False)
    assert not folder.exists()
    same(first, formats.read_geometries(path))
    same(first, formats.read_geometries(path, cache=False))
    assert len(started) == 3


def test_damaged_entry_is_made_again(tmp_path, folder, started):
    path = write(tmp_path, "part.step", BALL)
    first = formats.read_geometries(path)
    for entry in folder.iterdir():
        entry.write_bytes(entry.read_bytes()[:50])
    same(first, formats.read_geometries(path))
    same(first, formats.read_geometries(path))
    assert len(started) == 2
