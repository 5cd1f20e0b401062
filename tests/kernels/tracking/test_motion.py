"""Velocity estimate and prediction of a finger: exact where possible, bounded elsewhere."""

import numpy as np
import pytest
from fingers import MS, Finger

from proximity.kernels.contact_record import JUMPED, PREDICTED, TRACKED
from proximity.kernels.tracking import motion
from proximity.kernels.tracking.motion import (
    COAST,
    MAX_ACCELERATION,
    MAX_SPEED,
    MOTION_HORIZON,
    REPEATED,
    STARTED,
)

pytestmark = pytest.mark.internals

KNOWN = TRACKED | PREDICTED


def steady(times_ns, velocity, start=(0.1, 0.2, 0.3)):
    seconds = 1e-9 * (np.asarray(times_ns) - times_ns[0])
    return np.asarray(start) + seconds[:, None] * np.asarray(velocity)


def irregular_times(rng, count, start_ns=0):
    """Times 0.1 to 50 ms apart, log-uniformly distributed."""
    return start_ns + np.cumsum((1e5 * 500.0 ** rng.random(count)).astype(np.int64))


@pytest.mark.parametrize("start_ns", [0, 10**18])
@pytest.mark.parametrize("seed", range(5))
def test_steady_motion_has_its_velocity_at_any_times(seed, start_ns):
    rng = np.random.default_rng(seed)
    times = irregular_times(rng, 300, start_ns)
    velocity = rng.uniform(-1.0, 1.0, 3)
    finger, is_known = Finger(), False

    for count, (t_ns, position) in enumerate(zip(times, steady(times, velocity), strict=True), start=1):
        status = finger.see(t_ns, position)

        assert status & TRACKED and not status & (JUMPED | REPEATED)
        assert bool(status & STARTED) == (count == 1)
        is_known = is_known or bool(status & PREDICTED)
        assert bool(status & PREDICTED) == is_known  # once known, it remains known
        if is_known:
            # positions near one metre, rounded to 1e-16, at least 0.4 ms apart
            np.testing.assert_allclose(finger.velocity, velocity, rtol=0.0, atol=3e-12)
        else:
            assert not finger.velocity.any() and finger.velocity_error == MAX_SPEED
    assert is_known


def test_second_pose_gives_a_velocity_and_the_third_its_error():
    finger = Finger()
    times = np.arange(3) * 8 * MS

    assert finger.see(times[0], (0, 0, 0)) == TRACKED | STARTED
    assert finger.velocity_error == MAX_SPEED
    assert finger.see(times[1], (0, 0.008, 0)) == KNOWN
    np.testing.assert_allclose(finger.velocity, (0, 1, 0), atol=1e-12)
    # at maximum speed its direction may be opposite
    assert finger.velocity_error == pytest.approx(MAX_SPEED + 1.0)
    assert finger.see(times[2], (0, 0.016, 0)) == KNOWN
    # acceleration over half an interval, and the noise of two poses, in quadrature
    expected = MAX_ACCELERATION * 0.004 + np.sqrt(2.0) * motion.NOISE / 0.008
    assert finger.velocity_error == pytest.approx(expected, rel=0.05)


def test_velocity_of_two_poses_that_noise_could_have_made_is_not_known():
    finger = Finger()
    finger.see(0, (0, 0, 0))

    assert finger.see(100_000, (0.0001, 0, 0)) == TRACKED
    assert not finger.velocity.any() and finger.velocity_error == MAX_SPEED
    assert finger.see(2 * MS, (0.002, 0, 0)) == KNOWN


def test_rows_of_other_fingers_are_left_alone():
    finger = Finger()
    times = np.arange(6) * MS
    finger.see_all(times, [(0, 0, 0), (0.001, 0, 0), (1, 1, 1), (0.003, 0, 0), (0.004, 0, 0), (2, 0, 0)])

    for row in (0, 2):
        assert finger.motions[row].tobytes() == Finger().motions[row].tobytes()


def test_noise_of_poses_each_millisecond_is_halved():
    rng = np.random.default_rng(3)
    times = np.arange(4000) * MS
    velocity = np.array([0.3, -0.2, 0.1])
    positions = steady(times, velocity) + rng.normal(scale=5e-5, size=(4000, 3))
    finger, errors = Finger(), []
    for t_ns, position in zip(times, positions, strict=True):
        finger.see(t_ns, position)
        errors.append(finger.velocity - velocity)
        if len(errors) > 2:
            assert np.linalg.norm(errors[-1]) < finger.velocity_error - MAX_ACCELERATION * 0.5e-3

    of_last_difference = np.sqrt(2.0) * 5e-5 / 1e-3
    assert np.std(errors[10:]) < 0.5 * of_last_difference
    assert abs(np.mean(errors[10:], axis=0)).max() < 1e-3


def test_noise_of_poses_in_quick_succession_is_no_surprise():
    rng = np.random.default_rng(5)
    finger = Finger()
    for t_ns in range(0, 200 * MS, MS // 10):
        finger.see(t_ns, rng.normal(scale=5e-5, size=3))

        assert finger.motions["surprise"][1, 0] == 0.0


def test_velocity_of_the_caller_is_taken_at_its_word():
    finger = Finger()

    assert finger.see(0, (0, 0, 0), velocity=(0.1, 0.2, 0.3)) == KNOWN | STARTED
    np.testing.assert_array_equal(finger.velocity, (0.1, 0.2, 0.3))
    assert finger.velocity_error == 0.0
    assert finger.after(0.01)[1] == pytest.approx(0.5 * MAX_ACCELERATION * 1e-4, rel=0.1)
    assert finger.see(0, (0, 0, 0), velocity=(0.4, 0, 0)) == KNOWN | REPEATED
    np.testing.assert_array_equal(finger.velocity, (0.4, 0, 0))
    assert finger.see(8 * MS, (0.5, 0, 0), velocity=(0.1, 0, 0)) == KNOWN | STARTED | JUMPED


@pytest.mark.parametrize("missing", [(np.nan, 0, 0), (0, np.inf, 0), (0, 0, -np.inf)])
def test_velocity_that_is_not_finite_is_found_from_the_poses(missing):
    finger, alone = Finger(), Finger()
    for t_ns in (0, 8 * MS, 16 * MS):
        position = (1e-10 * t_ns, 0, 0)
        assert finger.see(t_ns, position, velocity=missing) == alone.see(t_ns, position)

    assert finger.state == alone.state and alone.velocity[0] == pytest.approx(0.1)
    assert finger.see(24 * MS, (np.nan, 0, 0), velocity=(1, 2, 3)) == 0
    assert finger.state == alone.state


@pytest.mark.parametrize("speed", [1e12, 1e200, 1e300])
def test_velocity_that_was_nonsense_is_forgotten_soon(speed):
    finger = Finger()
    for t_ns in (0, MS, 2 * MS):
        finger.see(t_ns, (0, 0, 0), velocity=(speed, 0, 0))
        step, rho = finger.after(0.0)
        assert not step.any() and rho == 0.0
    for tick in range(3, 100):
        finger.see(tick * MS, (0, 0, 0))
        step, rho = finger.after(0.0)
        assert not step.any() and rho == 0.0

    assert finger.velocity_error < 0.5 and not finger.velocity.any()


@pytest.mark.parametrize("lost", [(np.nan, 0, 0), (0, np.nan, 0), (0, 0, np.nan), (np.inf, 0, 0)])
def test_lost_finger_answers_nothing_and_is_remembered(lost):
    finger = Finger()
    times = np.arange(5) * 8 * MS
    finger.see_all(times, steady(times, (0.5, 0, 0)))
    before = finger.state

    assert finger.see(times[-1] + 8 * MS, lost) == 0
    assert finger.state == before
    assert finger.see(times[-1] + 16 * MS, steady([0, 48 * MS], (0.5, 0, 0))[1]) == KNOWN
    np.testing.assert_allclose(finger.velocity, (0.5, 0, 0), atol=1e-12)


def test_pose_held_between_frames_counts_once():
    rng = np.random.default_rng(4)
    frames = 10**18 + np.arange(40) * 8_500_000
    positions = np.cumsum(rng.normal(scale=1e-3, size=(40, 3)), axis=0)
    each_frame, each_tick = Finger(), Finger()
    each_frame.see_all(frames, positions)

    for now in range(int(frames[0]), int(frames[-1]) + 1, MS // 2):
        newest = np.searchsorted(frames, now, side="right") - 1
        status = each_tick.see(frames[newest], positions[newest])
        assert bool(status & REPEATED) == (now - frames[newest] >= MS // 2)
    assert each_tick.state == each_frame.state


@pytest.mark.parametrize("t_ns", [40 * MS - 1, 0, -(10**18), 40 * MS + motion.MAX_GAP_NS + 1])
def test_estimate_starts_anew_back_in_time_and_after_a_gap(t_ns):
    finger, fresh = Finger(), Finger()
    times = np.arange(6) * 8 * MS
    assert finger.see_all(times, steady(times, (0.5, 0, 0)))[-1] == KNOWN

    assert finger.see(t_ns, (0, 0, 0)) == fresh.see(t_ns, (0, 0, 0)) == TRACKED | STARTED
    assert not finger.velocity.any() and finger.velocity_error == MAX_SPEED
    for later in (8 * MS, 16 * MS):
        assert finger.see(t_ns + later, (0, 1e-3, 0)) == fresh.see(t_ns + later, (0, 1e-3, 0)) == KNOWN
        np.testing.assert_array_equal(finger.velocity, fresh.velocity)


def test_longest_gap_is_still_bridged():
    finger = Finger()
    times = np.array([0, 8, 16, 116]) * MS

    assert finger.see_all(times, steady(times, (0.5, 0, 0)))[-1] == KNOWN
    np.testing.assert_allclose(finger.velocity, (0.5, 0, 0), atol=1e-9)


def test_hand_that_jumps_starts_anew_there():
    finger = Finger()
    times = np.arange(12) * 8 * MS
    positions = steady(times, (0.5, 0, 0))
    positions[6:] += (0, 0.2, 0)
    statuses = finger.see_all(times[:7], positions[:7])

    assert statuses[6] == TRACKED | STARTED | JUMPED
    assert not finger.velocity.any() and finger.velocity_error == MAX_SPEED
    assert finger.see_all(times[7:], positions[7:]) == [KNOWN] * 5
    np.testing.assert_allclose(finger.velocity, (0.5, 0, 0), atol=1e-9)


@pytest.mark.parametrize("period_ns", [MS, 8 * MS])
def test_jump_is_what_speed_and_slack_do_not_allow(period_ns):
    reach = MAX_SPEED * 1e-9 * period_ns + motion.JUMP_SLACK
    for factor, jumped in ((0.999, 0), (1.001, JUMPED)):
        finger = Finger()
        finger.see(0, (0, 0, 0))

        assert finger.see(period_ns, (0, 0, factor * reach)) & JUMPED == jumped


FAR, ELSEWHERE = np.array([(0.3, 0.4, 0.5), (-0.2, 0.1, 0.4)])


@pytest.mark.parametrize("start", [2, 6])
@pytest.mark.parametrize(
    "strays", [[FAR], [FAR, 0, FAR], [FAR, ELSEWHERE], [FAR, ELSEWHERE, FAR], [FAR, FAR]]
)
def test_poses_gone_astray_and_back_leave_the_velocity_as_it_was(start, strays):
    """From the second pose on there is a velocity to return to."""
    finger = Finger()
    times = np.arange(12) * 8 * MS
    right = steady(times, (0.5, 0, 0))
    finger.see_all(times[:start], right[:start])

    before = 0.0
    for pose, stray in enumerate([*strays, 0.0], start=start):
        status = finger.see(times[pose], right[pose] + stray)
        is_right, is_jump = not np.any(stray), not np.array_equal(stray, before)
        assert bool(status & STARTED) == (is_jump and not is_right)
        assert bool(status & JUMPED) == is_jump
        if is_right:
            assert status & PREDICTED
            np.testing.assert_allclose(finger.velocity, (0.5, 0, 0), atol=1e-9)
        before = stray
    finger.see_all(times[pose + 1 :], right[pose + 1 :])
    assert finger.velocity_error < 0.6


ANEW = TRACKED | STARTED | JUMPED


@pytest.mark.parametrize(
    ("times", "strays", "expected"),
    [
        (range(0, 80, 8), {5: FAR, 6: FAR, 7: FAR}, [ANEW, KNOWN, KNOWN, ANEW, KNOWN]),
        (range(0, 64, 8), {5: FAR, 7: (0.04, 0, 0)}, [ANEW, KNOWN | JUMPED, ANEW]),
        ([0, 8, 16, 24, 32, 40, 30, 41], {5: FAR, 6: FAR}, [ANEW]),
        ([0, 8, 16, 24, 84, 144], {4: (1, 1, 1)}, [ANEW]),
    ],
    ids=["three poses elsewhere", "a jump after a return", "time runs backwards", "long ago"],
)
def test_way_back_is_closed(times, strays, expected):
    """After a return, four centimetres are too far from the last pose, though not from the one before."""
    positions = np.zeros((len(times), 3))
    for pose, stray in strays.items():
        positions[pose] = stray

    assert Finger().see_all(np.array(times) * MS, positions)[-len(expected) :] == expected


def test_small_stray_widens_the_error_and_passes():
    """Two centimetres in 8 ms do not count as a jump, but far exceed the acceleration limit."""
    finger = Finger()
    times = np.arange(9) * 8 * MS
    positions = np.zeros((9, 3))
    positions[5] = (0.02, 0, 0)
    finger.see_all(times[:5], positions[:5])
    calm = finger.velocity_error

    assert finger.see(times[5], positions[5]) == KNOWN
    assert finger.velocity_error > 1.5 < finger.velocity[0]
    assert finger.see(times[6], positions[6]) == KNOWN
    finger.see_all(times[7:], positions[7:])
    assert finger.velocity_error < 1.1 * calm and np.linalg.norm(finger.velocity) < 0.02


def test_places_beyond_all_numbers_jump_and_come_back():
    finger = Finger()
    times = np.arange(8) * 8 * MS
    positions = steady(times, (0.5, 0, 0))
    positions[4] = 1e300
    with np.errstate(over="ignore"):
        statuses = finger.see_all(times, positions)

    assert statuses[4:6] == [TRACKED | STARTED | JUMPED, KNOWN | JUMPED]
    np.testing.assert_allclose(finger.velocity, (0.5, 0, 0), atol=1e-9)


def test_prediction_is_a_little_short_of_straight_ahead_and_ends_at_the_horizon():
    finger = Finger()
    times = np.arange(5) * 8 * MS
    finger.see_all(times, steady(times, (0.4, 0, -0.3)))

    for h in (0.0, 0.001, 0.009, MOTION_HORIZON):
        step, _ = finger.after(h)
        np.testing.assert_allclose(step, np.multiply((0.4, 0, -0.3), h - h * h / (2 * COAST)), atol=1e-12)
    np.testing.assert_array_equal(finger.after(10.0)[0], finger.after(MOTION_HORIZON)[0])
    np.testing.assert_array_equal(finger.after(-1.0)[0], (0, 0, 0))
    assert finger.after(-1.0)[1] == finger.after(0.0)[1] == 0.0


def test_bound_far_ahead_is_what_a_hand_can_move_or_a_finger_that_turns_at_full_speed():
    unknown, finger, limits = Finger(), Finger(), (0.6, MAX_ACCELERATION)
    unknown.see(0, (0, 0, 0))
    times = np.arange(5) * 8 * MS
    for t_ns, position in zip(times, steady(times, (0.5, 0, 0)), strict=True):
        finger.see(t_ns, position, limits=limits)

    for h in (0.001, 0.05, 0.5):
        step, rho = unknown.after(h)
        assert not step.any() and rho == MAX_SPEED * h
        if h > 0.001:
            step, rho = finger.after(h, limits)
            assert rho == pytest.approx(0.6 * h + step[0])


@pytest.mark.parametrize("is_steady", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_no_motion_within_the_limits_leaves_the_bound(seed, is_steady):
    """The finger accelerates at the limit all the time, in one direction or in random ones."""
    rng = np.random.default_rng(seed)
    acceleration, finger = 60.0, Finger()
    limits = (30.0, acceleration)  # a speed that is not reached
    times = irregular_times(rng, 60)
    keep = times < 400 * MS
    times = times[keep]
    position, velocity, t_ns = np.zeros(3), np.zeros(3), 0
    direction = np.array([0.6, 0.0, -0.8])
    tightest = np.inf
    for next_ns in times:
        while t_ns < next_ns:
            if not is_steady:
                direction = rng.normal(size=3)
                direction /= np.linalg.norm(direction)
            step_ns = min(int(next_ns - t_ns), int(rng.integers(1, 8 * MS)))
            h = 1e-9 * step_ns
            position = position + h * velocity + 0.5 * h * h * acceleration * direction
            velocity = velocity + h * acceleration * direction
            t_ns += step_ns
        status = finger.see(t_ns, position, limits=limits)
        assert not status & JUMPED
        # it may continue straight on, backwards, or sideways
        for way in (direction, -direction, np.roll(direction, 1)):
            for h in (0.0005, 0.002, 0.009, 0.05, 0.15):
                step, rho = finger.after(h, limits)
                miss = np.linalg.norm(h * velocity + 0.5 * h * h * acceleration * way - step)
                assert miss <= rho
                if h == 0.009:
                    tightest = min(tightest, rho / miss)
    assert tightest < (1.2 if is_steady else 3.0)
