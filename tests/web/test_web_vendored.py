"""Vendored files: unchanged, with their licences, and within the agreed size."""

import hashlib
import re
from pathlib import Path

import pytest

from proximity.web.page_content import PAGE, scene_page_files

FOLDERS = [PAGE / "vendor" / "three", Path(__file__).parent / "vendor"]


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_vendored_files_are_as_published(folder):
    listed = dict(
        reversed(line.split(maxsplit=1)) for line in (folder / "SHA256SUMS").read_text().splitlines()
    )
    found = {path for path in folder.rglob("*") if path.is_file() and path.name != "SHA256SUMS"}

    assert {folder / name for name in listed} == found
    for name, expected in listed.items():
        assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == expected, name


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_vendored_files_have_their_licence(folder):
    (licence,) = folder.glob("*LICENSE*")

    assert "MIT" in licence.read_text()


def test_the_page_weighs_less_than_a_megabyte():
    files = scene_page_files()
    names = [
        "/proximity_client.mjs",
        "/layout.mjs",
        *("/" + path.relative_to(PAGE).as_posix() for path in PAGE.rglob("*")),
    ]
    assert sum(len(found[1]) for name in names if (found := files.get(f"/{name}")) is not None) <= 1_000_000


def test_the_page_loads_nothing_from_elsewhere():
    for path in PAGE.rglob("*"):
        if path.suffix in (".js", ".css", ".html") and "vendor" not in path.parts:
            text = path.read_text(encoding="utf-8")
            found = re.findall(r"(?:from|import|src=|href=|url\()\s*[\"'(]?(https?:[^\"') ]+)", text)
            assert not found, path


def test_every_import_of_the_page_is_there():
    files = scene_page_files()
    for path in PAGE.rglob("*.js"):
        if "vendor" in path.parts:
            continue
        for name in re.findall(r'from "(\.[^"]+)"', path.read_text(encoding="utf-8")):
            target = "/" + (path.parent / name).resolve().relative_to(PAGE.resolve()).as_posix()
            assert files.get(target) is not None, (path, name)


def test_only_files_of_the_page_are_given():
    files = scene_page_files()

    for name in ("/../bridge.py", "/vendor/three/SHA256SUMS", "/%2e%2e/bridge.py", "//etc/passwd", ""):
        assert files.get(name) is None
    assert files.get("/")[0].startswith("text/html")
    assert files.get("/main.js?x=1") == files.get("/main.js")


def test_the_policy_lets_nothing_in_but_what_is_served():
    policy = scene_page_files().headers["Content-Security-Policy"]

    assert "default-src 'none'" in policy
    assert re.search(r"script-src 'self' 'wasm-unsafe-eval' 'sha256-[^']+';", policy)
    assert "unsafe" not in policy.replace("'wasm-unsafe-eval'", "")  # for the engine, not for text
    assert "*" not in policy
