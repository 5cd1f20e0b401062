"""Conservative advancement: certified parameters are free, surfaces are not missed, balls save queries."""

import numpy as np
import pytest
import shapes
from ticking import block, line, plate, sheet, solid

from proximity.kernels.geometry.closest_feature import CLOSEST
from proximity.kernels.layout import NO_SLOT, ModelArrays
from proximity.kernels.scene.queries.distance_bounds import fill_closest
from proximity.kernels.tracking import conservative_advancement as advancing
from proximity.kernels.tracking.conservative_advancement import (
    BALL_COUNT,
    BALLS_SIZE,
    TOUCH,
    Path,
    Sphere,
    advance_conservatively,
    outward_of,
    point_on_path,
    touches,
)
from proximity.kernels.tracking.part_drift import Drift, movers_workspace
from proximity.kernels.tracking.track import Scratch
from proximity.kernels.traverse.best_first import WORKSPACE_SIZE
from proximity.scene.scene import Scene

pytestmark = pytest.mark.internals

RADIUS = 0.007
PLENTY = 10**6
FREE, EXPECTED, STEPS = 0, 1, 4


def no_balls():
    balls = np.zeros(BALLS_SIZE)
    balls[3 * BALL_COUNT : 4 * BALL_COUNT] = -1.0
    return balls


def unsigned(scene, points):
    """Distances to the nearest surface, also inside overlapping parts, by segments of zero length."""
    return scene.closest_to_segments(points, points).distance


class Way:
    """The path of a sphere through a scene; the default parameter is arc length in metres."""

    def __init__(self, things, corners, parameters=None, *, radius=RADIUS):
        self.scene = things if isinstance(things, Scene) else Scene(things)
        self.corners, self.radius = np.asarray(corners, dtype=np.float64), radius
        lengths = np.linalg.norm(np.diff(self.corners, axis=0), axis=1)
        self.parameters = (
            np.append(0.0, np.cumsum(lengths)) if parameters is None else np.asarray(parameters, float)
        )
        self.balls = no_balls()
        self.scratch = Scratch(np.zeros(WORKSPACE_SIZE, np.float32), np.zeros(1, CLOSEST)[0], np.zeros(9))

    @property
    def model(self):
        model = self.scene.snapshot()
        return ModelArrays(model.reals, model.words, model.frames, model.parts)

    def at(self, parameter):
        return np.array([np.interp(parameter, self.parameters, column) for column in self.corners.T])

    def clearance(self, parameter):
        return max(float(unsigned(self.scene, self.at(parameter))) - self.radius, 0.0)

    def go(
        self, *, start=0.0, speed=1.0, drift=0.0, tolerance=0.0, stride=PLENTY, budget=PLENTY,
        clearance=None, displacement_of_parts=0.0,
    ):  # fmt: skip
        """Return free parameter, expected contact, part, slot, steps."""
        clearance = self.clearance(start) if clearance is None else clearance
        sphere = Sphere(self.radius, float(speed), self.balls, displacement_of_parts)
        nothing_near = Drift(movers_workspace(0), 0, float(drift))
        return advance_conservatively(
            self.model, Path(self.corners, self.parameters), sphere, nothing_near, start, clearance, 0,
            NO_SLOT,
            float(tolerance), min(stride, budget), budget, self.scratch,
        )  # fmt: skip

    def is_free(self, start, end, count=200):
        parameters = np.linspace(start, end, count)
        return (unsigned(self.scene, np.array([self.at(s) for s in parameters])) >= self.radius - 1e-12).all()


def down(things=None, **settings):
    return Way([plate(half=0.3)] if things is None else things, line((0, 0, 0.1), (0, 0, -0.1)), **settings)


@pytest.mark.parametrize(
    ("parameter", "place", "direction"),
    [
        (0.0, (0, 0, 0), (0.5, 0, 0)), (1.0, (0.5, 0, 0), (0.5, 0, 0)), (2.0, (1, 0, 0), (0, 3, 0)),
        (2.5, (1, 1.5, 0), (0, 3, 0)), (3.0, (1, 3, 0), (0, 3, 0)), (4.0, (1, 6, 0), (0, 3, 0)),
    ],
)  # fmt: skip
def test_place_on_a_way_is_between_its_corners_and_the_direction_a_unit_of_stage(parameter, place, direction):
    out = np.full(9, np.nan)
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 3, 0)], float)
    point_on_path(Path(corners, np.array([0.0, 2.0, 3.0])), parameter, out)
    assert out[:6].tolist() == [*place, *direction]


def test_corner_that_is_there_twice_leads_on():
    corners, out = np.array([(0, 0, 0), (1, 0, 0), (1, 0, 0), (1, 1, 0)], float), np.zeros(9)
    point_on_path(Path(corners, np.array([0.0, 1.0, 1.0, 2.0])), 1.0, out)
    assert out[:6].tolist() == [1, 0, 0, 0, 1, 0]
    point_on_path(Path(corners[:3], np.array([0.0, 1.0, 1.0])), 1.0, out)
    assert out[:6].tolist() == [1, 0, 0, 0, 0, 0]


def test_outward_is_from_the_surface_to_the_point_and_nothing_on_it():
    way, out = down(), np.zeros(3)
    model, closest = way.model, way.scratch.closest
    for height, expected in ((0.05, (0, 0, 1)), (-0.001, (0, 0, -1)), (0.0, (0, 0, 0))):
        # Find the slot of the top by a path that leads there.
        slot = way.go()[3]
        fill_closest(model, 0, slot, (0.0, 0.0, height), closest)
        outward_of(model, 0, closest, out)
        assert out.tolist() == pytest.approx(expected, abs=1e-12)


def test_straight_at_a_plate_the_way_is_free_until_just_before_the_touch():
    free, expected, part, slot, steps = down().go()
    assert 0.0929 <= free <= 0.093
    assert expected == pytest.approx(0.093, abs=1e-9)
    assert (part, slot != NO_SLOT, steps > 0) == (0, True, True)


@pytest.mark.parametrize("thing", [sheet(half=0.3), plate(thickness=1e-7, half=0.3)])
@pytest.mark.parametrize("radius", [0.0, 1e-9, RADIUS])
def test_nothing_thin_is_passed(thing, radius):
    free, expected, *_ = down([thing], radius=radius).go()
    assert free <= 0.1 - radius
    assert expected == pytest.approx(0.1 - radius, abs=2 * TOUCH)


@pytest.mark.parametrize("end", [0.3, RADIUS + 0.001], ids=["away", "until before the surface"])
def test_way_that_meets_nothing_is_free_to_its_end(end):
    way = Way([plate()], line((0, 0, 0.1), (0, 0, end)))
    assert way.go()[:2] == (way.parameters[-1], np.inf)


def test_what_is_far_is_not_asked_twice():
    """No surface is nearer than the end of the path, which one query shows."""
    way = Way([plate()], line((0, 0, 0.5), (0, 0, 0.3)))
    assert way.go(clearance=0.0)[STEPS] <= 2


@pytest.mark.parametrize("tolerance", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("seed", range(8))
def test_what_is_certified_is_free_on_any_way_with_any_budget(seed, tolerance):
    rng = np.random.default_rng(seed)
    things = [block("block", (0, 0, 0)), solid(shapes.torus(0.1, 0.03), "ring"), sheet(height=-0.12)]
    way = Way(things, np.concatenate([[(0.2, 0.2, 0.2)], rng.uniform(-0.2, 0.2, (5, 3))]))
    for budget in (1, 3, 10, PLENTY):
        way.balls = no_balls()
        free, expected, *_ = way.go(budget=budget, tolerance=tolerance)
        assert free > 0.0 and way.is_free(0.0, free)
        assert free <= expected


def test_a_start_along_the_way_counts_from_there():
    way = down()
    assert way.go(start=0.05)[EXPECTED] == pytest.approx(0.093, abs=1e-9)
    assert way.go(start=0.05)[FREE] >= 0.05


def test_stages_may_be_seconds():
    """0.2 m in 4 s is 0.05 m/s."""
    free, expected, *_ = down(parameters=(0.0, 4.0)).go(speed=0.05)
    assert expected == pytest.approx(0.093 / 0.05, rel=1e-9)
    assert 0.0929 / 0.05 <= free <= 0.093 / 0.05


@pytest.mark.parametrize("drift", [0.1, 1.0, 5.0])
def test_surfaces_that_may_come_nearer_leave_less(drift):
    """As if all surfaces approached head-on."""
    free, *_ = down().go(drift=drift)
    assert 0.6 * 0.093 / (1.0 + drift) <= free <= 0.093 / (1.0 + drift)


def test_balls_found_while_surfaces_stood_are_smaller_where_they_may_have_come_nearer():
    way = down()
    way.go()
    assert 0.0 < way.go(drift=1.0)[FREE] <= 0.093 / 2.0


def test_surface_that_may_come_from_beyond_the_end_of_the_way_is_looked_for():
    """The sphere hardly moves; at 0.1 m/s the plate, 0.093 m away, may arrive after 0.93 s of 1 s."""
    way = Way([plate(half=0.3)], line((0, 0, 0.1), (0.01, 0, 0.1)), parameters=(0.0, 1.0))
    free = way.go(speed=0.01, drift=0.1)[FREE]
    assert 0.8 <= free <= 0.9300001


def test_sphere_that_does_not_move_among_surfaces_that_do_not_is_free_for_ever():
    way = Way([plate()], line((0, 0, 0.01), (0, 0, 0.01)), parameters=(0.0, 1.0))
    assert way.go(speed=0.0)[:2] == (1.0, np.inf)


def test_with_a_budget_of_one_step_something_is_certified():
    way = down([solid(shapes.sphere(0.05, 4), "ball")])
    free, *_, steps = way.go(budget=1)
    assert way.clearance(0.0) * (1 - 1e-9) <= free <= 0.043
    assert steps <= 24


def test_no_query_begins_after_the_stride_and_the_next_advance_continues_from_the_balls():
    way = Way([solid(shapes.sphere(0.05, 4), "ball")], line((-0.2, 0, 0.04), (0.2, 0, 0.04)))
    whole, way.balls = way.go(), no_balls()
    strides = [way.go(stride=1) for _ in range(BALL_COUNT)]
    ends = [each[FREE] for each in strides]
    assert ends == sorted(ends) and ends[0] < whole[FREE] and strides[0][STEPS] < whole[STEPS]
    assert ends[-1] == pytest.approx(whole[FREE], rel=0.05)
    assert way.is_free(0.0, ends[-1])


def test_second_time_balls_answer_and_certify_no_less_than_is_true():
    way = Way([solid(shapes.sphere(0.05, 4), "ball")], line((-0.2, 0, 0.04), (0.2, 0, 0.04)))
    first, second = way.go(), way.go()
    assert second[STEPS] < first[STEPS]
    assert way.is_free(0.0, second[FREE])
    assert second[FREE] == pytest.approx(first[FREE], rel=0.05)


def test_balls_are_free_of_surface_and_the_oldest_goes_first():
    way = Way([solid(shapes.sphere(0.05, 3), "ball")], line((-0.1, 0, 0.055), (0.1, 0, 0.055)), radius=0.0)
    for height in np.linspace(0.055, 0.4, 40):
        way.corners[:, 2] = height
        way.go(clearance=0.0)
    x, y, z, radius, _ = way.balls[: 5 * BALL_COUNT].reshape(5, BALL_COUNT)
    assert (radius > 0.0).all()
    assert (radius <= unsigned(way.scene, np.stack([x, y, z], axis=1)) + 1e-15).all()
    assert z.min() > 0.2  # the balls of the first paths are gone


def test_a_ball_tells_its_room_less_what_moved_and_nothing_when_it_gave_more():
    """A ball of radius 0.1 m about (1, 0, 0), made after parts had moved 2 m; the sphere has 0.02 m."""
    balls = no_balls()
    balls[[3, 3 + BALL_COUNT, 3 + 2 * BALL_COUNT, 3 + 3 * BALL_COUNT, 3 + 4 * BALL_COUNT]] = (
        1.0, 0.0, 0.0, 0.1, 2.0,
    )  # fmt: skip

    def clearance(x, moved=2.0):
        return advancing._clearance_in_balls(Sphere(0.02, 1.0, balls, moved), x, 0.0, 0.0)

    assert clearance(1.0) == 0.08
    assert clearance(1.03) == pytest.approx(0.05, rel=1e-9) and clearance(1.03) <= 0.05
    assert clearance(1.01, 2.02) == pytest.approx(0.05, rel=1e-9) and clearance(1.01, 2.02) <= 0.05
    # Balls with less than a quarter of their radius left are not used.
    assert clearance(1.07) < 0.0 and clearance(1.0, 2.07) < 0.0 and clearance(0.0) < 0.0


def test_moved_parts_are_met_where_they_are_now():
    """An old ball, from when the plate was 0.08 m lower, would let the sphere pass through it."""
    way = down()
    way.go()
    way.scene.move("plate", np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.08], [0, 0, 0, 1.0]]))
    free, expected, *_ = way.go(displacement_of_parts=0.08)
    assert free <= 0.013
    assert expected == pytest.approx(0.013, abs=1e-6)


@pytest.mark.parametrize(
    ("height", "expected"), [(0.0069, True), (0.0071, False), (-0.001, True), (1.0, False)]
)
def test_sphere_touches_what_is_nearer_than_its_radius(height, expected):
    way = down()
    is_touch, steps = touches(
        way.model, (0.0, 0.0, height), RADIUS, 0, NO_SLOT, PLENTY, way.scratch.workspace
    )
    assert is_touch == expected and steps > 0


def test_without_steps_left_a_touch_is_not_claimed():
    ball = down([solid(shapes.sphere(0.05, 4), "ball")])
    is_touch, _ = touches(ball.model, (0.0, 0.0, 0.0), 0.0499, 0, NO_SLOT, 1, ball.scratch.workspace)
    assert not is_touch
