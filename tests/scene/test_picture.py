"""Pictures: agreement with the scene, projection, shapes and colours."""

import io
import math

import numpy as np
import pytest
import shapes
from PIL import Image
from project import MESHES

import proximity
from proximity.errors import ArgumentError, MissingLibraryError
from proximity.scene.picture import Picture, sheet, write_picture
from proximity.scene.picture.distance_field import DistanceColors, FieldSlice
from proximity.scene.picture.scene_view import TO_VIEWER, Camera, Connections, draw_scene, rotation_of
from proximity.scene.picture.thickness_map import draw_thickness

pytest.importorskip("pyvista", reason="pictures need PyVista: pip install cad-proximity[picture]")
pytest.importorskip("matplotlib", reason="pictures need matplotlib: pip install cad-proximity[picture]")

SIZE = (700, 400)


@pytest.fixture(scope="module")
def bracket():
    return proximity.load(MESHES / "bracket.stl")


@pytest.fixture(scope="module")
def box():
    return proximity.load(MESHES / "box.stl")


def pixels_of(content):
    image = Image.open(io.BytesIO(content))
    assert image.format == "PNG"
    return np.asarray(image.convert("RGB")) / 255.0


def test_picture_is_a_png_of_the_size_asked_for(bracket, tmp_path):
    points = np.array([[26.0, -14.0, 22.0], [30.0, 10.0, 2.0], [math.nan, 0.0, 0.0]]) / 1e3

    write_picture(Picture(bracket, "bracket", points, ("z", 0.027), size=SIZE), tmp_path / "picture.png")

    image = pixels_of((tmp_path / "picture.png").read_bytes())
    assert image.shape == (SIZE[1], SIZE[0], 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 2000


@pytest.mark.parametrize(("axis", "position"), [("x", 0.03), ("y", 0.01), ("z", 0.027)])
def test_colours_of_the_map_are_those_of_the_scenes_distances(bracket, axis, position):
    field = FieldSlice.of(bracket, axis, position)
    colors = DistanceColors(field.signed_distance.reshape(-1), 1e-3)
    size = (1400, 800)
    image = pixels_of(sheet.draw(Picture(bracket, "bracket", cut=(axis, position), size=size)))
    left, bottom, width, height = sheet.slice_box(size, field)
    rng = np.random.default_rng(7)
    share = rng.uniform(0.03, 0.97, (400, 2))
    column = np.floor((left + share[:, 0] * width) * size[0]).astype(int)
    row = np.floor((1 - bottom - share[:, 1] * height) * size[1]).astype(int)

    # The centre of each pixel, transformed back to the plane.
    first = ((column + 0.5) / size[0] - left) / width * (field.right[-1] - field.right[0]) + field.right[0]
    second = (1 - (row + 0.5) / size[1] - bottom) / height * (field.up[-1] - field.up[0]) + field.up[0]
    points = np.insert(np.stack([first, second], axis=1), "xyz".index(axis), position, axis=1)
    error = np.abs(image[row, column] - colors(bracket.signed_distance(points))).max(axis=1)

    # Lines, labels and the surface cover some of them.
    assert np.median(error) < 0.01
    assert (error < 0.04).mean() > 0.75


def test_parts_have_colours_of_their_own_and_hidden_ones_are_left_out():
    scene = proximity.load(MESHES / "assembly.step")
    names = [part.name for part in scene.parts]
    whole = sheet.draw(Picture(scene, "assembly", size=SIZE))
    scene.hide(names[1])

    assert sheet.draw(Picture(scene, "assembly", size=SIZE)) != whole
    for name in names:
        scene.hide(name)
    with pytest.raises(ArgumentError, match="all parts of the scene are hidden"):
        sheet.draw(Picture(scene, "assembly", size=SIZE))


def test_page_does_not_speak_of_an_inside_that_no_part_has(box, monkeypatch):
    written = []
    draw_map, draw_bar = sheet._draw_map, sheet._draw_bar
    monkeypatch.setattr(sheet, "_draw_map", lambda axes, *rest: (draw_map(axes, *rest), written.append(axes)))
    monkeypatch.setattr(
        sheet, "_draw_bar", lambda figure, axes, *rest: (draw_bar(figure, axes, *rest), written.append(axes))
    )
    tray = proximity.Solid(0.01 * shapes.open_box()[0], shapes.open_box()[1])

    for scene in (proximity.Scene([tray]), box):
        sheet.draw(Picture(scene, "scene", cut=("z", 0.005), size=SIZE))

    titles = [axes.get_title() or axes.get_ylabel() for axes in written]
    assert titles == [
        "Distance (no inside is known) at z = 5 mm",
        "mm, no inside is known",
        "Signed distance at z = 5 mm",
        "mm, negative inside",
    ]


def test_points_beside_a_slice_have_a_scale_of_their_own(box, monkeypatch):
    levels = []
    draw_bar = sheet._draw_bar
    monkeypatch.setattr(
        sheet, "_draw_bar",
        lambda *given, **more: (draw_bar(*given, **more), levels.append(given[3].levels[[0, -1]].tolist())),
    )  # fmt: skip
    near = np.array([[0.02, 0.015, -4e-5], [0.02, 0.015, 2e-5]])

    for reach in (None, (-2.5e-5, 2.5e-5)):
        sheet.draw(Picture(box, "box", near, ("z", 0.005), size=SIZE, reach=reach))

    assert levels[1] == pytest.approx([-0.04, 0.04]) and levels[3] == pytest.approx([-0.025, 0.025])
    assert levels[0] == levels[2] and levels[0][1] > 1.0


@pytest.mark.parametrize(
    ("reach", "words"),
    [
        (None, None),
        ((-2.5e-5, 2.5e-5), "66.6 % within ±0.025 mm"),
        ((-5e-5, 1e-5), "33.3 % within \N{MINUS SIGN}0.05 to 0.01 mm"),
    ],
)
@pytest.mark.parametrize("cut", [None, ("z", 0.005)])
def test_share_of_points_within_the_bar_is_written_on_the_page_and_nothing_is_cut_off(
    box, monkeypatch, reach, words, cut
):
    figures, make = [], sheet._figure
    monkeypatch.setattr(sheet, "_figure", lambda *given: figures.append(make(*given)) or figures[-1])
    points = np.array([[0.02, 0.015, height] for height in (4e-5, -2e-5, -2.2e-5)])  # of the lowest face
    sheet.draw(Picture(box, "box", points, cut, size=(640, 360), reach=reach))

    (figure,) = figures
    agg = pytest.importorskip("matplotlib.backends.backend_agg")
    renderer = agg.FigureCanvasAgg(figure).get_renderer()
    labels = [label for axes in figure.axes[1:] for label in (axes.yaxis.label, axes.xaxis.label)]
    (label,) = (label for label in labels[-2:] if "negative inside" in label.get_text())
    assert (words is None) == ("within" not in label.get_text()) and (words or "") in label.get_text()
    for text in labels:
        extent = text.get_window_extent(renderer)
        assert extent.x0 >= 0 and extent.x1 <= figure.bbox.width and extent.y1 <= figure.bbox.height


def test_points_of_one_side_have_zero_in_the_middle_of_the_colours():
    # Regression: the bar ranged from -0.1 to 0.3 for deviations up to 0.3 mm.
    distances = np.array([-8e-5, 3e-4])
    assert DistanceColors(distances, 1e-3, is_even=True).levels[[0, -1]] == pytest.approx([-0.3, 0.3])
    uneven = DistanceColors(distances, 1e-3, is_even=True, reach=(-5e-5, 2e-4))
    assert uneven.levels[[0, -1]] == pytest.approx([-0.05, 0.2])
    assert uneven.share(distances) == 0.0 and uneven.share(np.array([0.0, 1e-4, 3e-4, -5e-5])) == 0.75
    for colors in (uneven, DistanceColors(distances, 1e-3, is_even=True)):
        assert colors(np.array([0.0])).min() > 0.95


def test_many_parts_and_long_names_are_cut_short(box):
    solid = box.parts[0].solid
    parts = [
        proximity.Part(
            "long name " * 9 + str(number), solid, proximity.Pose(None, [0.05 * number, 0, 0]), rows
        )
        for number, rows in enumerate([box.parts[0].source_faces] * 11)
    ]

    assert sheet.draw(Picture(proximity.Scene(parts), "row", size=SIZE)).startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"size": (100, 400)}, "a picture of 100x400 pixels, expected 200 to 4000 a side"),
        ({"view": "above"}, "no view 'above', expected one of iso, front, back, left, right, top, bottom"),
        ({"cut": ("w", 0.0)}, "a slice across 'w', expected one of x, y, z"),
        ({"cut": ("z", 3.0)}, "the slice at z = 3000 mm passes far from the parts: expected 0 to 20 mm"),
        ({"cut": ("z", 3.0), "unit": "cm", "metres": 0.01},
         "the slice at z = 300 cm passes far from the parts: expected 0 to 2 cm"),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_is_refused(box, options, sentence):
    with pytest.raises(ArgumentError, match=sentence):
        sheet.draw(Picture(box, "box", **options))


def test_missing_pyvista_is_reported_with_what_to_install(box, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "pyvista", None)

    with pytest.raises(
        MissingLibraryError, match=r'pictures need PyVista.*pip install "cad-proximity\[picture\]"'
    ):
        sheet.draw(Picture(box, "box", size=SIZE))


@pytest.mark.parametrize("view", TO_VIEWER)
def test_views_are_rotations_that_look_at_the_part(view):
    turn = rotation_of(view)

    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert turn[1, 2] >= 0.0  # z is not upside down


def test_camera_shows_all_points():
    points = np.random.default_rng(3).uniform(-1.0, 2.0, (50, 3))
    pixels = Camera.fitted("iso", points, (300, 200)).pixels(points)

    assert (pixels >= 0.0).all() and (pixels <= [300, 200]).all()
    share = np.ptp(pixels, axis=0) / [300, 200]
    assert share.max() == pytest.approx(0.8)


def drawn(scene, camera, points=None):
    """Draw the parts without shading; return the mask of pixels that are not white, and the image."""
    connections = None
    if points is not None:
        hit = scene.closest(points)
        connections = Connections(points, hit.point, hit.signed_distance)
    tints = ["#a9bdd1"] * len(scene.parts)
    colors = DistanceColors(np.ones(1), 1e-3)
    image = draw_scene(scene.parts, tints, connections, None, camera, (colors, colors))
    return (image < 250).any(axis=-1), image


@pytest.mark.parametrize("offset", [0.0, 1000.0])
def test_a_part_is_drawn_where_its_corners_are_and_as_large(box, offset):
    """Includes a kilometre from the origin, where single precision resolves 60 micrometres."""
    pose = proximity.Pose(None, [offset, 0.0, 0.0])
    scene = proximity.Scene([proximity.Part("box", box.parts[0].solid, pose, box.parts[0].source_faces)])
    vertices = pose.point(box.parts[0].solid.mesh.vertices)
    camera = Camera.fitted("top", vertices, (200, 200))
    is_drawn, _ = drawn(scene, camera)

    rows, columns = np.nonzero(is_drawn)
    right, down = camera.pixels(vertices).T
    assert (columns.min(), columns.max() + 1) == pytest.approx((right.min(), right.max()), abs=2)
    assert (rows.min(), rows.max() + 1) == pytest.approx((down.min(), down.max()), abs=2)


@pytest.mark.parametrize("height", [-0.05, 0.01, 0.05])
def test_points_are_seen_before_behind_and_through_the_part(box, height):
    """Regression: the view direction was reversed, and points in the rear half of the parts were omitted."""
    camera = Camera(rotation_of("top"), np.array([0.02, 0.015, 0.0]), 5e-4, (120, 120))
    point = np.array([[0.02, 0.015, height]])
    without, plain = drawn(box, camera)
    _, image = drawn(box, camera, point)

    right, down = camera.pixels(point)[0].astype(int)
    assert without[down, right]
    assert np.abs(image[down, right].astype(int) - plain[down, right]).max() > 10


def test_colours_are_red_inside_white_on_the_surface_and_blue_outside():
    colors = DistanceColors(np.array([-0.004, 0.02, math.inf]), 1e-3)
    inside, surface, outside = colors(np.array([-0.004, 0.0, 0.02]))

    assert inside[0] > inside[2] and outside[2] > outside[0]
    assert surface.min() > 0.95
    assert colors.levels[0] <= -4.0 and colors.levels[-1] >= 20.0
    assert (colors(np.array([math.nan])) == 0.5).all()


def test_thickness_is_red_below_the_limit_and_blue_above():
    scene = proximity.Scene([proximity.Solid(*shapes.box((0, 0, 0), (10, 10, 1)))])
    for limit, is_red in ((4.0, True), (0.3, False)):
        walls = scene.parts[0].thin_places(below=limit)
        views = pixels_of(draw_thickness(scene, [walls], limit, unit="m", metres=1.0))[:, :1300].reshape(
            -1, 3
        )
        red, _, blue = views[np.ptp(views, axis=1) > 0.25].T
        assert ((red > blue).sum() > 2 * (blue > red).sum()) == is_red


def test_thickness_of_a_part_without_walls_is_grey():
    scene = proximity.Scene([proximity.Solid(*shapes.tetrahedron())])
    walls = scene.parts[0].thin_places(below=1.0, wall_angle=0.1)
    image = pixels_of(draw_thickness(scene, [walls], 1.0, unit="m", metres=1.0))
    views = image[:420, :1300].reshape(-1, 3)  # without the axes and the bar

    assert np.ptp(views, axis=1).max() < 0.1 < np.ptp(views)
