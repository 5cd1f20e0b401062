"""The engine for browsers in bundled and typed programs: `tsc --strict`, and a build with Vite.

Install the tools with npm: npm install --prefix FOLDER typescript vite, with FOLDER/node_modules/.bin in
PATH.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from browsing import browser
from project import MESHES, SUPPORT

import proximity
from proximity.clients import wasm_package

PROGRAM = SUPPORT / "clients" / "bundled"
PLACE = "http://engine.test/"
pytestmark = pytest.mark.skipif(
    not all((wasm_package.NATIVE / name).is_file() for name in wasm_package.MODULES),
    reason="the engine for browsers is not compiled",
)


def tool(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"there is no {name}: npm install --prefix FOLDER typescript vite, and FOLDER in PATH")
    return found


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An npm project with the program, and the engine as an installed package."""
    made = tmp_path_factory.mktemp("bundled")
    shutil.copytree(PROGRAM, made, dirs_exist_ok=True)
    wasm_package.write_package(made / "node_modules" / "proximity-engine")
    return made


def compiled(folder: Path, program: str, resolution: str, module: str) -> str:
    """Return the TypeScript compiler's messages for a program; empty if all types fit."""
    options = ("--strict", "--noEmit", "--target", "es2022", "--module", module)
    command = [tool("tsc"), *options, "--moduleResolution", resolution, program]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False).stdout


@pytest.mark.parametrize(("resolution", "module"), [("bundler", "esnext"), ("nodenext", "nodenext")])
def test_an_ordinary_program_has_the_right_types(project, resolution, module):
    (project / "package.json").write_text('{"type": "module"}')

    assert compiled(project, "program.ts", resolution, module) == ""


def test_a_wrong_field_of_a_contact_is_found_by_its_type(project):
    text = (project / "program.ts").read_text().replace("kept.lower", "kept.lowest")
    (project / "wrong.ts").write_text(text)

    said = compiled(project, "wrong.ts", "bundler", "esnext")

    assert "'lowest' does not exist on type 'ContactFields'" in said


def serve(folder):
    """Return a handler of requests that answers with the files of a folder."""

    def answer(route, request):
        path = folder / request.url.removeprefix(PLACE)
        route.fulfill(path=path) if path.is_file() else route.fulfill(status=404, body="")

    return answer


@pytest.mark.browser
def test_example_imports_a_part_while_fingers_are_tracked(project, tmp_path):
    engine = project / "node_modules" / "proximity-engine"
    for path in engine.glob("imported*.mjs"):
        shutil.copy(path, tmp_path)
    markup = re.search(r"//   (<input.*)", (tmp_path / "imported.mjs").read_text("utf-8"))[1]
    (tmp_path / "index.html").write_text(f"<!doctype html>{markup}", "utf-8")
    (tmp_path / "vite.config.mjs").write_text('export default { worker: { format: "es" } };', "utf-8")
    shutil.copytree(engine, tmp_path / "node_modules" / "proximity-engine")
    command = [tool("vite"), "build", "--base", "./", "--target", "esnext", "--logLevel", "error"]
    subprocess.run(command, cwd=tmp_path, check=True)

    with browser() as running:
        page = running.new_page()
        page.route(PLACE + "**", serve(tmp_path / "dist"))
        page.goto(PLACE + "index.html")
        page.set_input_files("#part", MESHES / "bracket.stl")
        page.wait_for_function("document.getElementById('nearest').textContent !== ''")
        result = page.text_content("#nearest")

    assert re.fullmatch(r"came within -?[\d.]+ mm of 'imported', now 1 part", result)


@pytest.mark.browser
def test_a_bundle_finds_its_modules_in_a_browser(project):
    subprocess.run([tool("vite"), "build", "--base", "./", "--logLevel", "error"], cwd=project, check=True)
    built = project / "dist"
    assert len(list(built.rglob("*.wasm"))) == 2
    scene = proximity.load(MESHES / "bracket.stl", units="mm")
    scene.save(built / "scene.prox")

    with browser() as running:
        page = running.new_page()
        page.route(PLACE + "**", serve(built))
        page.goto(PLACE + "index.html")
        page.wait_for_function("document.getElementById('told').textContent !== ''")
        told = json.loads(page.text_content("#told"))

    lower, upper = scene.bounds
    assert told["distances"] == scene.signed_distance([upper, lower]).tolist()
    assert told["again"] and told["isTracked"] == [True, True] and told["point"] == 3
    assert (told["age"], told["instructions"]) == (0, "relaxed")
    ticked = proximity.Tracker(scene, fingers=2, radius=0.005).tick([upper, lower], 10**6, 10**6)
    assert told["lower"] == ticked["lower"][0]
    assert "index.html: these bytes are HTML, expected a compiled scene" in told["page"]
