"""Kernels from objects, numba, or plain Python: always the same answers."""

import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import proximity
from proximity import native

ROOT = Path(proximity.__file__).parent.parent
ANSWER = """
import numpy as np, proximity
from proximity.native import MODE
scene = proximity.load({mesh!r})
rng = np.random.default_rng(7)
points = rng.uniform(-0.02, 0.08, (40, 3))
hit, ray = scene.closest(points), scene.cast(points, -points)
parts = [hit.signed_distance, hit.gradient, hit.barycentric, ray.distance, scene.contains(points)]
parts.append(scene.closest_to_segments(points, points[::-1].copy()).distance)
import hashlib
print(MODE, hashlib.sha256(b"".join(np.ascontiguousarray(part).tobytes() for part in parts)).hexdigest())
"""
HIDE_NUMBA = """
import importlib.abc, sys
class Hide(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ("numba", "llvmlite"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Hide())
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name == "numba" else found(name, *rest)
"""
ahead = pytest.mark.skipif(not native.IS_AHEAD, reason="no kernels compiled ahead of time are in use")


def run(program: str, root: Path = ROOT, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a program with that checkout's package and these variables."""
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PROXIMITY_ISA", "NUMBA_DISABLE_JIT")
    }
    return subprocess.run(
        [sys.executable, "-c", program],
        cwd=root,  # precedes the variable
        env=kept | {"PYTHONPATH": str(root)} | environment,
        capture_output=True,
        text=True,
        timeout=900,
        check=False,
    )


def answer(**environment: str) -> list[str]:
    """Return the mode and the digest of some answers."""
    done = run(ANSWER.format(mesh=str(ROOT / "meshes" / "bracket.stl")), **environment)
    assert done.returncode == 0, done.stderr
    return done.stdout.split()


@ahead
def test_every_set_of_instructions_gives_the_same_bits():
    from proximity.native import _kernels

    mode, expected = answer()
    assert mode == _kernels.usable_instructions()[-1]
    for instructions in _kernels.usable_instructions():
        assert answer(PROXIMITY_ISA=instructions) == [instructions, expected]


@ahead
@pytest.mark.slow
def test_numba_gives_the_same_bits():
    assert answer(PROXIMITY_ISA="jit")[1] == answer()[1]


@ahead
def test_nothing_of_numba_is_needed():
    done = run(HIDE_NUMBA + ANSWER.format(mesh=str(ROOT / "meshes" / "bracket.stl")))

    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == answer()


@ahead
def test_an_unknown_set_of_instructions_is_refused_by_name():
    done = run("import proximity; proximity.Solid", PROXIMITY_ISA="v9")

    assert done.returncode == 1
    assert "PROXIMITY_ISA is 'v9', expected 'jit' or one of [" in done.stderr


@pytest.fixture
def copy(tmp_path):
    """A copy of the checkout."""
    for folder in ("proximity", "tools", "meshes"):
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=shutil.ignore_patterns("__pycache__"))
    return tmp_path


@ahead
def test_edited_kernels_are_not_answered_by_old_objects(copy):
    kernel = copy / "proximity" / "kernels" / "layout.py"
    kernel.write_text(kernel.read_text() + "\n# edited\n")

    done = run("from proximity.native import MODE; print(MODE)", copy)
    assert done.stdout.strip() == "jit"
    assert "kernels have been edited since they were compiled; numba compiles them" in done.stderr

    alone = run(HIDE_NUMBA + "from proximity.native import MODE", copy)
    assert alone.returncode == 1
    assert "numba, which compiles them when they are called, is not installed" in alone.stderr


@ahead
def test_without_objects_numba_serves_and_says_so(copy):
    for extension in (copy / "proximity" / "native").glob("_kernels*"):
        extension.unlink()

    done = run("from proximity.native import MODE; print(MODE)", copy)
    assert done.stdout.strip() == "jit"
    assert "kernels have not been compiled for this system" in done.stderr


def test_interpreted_kernels_are_plain_functions():
    done = run(
        "from proximity.native import MODE; from proximity.kernels.geometry.frames import to_local;"
        "print(MODE, type(to_local).__name__)",
        NUMBA_DISABLE_JIT="1",
    )
    assert done.stdout.split() == ["interpreted", "function"], done.stderr


def test_kernels_in_the_temporary_folder_are_in_one_that_nobody_else_can_have_made(tmp_path, monkeypatch):
    """Regression: another user could create the folder first, with pickles; others' folders were removed."""
    jit = pytest.importorskip("proximity.native.jit")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(jit.numba.config, "CACHE_DIR", "")
    monkeypatch.setattr(jit, "_is_ours", lambda folder: False)
    others = [
        tmp_path / "proximity-of-somebody",
        tmp_path / f"proximity-{jit.sources_digest()[:16]}-{jit.numba.__version__}",
    ]
    for each in others:
        each.mkdir()

    folder = jit.cache_folder.__wrapped__()

    assert folder.parent.parent == tmp_path and folder.parent not in others
    assert stat.S_IMODE(folder.parent.stat().st_mode) == 0o700
    assert all(each.is_dir() for each in others)


@pytest.mark.skipif(os.name == "nt", reason="modes are of POSIX")
def test_kernels_are_not_read_from_a_folder_of_another_user(tmp_path, monkeypatch):
    jit = pytest.importorskip("proximity.native.jit")
    ours, open_to_all = tmp_path / "ours", tmp_path / "open"
    open_to_all.mkdir()
    open_to_all.chmod(0o777)

    assert jit._is_ours(ours) and not jit._is_ours(open_to_all)
    monkeypatch.setattr(jit.os, "geteuid", lambda: 12345)
    assert not jit._is_ours(ours)
