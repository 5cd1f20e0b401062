"""The name of the distribution, in `pyproject.toml` and in every sentence that says what to install."""

import re
import tomllib

import pytest
from project import ROOT

from proximity.system.extras import DISTRIBUTION, installation

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
SOURCES = sorted((ROOT / "proximity").rglob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def test_distribution_is_that_of_the_project():
    assert DISTRIBUTION == PROJECT["name"] == "cad-proximity"
    assert installation("sim") == 'pip install "cad-proximity[sim]"'


@pytest.mark.parametrize("path", [*SOURCES, *PAGES], ids=lambda path: path.relative_to(ROOT).as_posix())
def test_what_is_to_be_installed_is_an_extra_of_this_project(path):
    """A slip would fetch the package of a stranger."""
    text = path.read_text(encoding="utf-8")
    extras = re.findall(r"""installation\(["'](\w+)["']\)""", text)
    for name, extra in re.findall(r'pip install (?:-e )?"?([\w.-]+)\[([\w,]+)\]', text):
        assert name in (DISTRIBUTION, "."), name
        extras += extra.split(",")
    assert set(extras) <= set(PROJECT["optional-dependencies"])
    assert not re.search(r"pip install proximity\b", text)
