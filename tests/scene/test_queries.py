"""Arguments of queries: shapes and types, errors, and rows that are not finite."""

import re

import judging
import numpy as np
import pytest
import shapes
from odd_arrays import unaligned
from scene_parts import part_of, some_parts

from proximity.errors import ArgumentError, NotWatertightError
from proximity.pose import Pose
from proximity.scene.queries.results import NO_FACE, NO_PART, ClosestPoints, Feature
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid

SOLID = Solid(*shapes.cube())
SCENE = Scene([Solid(*shapes.cube(), name="cube"), Solid(*shapes.moved(shapes.octahedron(), (5, 0, 0)))])
ASKED = pytest.mark.parametrize("asked", [SOLID, SCENE], ids=["solid", "scene"])
POINTS = np.array([[2.0, 0.25, 0.5], [0.5, 0.5, 0.9], [4.0, 1.0, 0.0], [0.25, 0.5, -3.0]])


def ask_all(asked, points, **options):
    """Results of every point query."""
    return {
        "closest": asked.closest(points, **options),
        "signed_distance": asked.signed_distance(points, **options),
        "distance": asked.distance(points, **options),
        "contains": asked.contains(points, **options),
    }


@ASKED
@pytest.mark.parametrize("shape", [(), (0,), (1,), (4,), (2, 2), (2, 0), (1, 2, 2)])
def test_answers_have_the_shape_of_the_points(asked, shape):
    points = np.resize(POINTS, (*shape, 3))
    answers = ask_all(asked, points)
    hit = answers.pop("closest")
    for answer in [*answers.values(), hit.signed_distance, hit.part, hit.face_id, hit.feature, hit.is_signed]:
        assert np.shape(answer) == shape
    for answer in (hit.point, hit.gradient, hit.barycentric):
        assert answer.shape == (*shape, 3)


@ASKED
def test_one_point_gives_scalars(asked):
    answers = ask_all(asked, (2.0, 0.25, 0.5))
    hit = answers["closest"]
    kinds = {"signed_distance": np.float64, "distance": np.float64, "contains": np.bool_}
    assert all(isinstance(answers[name], kind) for name, kind in kinds.items())
    kinds = {"signed_distance": np.float64, "part": np.int32, "face_id": np.int32, "is_signed": np.bool_}
    assert all(isinstance(getattr(hit, name), kind) for name, kind in kinds.items())
    assert (answers["signed_distance"], hit.signed_distance, answers["distance"]) == (1.0, 1.0, 1.0)
    assert hit.point.tolist() == [1.0, 0.25, 0.5]
    assert hit.gradient.tolist() == [1.0, 0.0, 0.0]


@ASKED
def test_grid_is_its_points_in_order(asked):
    flat, grid = ask_all(asked, POINTS), ask_all(asked, POINTS.reshape(2, 2, 3))
    for name in ("signed_distance", "distance", "contains"):
        assert np.array_equal(flat[name], grid[name].ravel())
    for field in ClosestPoints._fields:
        one, other = getattr(flat["closest"], field), getattr(grid["closest"], field)
        assert np.array_equal(one, other.reshape(one.shape)), field


@pytest.mark.parametrize(
    "points",
    [
        POINTS.tolist(), tuple(POINTS), POINTS.astype(np.float32), POINTS.astype(np.float16),
        POINTS.astype(np.longdouble), np.broadcast_to(POINTS, (1, 4, 3))[0],
    ],
    ids=["list", "tuple", "f4", "f2", "long", "read-only"],
)  # fmt: skip
def test_points_of_any_kind_give_the_same(points):
    """The coordinates are exact in all of these types, except 0.9 in one of them."""
    expected = ask_all(SOLID, np.array(points, dtype=np.float64))
    for name, answer in ask_all(SOLID, points).items():
        assert judging.same_bits(answer, expected[name]), name


def test_whole_numbers_are_points():
    assert SOLID.distance([3, 0, 0]) == 2.0
    assert SOLID.distance(np.array([3, 0, 0], np.uint8)) == 2.0


@pytest.mark.parametrize("asked", [SOLID, SCENE], ids=["solid", "scene"])
def test_what_a_mask_hides_is_no_point_nor_ray_however_often_it_is_asked(asked):
    """Compiled code tests for plain arrays once it has been called."""
    hidden = np.ma.masked_array(POINTS, mask=[[False] * 3, [True] * 3, [False] * 3, [False] * 3])
    plain = np.array(POINTS)
    for _ in range(2):
        expected = asked.signed_distance(plain), asked.cast(plain, plain).distance
        found = asked.signed_distance(hidden), asked.cast(hidden, plain).distance
        for one, other in zip(found, expected, strict=True):
            assert np.isnan(one[1]) and np.array_equal(np.delete(one, 1), np.delete(other, 1))


def test_rows_that_do_not_fit_are_refused_however_often_they_are_asked():
    for _ in range(2):
        SCENE.signed_distance(POINTS)
        SCENE.cast(POINTS, POINTS)
        with pytest.raises(ArgumentError, match=r"points have shape \(4, 2\), expected"):
            SCENE.signed_distance(np.ascontiguousarray(POINTS[:, :2]))
        with pytest.raises(ArgumentError, match=r"origins have shape \(4, 2\), expected"):
            SCENE.cast(np.ascontiguousarray(POINTS[:, :2]), np.ascontiguousarray(POINTS[:, :2]))
        with pytest.raises(ArgumentError, match=r"origins have shape \(4, 3\) and directions \(3, 3\)"):
            SCENE.cast(POINTS, POINTS[:3].copy())
        with pytest.raises(ArgumentError, match="direction 2 is zero"):
            SCENE.cast(POINTS, POINTS * np.array([[1.0], [1.0], [0.0], [1.0]]))


def test_points_are_not_changed():
    points = np.array(POINTS)
    ask_all(SCENE, points)
    SCENE.cast(points, points)
    SCENE.closest_to_segments(points, points[::-1])
    assert np.array_equal(points, POINTS)


@pytest.mark.parametrize(
    "field",
    ["signed_distance", "point", "gradient", "part", "face_id", "barycentric", "feature", "is_signed"],
)
def test_results_are_read_only(field):
    for shape in ((4, 3), (2, 2, 3)):
        values = getattr(SCENE.closest(POINTS.reshape(shape)), field)
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 0


def test_results_do_not_change_with_later_questions():
    hit = SCENE.closest(POINTS)
    before = hit.point.copy()
    SCENE.closest(POINTS + 1.0)
    assert np.array_equal(hit.point, before)


def test_results_show_themselves():
    assert repr(SOLID.closest((2.0, 0.25, 0.5 + 0.1 + 0.2))) == (
        "ClosestPoints(signed_distance=1.0, point=[1.0, 0.25, 0.8], gradient=[1.0, 0.0, 0.0], "
        "part=0, face_id=11, barycentric=[0.2, 0.25, 0.55], feature=FACE, is_signed=True)"
    )
    assert repr(SOLID.cast((2.0, 0.25, 0.5), (-1, 0, 0))).startswith("RayHits(distance=1.0, point=[1.0, 0.25")
    segment = SOLID.closest_to_segments((2.0, 0.25, 0.5), (3.0, 0.25, 0.5))
    assert repr(segment).startswith("SegmentHits(distance=1.0, point_on_segment=[2.0, 0.25, 0.5], ")


@pytest.mark.parametrize("shape", [(2,), (1000,), (60, 50)])
def test_many_results_show_their_shape_and_a_few_distances(shape):
    points = np.full((*shape, 3), 3.0)
    texts = [repr(SOLID.closest(points)), repr(SOLID.cast(points, -points))]
    texts.append(repr(SOLID.closest_to_segments(points, points + 1.0)))
    for text, name in zip(texts, ("signed_distance", "distance", "distance"), strict=True):
        assert f"(shape={shape}, {name}=[" in text
        assert len(text) < 300
        assert "\n" not in text


@ASKED
def test_nan_and_inf_of_closest_points_are_those_of_the_signed_distance(asked):
    points = [[0.5, 0.5, 0.9], [2.0, 0.25, 0.5], [1.0, 0.5, 0.5], [np.nan, 0.0, 0.0], [99.0, 0.0, 0.0]]
    hits = asked.closest(points, max_distance=50.0)
    np.testing.assert_allclose(hits.signed_distance, [-0.1, 1.0, 0.0, np.nan, np.inf], rtol=1e-12)
    assert isinstance(asked.closest(points[0]).signed_distance, np.float64)


def test_feature_says_what_was_nearest():
    hit = SOLID.closest([[2.0, 0.25, 0.5], [2.0, 0.5, 2.0], [2.0, 2.0, 2.0]])
    assert hit.feature.tolist() == [Feature.FACE, Feature.EDGE, Feature.VERTEX]


@ASKED
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("count", [1, 5, 100])
def test_row_that_is_not_finite_answers_nan_and_the_others_go_on(asked, value, count):
    points = np.resize(POINTS, (count, 3))
    row = count // 2
    points[row, 1] = value
    others = np.arange(count) != row
    answers, clean = ask_all(asked, points), ask_all(asked, points[others])
    hit = answers["closest"]
    assert np.isnan(hit.signed_distance[row])
    assert np.isnan(hit.point[row]).all() and np.isnan(hit.gradient[row]).all()
    assert np.isnan(hit.barycentric[row]).all()
    assert (hit.part[row], hit.face_id[row], hit.feature[row]) == (NO_PART, NO_FACE, Feature.NONE)
    assert not hit.is_signed[row]
    assert np.isnan(answers["signed_distance"][row]) and np.isnan(answers["distance"][row])
    assert not answers["contains"][row]
    for field in ClosestPoints._fields:
        assert judging.same_bits(getattr(hit, field)[others], getattr(clean["closest"], field)), field
    for name in ("signed_distance", "distance", "contains"):
        assert judging.same_bits(answers[name][others], clean[name]), name


@ASKED
def test_rows_that_are_all_not_finite_answer_nan(asked):
    answers = ask_all(asked, np.full((60, 3), np.nan))
    assert np.isnan(answers["signed_distance"]).all()
    assert (answers["closest"].face_id == NO_FACE).all()


TWO = {"cast": ("rays", "origins", "directions"), "closest_to_segments": ("segments", "starts", "ends")}
ZERO = np.array([[1.0, 0.0, 0.0], [0.0, -0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
REFUSED = [  # queries, their arguments, options, and the error message
    *((("closest", "contains"), (points,), {}, f"points {words}") for points, words in (
        ((1.0, 2.0), "have shape (2,), expected (..., 3)"),
        (np.ones((5, 2)), "have shape (5, 2), expected (..., 3)"),
        (5.0, "have shape (), expected (..., 3)"),
        ([[1, 2, 3], [1]], "have rows of different lengths, expected numbers of shape (..., 3)"),
        ([1, 2, 3j], "have dtype complex128, expected numbers of shape (..., 3)"),
        ([1, 2, None], "hold None, which is not a number, expected numbers of shape (..., 3)"))),
    *((("closest", "contains"), (np.zeros((count, 3)),), {"workers": workers},
       f"workers is {workers!r}, expected a number of threads, or -1 for all cores")
      for count in (1, 3000) for workers in (0, 1.5, None, "all", False)),
    (tuple(TWO), (POINTS, POINTS), {"workers": 0},
     "workers is 0, expected a number of threads, or -1 for all cores"),
    *((query, (POINTS,) * count, {"max_distance": limit}, words)
      for query, count in ((("closest",), 1), (tuple(TWO), 2))
      for limit, words in (
          (-np.inf, "max_distance is -inf, expected a length of 0 m or more"),
          (np.nan, "max_distance is nan, expected a length of 0 m or more"),
          ("0.1", "max_distance is '0.1', expected a length in metres"),
          ([0.1, -0.5, 0.2, 0.1], "max_distance[1] is -0.5, expected a length of 0 m or more"),
          (np.array([[0.1], [np.nan]]), "max_distance[1, 0] is nan, expected a length of 0 m or more"),
          (["a"], "values of max_distance have dtype <U1, expected lengths in metres"))),
    *(((query,), (POINTS,) * (1 + (query in TWO)), {"max_distance": [1.0, 2.0, 3.0]},
       f"max_distance has shape (3,) and {TWO.get(query, ['points'])[0]} (4, 3), expected a shape that "
       "broadcasts against (4,)") for query in ("closest", *TWO)),
    *(((query,), arguments, {}, words) for query, (_, first, second) in TWO.items() for arguments, words in (
        ((POINTS, POINTS[:2]),
         f"{first} have shape (4, 3) and {second} (2, 3), expected shapes that broadcast together"),
        (((1.0, 2.0), POINTS), f"{first} have shape (2,), expected (..., 3)"),
        ((POINTS, ["a", "b", "c"]), f"{second} have dtype <U1, expected numbers of shape (..., 3)"))),
    *((("cast", "cast_distance"), (POINTS, ways), {},
       f"direction {row} is zero, expected a vector with a length")
      for row, ways in ((1, ZERO), (1, ZERO.tolist()), (0, (0, 0, 0)))),
]  # fmt: skip


@ASKED
@pytest.mark.parametrize(("queries", "arguments", "options", "words"), REFUSED, ids=range(len(REFUSED)))
def test_argument_that_does_not_fit_is_refused(asked, queries, arguments, options, words):
    for query in queries:
        with pytest.raises(ArgumentError, match=f"^{re.escape(words)}$"):
            getattr(asked, query)(*arguments, **options)


@ASKED
@pytest.mark.parametrize("points", [[], np.empty((0, 3))], ids=["list", "array"])
def test_no_points_have_an_empty_answer(asked, points):
    for query in ("signed_distance", "distance", "contains"):
        assert getattr(asked, query)(points).shape == (0,)
    table = asked.closest(points)
    assert table.signed_distance.shape == table.part.shape == table.face_id.shape == (0,)
    assert table.point.shape == table.gradient.shape == table.barycentric.shape == (0, 3)


def test_workers_may_be_any_whole_number():
    for workers in (1, 2, 64, -1, np.int64(2), np.uint8(1)):
        assert SOLID.distance((3.0, 0.0, 0.0), workers=workers) == 2.0


def test_limit_may_be_any_number():
    for limit in (2, 2.0, np.float32(2.0), np.array(2.0), np.inf, 10**300):
        assert SOLID.closest((3.0, 0.0, 0.0), max_distance=limit).signed_distance == 2.0
    assert SOLID.closest((3.0, 0.0, 0.0), max_distance=0).signed_distance == np.inf
    assert SOLID.closest((1.0, 0.5, 0.5), max_distance=-0.0).signed_distance == 0.0


EACH_OF_MANY = pytest.mark.parametrize(
    "asked", [Solid(*shapes.torus()), Scene(some_parts(20))], ids=["solid", "scene"]
)
EVERY_QUESTION = pytest.mark.parametrize(
    "ask",
    ["closest", "signed_distance", "distance", "contains", "cast", "cast_distance", "closest_to_segments"],
)


def many_rows(ask, count):
    count_of_arguments = 2 if ask in ("cast", "cast_distance", "closest_to_segments") else 1
    return np.random.default_rng(count).uniform(-6.0, 6.0, (count_of_arguments, count, 3))


@EACH_OF_MANY
@EVERY_QUESTION
@pytest.mark.parametrize("count", [1, 7, 48, 1025])
def test_batch_is_its_rows_one_by_one(asked, ask, count):
    rows, question = many_rows(ask, count), getattr(asked, ask)
    answers = columns(question(*rows))
    for row in range(0, count, 1 + count // 20):
        one = columns(question(*rows[:, row]))
        assert all(judging.same_bits(many[row], own) for many, own in zip(answers, one, strict=True))


def test_features_of_all_parts_are_the_same_in_a_batch_and_one_by_one():
    turned = part_of(shapes.octahedron(), "turned", Pose(shapes.rotation(3), (3.0, 0.5, 0.5)))
    sheet = part_of(shapes.moved(shapes.grid(), (0.0, 0.0, 3.0)), "sheet")
    scene = Scene([part_of(shapes.cube(), "cube"), turned, sheet])
    axis = np.linspace(-0.5, 4.5, 11)  # on corners, edges and faces, and off them
    points = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    hits = scene.closest(points)
    assert set(hits.feature) == {Feature.FACE, Feature.EDGE, Feature.VERTEX}
    assert set(hits.part) == {0, 1, 2}
    for row, point in enumerate(points):
        one = columns(scene.closest(point))
        assert all(judging.same_bits(many[row], own) for many, own in zip(columns(hits), one, strict=True))


@pytest.mark.parametrize("count", [3, 8, 13, 70])
def test_body_of_a_mesh_with_several_answers_for_any_number_of_points(count):
    scene = Scene.from_mesh(*shapes.join(shapes.torus(), shapes.moved(shapes.cube(), (5.0, 0.0, 0.0))))
    body = next(part.solid for part in scene.parts if part.solid.mesh.face_count == 12)
    points = np.random.default_rng(count).uniform(4.0, 7.0, (count, 3))
    points[count // 2] = np.nan
    hits = columns(body.closest(points))
    for row, point in enumerate(points):
        one = columns(body.closest(point))
        assert all(judging.same_bits(many[row], own) for many, own in zip(hits, one, strict=True))


@EACH_OF_MANY
@EVERY_QUESTION
@pytest.mark.parametrize("count, workers", [(5, 2), (2047, 2), (5001, -1)])
def test_workers_answer_the_same(asked, ask, count, workers):
    rows, question = many_rows(ask, count), getattr(asked, ask)
    rows[-1, count // 2] = np.nan
    assert judging.same_bits(question(*rows, workers=workers), question(*rows))


@ASKED
@pytest.mark.parametrize("count, workers", [(4, 1), (200, 1), (5000, 3)])
@pytest.mark.parametrize("ask", ["closest", "cast", "cast_distance", "closest_to_segments"])
def test_each_row_has_its_own_limit(asked, ask, count, workers):
    rng = np.random.default_rng(2)
    rows = rng.uniform(-1.0, 6.0, (2, count, 3))[: 1 + (ask != "closest")]
    limits = rng.choice([0.0, 0.3, 1.0, 3.0, np.inf], count)
    question = getattr(asked, ask)
    answers = columns(question(*rows, max_distance=limits, workers=workers))
    for limit in np.unique(limits):
        expected = columns(question(*rows, max_distance=float(limit)))
        for some, all_alike in zip(answers, expected, strict=True):
            assert judging.same_bits(some[limits == limit], all_alike[limits == limit])


@pytest.mark.parametrize("ask", ["closest", "cast_distance", "closest_to_segments"])
def test_limits_broadcast_against_the_rows_as_numpy_does(ask):
    rows = [POINTS[:, None], POINTS[::-1, None] + 0.25][: 1 + (ask != "closest")]
    limits = np.array([0.0, 0.5, 1.1, 3.0, np.inf])
    table = columns(getattr(SCENE, ask)(*rows, max_distance=limits))[0]
    assert table.shape == (4, 5)
    for k, limit in enumerate(limits):
        column = columns(getattr(SCENE, ask)(*rows, max_distance=limit))[0]
        assert judging.same_bits(table[:, k], column[:, 0])
    one = [row[0, 0] for row in rows]
    assert columns(getattr(SCENE, ask)(*one, max_distance=[1.0, 2.0]))[0].shape == (2,)
    assert columns(getattr(SCENE, ask)(*(np.empty((0, 3)) for _ in rows), max_distance=[]))[0].shape == (0,)


def test_inside_is_not_asked_where_there_is_none():
    sheet = Solid(*shapes.grid())
    message = "^no part has an inside, so that nothing can be contained; sign_reason of each part says why$"
    for asked in (sheet, Scene([sheet])):
        with pytest.raises(NotWatertightError, match=message):
            asked.contains(POINTS)


def test_inside_is_asked_of_the_parts_that_have_one():
    scene = Scene([Solid(*shapes.grid(), name="sheet"), Solid(*shapes.cube(), name="cube")])
    assert scene.contains([[0.5, 0.5, 0.5], [0.5, 0.5, -0.5]]).tolist() == [True, False]


def read_only(values):
    found = values.copy()
    found.setflags(write=False)
    return found


@pytest.mark.parametrize(
    "laid",
    [
        unaligned, read_only, np.ma.masked_array, np.asfortranarray, lambda values: values.astype(">f8"),
        lambda values: values.tolist(), lambda values: np.repeat(values, 2, axis=0)[::2],
        lambda values: np.repeat(values, 2, axis=1)[:, ::2], lambda values: values[::-1].copy()[::-1],
        lambda values: values.astype(object),
    ],
    ids=[
        "unaligned", "read-only", "masked", "by column", "other", "list", "rows", "columns", "back", "object",
    ],
)  # fmt: skip
@pytest.mark.parametrize(
    "ask", ["closest", "signed_distance", "contains", "cast_distance", "closest_to_segments"]
)
@ASKED
def test_few_rows_are_read_as_they_lie(asked, ask, laid):
    """Regression: after an unaligned array, compiled code accepted one of the other byte order."""
    count = 2 if ask in ("cast_distance", "cast", "closest_to_segments") else 1
    question, arguments = getattr(asked, ask), [POINTS, POINTS[::-1] + 0.25][:count]
    expected = question(*arguments)
    assert judging.same_bits(question(*map(laid, arguments)), expected)
    for k in range(count):
        one = [laid(each) if k == at else each for at, each in enumerate(arguments)]
        assert judging.same_bits(question(*one), expected)
    many = columns(question(*(np.repeat(laid(each), 20, axis=0) for each in arguments)))
    assert all(
        judging.same_bits(one[::20], other) for one, other in zip(many, columns(expected), strict=True)
    )


def columns(answer):
    """The arrays of a result."""
    return [getattr(answer, name) for name in getattr(answer, "_fields", ())] or [answer]


@pytest.mark.parametrize("ask", ["cast", "closest_to_segments"])
def test_two_arguments_broadcast(ask):
    query, here, there = getattr(SCENE, ask), POINTS[:, None], np.array([[-2.0, 0.25, 0.5], [0.5, 0.5, 0.5]])
    table = query(here, there)
    assert table.distance.shape == (4, 2)
    assert (table.part.shape, table.barycentric.shape) == ((4, 2), (4, 2, 3))
    for row in range(4):
        for column in range(2):
            one = query(POINTS[row], there[column])
            for field in table._fields:
                assert judging.same_bits(getattr(table, field)[row, column], getattr(one, field)), field
    assert query(POINTS, there[0]).distance.shape == (4,)
    assert query(POINTS[0], there).distance.shape == (2,)
    assert query(np.empty((0, 3)), there[0]).distance.shape == (0,)
    assert query([], there[0]).distance.shape == query([], []).distance.shape == (0,)
    assert isinstance(query(POINTS[0], there[0]).distance, np.float64)


@pytest.mark.parametrize("argument", [0, 1])
@pytest.mark.parametrize("ask", ["cast", "closest_to_segments"])
def test_ray_or_segment_that_is_not_finite_answers_nan(ask, argument):
    given = [POINTS.copy(), POINTS[::-1].copy()]
    clean = getattr(SCENE, ask)(*given)
    given[argument][2, 0] = np.nan
    hits = getattr(SCENE, ask)(*given)
    assert np.isnan(hits.distance[2])
    assert np.isnan(hits.barycentric[2]).all()
    assert (hits.part[2], hits.face_id[2]) == (NO_PART, NO_FACE)
    for field in hits._fields:
        kept = np.delete(getattr(hits, field), 2, axis=0), np.delete(getattr(clean, field), 2, axis=0)
        assert judging.same_bits(*kept), field
