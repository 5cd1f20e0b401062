"""The page in a browser: hands in, distances shown, parts moved, and its status when frames stop."""

import contextlib
import csv
import os
import socket
import subprocess
import sys

import browsing
import numpy as np
import psutil
import pytest
from browsing import Page, Viewing
from project import MESHES

import proximity

MICROMETRE = 1e-6
RADIUS = 0.007
KNOWN = (
    "['OK', 'DEGRADED'].includes(page.reading.state) && page.reading.contacts.some((each) => each.isKnown)"
)
MIDDLE = (420, 300)
WHERE_IS = """
(name) => {
  for (let y = 60; y < innerHeight; y += 12) {
    for (let x = 320; x < innerWidth - 260; x += 12) {
      if (page.tools.aim({ clientX: x, clientY: y })?.part.name === name) return [x, y];
    }
  }
}
"""

pytestmark = [pytest.mark.slow, pytest.mark.browser]


@pytest.fixture(scope="module")
def viewing():
    browsing.browser_path()
    with Viewing(MESHES / "assembly.step", MESHES / "bracket.stl") as running:
        yield running


@pytest.fixture(scope="module")
def scene():
    parts = [*proximity.load(MESHES / "assembly.step").parts, *proximity.load(MESHES / "bracket.stl").parts]
    return proximity.Scene(parts)


@pytest.fixture(scope="module")
def opened(chromium, viewing):
    with Page(chromium, viewing.url).ready() as one:
        yield one


@pytest.fixture
def page(opened):
    """The page in its initial state."""
    opened.page.mouse.move(2, 400)
    opened.page.keyboard.press("Escape")
    opened.ask("page.tools.reset()")
    opened.ask("page.choose('mouse')")
    opened.until(
        "page.feeds && page.parts.waiting.length === 0 && page.parts.list.every((part) => "
        "part.object.matrix.equals(part.initial))"
    )
    return opened


def has_mouse_hand(page, at=MIDDLE):
    page.page.mouse.move(at[0] + 5, at[1])
    page.page.mouse.move(*at)
    page.until(KNOWN)


def same_as(scene, contacts):
    """Compare the page's distances with the scene's."""
    expected = scene.signed_distance([each["position"] for each in contacts]) - RADIUS
    np.testing.assert_allclose([each["distance"] for each in contacts], expected, rtol=0, atol=MICROMETRE)


def probed(page, at):
    """Return the probe's answer at a mouse position."""
    page.page.mouse.move(at[0] + 3, at[1])
    page.page.mouse.move(*at)
    page.page.wait_for_timeout(300)
    return page.until("page.input === 'probe' && page.probe.answer")


def test_the_page_begins_with_a_probe_at_the_mouse(chromium, viewing, scene):
    with Page(chromium, viewing.url).ready() as page:
        on = probed(page, page.ask(WHERE_IS, "lid"))
        page.until("document.getElementById('probe-side').textContent === 'on lid'")
        assert (on["distance"], on["part"]) == (0, "lid")
        assert abs(scene.signed_distance(on["position"])) < 1e-9

        page.page.keyboard.down("Shift")
        page.page.mouse.wheel(0, -300)
        page.page.keyboard.up("Shift")
        page.until("page.probe.lift > 0 && page.probe.answer.distance > 0")
        beside = probed(page, (340, 200))
        hit = scene.closest(beside["position"])
        np.testing.assert_allclose(beside["distance"], hit.signed_distance, rtol=0, atol=1e-15)
        assert list(hit.point) == beside["pointOnPart"]
        assert page.ask("document.getElementById('state').textContent") == "OK"
        page.picture("probe")

        page.page.keyboard.press("h")
        page.until("page.input === 'mouse' && document.getElementById('probe-card').hidden")
        page.page.keyboard.press("h")
        page.until("page.input === 'probe'")


def test_the_probe_is_inside_where_a_part_is_cut(page, scene):
    page.ask("page.choose('probe')")
    page.page.keyboard.press("c")
    page.page.get_by_role("radio", name="x", exact=True).click()
    inside = (
        "[...Array(60).keys()].some((k) => { page.probe.pointer.set(k / 60 - 0.5, -0.1); "
        "page.probe.update(); return page.probe.answer.distance < -5e-4; })"
    )
    page.until(inside)

    answer = page.ask("page.probe.answer")

    np.testing.assert_allclose(
        answer["distance"], scene.signed_distance(answer["position"]), rtol=0, atol=1e-15
    )
    assert page.ask("[...page.tools.plane.cut.caps.values()].every(({ cap }) => cap.visible)")
    page.picture("cut")
    page.page.keyboard.press("Escape")
    page.until("page.parts.clipping.length === 0 && document.getElementById('plane').hidden")
    assert not page.ask("[...page.tools.plane.cut.caps.values()].some(({ cap }) => cap.visible)")


def test_escape_closes_what_is_open_one_after_the_other(page):
    for key in ("c", "m", "?"):
        page.page.keyboard.press(key)
    open_ = "[!document.getElementById('help').hidden, page.tools.mode === 'move', page.tools.plane.clips]"
    assert page.ask(open_) == [True, True, True]

    seen = []
    for _ in range(3):
        page.page.keyboard.press("Escape")
        seen.append(page.ask(open_))

    assert seen == [[False, True, True], [False, False, True], [False, False, False]]


def test_nothing_is_computed_where_nothing_happens(page):
    page.ask("page.choose('none')")
    page.until("page.reading.state === 'NO HANDS' && !page.link.wasTracked")
    ticks = page.ask("page.link.count")
    page.page.locator("#parts .name", has_text="lid").first.click()
    page.until("page.tools.nearest.found.length > 0")
    page.ask("void (page.asked = 0, page.local.scene.clearance = () => page.asked++)")

    page.page.wait_for_timeout(1000)

    assert page.ask("[page.link.count, page.asked]") == [ticks, 0]
    page.ask("delete page.local.scene.clearance")


def test_a_picture_that_is_not_ready_is_awaited(page):
    """Regression: pictures were begun while those before were being drawn, which took all processors."""
    page.ask(
        "{ const gl = page.stage.renderer.getContext(); window.known = gl.getSyncParameter; "
        "gl.getSyncParameter = () => gl.UNSIGNALED; }"
    )
    page.until("page.stage.fence && performance.now() - page.stage.fenceMs > 200")
    drawn = page.ask("page.stage.renderer.info.render.frame")
    page.page.wait_for_timeout(600)
    assert page.ask("page.stage.renderer.info.render.frame") == drawn

    page.ask("void (page.stage.renderer.getContext().getSyncParameter = window.known)")
    page.until(f"page.stage.renderer.info.render.frame > {drawn}")


def test_points_are_shown_with_their_distances_and_saved(page, scene, tmp_path):
    rng = np.random.default_rng(48)
    points = rng.uniform(*scene.bounds, (5000, 3)).round(6)
    rows = [f"P{k};{x * 1e2:.4f};{y * 1e2:.4f};{z * 1e2:.4f}" for k, (x, y, z) in enumerate(points)]
    (tmp_path / "scan.csv").write_text("\n".join(["# of a scan", "name;x [cm];y [cm];z [cm]", *rows]) + "\n")

    page.page.locator("#points-file").set_input_files(tmp_path / "scan.csv")
    page.until("page.tools.points.object && !document.getElementById('points-card').hidden")

    expected = scene.signed_distance(points)
    np.testing.assert_allclose(page.ask("[...page.tools.points.distances]"), expected, rtol=0, atol=1e-12)
    shown = dict(zip(*(page.ask(f"[...document.querySelectorAll('#points-table {tag}')].map((each) => "
                                "each.textContent)") for tag in ("dt", "dd")), strict=True))  # fmt: skip
    assert shown["points"] == "5 000"
    within = next(name for name in shown if name.startswith("within ±"))
    reach = float(within.removeprefix("within ±").removesuffix(" mm")) / 1e3
    assert shown[within] == f"{100 * np.mean(np.abs(expected) <= reach):.1f} %"
    assert shown["RMS"] == f"{1e3 * np.sqrt(np.mean(expected**2)):.3f} mm"
    assert shown["95 % within"] == f"{1e3 * np.quantile(abs(expected), 0.95, method='inverted_cdf'):.3f} mm"
    page.picture("points")
    with page.page.expect_download(timeout=60_000) as saved:
        page.page.get_by_role("button", name="Save CSV").click()
    with open(saved.value.path(), newline="") as file:
        written = list(csv.DictReader(file))
    assert saved.value.suggested_filename == "scan-distances.csv"
    np.testing.assert_allclose(
        [float(row["signed_distance_mm"]) for row in written], 1e3 * expected, rtol=0, atol=1e-9
    )

    page.page.get_by_role("button", name="hide bracket").click()
    others = proximity.Scene(scene.parts)
    others.hide("bracket")
    changed = others.signed_distance(points)
    page.until(f"Math.abs(page.tools.points.distances[7] - {changed[7]}) < 1e-12")
    page.page.get_by_role("button", name="show bracket").click()
    page.page.get_by_role("button", name="Close").click()
    assert page.ask("page.tools.points.object === null")


def test_the_probe_answers_for_a_point_under_the_mouse_and_points_are_clipped(page, scene, tmp_path):
    seen = (
        "[...Array(900).keys()].map((k) => page.tools.points.under({ x: (k % 30) / 30 - 0.5, "
        "y: Math.floor(k / 30) / 30 - 0.5 })).filter((row) => row >= 0)"
    )
    rng = np.random.default_rng(48)
    points = rng.uniform(*scene.bounds, (5000, 3)).round(6)
    np.savetxt(tmp_path / "scan.csv", 1e3 * points, delimiter=",")
    page.page.locator("#points-file").set_input_files(tmp_path / "scan.csv")
    page.until("page.tools.points.object && !document.getElementById('points-card').hidden")
    page.ask("page.choose('probe')")

    page.until(f"!!({seen}).length")
    row = page.ask(
        "[...Array(900).keys()].some((k) => { page.probe.pointer.set((k % 30) / 30 - 0.5, "
        "Math.floor(k / 30) / 30 - 0.5); page.probe.update(); return page.probe.answer.point; }) && "
        "page.probe.answer.point"
    )
    k = int(row.removeprefix("#"))
    assert page.ask("page.probe.answer.distance") == page.ask(f"page.tools.points.distances[{k}]")
    assert f"{row} of scan.csv" in page.ask("document.getElementById('probe-side').textContent")
    assert (points[page.ask(seen), 1] < np.mean(scene.bounds, axis=0)[1] - 1e-3).any()

    page.page.keyboard.press("c")
    page.page.get_by_role("radio", name="y", exact=True).click()
    page.until("page.tools.points.object.material.clippingPlanes?.length === 1")
    assert (points[page.ask(seen), 1] > np.mean(scene.bounds, axis=0)[1] - 1e-3).all()
    page.picture("points-clipped")
    page.page.keyboard.press("Escape")
    page.page.get_by_role("button", name="Close").click()


def test_a_file_that_has_no_points_is_refused_with_its_line(page, tmp_path):
    (tmp_path / "wrong.csv").write_text("x,y,z\n1,2,3\n1,2,three\n")
    page.page.locator("#points-file").set_input_files(tmp_path / "wrong.csv")
    page.until(
        "document.getElementById('notice').textContent === "
        "'wrong.csv, line 3: expected three numbers, with decimal points.'"
    )


def test_the_mouse_is_a_hand_with_five_fingers(page, scene):
    has_mouse_hand(page)

    contacts = page.exact()

    same_as(scene, contacts)
    assert page.ask("page.reading.contacts.filter((each) => each.isKnown).map((each) => each.finger)") == [
        5, 6, 7, 8, 9,
    ]  # fmt: skip
    page.until("document.querySelectorAll('#fingers tbody tr').length === 5")
    page.until("page.link.latencies.length > 20")
    page.picture("mouse")


def test_keys_bend_the_hand_and_the_wheel_is_depth(page):
    has_mouse_hand(page)
    bend = "page.inputs.mouse.bends"
    assert max(page.ask(bend)) < 0.2

    page.page.keyboard.down("2")
    page.until(f"{bend}[1] > 0.9")
    assert page.ask(f"{bend}[2]") < 0.2
    page.picture("bent")
    page.page.keyboard.up("2")
    page.until(f"{bend}[1] < 0.2")

    before = page.until("page.inputs.mouse.joints?.get('wrist').position.toArray()")  # none yet if late
    page.page.mouse.wheel(0, -300)
    page.until(
        "(before) => page.inputs.mouse.joints?.get('wrist').position.toArray()"
        ".some((x, k) => Math.abs(x - before[k]) > 1e-4)",
        before,
    )
    assert page.ask("page.inputs.mouse.depth") > 0


def test_a_part_is_hidden_and_distances_do_not_know_it(page, scene):
    has_mouse_hand(page)
    page.page.get_by_role("button", name="hide bracket").click()
    page.until(
        "page.parts.list.filter((part) => !part.object.visible).map((part) => part.name).join() === 'bracket'"
    )
    page.page.wait_for_timeout(500)
    others = proximity.Scene(scene.parts)
    others.hide("bracket")

    same_as(others, page.exact())  # over the buttons the mouse leaves the hand at rest

    page.page.get_by_role("button", name="show bracket").click()
    page.until("page.parts.list.every((part) => part.object.visible)")
    page.page.wait_for_timeout(500)
    same_as(scene, page.exact())


def test_a_part_is_dragged_and_distances_follow(page, scene):
    has_mouse_hand(page)
    page.page.keyboard.press("Home")
    page.page.keyboard.press("m")
    place = page.ask(WHERE_IS, "bracket")
    page.page.mouse.move(*place)
    page.page.mouse.down()
    grasped = page.ask("page.tools.held?.part.name ?? null")
    assert grasped == "bracket"
    page.page.mouse.move(place[0] + 60, place[1] + 20, steps=4)
    moved = "page.parts.list.at(-1).object.matrix.elements"
    page.until(f"Math.hypot({moved}[12], {moved}[13], {moved}[14]) > 0.005")
    page.page.mouse.up()
    page.until("page.parts.waiting.length === 0 && page.parts.wanted.size === 0")
    page.page.mouse.move(*MIDDLE)
    page.page.wait_for_timeout(500)

    matrix = np.array(page.ask(moved)).reshape(4, 4).T
    elsewhere = proximity.Scene(scene.parts)
    elsewhere.move("bracket", matrix)
    page.picture("dragged")
    same_as(elsewhere, page.exact())

    page.page.keyboard.press("Home")
    page.until(f"{moved}[12] === 0 && {moved}[13] === 0")
    same_as(scene, page.exact())


def test_keys_move_a_picked_part(page):
    page.page.locator("#parts .name", has_text="bracket").click()
    page.page.keyboard.press("Shift+ArrowRight")
    moved = "page.parts.list.at(-1).object.matrix.elements"

    page.until(f"Math.abs({moved}[12] - 0.01) < 1e-9")

    page.page.keyboard.press("q")
    page.until(f"Math.abs({moved}[1] - Math.sin(Math.PI / 36)) < 1e-9")
    page.page.keyboard.press("Home")
    page.until(f"{moved}[12] === 0 && {moved}[1] === 0")


def test_nearest_parts_of_the_picked_one_are_shown(page, scene):
    page.page.locator("#parts .name").get_by_text("lid", exact=True).click()
    tight = "page.tools.nearest.found.every((each) => each.distance <= 1.01 * each.lower + 1e-9)"
    shown = "document.getElementById('tool-hint').textContent.startsWith('lid: ')"  # not of another part
    page.until(f"{shown} && page.tools.nearest.found.length >= 3 && {tight}")

    found = page.ask(
        "page.tools.nearest.found.map((each) => [each.part.name, each.lower, each.distance, each.relation])"
    )
    for name, lower, distance, relation in found:
        exact = scene.clearance("lid", name)
        assert lower <= exact.distance <= distance <= 1.01 * exact.distance
        assert list(proximity.Relation)[relation] == exact.relation
    nearest = scene.closest_pairs(of="lid", most=3)
    names = {name for pair in nearest for name in (pair.first, pair.second)} - {"lid"}
    assert names <= {name for name, *_ in found}
    page.picture("nearest")
    page.page.keyboard.press("Escape")
    page.until("page.tools.nearest.found.length === 0 && !page.tools.nearest.group.visible")


def test_a_moved_part_stops_at_contact(page, scene):
    """The pin is raised by 10 mm, then lowered by 15 mm: it stops on the lid, where it was."""
    pin = "page.parts.named('pin')"
    height = f"{pin}.object.matrix.elements[14]"
    raised = f"{pin}.object.matrix.clone().premultiply({pin}.initial.clone().makeTranslation(0, 0, SHIFT))"
    page.page.get_by_role("button", name="hide bracket").click()
    page.ask(f"void page.parts.ask({pin}, {raised.replace('SHIFT', '0.01')})")
    page.until(f"Math.abs({height} - {pin}.initial.elements[14] - 0.01) < 1e-9")
    page.page.get_by_label("A moved part stops at contact").check()

    page.ask(f"void page.parts.ask({pin}, {raised.replace('SHIFT', '-0.015')})")
    page.until(f"{height} - {pin}.initial.elements[14] < 0.005")

    apart = proximity.Scene([part for part in scene.parts if part.name != "bracket"])
    apart.move("pin", np.array(page.ask(f"{pin}.object.matrix.elements")).reshape(4, 4).T)
    assert 0.0 < apart.closest_pairs(of="pin", most=1)[0].distance < 2e-5

    page.ask(f"void page.parts.ask({pin}, {raised.replace('SHIFT', '0.002')})")  # up again
    page.until(f"{height} - {pin}.initial.elements[14] > 0.0015")
    page.page.get_by_label("A moved part stops at contact").uncheck()
    page.page.keyboard.press("Home")
    page.until(f"{height} === {pin}.initial.elements[14]")
    page.until("page.parts.list.every((part) => part.object.visible)")


def test_two_points_are_measured(page):
    page.page.get_by_role("button", name="Measure").click()
    page.ask("page.tools.measure.add(page.stage.box.min.clone())")

    said = page.ask("page.tools.measure.add(page.stage.box.min.clone().add({ x: 0.003, y: 0.004, z: 0 }))")

    assert said == "5.00 mm apart; along x, y, z: 3.00, 4.00, 0.00 mm."
    page.page.keyboard.press("Escape")
    assert page.ask("page.tools.measure.group.children.length") == 0


def test_two_parts_are_measured(page, scene):
    page.page.get_by_role("button", name="Measure").click()
    for name in ("pin", "pin_2"):
        page.page.locator("#parts .name").get_by_text(name, exact=True).click()

    page.until("document.getElementById('tool-hint').textContent.startsWith('pin and pin_2: ')")

    found = scene.clearance("pin", "pin_2")
    assert f"{1e3 * found.distance:.2f} mm apart" in page.ask(
        "document.getElementById('tool-hint').textContent"
    )
    page.picture("measured")
    page.page.keyboard.press("Escape")


def test_a_slice_of_the_signed_distance_is_seen(page):
    page.page.keyboard.press("c")
    page.page.keyboard.press("s")

    page.until("page.tools.plane.mesh.visible")

    assert page.ask("page.parts.list.at(-1).meshes[0].material.clippingPlanes.length") == 1
    first = page.ask("page.tools.plane.ticket")
    page.page.get_by_role("radio", name="z", exact=True).click()
    page.until(f"page.tools.plane.ticket > {first} && page.tools.plane.mesh.visible")
    page.page.wait_for_timeout(600)
    page.picture("slice")
    low, high = (page.ask(f"document.getElementById('legend-{end}').textContent") for end in ("low", "high"))
    deepest, farthest = float(low.removeprefix("−")), float(high.split(" mm, lines every ")[0])
    assert 0.0 < deepest < farthest, "inside has a scale of its own"

    # Without a part in front of it the probe stops at the slice.
    page.ask("page.choose('probe')")
    page.until("page.local.scene && page.probe.answer")
    found = page.ask(
        "[...Array(900).keys()].map((k) => { page.probe.pointer.set((k % 30) / 30 - 0.5, "
        "Math.floor(k / 30) / 30 - 0.5); page.probe.update(); "
        "return [page.probe.answer.position[2], page.probe.answer.distance]; })"
    )
    offset = page.ask("page.tools.plane.offset")
    on_slice = [distance for height, distance in found if abs(height - offset) < 1e-9]
    assert len(on_slice) > 100 and max(on_slice) > 1e-3


def test_a_picture_is_saved_and_a_link_opens_the_same_view(page, chromium):
    with page.page.expect_download(timeout=60_000) as saved:
        page.page.keyboard.press("p")
    assert saved.value.suggested_filename.endswith(".png")
    with open(saved.value.path(), "rb") as file:
        assert file.read(8) == b"\x89PNG\r\n\x1a\n"
    page.page.get_by_role("button", name="hide bracket").click()
    page.page.keyboard.press("-")
    page.page.keyboard.press("l")
    page.until("location.hash.includes('view=')")

    eye = "page.stage.camera.position.toArray()"
    with Page(chromium, page.page.url).ready() as other:
        other.until("page.parts.list.some((part) => !part.object.visible)")
        np.testing.assert_allclose(other.ask(eye), page.ask(eye), rtol=1e-4)


def test_without_hands_the_page_says_so(page):
    has_mouse_hand(page)
    page.until("document.getElementById('state').textContent === 'OK'")
    assert page.ask("document.getElementById('meaning').textContent") == "The right hand is tracked."

    page.page.get_by_role("radio", name="None").click()

    page.until("document.getElementById('state').textContent === 'NO HANDS'")
    page.until("page.fingers.shown.every((finger) => !finger.group.visible)")
    page.picture("no-hands")


def test_without_a_headset_a_sentence_says_so(page):
    page.page.get_by_role("radio", name="Headset").click()
    page.until("document.getElementById('input-hint').textContent.startsWith('No headset is connected')")
    assert page.ask("page.input") == "mouse"


def test_without_its_token_a_sentence_says_so(chromium, viewing):
    for url in (viewing.url.partition("#")[0], viewing.url.partition("#")[0] + "#token=wrong"):
        with Page(chromium, url) as page:
            page.until(
                "document.getElementById('cover-text').textContent.startsWith('The address has no token')"
            )
            assert all("403" in complaint for complaint in page.complaints)
            page.complaints.clear()


def test_everything_can_be_reached_by_the_keyboard(page):
    reached = set()
    for _ in range(40):
        page.page.keyboard.press("Tab")
        reached.add(page.ask("document.activeElement.id || document.activeElement.textContent"))

    assert {
        "canvas", "Probe", "Hand", "tool-move", "tool-measure", "tool-slice", "tool-help", "hide",
    } <= reached  # fmt: skip


# With a service


@pytest.fixture(scope="module")
def serving(tmp_path_factory):
    browsing.browser_path()
    folder = tmp_path_factory.mktemp("served")
    with contextlib.ExitStack() as opened:
        free = [opened.enter_context(socket.socket(type=socket.SOCK_DGRAM)) for _ in range(3)]
        for each in free:
            each.bind(("127.0.0.1", 0))
        poses, moves, changes = (f"udp://127.0.0.1:{each.getsockname()[1]}" for each in free)
    (folder / "cell.toml").write_text(
        f'[service]\nrate_hz = 200\nvalid_for = 0.1\npublish = "shm://page-{os.getpid()}"\n'
        "[fingers]\ncount = 10\n"
        f'[[parts]]\nfile = "{(MESHES / "bracket.stl").as_posix()}"\n[web]\nfeed = true\n'
        f'[input]\nposes = "{poses}"\nmoves = "{moves}"\nchanges = "{changes}"\n'
    )
    command = [
        sys.executable,
        "-m",
        "proximity",
        "serve",
        str(folder / "cell.toml"),
        "--web",
        "--until-stdin",
    ]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as running:
        running.url = next(line for line in running.stderr if "the page is at" in line).split()[-1]
        yield running
        running.communicate("")


@pytest.fixture(scope="module")
def beside(chromium, serving):
    with Page(chromium, serving.url).ready() as one:
        one.until("page.feeds && page.tools.mayMove")  # once the page of the previous test has left
        yield one


def test_a_second_page_watches_and_may_take_over(beside, chromium, serving):
    has_mouse_hand(beside)
    with Page(chromium, serving.url).ready() as second:
        second.until(KNOWN)
        second.until("document.getElementById('input-hint').textContent.startsWith('Another page sends')")
        second.page.get_by_role("radio", name="Hand").click()
        second.until("page.input === 'mouse' && page.feeds")
        beside.until("!page.feeds")
    beside.until("page.feeds")


def test_a_slice_is_of_parts_where_a_service_has_them(beside):
    moved = "page.parts.list[0].object.matrix.elements[12]"
    beside.page.locator("#parts .name", has_text="bracket").click()
    beside.page.keyboard.press("Shift+ArrowRight")
    beside.until(f"Math.abs({moved} - 0.01) < 1e-9")
    plane = "{ origin: [0, 0, 0.02], u: [0.1, 0, 0], v: [0, 0.1, 0], width: 3, height: 3 }"

    values = beside.ask(f"page.local.sliced({plane}, page.parts.list, () => true).then(Array.from)")

    grid = np.array([[0.05 * column, 0.05 * row, 0.02] for row in range(3) for column in range(3)])
    shifted = proximity.load(MESHES / "bracket.stl").signed_distance(grid - [0.01, 0, 0])
    np.testing.assert_allclose(values, shifted, rtol=0, atol=1e-15)
    beside.page.keyboard.press("Home")
    beside.until(f"{moved} === 0")


def test_the_path_of_a_finger_goes_through_its_tip(beside):
    has_mouse_hand(beside)

    offs = beside.until(
        "[...page.paths].map(([finger, path]) => { const tip = page.inputs.mouse.joints.get(['thumb-tip', "
        "'index-finger-tip', 'middle-finger-tip', 'ring-finger-tip', 'pinky-finger-tip'][finger - 5]"
        ").position.toArray(); let least = 1; for (let k = 0; k < 65; k++) least = Math.min(least, "
        "Math.hypot(...tip.map((x, i) => x - path[3 * k + i]))); return least; })"
    )

    assert len(offs) == 5
    assert max(offs) < 0.002  # half of the distance between two corners


@pytest.mark.skipif(os.name == "nt", reason="processes are stopped by signals")
def test_stale_is_shown_and_all_is_back_when_frames_come_again(beside, serving):
    has_mouse_hand(beside)
    beside.page.locator("#parts .name", has_text="bracket").click()
    beside.page.keyboard.press("Shift+ArrowRight")
    moved = "page.parts.list[0].object.matrix.elements[12]"
    beside.until(f"Math.abs({moved} - 0.01) < 1e-9")
    processes = [psutil.Process(serving.pid), *psutil.Process(serving.pid).children()]

    for process in processes:
        process.suspend()  # processes that hang
    try:
        beside.until(
            "page.reading.state === 'STALE' && document.getElementById('state').textContent === 'STALE'"
        )
        assert beside.contacts() == []
        beside.until(
            "[...document.querySelectorAll('#fingers td:nth-child(2)')].every((td) => td.textContent === '—')"
        )
        beside.picture("stale")
    finally:
        for process in processes:
            process.resume()
    beside.until(KNOWN)

    shifted = proximity.load(MESHES / "bracket.stl")
    shifted.move("bracket", [[1, 0, 0, 0.01], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    same_as(shifted, beside.exact())
    beside.page.keyboard.press("Home")
    beside.until(f"{moved} === 0")


def test_without_hands_a_service_is_not_called_stale(beside):
    beside.ask("page.choose('none')")
    beside.until("document.getElementById('state').textContent === 'NO HANDS'")
