"""A saved page that plays a motion: poses and distances are Python's, by slider, playback and curve."""

import itertools
import re

import numpy as np
import pytest
import shapes
from browsing import browser
from far_end import until
from scene_parts import part_of

from proximity.clients import wasm_package
from proximity.pose import Pose
from proximity.scene.motion import Motion
from proximity.scene.scene import Scene
from proximity.web.motion_page import write_motion_page

pytestmark = pytest.mark.skipif(
    not any((wasm_package.NATIVE / name).is_file() for name in wasm_package.MODULES),
    reason="the engine for browsers is not compiled",
)
TURNED = Pose(shapes.rotation(4), (0.02, 0.5, 0.3))
MOTIONS = {
    "hinge": (Motion.hinge([0.0, 0.1, 0.0], [1.0, 2.0, 0.5], -0.1, -1.7), "degrees", np.pi / 180.0),
    "slide": (Motion.slide([0.0, -1.0, -0.5], -0.05, 0.8), "mm", 1e-3),
    "poses": (
        Motion.through([TURNED, Pose(), Pose(None, (0.0, 0.3, 0.1))], [0.0, 1.5, 4.0]),
        "position",
        1.0,
    ),
}


def some_scene():
    """A block that moves, and three others; one of them is hidden."""
    block = shapes.cube(0.1, (0.0, 0.2, 0.0))
    rest = [
        shapes.cube(0.1, (0.0, -0.1, 0.0)),
        shapes.moved(shapes.octahedron(), (-2.0, 0, 0)),
        shapes.cube(0.01),
    ]
    others = [part_of(mesh, f"rest {k}", is_hidden=k == 2) for k, mesh in enumerate(rest)]
    return Scene([part_of(block, "block", TURNED), *others])


def saved_page(path, kind, *, others=None):
    motion, unit, scale = MOTIONS[kind]
    scene = some_scene()
    found = scene.clearance_along("block", motion, others=others)
    size = write_motion_page(
        path, scene, motion, found, title="<block> & rest", others=others, unit=unit, scale=scale
    )
    assert size == path.stat().st_size < 2_500_000
    return scene, motion, found


def spans_of(scene, motion):
    part = scene.part("block")
    corners = part.solid.mesh.vertices
    return motion.spans(part.pose, 0.5 * (corners.min(axis=0) + corners.max(axis=0)))


def test_file_names_nothing_elsewhere(tmp_path):
    saved_page(tmp_path / "block.html", "hinge")
    content = (tmp_path / "block.html").read_bytes()
    text = re.sub(rb'("application/octet-stream" id="[^"]+">)[^<]+</', rb"\1</", content).decode("ascii")

    assert not re.search(r'(src|href)="(?!data:)[^"#]', text)
    assert "<block>" not in text


class Opened:
    """A page that was opened from the disk, and its complaints."""

    def __init__(self, running, path):
        self.page, self.complaints = running.new_page(viewport={"width": 960, "height": 640}), []
        self.page.on("pageerror", lambda failure: self.complaints.append(str(failure)))
        self.page.on(
            "console", lambda said: self.complaints.append(said.text) if said.type == "error" else None
        )
        self.page.on(
            "request",
            lambda sent: sent.url.startswith(("blob:", "data:", "file:")) or self.complaints.append(sent.url),
        )
        self.page.goto(path.as_uri())
        until(lambda: self.page.evaluate("!!window.page?.motion"))
        self.ask = self.page.evaluate

    def at(self, position):
        """Move to a position; return the pose of the part, and its distance."""
        self.ask("(position) => page.motion.stopAt(position)", position)
        matrix = self.ask("page.motion.part.object.matrix.clone().transpose().toArray()")
        found = self.ask("page.motion.update(), page.motion.nearest.found.map((each) => each.distance)")
        return np.array(matrix).reshape(4, 4), found[0]

    def text(self, name):
        return self.ask("(name) => document.getElementById(name).textContent", name)


@pytest.fixture(scope="module")
def running():
    with browser() as chromium:
        yield chromium


@pytest.mark.browser
@pytest.mark.parametrize(("kind", "others"), [("hinge", None), ("slide", ["rest 0"]), ("poses", None)])
def test_part_is_where_python_has_it_and_as_far(tmp_path, running, kind, others):
    scene, motion, found = saved_page(tmp_path / "page.html", kind, others=others)
    names = others or ["rest 0", "rest 1"]
    opened = Opened(running, tmp_path / "page.html")

    for span, share in itertools.product(spans_of(scene, motion), (0.0, 0.3, 0.77, 1.0)):
        position = span.start + share * (span.end - span.start)
        pose, distance = opened.at(position)
        expected = span.pose_at(position)
        np.testing.assert_allclose(pose, expected.matrix, atol=1e-14)
        scene.move("block", expected)
        least = min(scene.clearance("block", name).distance for name in names)
        np.testing.assert_allclose(distance, least, rtol=1e-9, atol=1e-12)
    opened.page.click("#motion-worst")
    worst = found.position if found.first_touch is None else found.first_touch[1]
    assert opened.ask("page.motion.position") == worst
    assert opened.complaints == []


@pytest.mark.browser
def test_playback_slider_and_curve_move_the_part(tmp_path, running):
    _, motion, found = saved_page(tmp_path / "page.html", "hinge")
    opened = Opened(running, tmp_path / "page.html")

    assert opened.ask("page.motion.position") == motion.first
    assert opened.text("motion-least").startswith("smallest distance") and found.first_touch is None
    opened.page.click("#motion-play")
    assert opened.text("motion-play") == "Pause"
    until(lambda: opened.ask("page.motion.position") == motion.last)
    assert opened.text("motion-play") == "Play"
    assert opened.text("motion-text").startswith(f"−{-motion.last * 180.0 / np.pi:.1f}°: ")
    opened.ask(
        "(at) => { at.value = 0.25; at.dispatchEvent(new Event('input')); }",
        opened.page.query_selector("#motion-at"),
    )
    assert opened.ask("page.motion.position") == pytest.approx(0.75 * motion.first + 0.25 * motion.last)
    box = opened.page.query_selector("#motion-curve").bounding_box()
    opened.page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 20)
    assert opened.ask("page.motion.position") == pytest.approx(0.5 * (motion.first + motion.last), abs=0.02)
    opened.ask("page.parts.reset()")
    until(lambda: "left its motion" in opened.text("motion-text"))
    assert opened.complaints == []


@pytest.mark.browser
def test_hidden_part_has_no_distance(tmp_path, running):
    saved_page(tmp_path / "page.html", "slide")
    opened = Opened(running, tmp_path / "page.html")

    opened.ask("page.parts.setVisible(page.motion.part, false)")
    until(lambda: "no visible parts" in opened.text("motion-text"))
    opened.ask("page.parts.setVisible(page.motion.part, true)")
    until(lambda: " to rest" in opened.text("motion-text") or " rest" in opened.text("motion-text"))
    assert opened.complaints == []
