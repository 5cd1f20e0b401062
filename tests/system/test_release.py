"""The distribution's name in all install instructions, and the release script."""

import importlib.util
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile

import pytest
from project import ROOT

from proximity.system.extras import DISTRIBUTION, installation

SETTINGS = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = SETTINGS["project"]
SOURCES = sorted((ROOT / "proximity").rglob("*.py"))
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_distribution_is_that_of_the_project():
    assert DISTRIBUTION == PROJECT["name"] == "cad-proximity"
    assert installation("sim") == 'pip install "cad-proximity[sim]"'


@pytest.mark.parametrize("path", [*SOURCES, *PAGES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_is_to_be_installed_is_an_extra_of_this_project(path):
    """A mistake would install another package."""
    text = path.read_text(encoding="utf-8")
    extras = re.findall(r"""installation\(["'](\w+)["']\)""", text)
    for name, extra in re.findall(r'pip install (?:-e )?"?([\w.-]+)\[([\w,]+)\]', text):
        assert name in (DISTRIBUTION, "."), name
        extras += extra.split(",")
    assert set(extras) <= set(PROJECT["optional-dependencies"])
    assert set(re.findall(r"--group ([\w-]+)", text)) <= set(SETTINGS["dependency-groups"])
    assert not re.search(r"pip install proximity\b", text)


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
    """Return an environment whose only program is this Python."""
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
    """As with the checkout on the path: the sources would be tested, not the wheel."""
    environment = fake_environment(release, tmp_path)
    monkeypatch.setattr(release, "Environment", lambda *_: environment)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))

    with pytest.raises(SystemExit, match=r"proximity was imported from .*proximity/__init__\.py, not from"):
        release.try_wheel(tmp_path, tmp_path / "cad_proximity.whl")


def test_bill_of_materials_has_each_requirement_and_what_was_compiled_with(release, tmp_path):
    wheel = tmp_path / "cad_proximity-1.0.0-py3-none-any.whl"
    with zipfile.ZipFile(wheel, "w") as archive:
        archive.writestr(
            "cad_proximity-1.0.0.dist-info/METADATA",
            "Metadata-Version: 2.4\nName: cad-proximity\nVersion: 1.0.0\nLicense-Expression: MIT\n"
            "Requires-Dist: numpy>=1.26\n"
            "Requires-Dist: websockets>=14; extra == 'web'\n"
            "Requires-Dist: cad-proximity[web]; extra == 'all'\n",
        )

    bill = release.bill_of_materials(wheel)

    parts = {part["name"]: part["scope"] for part in bill["components"][:3]}
    assert parts == {"numpy": "required", "websockets": "optional", "cad-proximity[web]": "optional"}
    assert {"numba", "ziglang"} <= {
        part["name"] for part in bill["components"] if part["scope"] == "excluded"
    }
    references = [part["bom-ref"] for part in bill["components"]]
    assert len(set(references)) == len(references)
    assert set(bill["dependencies"][0]["dependsOn"]) == set(references[:3])


@pytest.mark.processes
def test_distribution_of_the_same_import_name_is_reported_at_import(tmp_path):
    package = tmp_path / "proximity"
    package.mkdir()
    for name in ("__init__.py", "__init__.pyi", "__main__.py"):
        shutil.copy(ROOT / "proximity" / name, package)
    command = [sys.executable, "-W", "always", "-c", "import proximity; print(proximity.__version__)"]

    def imported():
        done = subprocess.run(command, cwd=tmp_path, env={}, capture_output=True, text=True, check=True)
        return done.stderr

    (tmp_path / "proximity_other-1.0.dist-info").mkdir()
    assert imported() == ""
    (tmp_path / "proximity-3.0.0.dist-info").mkdir()
    assert "pip uninstall proximity cad-proximity" in imported()

    (package / "__init__.py").write_text("", encoding="utf-8")
    command = [sys.executable, "-m", "proximity"]
    done = subprocess.run(command, cwd=tmp_path, env={}, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert "another distribution" in done.stderr
