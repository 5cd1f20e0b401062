"""What works without any extra, and the sentence that names the extra of what does not."""

import os
import subprocess
import sys
from contextlib import nullcontext
from types import SimpleNamespace

import pytest
from project import MESHES, ROOT

import proximity
from proximity.errors import MissingLibraryError
from proximity.formats.step import conversion
from proximity.formats.worker import NOT_INSTALLED

LACKING = 'raise ModuleNotFoundError(f"No module named {__name__!r}", name=__name__)\n'
pytestmark = pytest.mark.processes


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Run Python where SciPy is not installed."""
    folder = tmp_path_factory.mktemp("lacking")
    (folder / "scipy.py").write_text(LACKING, encoding="utf-8")
    paths = os.pathsep.join([str(folder), str(ROOT)])
    environment = os.environ | {"PYTHONPATH": paths}

    def run(*arguments):
        command = [sys.executable, *map(str, arguments)]
        return subprocess.run(
            command, cwd=MESHES, env=environment, capture_output=True, text=True, check=False
        )

    return run


def test_meshes_are_queried_tracked_and_compared(run):
    code = f"""
import proximity
scene = proximity.load({str(MESHES / "assembly.glb")!r})
proximity.Tracker(scene, fingers=1).tick([[0, 0, 0]], 0, 0)
print(scene.clearance(0, 1).relation, proximity.overlap(scene, scene[0].name, scene[1].name))
"""
    done = run("-c", code)

    assert done.stdout == "apart None\n", done.stderr
    assert "distance 1 mm" in run("-m", "proximity", "query", MESHES / "bracket.stl", 30, 10, 5).stdout


def test_step_names_its_extra(monkeypatch):
    """The converter runs in a process of its own, which reports that it lacks its library."""
    lacking = SimpleNamespace(run=lambda *_, **__: SimpleNamespace(returncode=NOT_INSTALLED, printed=""))
    monkeypatch.setattr(conversion, "converter", lambda: nullcontext(lacking))
    monkeypatch.setattr(conversion, "CACHE", SimpleNamespace(read=lambda _: None))

    with pytest.raises(MissingLibraryError, match=r'assembly\.step: .*"cad-proximity\[step\]"'):
        proximity.load(MESHES / "assembly.step")


@pytest.mark.parametrize("command", ["serve demo.toml", "demo", "bench bracket.stl"])
def test_services_name_their_extra(run, command):
    done = run("-m", "proximity", *command.split())

    assert done.returncode == 2
    assert "cad-proximity[service]" in done.stderr
    assert len(done.stderr.splitlines()) == 1
