"""The release script: the blocks that it runs, and how it fails. A release itself takes minutes."""

import importlib.util
import sys

import pytest
from project import ROOT

SCRIPT = ROOT / "tools" / "release.py"


@pytest.fixture
def release():
    spec = importlib.util.spec_from_file_location("release", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_python_block_of_the_readme_is_run_and_compared(release):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")

    examples = release.examples()

    assert len(examples) == readme.count("```python\n") > 0
    assert all("print(" in code and printed for code, printed in examples)


def fake_environment(release, tmp_path):
    """An environment whose only program is this Python."""
    environment = object.__new__(release.Environment)
    environment._programs = tmp_path
    (tmp_path / "python").symlink_to(sys.executable)
    return environment


@pytest.mark.skipif(sys.platform == "win32", reason="links a program")
def test_program_that_fails_ends_the_release_with_what_it_printed(release, tmp_path):
    environment = fake_environment(release, tmp_path)

    assert environment.run("python", "-c", "print(3)") == "3\n"
    with pytest.raises(SystemExit, match=r"^release: python -c .* failed:\nhalf\n$"):
        environment.run("python", "-c", "print('half'); raise SystemExit(3)")


@pytest.mark.skipif(sys.platform == "win32", reason="links a program")
def test_wheel_that_is_not_the_one_imported_ends_the_release(release, tmp_path, monkeypatch):
    """As where the checkout is on the path: the sources would be tried, not the wheel."""
    environment = fake_environment(release, tmp_path)
    monkeypatch.setattr(release, "Environment", lambda *_: environment)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))

    with pytest.raises(SystemExit, match=r"proximity was imported from .*proximity/__init__\.py, not from"):
        release.try_wheel(tmp_path, tmp_path / "cad_proximity.whl")
