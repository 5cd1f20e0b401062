"""Deviations of STEP files from their CAD surfaces, against closed forms and dense samples."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
import step_text
from mesh_reading import read as read_file

import proximity
from proximity.formats.contents import RawFile, RawMesh
from proximity.formats.step import cad_faces, chords, conversion, deviation, step, surface_distance
from proximity.formats.step.entities import parsed
from proximity.formats.step.shapes import Shape, Spline, extruded, revolved
from proximity.formats.step.step_records import StepText
from proximity.formats.step.surface_distance import Surfaces
from proximity.scene import clashes, pairs

SHARES = np.array([(i, j, 12 - i - j) for i in range(13) for j in range(13 - i)]) / 12
"""Barycentric coordinates of points in a triangle."""


@pytest.fixture(scope="module", autouse=True)
def one_process():
    """Convert all files in one process."""
    with conversion.converter():
        yield


def read(tmp_path, text, **options):
    (part,) = read_file(tmp_path, "part.step", text, **options).geometries
    return part


def rotation(random):
    """Return a random rotation, (3, 3)."""
    matrix, _ = np.linalg.qr(random.normal(size=(3, 3)))
    return matrix * np.sign(np.linalg.det(matrix))


def points_in(triangles):
    return np.einsum("sk,nkc->nsc", SHARES, triangles)


# --- records ---


def test_records_of_both_forms_are_parsed():
    assert parsed("CIRCLE('' ,#12, -5.E-1)".replace("''", "  ")) == {"CIRCLE": [None, "#12", -0.5]}
    assert parsed("( A(3,((#1,#2),(#3,#4)),.F.) B() C((1.,.5E1)) )".replace(".5E1", "0.5E1")) == {
        "A": [3.0, [["#1", "#2"], ["#3", "#4"]], ".F."],
        "B": [],
        "C": [[1.0, 5.0]],
    }
    assert parsed("X(LENGTH_MEASURE(25.4),#9,$,*)")["LENGTH_MEASURE"] == [25.4]


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("m", 1.0), ("in", 0.0254), (None, 1e-3)])
def test_faces_are_read_in_metres(unit, metres):
    ((body,),) = cad_faces.read_bodies(StepText(step_text.box_step((1, 2, 3), unit)))

    assert [face.surface.kind for face in body.faces] == ["plane"] * 6
    origins = np.array([face.surface.origin for face in body.faces])
    assert np.abs(origins).max(axis=0) == pytest.approx([metres, 2 * metres, 3 * metres])
    assert all(len(face.edges) == 4 for face in body.faces)


def test_angles_in_degrees_are_read():
    text = step_text.box_step((1, 2, 3))
    radian = re.search(
        r"(#\d+) = \( NAMED_UNIT\(\*\) PLANE_ANGLE_UNIT\(\) SI_UNIT\(\$,\.RADIAN\.\) \);", text
    )
    degree = (
        f"#901 = {radian[0].partition('= ')[2]}\n#902 = PLANE_ANGLE_MEASURE_WITH_UNIT(PLANE_ANGLE_MEASURE("
        f"0.017453292519943295),#901);\n{radian[1]} = ( CONVERSION_BASED_UNIT('DEGREE',#902) NAMED_UNIT(*) "
        "PLANE_ANGLE_UNIT() );"
    )
    text = text.replace(radian[0], degree)
    plane = re.search(r"PLANE\('',(#\d+)\)", text)
    text = text.replace(plane[0], f"CONICAL_SURFACE('',{plane[1]},2.,45.)", 1)

    ((body,),) = cad_faces.read_bodies(StepText(text))

    assert (body.faces[0].surface.kind, body.faces[0].surface.size) == ("cone", 0.002)
    assert body.faces[0].surface.second == pytest.approx(1.0)


# --- triangles with corners on surfaces of elementary form ---


def on_surface(kind, size, second, along, around):
    """Return points of a surface about z at parameters."""
    if kind == "cone":
        radius, height = size + second * along, along
    elif kind == "sphere":
        radius, height = size * np.cos(along), size * np.sin(along)
    else:
        radius, height = size + second * np.cos(along), second * np.sin(along)
    return np.stack([radius * np.cos(around), radius * np.sin(around), height], axis=-1)


@pytest.mark.parametrize(
    ("kind", "size", "second", "lower", "upper", "widest"),
    [
        ("cone", 2.0, 0.0, -3.0, 3.0, 1.0),
        ("cone", 2.0, 0.7, -2.0, 3.0, 1.0),
        ("cone", 2.0, -0.3, -3.0, 6.0, 1.0),
        ("cone", 0.0, 4.0, 0.0, 1.0, 1.0),
        ("sphere", 3.0, 0.0, -1.5, 1.5, 1.0),
        ("torus", 3.0, 1.0, -3.1, 3.1, 0.3),
        ("torus", 30.0, 0.2, -3.1, 3.1, 0.02),
    ],
)
def test_bounds_of_triangles_contain_dense_samples(kind, size, second, lower, upper, widest):
    random = np.random.default_rng(7)
    count = 60
    middle = random.uniform(lower, upper, (count, 1)), random.uniform(-3, 3, (count, 1))
    spread = widest * 10.0 ** random.uniform(-2, 0, (count, 1))
    along = np.clip(middle[0] + spread * random.uniform(-1, 1, (count, 3)), lower, upper)
    around = middle[1] + 0.5 * spread * random.uniform(-1, 1, (count, 3))
    turn, origin = rotation(random), random.normal(size=3)
    triangles = on_surface(kind, size, second, along, around) @ turn.T + origin
    surfaces = Surfaces(
        np.tile(origin, (count, 1)),
        np.tile(turn[:, 2], (count, 1)),
        np.full(count, size),
        np.full(count, second),
    )

    distances = surface_distance.signed_distances(kind, surfaces, triangles)
    bounds = surface_distance.upper_bounds(kind, surfaces, triangles, np.arange(count), distances)
    found = np.abs(surface_distance.signed_distances(kind, surfaces, points_in(triangles))).max(axis=1)

    assert (bounds >= found - 1e-14).all()
    ratios = (bounds / np.maximum(found, 1e-12))[found > 1e-6]
    is_thin = kind == "torus" and second < 0.1 * size  # subdivision ends at a number of triangles
    assert np.median(ratios) < (1.5 if is_thin else 1.15)
    assert np.quantile(ratios, 0.95) < (4.0 if is_thin else 2.0)


def test_cone_that_is_pierced_by_its_axis_is_bounded_by_its_radius():
    triangle = np.array([[[2.0, 0, 0], [-1, np.sqrt(3), 0], [-1, -np.sqrt(3), 0]]])
    surfaces = Surfaces(np.zeros((1, 3)), np.array([[0.0, 0, 1]]), np.array([2.0]), np.zeros(1))

    bounds = surface_distance.upper_bounds("cone", surfaces, triangle, np.zeros(1, int), np.zeros((1, 3)))

    assert bounds == pytest.approx(2.0)


# --- splines ---

interpolate = pytest.importorskip("scipy.interpolate")
spatial = pytest.importorskip("scipy.spatial")


def bump(weights=None):
    """Return a bicubic surface over the unit square, in m, with a bump."""
    axis = np.linspace(0.0, 1.0, 6)
    x, y = np.meshgrid(axis, axis, indexing="ij")
    z = 0.3 * np.sin(3 * x) * np.cos(2 * y)
    weights = np.ones_like(x) if weights is None else weights
    knots = np.array([0, 0, 0, 0, 1 / 3, 2 / 3, 1, 1, 1, 1.0])
    net = np.stack([x, y, z], axis=-1) * weights[..., None]
    return Spline((3, 3), (knots, knots), np.concatenate([net, weights[..., None]], axis=-1))


@pytest.mark.parametrize("is_rational", [False, True])
def test_spline_has_the_points_of_scipy(is_rational):
    from proximity.formats.step.spline_distance import SplineShape

    weights = 1.0 + np.random.default_rng(1).uniform(0, 1, (6, 6)) if is_rational else None
    spline = bump(weights)
    parameters = np.random.default_rng(2).uniform(0, 1, (50, 2))
    reference = interpolate.NdBSpline(spline.knots, spline.control, (3, 3))(parameters)
    shape = SplineShape(spline)

    points, slopes = shape.points_and_slopes(parameters)
    step = 1e-6
    ahead = shape.points(np.minimum(parameters + np.array([step, 0.0]), 1.0))

    assert points == pytest.approx(reference[:, :3] / reference[:, 3:], abs=1e-12)
    assert slopes[:, 0] == pytest.approx((ahead - points) / step, abs=1e-4)


@pytest.mark.parametrize("is_rational", [False, True])
@pytest.mark.parametrize("count", [4, 12])
def test_bound_of_spline_is_near_the_largest_distance(is_rational, count):
    from proximity.formats.step.spline_distance import SplineShape, surface_bound

    weights = 1.0 + np.random.default_rng(1).uniform(0, 0.5, (6, 6)) if is_rational else None
    shape = SplineShape(bump(weights))
    axis = np.linspace(0.0, 1.0, count + 1)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    parameters = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 2) for t in ((a, b, c), (a, c, d))])
    triangles = shape.points(parameters.reshape(-1, 2)).reshape(-1, 3, 3)

    bound = surface_bound(shape, triangles)
    points = points_in(triangles).reshape(-1, 3)
    fine = np.linspace(0.0, 1.0, 400)
    dense = shape.points(np.stack(np.meshgrid(fine, fine, indexing="ij"), axis=-1).reshape(-1, 2))
    true = spatial.cKDTree(dense).query(points)[0].max()

    assert true * 0.99 <= bound <= 1.3 * true + 1e-5


def largest_distance(shape, triangles, count=500):
    """Return bounds of the largest distance of points of triangles from a surface, by dense points of it."""
    axes = [np.linspace(low, high, count) for low, high in zip(shape.lower, shape.upper, strict=True)]
    dense = shape.points(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2))
    net = dense.reshape(count, count, 3)
    steps = [np.linalg.norm(np.diff(net, axis=axis), axis=2).max() for axis in (0, 1)]
    points = shape.flattened(points_in(triangles)).reshape(-1, 3)
    found = spatial.cKDTree(dense).query(points)[0].max()
    return np.sqrt(max(found**2 - np.hypot(*steps) ** 2, 0.0)), found


def grid_of_triangles(function, us, vs):
    """Return the triangles between the points of a surface at a grid of parameters."""
    points = np.array([[function(u, v) for v in vs] for u in us])
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[1:, 1:], points[:-1, 1:]
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])


@pytest.mark.parametrize("offset", [0.0, 0.03])
def test_spline_with_a_kink_is_bounded_piece_by_piece(offset):
    """Triangles end at the kink in the middle, or cross it."""
    from proximity.formats.step.spline_distance import SplineShape, surface_bound

    knots = np.array([0, 0, 0, 0.5, 0.5, 1, 1, 1]), np.array([0, 0, 1, 1.0])
    profile = np.array([[0, 0], [0.2, 0.3], [0.5, 0.4], [0.7, 0.1], [1.0, 0.1]])
    net = np.array([[[x, y, z, 1.0] for y in (0.0, 1.0)] for x, z in profile])
    shape = SplineShape(Spline((2, 1), knots, net))
    axis = np.linspace(0.0, 1.0, 13)
    axis[1:-1] += offset
    triangles = grid_of_triangles(lambda u, v: shape.points(np.array([[u, v]]))[0], axis, (0.0, 1.0))

    bound, (lower, upper) = surface_bound(shape, triangles), largest_distance(shape, triangles)

    assert lower <= bound <= (1.3 if offset == 0.0 else 1.6) * upper
    assert (bound < 0.003) == (offset == 0.0)


def test_spline_with_a_gap_is_not_bounded():
    from proximity.formats.step.spline_distance import SplineShape, surface_bound

    knots = np.array([0, 0, 0.5, 0.5, 1, 1.0])
    control = np.concatenate([np.random.default_rng(0).uniform(size=(4, 4, 3)), np.ones((4, 4, 1))], axis=2)

    assert surface_bound(SplineShape(Spline((1, 1), (knots, knots), control)), np.zeros((1, 3, 3))) == np.inf


# --- swept surfaces ---

AXIS = np.array([0.0, 0.0, 1.0])
BENT = Spline(
    (2, 0),
    (np.array([0, 0, 0, 1, 1, 1.0]), np.array([0.0, 1.0])),
    np.array([[[0.02, 0, 0, 1.0]], [[0.035, 0, 0.02, 1.0]], [[0.015, 0, 0.03, 1.0]]]),
)


@pytest.mark.parametrize(
    ("profile", "kind", "size", "second"),
    [
        (Shape("line", "LINE", np.array([0, -3.0, 5]), np.array([0, 0.6, 0.8])), "cone", 3.0, -0.75),
        (Shape("line", "LINE", np.array([2.0, 0, 5]), AXIS), "cone", 2.0, 0.0),
        (Shape("line", "LINE", np.array([2.0, 0, 5]), np.array([0, 1.0, 0])), "plane", 0.0, 0.0),
        (Shape("line", "LINE", np.array([2.0, 0, 5]), np.array([0, 0.6, 0.8])), None, 0.0, 0.0),
        (Shape("circle", "CIRCLE", np.array([0, 0, 5.0]), np.eye(3)[1], size=2.0), "sphere", 2.0, 0.0),
        (Shape("circle", "CIRCLE", np.array([4.0, 0, 5]), np.eye(3)[1], size=2.0), "torus", 4.0, 2.0),
        (Shape("circle", "CIRCLE", np.array([1.0, 0, 5]), np.eye(3)[1], size=2.0), "spline", 0.0, 0.0),
        (Shape("other", "X"), None, 0.0, 0.0),
    ],
)
def test_lines_and_circles_turn_to_surfaces_of_elementary_form(profile, kind, size, second):
    found = revolved(profile, np.zeros(3), AXIS, "SURFACE_OF_REVOLUTION")

    assert (found and found.kind) == kind
    if found is not None:
        assert (found.size, found.second) == pytest.approx((size, second))


def test_lines_and_circles_are_extruded_to_planes_and_cylinders():
    circle = Shape("circle", "CIRCLE", np.ones(3), AXIS, size=2.0)

    assert extruded(circle, -AXIS, "X").kind == "cone"
    assert extruded(Shape("line", "LINE", axis=np.eye(3)[0]), AXIS, "X").axis @ np.eye(3)[0] == 0.0
    assert extruded(Shape("line", "LINE", axis=AXIS), AXIS, "X") is None


@pytest.mark.parametrize(
    "profile",
    [
        Shape("spline", "B_SPLINE_CURVE", spline=BENT),
        Shape("ellipse", "ELLIPSE", np.array([0.05, 0, 0]), -np.eye(3)[1], size=0.02, second=0.01),
    ],
)
@pytest.mark.parametrize("is_turned", [True, False])
def test_bounds_of_swept_curves_are_near_the_largest_distance(profile, is_turned):
    from proximity.formats.step.spline_distance import shape_of, surface_bound

    direction = np.array([0.48, 0.6, 0.64])
    surface = revolved(profile, np.zeros(3), AXIS, "X") if is_turned else extruded(profile, direction, "X")
    curve = shape_of(profile.spline or extruded(profile, np.eye(3)[1], "X").spline)

    def point(u, v):
        radius, _, height = curve.points(np.array([[u, 0.0]]))[0]
        if is_turned:
            return np.array([radius * np.cos(v), radius * np.sin(v), height])
        return np.array([radius, 0.0, height]) + 0.02 * v * direction

    us = np.linspace(curve.lower[0], curve.upper[0], 13)
    triangles = grid_of_triangles(point, us, np.linspace(0.0, 3.5, 9))
    shape = shape_of(surface.spline)
    bound, (lower, upper) = surface_bound(shape, triangles), largest_distance(shape, triangles, 400)

    assert lower <= bound <= 1.2 * upper


def test_corners_next_to_the_seam_of_a_closed_surface_are_on_it():
    from proximity.formats.step.spline_distance import shape_of

    shape = shape_of(revolved(Shape("spline", "X", spline=BENT), np.zeros(3), AXIS, "X").spline)
    angles = np.array([-0.03, -1e-3, 0.0, 1e-3, 0.03])
    points = np.stack([0.02 * np.cos(angles), 0.02 * np.sin(angles), np.zeros(5)], axis=1)

    assert shape.distances(points[:, None], shape.nearest_parameters(points)[:, None]).max() < 1e-12


# --- files ---


@pytest.mark.parametrize("radius", [1.0, 10.0, 300.0])
def test_ball_deviates_by_its_deepest_triangle(tmp_path, radius):
    part = read(tmp_path, step_text.ball_step(radius))
    distances = np.linalg.norm(points_in(part.vertices[part.faces]), axis=-1)
    true = np.abs(distances - radius * 1e-3).max()

    assert len(part.deviations) == 1
    assert true * 0.999 <= part.deviations[0] <= 1.05 * true + 1e-7 * radius * 1e-3
    assert part.deviations[0] <= (1e-5 if radius < 100.0 else 1e-4)  # limited by the number of triangles


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("m", 1.0), ("in", 0.0254), (None, 1e-3)])
def test_box_deviates_by_the_rounding_of_positions(tmp_path, unit, metres):
    part = read(tmp_path, step_text.box_step((1, 2, 3), unit))

    assert len(part.deviations) == 6
    assert part.deviations.max() <= 1e-6 * metres


def test_turned_curve_is_bounded(tmp_path):
    profile = [(10.0, 0.0), (16.0, 8.0), (5.0, 16.0), (9.0, 24.0)]
    part = read(tmp_path, step_text.vase_step(profile), step_tolerance=1e-4)
    t = np.linspace(0.0, 1.0, 20_001)[:, None]
    weights = np.concatenate([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t * t * (1 - t), t**3], axis=1)
    curve = 1e-3 * weights @ np.array(profile)
    points = points_in(part.vertices[part.faces[part.source_faces == 2]]).reshape(-1, 3)
    flat = np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=1)
    true = spatial.cKDTree(curve).query(flat)[0].max()

    assert len(part.deviations) == 3
    assert 0.98 * true <= part.deviations[2] <= 1.6 * true + 1e-7


def test_scale_multiplies_the_deviation(tmp_path):
    small, large = (read(tmp_path, step_text.ball_step(10.0), scale=scale) for scale in (1.0, 3.0))

    assert large.deviations == pytest.approx(3.0 * small.deviations)


def test_surface_that_is_not_read_has_no_bound_and_a_note(tmp_path):
    text = step_text.box_step((1, 2, 3))
    plane = re.search(r"(#\d+) = PLANE\('',#\d+\);", text)
    offset = f"#999 = {plane[0].partition('= ')[2]}\n{plane[1]} = OFFSET_SURFACE('',#999,0.,.F.);"
    contents = read_file(tmp_path, "part.step", text.replace(plane[0], offset))

    (part,) = contents.geometries
    assert np.isinf(part.deviations).sum() == 1
    (note,) = [note for note in contents.notes if "not bounded" in note]
    assert re.search(r"faces #\d+ \(OFFSET_SURFACE\): surfaces of this type are not bounded", note)


def test_file_whose_faces_are_elsewhere_has_no_bound(tmp_path, monkeypatch):
    monkeypatch.setattr(cad_faces, "_DEFAULT_METRES", 1e-3)
    whole = cad_faces.read_bodies

    def shifted(text):
        representations = whole(text)
        representations[0][0].faces[2].surface.origin += 1e-3
        return representations

    monkeypatch.setattr("proximity.formats.step.deviation.read_bodies", shifted)
    contents = read_file(tmp_path, "part.step", step_text.box_step((1, 2, 3)), cache=False)

    assert np.isinf(contents.geometries[0].deviations).all()
    assert any("no solid of the file has its faces" in note for note in contents.notes)


def test_damaged_records_do_not_refuse_the_file(tmp_path, monkeypatch):
    def fail(text):
        raise ValueError

    monkeypatch.setattr("proximity.formats.step.deviation.read_bodies", fail)
    part = read(tmp_path, step_text.box_step((1, 2, 3)), cache=False)

    assert np.isinf(part.deviations).all()


def test_files_of_triangles_have_no_deviation():
    from project import MESHES

    (part,) = proximity.load(MESHES / "bracket.stl").parts

    assert (part.deviation, len(part.deviation_by_face)) == (0.0, 0)


def test_second_read_has_the_same_bounds_without_the_surfaces(tmp_path, monkeypatch):
    monkeypatch.setenv("PROXIMITY_CACHE_DIR", str(tmp_path / "cache"))
    first = read(tmp_path, step_text.ball_step(7.0))
    monkeypatch.setattr("proximity.formats.step.deviation.read_bodies", None)

    assert (read(tmp_path, step_text.ball_step(7.0)).deviations == first.deviations).all()


def test_splines_without_scipy_have_no_bound(monkeypatch):
    monkeypatch.delattr("proximity.formats.step.spline_distance", raising=False)
    monkeypatch.setitem(sys.modules, "proximity.formats.step.spline_distance", None)
    face = cad_faces.CadFace("#1", Shape("spline", "B_SPLINE_SURFACE", spline=bump()), {}, True)

    bound, reason = deviation._spline_depth(face, np.zeros((1, 3, 3)))

    assert bound == np.inf
    assert reason.startswith("free-form faces need SciPy: ")


def test_edges_that_need_scipy_have_no_bound_without_it(monkeypatch):
    monkeypatch.delattr("proximity.formats.step.spline_distance", raising=False)
    monkeypatch.setitem(sys.modules, "proximity.formats.step.spline_distance", None)
    curve = Shape("spline", "B_SPLINE_CURVE", spline=bump())

    assert np.isinf(chords.chord_bounds([curve], np.zeros(1, int), np.zeros((1, 2, 3)), 1.0)).all()


def raw_file(*deviations):
    """Return meshes of one face with these deviations, m."""
    faces = np.array([[0, 1, 2]])
    return RawFile("STEP", [
        RawMesh(f"p{row}", np.eye(3), faces, np.zeros(1, np.int32), deviations=np.array([value]))
        for row, value in enumerate(deviations)
    ])  # fmt: skip


@pytest.mark.parametrize(
    ("finer", "kept", "words"),
    [
        ([1e-6, 1e-6, 1e-6], [4e-6, 1e-6, np.inf], "finer ones are used, which deviate by up to 0.004 mm"),
        ([1e-6, 3e-5, 1e-6], [4e-6, 2e-5, np.inf], "and finer ones do not improve it"),
        ([1e-6, np.inf, 1e-6], [4e-6, 2e-5, np.inf], "and finer ones do not improve it"),
    ],
)
def test_only_parts_that_deviate_too_much_get_finer_triangles(finer, kept, words):
    tolerances = []

    def mesh(tolerance):
        tolerances.append(tolerance)
        return raw_file(*finer), tolerance

    raw = raw_file(4e-6, 2e-5, np.inf)
    (note,) = step._mesh_finer(raw, 1e-5, mesh, lambda meshes: None)

    assert [one.deviations[0] for one in raw.meshes] == kept
    assert note.startswith("p1: triangles within 0.01 mm deviate by up to 0.02 mm") and words in note
    assert tolerances == pytest.approx([4e-6])


def test_a_file_that_would_take_too_many_triangles_is_meshed_once(monkeypatch):
    monkeypatch.setattr(step, "_MOST_TRIANGLES", 7)

    (note,) = step._mesh_finer(raw_file(4e-6, 2e-5, np.inf), 1e-5, None, None)

    assert note.endswith("by up to 0.02 mm from the CAD surfaces, and finer ones would be more than 7")


def test_parts_within_the_tolerance_are_meshed_once():
    assert step._mesh_finer(raw_file(4e-6, 1e-5), 1e-5, None, None) == []


# --- scenes ---


@pytest.fixture(scope="module")
def balls(tmp_path_factory):
    """Two balls of 10 mm, 5 mm apart."""
    path = tmp_path_factory.mktemp("balls") / "ball.step"
    path.write_text(step_text.ball_step(10.0))
    part = proximity.load(path).parts[0]
    return proximity.Scene([part, replace(part, name="other", pose=proximity.Pose(None, [0.025, 0.0, 0.0]))])


def test_bounds_of_cad_surfaces_contain_the_distance_of_the_balls(balls):
    deviation = balls.part("other").deviation
    triangles = balls.clearance("ball", "other")
    found = balls.clearance("ball", "other", surface="cad")

    assert 0.0 < deviation <= 1e-5
    assert triangles.lower == triangles.distance
    assert found.lower <= 0.005 <= found.distance
    assert found.distance - found.lower == pytest.approx(4 * deviation)
    assert found.relation == triangles.relation
    with pytest.raises(proximity.ArgumentError, match="surface is 'step', expected one of triangles, cad"):
        balls.clearance("ball", "other", surface="step")


def test_bounds_of_points_contain_the_distance_to_the_balls(balls):
    random = np.random.default_rng(9)
    points = random.uniform(-0.015, 0.04, (4000, 3))
    near = random.normal(size=(4000, 3))
    points[2000:] = (
        near[2000:]
        / np.linalg.norm(near[2000:], axis=1, keepdims=True)
        * (0.01 + random.uniform(-1e-5, 1e-5, (2000, 1)))
    )
    middles = np.array([[0.0, 0, 0], [0.025, 0, 0]])
    true = (np.linalg.norm(points[:, None] - middles, axis=2) - 0.01).min(axis=1)

    lower, upper = balls.signed_distance_bounds(points)

    assert (lower <= true + 1e-15).all() and (true <= upper + 1e-15).all()
    assert (upper - lower).max() == pytest.approx(2 * balls.part("ball").deviation)
    assert ((lower < 0.0) & (upper > 0.0)).any()
    assert np.isnan(balls.signed_distance_bounds([np.nan, 0, 0])).all()


def test_lower_bound_has_the_largest_deviation_of_parts_that_are_measured(balls):
    first, second = (
        replace(part, deviation=value) for part, value in zip(balls.parts, (1e-3, np.inf), strict=True)
    )
    scene = proximity.Scene([first, second])
    point = [-0.02, 0.0, 0.0]
    distance = scene.signed_distance(point)

    assert scene.signed_distance_bounds(point) == (-np.inf, distance + 1e-3)
    assert scene.signed_distance_bounds(point, ignore="other") == (distance - 1e-3, distance + 1e-3)
    assert scene.signed_distance_bounds([0.05, 0.0, 0.0])[1] == np.inf


def test_deviations_are_those_of_the_parts_that_were_measured(balls, monkeypatch):
    """Another part is removed during the search: rows of the scene are then those of other parts."""
    first = balls.parts[0]
    scene = proximity.Scene([replace(first, name="removed", deviation=0.0), *balls.parts])
    connect = pairs.connect

    def interrupted(*arguments):
        found = connect(*arguments)
        scene.remove("removed")
        return found

    monkeypatch.setattr(pairs, "connect", interrupted)
    found = scene.clearance("ball", "other", surface="cad")

    assert found.distance - found.lower == pytest.approx(4 * first.deviation)


def test_depth_of_cad_surfaces_is_within_the_deviations(balls):
    deviation = balls.part("other").deviation
    scene = proximity.Scene(list(balls.parts))
    for apart, true in ((0.019, 0.001), (0.02, 0.0), (0.02 + 0.5 * deviation, 0.0)):
        scene.move("other", proximity.Pose(None, [apart, 0.0, 0.0]))
        triangles = scene.penetration("ball", "other")
        found = scene.penetration("ball", "other", surface="cad")

        assert found.deepest_lower <= true <= found.deepest
        assert found.deepest - triangles.deepest <= 2 * deviation + 1e-15
        assert (found.deepest_lower > 0.0) == (true > 0.0)
        assert found[2:4] == triangles[2:4]
    scene.move("other", proximity.Pose(None, [0.03, 0.0, 0.0]))
    assert scene.penetration("ball", "other", surface="cad").deepest == 0.0
    with pytest.raises(proximity.ArgumentError, match="surface is 'step'"):
        scene.penetration("ball", "other", surface="step")


def test_facets_that_interfere_by_less_than_the_deviations_may_fit(balls):
    deviation = balls.part("other").deviation
    scene = proximity.Scene(list(balls.parts))
    scene.move("other", proximity.Pose(None, [0.02 - 1.5 * deviation, 0.0, 0.0]))
    pair = scene.clearance("ball", "other")
    assert pair.relation == "crossing"

    (triangles,), (cad,) = (
        clashes.measure_pairs(scene, [pair], clashes.CONTACT, is_cad=is_cad) for is_cad in (False, True)
    )

    assert (triangles.is_clash, cad.is_clash, cad.is_fit) == (True, False, True)


def test_compiled_scene_keeps_the_deviation(balls, tmp_path):
    balls.save(tmp_path / "balls.prox")
    opened = proximity.load(tmp_path / "balls.prox")

    for part, other in zip(balls.parts, opened.parts, strict=True):
        assert part.deviation == other.deviation
        assert (part.deviation_by_face == other.deviation_by_face).all()


def test_deformed_part_has_no_bound(balls):
    scene = proximity.Scene(list(balls.parts))
    scene.deform("ball", scene.part("ball").solid.mesh.vertices * 1.1)
    found = scene.clearance("ball", "other", surface="cad")

    assert scene.part("ball").deviation == np.inf
    assert (found.lower, found.distance) == (0.0, np.inf)


@pytest.mark.parametrize("name", ["cad/featuretype.STEP", "assemblies/iris-box.step"])
def test_public_files_are_bounded(shared_data, name):
    for part in proximity.load(shared_data / name).parts:
        assert 0.0 < part.deviation < 1.1e-4, part.name
        assert (part.deviation_by_face <= 1e-5).mean() > 0.95
