"""Pictures: what is on them agrees with the scene; projection, shapes and colours on their own."""

import io
import math

import numpy as np
import pytest
import shapes
from PIL import Image
from project import MESHES

import proximity
from proximity.errors import QueryError
from proximity.scene.picture import Picture, page, surface_image, write_picture
from proximity.scene.picture.camera import TO_VIEWER, Camera, rotation_of
from proximity.scene.picture.distance_colors import DistanceColors
from proximity.scene.picture.field_slice import FieldSlice
from proximity.scene.picture.glyphs import sphere, tube
from proximity.scene.picture.scene_image import INK, triangles_of

pytest.importorskip("vtkmodules", reason="pictures need VTK: pip install cad-proximity[picture]")
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


# ------------------------------------------------------------------------------------------- the whole page


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
    image = pixels_of(page.draw(Picture(bracket, "bracket", cut=(axis, position), size=size)))
    left, bottom, width, height = page.slice_box(size, field)
    rng = np.random.default_rng(7)
    share = rng.uniform(0.03, 0.97, (400, 2))
    column = np.floor((left + share[:, 0] * width) * size[0]).astype(int)
    row = np.floor((1 - bottom - share[:, 1] * height) * size[1]).astype(int)

    # The middle of each pixel, back in the plane.
    first = ((column + 0.5) / size[0] - left) / width * (field.right[-1] - field.right[0]) + field.right[0]
    second = (1 - (row + 0.5) / size[1] - bottom) / height * (field.up[-1] - field.up[0]) + field.up[0]
    points = np.insert(np.stack([first, second], axis=1), "xyz".index(axis), position, axis=1)
    error = np.abs(image[row, column] - colors(bracket.signed_distance(points))).max(axis=1)

    # Lines, their labels and the surface are drawn over some of them.
    assert np.median(error) < 0.01
    assert (error < 0.04).mean() > 0.75


def test_parts_have_colours_of_their_own_and_hidden_ones_are_left_out():
    scene = proximity.load(MESHES / "assembly.step")
    names = [part.name for part in scene.parts]
    whole = page.draw(Picture(scene, "assembly", size=SIZE))
    scene.hide(names[1])

    assert page.draw(Picture(scene, "assembly", size=SIZE)) != whole
    for name in names:
        scene.hide(name)
    with pytest.raises(QueryError, match="all parts of the scene are hidden"):
        page.draw(Picture(scene, "assembly", size=SIZE))


def test_page_does_not_speak_of_an_inside_that_no_part_has(box, monkeypatch):
    written = []
    draw_map, draw_bar = page._draw_map, page._draw_bar
    monkeypatch.setattr(page, "_draw_map", lambda axes, *rest: (draw_map(axes, *rest), written.append(axes)))
    monkeypatch.setattr(
        page, "_draw_bar", lambda figure, axes, *rest: (draw_bar(figure, axes, *rest), written.append(axes))
    )
    tray = proximity.Solid(0.01 * shapes.open_box()[0], shapes.open_box()[1])

    for scene in (proximity.Scene([tray]), box):
        page.draw(Picture(scene, "scene", cut=("z", 0.005), size=SIZE))

    titles = [axes.get_title() or axes.get_ylabel() for axes in written]
    assert titles == [
        "Distance (no inside is known) at z = 5 mm",
        "mm, no inside is known",
        "Signed distance at z = 5 mm",
        "mm, negative inside",
    ]


def test_many_parts_and_long_names_are_cut_short(box):
    solid = box.parts[0].solid
    parts = [
        proximity.Part(
            "long name " * 9 + str(number), solid, proximity.Pose(None, [0.05 * number, 0, 0]), rows
        )
        for number, rows in enumerate([box.parts[0].source_faces] * 11)
    ]

    assert page.draw(Picture(proximity.Scene(parts), "row", size=SIZE)).startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"size": (100, 400)}, "a picture of 100x400 pixels, expected 200 to 4000 a side"),
        ({"view": "above"}, "no view 'above', expected one of iso, front, back, left, right, top, bottom"),
        ({"cut": ("w", 0.0)}, "a slice across 'w', expected one of x, y, z"),
        ({"cut": ("z", 3.0)}, "the slice at z = 3000 mm passes far from the parts: expected 0 to 20 mm"),
        (
            {"cut": ("z", 3.0), "unit": "cm", "metres": 0.01},
            "the slice at z = 300 cm passes far from the parts: expected 0 to 2 cm",
        ),
    ],
)
def test_what_cannot_be_drawn_is_refused(box, options, sentence):
    with pytest.raises(QueryError, match=sentence):
        page.draw(Picture(box, "box", **options))


def test_missing_vtk_is_reported_with_what_to_install(box, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "vtkmodules.vtkRenderingCore", None)

    with pytest.raises(QueryError, match=r'pictures need VTK.*pip install "cad-proximity\[picture\]"'):
        page.draw(Picture(box, "box", size=SIZE))


# -------------------------------------------------------------------------------------------------- the view


@pytest.mark.parametrize("view", TO_VIEWER)
def test_views_are_rotations_that_look_at_the_part(view):
    turn = rotation_of(view)

    assert np.allclose(turn @ turn.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    assert turn[1, 2] >= 0.0  # z is not upside down


def test_camera_shows_all_points_and_its_rays_pass_them():
    points = np.random.default_rng(3).uniform(-1.0, 2.0, (50, 3))
    camera = Camera.fitted("iso", points, (300, 200))
    pixels = camera.pixels(points)

    assert (pixels[:, :2] >= 0.0).all() and (pixels[:, :2] <= [300, 200]).all()
    starts, away = camera.rays()
    right, down = 120, 70
    again = camera.pixels(starts[down, right] + 5.0 * camera.meters_per_pixel * away)
    assert np.allclose(again, [right + 0.5, down + 0.5, 5.0])


def test_depth_of_a_box_is_that_of_its_faces(box):
    surface = triangles_of(box.parts, np.array([[0.5, 0.5, 0.5]]))
    camera = Camera.fitted("top", surface.vertices, (200, 200))
    image = surface_image.render(surface, camera)

    middle = image.depth[100, 100] * camera.meters_per_pixel
    assert middle == pytest.approx(-0.010, abs=1e-4)  # 10 mm nearer than the centre of a box 20 mm high
    assert np.isinf(image.depth[2, 2])
    width = np.isfinite(image.depth[100]).sum() * camera.meters_per_pixel
    assert width == pytest.approx(0.040, abs=3 * camera.meters_per_pixel)  # with the lines of its edges


@pytest.mark.parametrize("depth", [-0.03, 0.0, 0.013, 0.03])
def test_what_is_behind_the_middle_of_the_scene_is_drawn(depth):
    """Points that all lay in the rear half of the parts were left out: the eye looked the other way."""
    camera = Camera(rotation_of("top"), np.zeros(3), 1e-3, (100, 100))
    ball = sphere(np.array([0.0, 0.0, -depth]), 0.01, INK, 3)

    image = surface_image.render(ball, camera)

    assert image.depth.min() == pytest.approx(1e3 * depth - 10.0, abs=0.2)  # a pixel is a millimetre


# ----------------------------------------------------------------------------------------- shapes and colours


def test_spheres_are_closed_and_tubes_have_their_length():
    ball = sphere(np.array([1.0, 2.0, 3.0]), 0.5, INK, 2)
    assert np.allclose(np.linalg.norm(ball.vertices - [1.0, 2.0, 3.0], axis=1), 0.5)
    assert len(ball.faces) == 320 and len(ball.vertices) == 162
    a, b, c = (ball.vertices[ball.faces[:, corner]] - [1.0, 2.0, 3.0] for corner in range(3))
    assert np.linalg.det(np.stack([a, b, c], axis=1)).min() > 0.0

    pipe = tube(np.zeros(3), np.array([0.0, 3.0, 0.0]), 0.1, INK)
    assert np.ptp(pipe.vertices[:, 1]) == 3.0
    assert not len(tube(np.ones(3), np.ones(3), 0.1, INK).faces)


def test_colours_are_red_inside_white_on_the_surface_and_blue_outside():
    colors = DistanceColors(np.array([-0.004, 0.02, math.inf]), 1e-3)
    inside, surface, outside = colors(np.array([-0.004, 0.0, 0.02]))

    assert inside[0] > inside[2] and outside[2] > outside[0]
    assert surface.min() > 0.95
    assert colors.levels[0] <= -4.0 and colors.levels[-1] >= 20.0
    assert (colors(np.array([math.nan])) == 0.5).all()


def test_field_between_grid_points_is_linear(box):
    field = FieldSlice.of(box, "z", 0.01)
    row, column = 100, 130
    low, high = field.signed_distance[row, column : column + 2]
    point = [(field.right[column] + field.right[column + 1]) / 2, field.up[row], 0.01]

    assert field.at(np.array(point)) == pytest.approx((low + high) / 2, abs=1e-12)
    assert np.isnan(field.at(np.array([9.0, 0.0, 0.01])))
