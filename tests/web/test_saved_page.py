"""A page saved as one file and opened from disk: distances equal Python's, without network."""

import re

import numpy as np
import pytest
from browsing import browser
from far_end import until
from project import MESHES

import proximity
from proximity import ServiceError
from proximity.clients import wasm_package
from proximity.web.page_process import PageSettings, write_page
from proximity.web.saved_page import _by_names

pytestmark = pytest.mark.skipif(
    not all((wasm_package.NATIVE / name).is_file() for name in wasm_package.MODULES),
    reason="the engine for browsers is not compiled",
)
KNOWN_FINGERS = "page.reading.contacts.filter((each) => each.isKnown)"
READING = f"{KNOWN_FINGERS}.map((each) => [each.distance, ...each.position])"
SLICE = "{ origin: [0, 0, 0], u: [0.1, 0, 0], v: [0, 0.1, 0], width: 3, height: 3 }"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "bracket.html"
    settings = PageSettings((str(MESHES / "bracket.stl"),), recording=str(MESHES / "hand.csv"))
    assert write_page(settings, path) == path.stat().st_size <= 2_500_000
    return path


def test_file_names_nothing_elsewhere(saved):
    content = saved.read_bytes()
    text = re.sub(rb'("application/octet-stream" id="[^"]+">)[^<]+</', rb"\1</", content).decode("ascii")

    assert len(text) < 50_000
    assert not re.search(r'(src|href)="(?!data:)[^"#]', text)


def test_page_lets_nothing_else_run_and_nothing_out(saved):
    text = saved.read_bytes().decode("latin-1")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)[1]
    rules = dict(each.split(" ", 1) for each in policy.split("; "))
    nonce = re.search(r'<script nonce="(\w{64})">', text)[1]

    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert rules["script-src"] == f"'nonce-{nonce}' 'wasm-unsafe-eval' blob:"
    assert text.index("Content-Security-Policy") < text.index("<style") < text.index("<script")


def test_imports_are_by_name():
    text = 'import { a } from "./b.js";\nimport * as T from "three";\nawait import("../c.mjs");\n"from here"'
    assert _by_names("page/inputs/x.js", text) == (
        'import { a } from "page/inputs/b.js";\nimport * as T from "page/vendor/three/three.module.js";\n'
        'await import("page/c.mjs");\n"from here"'
    )


def test_log_is_refused(tmp_path):
    with pytest.raises(ServiceError, match=r"a log cannot be saved as a page, expected parts"):
        write_page(PageSettings(("run.frames",)), tmp_path / "page.html")


@pytest.mark.browser
def test_page_from_a_disk_computes_what_python_computes(saved):
    with browser() as running:
        page = running.new_page(viewport={"width": 960, "height": 600})
        requests, failures = [], []
        page.on("request", lambda request: requests.append(request.url))
        page.on("pageerror", lambda failure: failures.append(str(failure)))
        page.on(
            "console", lambda said: failures.append(said.text) if "Content Security" in said.text else None
        )
        page.goto(saved.as_uri())
        until(lambda: page.evaluate("window.page?.parts.isLoaded"))
        page.evaluate("page.choose('mouse')")
        page.mouse.move(480, 300)
        found = until(lambda: page.evaluate(f"(({READING}).length === 5 && {READING})"))
        found = np.array(found)  # of five: the recorded hand leaves before that of the mouse arrives
        instructions = page.evaluate("page.link.scene.instructions")
        sliced = page.evaluate(f"page.local.sliced({SLICE}, page.parts.list, () => true).then(Array.from)")
        page.evaluate("page.link.sendChanges([{ name: 'bracket', action: 0 }])")
        until(lambda: page.evaluate("!page.parts.list[0].object.visible"))
        hidden = page.evaluate("page.reading.contacts.map((each) => each.distance)")

    scene = proximity.load(MESHES / "bracket.stl", units="mm")
    expected = scene.signed_distance(found[:, 1:]) - 0.007
    assert len(found) == 5 and instructions == "relaxed"
    np.testing.assert_allclose(found[:, 0], expected, rtol=0, atol=1e-15)
    grid = np.array([[0.05 * column, 0.05 * row, 0.0] for row in range(3) for column in range(3)])
    assert sliced == scene.signed_distance(grid).tolist()
    assert not [url for url in requests[1:] if not url.startswith(("blob:", "data:"))]
    assert not failures
    assert not np.isfinite(np.array(hidden, float)).any()


@pytest.mark.browser
def test_without_webassembly_the_page_says_so(saved):
    with browser() as running:
        page = running.new_page(viewport={"width": 960, "height": 600})
        page.add_init_script("delete window.WebAssembly")
        page.goto(saved.as_uri())
        until(
            lambda: page.evaluate(
                "document.getElementById('cover-text').textContent.includes('no WebAssembly')"
            )
        )
