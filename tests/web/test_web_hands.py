"""Hands of an emulated headset, and recorded ones: the page's answers equal the scene's."""

import browsing
import numpy as np
import pytest
from browsing import Page, Viewing
from project import MESHES

import proximity
from proximity.web.page_process import PageSettings, write_page

MICROMETRE = 1e-6
RADIUS = 0.007
BATCHES = 20  # of ten fingertips
TIPS = ["thumb-tip", "index-finger-tip", "middle-finger-tip", "ring-finger-tip", "pinky-finger-tip"]

pytestmark = [pytest.mark.slow, pytest.mark.browser]


@pytest.fixture(scope="module", params=["served", "saved"])
def url(request, tmp_path_factory):
    """Address of a served page, and of a saved one that needs only the browser."""
    browsing.browser_path()
    if request.param == "served":
        with Viewing(MESHES / "bracket.stl", "--replay", MESHES / "hand.csv") as running:
            yield running.url
        return
    path = tmp_path_factory.mktemp("saved") / "bracket.html"
    settings = {"recording": str(MESHES / "hand.csv"), "first_input": "replay"}
    write_page(PageSettings((str(MESHES / "bracket.stl"),), **settings), path)
    yield path.as_uri()


@pytest.fixture(scope="module")
def scene():
    return proximity.load(MESHES / "bracket.stl")


@pytest.fixture(scope="module")
def page(chromium, url):
    with Page(chromium, url, has_headset=True).ready() as one:
        yield one


def known(page, fingers):
    """Wait until exactly those fingers are known."""
    page.until(
        "(fingers) => JSON.stringify(page.reading.contacts"
        ".filter((each) => each.isKnown).map((each) => each.finger)) === JSON.stringify(fingers)",
        fingers,
    )


def test_a_recorded_hand_is_replayed(page, scene):
    page.until(
        "page.input === 'replay' && page.reading.contacts.some((each) => each.isKnown && each.isExact)"
    )
    nearest = "Math.min(...page.reading.contacts.filter((each) => each.isKnown).map((each) => each.distance))"
    page.until(f"{nearest} < 0.01")
    page.picture("replay")

    contacts = page.exact()

    expected = scene.signed_distance([each["position"] for each in contacts]) - RADIUS
    np.testing.assert_allclose([each["distance"] for each in contacts], expected, rtol=0, atol=MICROMETRE)


WEAR = """
(async () => {
  headset.primaryInputMode = "hand";
  for (const side of ["left", "right"]) {
    headset.hands[side].position.set(0, 0, 0);
    headset.hands[side].quaternion.set(0, 0, 0, 1);
    headset.hands[side].connected = true;
  }
  await page.choose("headset");
  return page.input;
})()
"""
POSE = """
(places) => {
  for (const [side, tips] of Object.entries(places)) {
    const hand = headset.hands[side];
    const own = Object.getOwnPropertySymbols(hand).find((each) => String(each).includes("hand-input"));
    const mirror = side === "right" ? -1 : 1;
    const joints = {};
    for (const [name, matrix] of Object.entries(tips)) {
      const offsetMatrix = [...matrix];
      offsetMatrix[12] *= mirror;
      joints[name] = { offsetMatrix, radius: 0.008 };
    }
    hand[own].poses = { default: { jointTransforms: joints }, pinch: { jointTransforms: joints } };
  }
}
"""
PLACE = "(all) => Object.entries(all).forEach(([side, at]) => headset.hands[side].position.set(...at))"
NAMES = "page.inputs.headset.constructor && [...new Set(headset.hands.left.inputSource.hand.keys())]"
WORLD_FROM_SCENE = "(page.stage.root.updateMatrixWorld(true), page.stage.root.matrixWorld.elements)"


def random_hand(rng, names, box, world_from_scene):
    """Return column-major matrices of joints, and their positions in the scene."""
    hand, places = {}, {}
    for name in names:
        point = rng.uniform(*box)
        matrix = np.eye(4)
        matrix[:3, :3] = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        matrix[:3, :3] *= np.sign(np.linalg.det(matrix[:3, :3]))
        matrix[:3, 3] = (world_from_scene @ [*point, 1.0])[:3]
        hand[name] = matrix.T.reshape(-1).tolist()
        places[name] = point
    return hand, places


def test_both_hands_of_a_headset_are_tracked_and_measured_to_a_micrometre(page, scene):
    assert page.ask(WEAR) == "headset"
    known(page, list(range(10)))
    page.until("page.inputs.headset.hands.size === 2")
    page.until("page.inputs.headset.isPlaced")
    page.ask("headset.quaternion.set(Math.sin(-0.3), 0, 0, Math.cos(-0.3))")  # towards the part
    page.ask(PLACE, {"left": [-0.1, 1.45, -0.2], "right": [0.1, 1.45, -0.2]})
    page.until("page.reading.contacts.filter((each) => each.isKnown && each.distance < 0.25).length > 3")
    page.page.wait_for_timeout(1500)
    page.picture("headset")
    page.ask(PLACE, {"left": [0, 0, 0], "right": [0, 0, 0]})
    names = page.ask(NAMES)
    assert len(names) == 25
    world_from_scene = np.array(page.ask(WORLD_FROM_SCENE)).reshape(4, 4).T
    lower, upper = scene.bounds
    box, rng = (lower - 0.05, upper + 0.05), np.random.default_rng(28)
    worst = 0.0
    for _ in range(BATCHES):
        hands = {side: random_hand(rng, names, box, world_from_scene) for side in ("left", "right")}
        page.ask(POSE, {side: hand for side, (hand, _) in hands.items()})
        expected = np.array([hands[side][1][tip] for side in ("left", "right") for tip in TIPS])
        found = page.until(
            "(expected) => { const { state, contacts } = page.reading;"
            " const known = contacts.filter((each) => each.isKnown && each.isExact);"
            " return state !== 'LATE' && known.length === 10 && known.every((each, k) => "
            "Math.hypot(...each.position.map((x, i) => x - expected[k][i])) < 1e-5) && known; }",
            expected.tolist(),
        )
        positions = np.array([each["position"] for each in found])
        np.testing.assert_allclose(positions, expected, rtol=0, atol=MICROMETRE)
        distances = np.array([each["distance"] for each in found])
        worst = max(worst, np.abs(distances - (scene.signed_distance(positions) - RADIUS)).max())
        np.testing.assert_allclose(
            distances, scene.signed_distance(expected) - RADIUS, rtol=0, atol=MICROMETRE
        )
    assert worst < 1e-15  # the page's answers equal the scene's
    page.picture("headset-random")
    page.ask("page.inputs.headset.stop()")
    page.until("page.input === 'probe'")


def test_a_hand_that_pinches_near_a_part_takes_it_along(page):
    assert page.ask(WEAR) == "headset"
    known(page, list(range(10)))
    names = page.ask(NAMES)
    world_from_scene = np.array(page.ask(WORLD_FROM_SCENE)).reshape(4, 4).T

    def put(point, apart):
        """Move the right hand to a point of the scene, with thumb and index *apart* metres apart."""
        hand = {}
        for name in names:
            x, y, z = point
            place = [x, y, z + (apart if name == "thumb-tip" else 0.0)]
            matrix = np.eye(4)
            matrix[:3, 3] = (world_from_scene @ [*place, 1.0])[:3]
            hand[name] = matrix.T.reshape(-1).tolist()
        page.ask(POSE, {"right": hand})

    put((0.03, 0.01, 0.015), 0.05)
    page.until(
        "page.reading.contacts.some((each) => each.finger === 6 && each.isKnown && each.distance < 0.02)"
    )
    put((0.03, 0.01, 0.015), 0.01)
    page.until("page.inputs.headset.grasps.size === 1")
    put((0.03, 0.03, 0.035), 0.01)

    elements = "page.parts.list[0].object.matrix.elements"
    page.until(f"Math.abs({elements}[13] - 0.02) < 1e-6 && Math.abs({elements}[14] - 0.02) < 1e-6")
    put((0.03, 0.03, 0.035), 0.06)
    page.until("page.inputs.headset.grasps.size === 0")
    page.ask("page.inputs.headset.stop()")
    page.ask("page.parts.reset()")
    page.until(f"{elements}[13] === 0")


def test_controllers_are_a_fingertip_each(page):
    page.ask("headset.primaryInputMode = 'controller'")
    assert page.ask("page.choose('headset').then(() => page.input)") == "headset"

    known(page, [1, 6])

    page.ask("page.inputs.headset.stop()")
