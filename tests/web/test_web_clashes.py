"""The list of clashes on a saved page: two parts are shown alone, and all are restored."""

import numpy as np
import pytest
import shapes
from browsing import Page

from proximity.cli.parts.measured_pairs import find_clashes
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.web.page_process import PageSettings, write_page

pytestmark = [pytest.mark.slow, pytest.mark.browser]
CUBES = {"left": 0.0, "middle": 0.09, "right": 0.17, "far": 0.5}  # m along x, of cubes of 0.1 m
OPACITIES = (
    "Object.fromEntries(page.parts.list.map((part) => [part.name, part.meshes[0].material.opacity < 1]))"
)
CHOSEN = "page.tools.clashes.chosen?.names ?? null"
VIEW = "[...page.stage.camera.position.toArray(), ...page.stage.controls.target.toArray()]"


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clashes")
    scene = Scene([Solid(*shapes.cube(0.1, (x, 0, 0)), name=name) for name, x in CUBES.items()])
    scene.save(folder / "cubes.prox")
    settings = PageSettings(
        (str(folder / "cubes.prox"),), find_clashes=lambda shown: find_clashes(shown, None, None)
    )
    write_page(settings, folder / "page.html")
    return folder / "page.html"


@pytest.fixture(scope="module")
def opened(chromium, saved):
    with Page(chromium, saved.as_uri()) as page:
        page.until("!!(window.page && page.parts.isLoaded && page.tools.clashes.list.length)")
        yield page


@pytest.fixture
def page(opened):
    opened.ask("page.tools.reset()")
    return opened


def faint(page):
    return {name for name, is_faint in page.ask(OPACITIES).items() if is_faint}


def test_clashes_are_listed_with_the_deepest_first(page):
    rows = page.page.locator("#clashes button").all_inner_texts()

    assert (
        page.ask("document.getElementById('clashes-name').textContent") == "2 clashes, the deepest 20.02 mm"
    )
    assert [row.split()[:2] for row in rows] == [["middle", "right"], ["left", "middle"]]
    assert all(words in rows[0] for words in ("deepest", "way out", "20.0", "200000 mm³"))


def test_a_chosen_clash_is_framed_and_the_others_are_faint_until_it_is_chosen_again(page):
    before, row = page.ask(VIEW), page.page.locator("#clashes button").first
    row.click()

    assert (page.ask(CHOSEN), faint(page)) == (["middle", "right"], {"left", "far"})
    target = page.ask("page.stage.toScene(page.stage.controls.target).toArray()")
    np.testing.assert_allclose(target, [(CUBES["middle"] + CUBES["right"]) / 2, 0, 0], atol=1e-6)
    assert row.get_attribute("aria-pressed") == "true"
    page.picture("clash")
    row.click()
    assert (page.ask(CHOSEN), faint(page)) == (None, set())
    np.testing.assert_allclose(page.ask(VIEW), before, atol=1e-9)


def test_clashes_are_chosen_by_the_keyboard_and_left_by_escape(page):
    page.page.locator("#clashes button").first.focus()
    page.page.keyboard.press("Enter")
    assert faint(page) == {"left", "far"}
    page.page.keyboard.press("ArrowDown")
    assert (page.ask(CHOSEN), faint(page)) == (["left", "middle"], {"right", "far"})
    page.page.keyboard.press("ArrowDown")  # the last row
    assert page.ask(CHOSEN) == ["left", "middle"]
    page.page.keyboard.press("Escape")
    assert (page.ask(CHOSEN), faint(page)) == (None, set())
    assert page.ask("page.tools.clashes.mark.children.length") == 0
