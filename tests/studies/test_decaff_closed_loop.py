"""Hand, finger and wall in closed loop, compared with reference values, and against other ways of knowing.

The reference values come from a separate simulation that sampled forces every 0.1 ms. Its errors as a whole
hold within what a shift of the contact by that much makes of them: 1.5 points at 0.25 m/s, 5 points at 1 m/s;
`SHIFT` has all speeds.
"""

import math
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from project import ROOT
from scipy.integrate import solve_ivp

from proximity.decaff.drum.drum_command import DriveMode, DrumCommand
from proximity.decaff.drum.drum_model import DIRECT, DRUMS
from proximity.decaff.drum.servo import servo_for
from proximity.errors import DecaffError
from proximity.studies.paper.trajectories import Press
from proximity.studies.simulation import metrics, press_kernels, sweeps
from proximity.studies.simulation.closed_loop import DecaffLoop, decaff, ideal_drum, penalty_wall, real_wall
from proximity.studies.simulation.devices import (
    COUPLED_DEVICE,
    MASSLESS_MOTOR,
    Decaff,
    Link,
    PenaltyWall,
    Sensing,
)
from proximity.studies.simulation.hand import Hand
from proximity.studies.simulation.metrics import deviation, drum_lag, drum_offset
from proximity.studies.simulation.sweeps import SPEEDS, with_drum, with_latency
from proximity.studies.simulation.target_policies import Holding, Target, TargetPolicy
from proximity.studies.stability.coupled_limit import critical_stiffness, device_resistance

HAND = Hand()
GLOVE = Decaff()  # gear4, 3 kHz servo, 1 kHz distances, as in the reference
SHIFT = np.array([0.006, 0.015, 0.030, 0.050])  # at 0.1, 0.25, 0.5, 1 m/s
LATENCIES = (0.0001, 0.001, 0.003, 0.010, 0.040)


def with_sensing(**numbers):
    return replace(GLOVE, sensing=Sensing(**numbers))


def error_of(target, speed, **numbers):
    return deviation(decaff(HAND, HAND.press(speed), with_sensing(**numbers), target)).error


# ---------------------------------------------------------------------------------------- hand and real wall


@pytest.mark.parametrize("speed", SPEEDS)
def test_hand_goes_as_the_press_says(speed):
    press = HAND.press(speed)
    times = np.linspace(-0.05, press.loss_time + 0.05, 401)
    found = [press_kernels.intent(np.array([press.speed, press.depth, press.release_time]), t) for t in times]
    expected = press.at(times)

    np.testing.assert_allclose([one[0] for one in found], expected.position, atol=1e-15)
    np.testing.assert_allclose([one[1] for one in found], expected.velocity, atol=1e-12)


def test_hand_of_paper_holds_four_millimetres_of_pad():
    press = HAND.press(0.1)

    assert press.depth == pytest.approx(6.667e-3, abs=5e-7)
    assert HAND.steady_force(press.depth) == pytest.approx(0.8)
    assert HAND.series_stiffness == pytest.approx(120.0)


@pytest.mark.parametrize("speed", SPEEDS)
def test_real_wall_answers_at_once_and_rests_at_0_8_newtons(speed):
    response = real_wall(HAND, HAND.press(speed))

    assert response.times[response.zero] == 0.0
    assert not response.force[: response.zero].any()
    assert response.force[response.zero] == pytest.approx(HAND.pad_damping * speed)  # a step, c v
    assert response.force.min() == 0.0
    assert response.force[metrics.rest(response)] == pytest.approx(0.8, abs=3e-4)


def exact_press(press):
    """A press on a real wall by an integrator of high order: position, speed and work until the release."""

    def motion(t, state):
        wanted = press.at(t)
        force = max(0.0, 200.0 * state[0] + 6.0 * state[1])
        push = 300.0 * (wanted.position - state[0]) + 3.0 * (wanted.velocity - state[1])
        return [state[1], (push - force) / 0.010, force * state[1]]

    start = [0.0, press.speed, 0.0]
    return solve_ivp(
        motion, (0.0, press.release_time), start, rtol=1e-10, atol=1e-14, max_step=1e-3, dense_output=True
    )


@pytest.mark.parametrize(
    ("speed", "printed", "first"), [(0.1, 2.534, 1), (0.25, 3.604, 1), (0.5, 5.407, 1), (1.0, 10.03, 0)]
)
def test_work_on_a_real_wall(speed, printed, first):
    """The reference has 2.534 / 3.604 / 5.407 / 10.03 mJ; it is 2.530 / 3.585 / 5.330 / 10.30 mJ.

    The printed ones are sums over every 0.1 ms, in which the sample at the contact counts wholly, and at 1
    m/s not at all: it depends on rounding whether the force has begun there. Summed so, they come out here as
    well.
    """
    press = HAND.press(speed)
    exact = exact_press(press)

    assert metrics.work(real_wall(HAND, press)) == pytest.approx(exact.y[2, -1], rel=1e-3)
    times = np.arange(1 - first, press.release_time / 1e-4) * 1e-4
    position, velocity, _ = exact.sol(times)
    summed = 1e-4 * np.sum(np.maximum(0.0, 200.0 * position + 6.0 * velocity) * velocity)
    assert 1e3 * summed == pytest.approx(printed, rel=2e-3)


def test_real_wall_is_the_exact_one():
    response, exact = real_wall(HAND, HAND.press(0.5)), exact_press(HAND.press(0.5))
    rows = slice(response.zero, response.zero + 20_000, 100)
    position, velocity, _ = exact.sol(response.times[rows])

    np.testing.assert_allclose(response.finger[rows], position, atol=4e-6)
    np.testing.assert_allclose(response.force[rows], 200.0 * position + 6.0 * velocity, atol=6e-3)


# ---------------------------------------------------------------------------------------------- ideal drum


def test_link_on_an_ideal_drum_is_the_floor():
    """Reference values, looked at as the reference does: every 0.1 ms, the contact's sample as above."""
    found = []
    for speed, first in zip(SPEEDS, (1.0, 1.0, 1.0, 0.0), strict=True):
        response = ideal_drum(HAND, HAND.press(speed), step=2e-6)
        every = slice(response.zero, None, round(1e-4 / response.step))
        real = real_wall(HAND, HAND.press(speed), like=response).force[every].copy()
        real[0] *= first
        found.append(100.0 * np.linalg.norm(response.force[every] - real) / np.linalg.norm(real))

    assert found == pytest.approx([1.7, 4.8, 10.0, 14.4], abs=0.1)


@pytest.mark.parametrize("speed", SPEEDS)
def test_floor_without_that_sampling_lies_within_its_spread(speed):
    """1.4 / 4.2 / 8.8 / 17.4 %; the reference has 1.7 / 4.8 / 10.0 / 14.4."""
    position = SPEEDS.index(speed)
    found = deviation(ideal_drum(HAND, HAND.press(speed)))

    assert found.error == pytest.approx([0.017, 0.048, 0.100, 0.144][position], abs=SHIFT[position])
    assert abs(found.onset) < 1e-4
    # F = D/(1/k_h + 1/k_f + 1/K), with the contact's 50 kN/m.
    rest = HAND.steady_force(HAND.press(speed).depth, 50e3)
    assert found.steady_error == pytest.approx(rest - 0.8, abs=2e-5)


def test_link_goes_as_far_past_an_ideal_drum_as_paper_says():
    """Reference: 0.018 mm at 0.1 m/s, 0.176 mm at 1 m/s."""
    assert deviation(ideal_drum(HAND, HAND.press(0.1))).penetration == pytest.approx(18e-6, abs=1e-6)
    assert deviation(ideal_drum(HAND, HAND.press(1.0))).penetration == pytest.approx(176e-6, rel=0.02)


def test_half_the_step_changes_the_floor_by_less_than_a_tenth_of_a_point():
    coarse, fine = (deviation(ideal_drum(HAND, HAND.press(0.25), step=step)).error for step in (1e-5, 5e-6))

    assert coarse == pytest.approx(fine, abs=1e-3)


# -------------------------------------------------------------------------------------------- penalty wall


@pytest.mark.parametrize(
    ("device", "printed"),
    [
        (COUPLED_DEVICE, (4593, 2398, 724.6, 253.0, 142.6)),
        (MASSLESS_MOTOR, (7303, 3451, 847.6, 297.3, 172.3)),
    ],
)
def test_critical_stiffness_of_a_delayed_spring(device, printed):
    """Reference values, to their digits."""
    for delay, stiffness in zip((0.0006, 0.001, 0.003, 0.010, 0.040), printed, strict=True):
        found = critical_stiffness(HAND, device, delay)
        assert found == pytest.approx(stiffness, abs=0.5 if stiffness > 1000 else 0.051)


def test_resistance_at_rest_is_hand_and_pad_in_a_row():
    assert device_resistance(HAND, COUPLED_DEVICE, 0.0) == pytest.approx(120.0)
    assert critical_stiffness(HAND, Link(mass=1.0, damping=100.0), 1e-4) > 1e5


@pytest.mark.parametrize("delay", [0.003, 0.010])
def test_finger_shakes_above_the_critical_stiffness_and_not_below(delay):
    """A sampled spring is felt half a period later than its latency."""
    ripples = {}
    for share in (0.9, 1.1):
        stiffness = share * critical_stiffness(HAND, COUPLED_DEVICE, delay)
        wall = PenaltyWall(stiffness, 0.0, 5000.0, delay - 1e-4, resolution=0.0)
        ripples[share] = deviation(penalty_wall(HAND, HAND.press(0.1, hold=1.5), wall)).ripple

    assert ripples[0.9] < 2e-3
    assert ripples[1.1] > 0.1


@pytest.mark.parametrize(
    ("latency", "stiffness", "damping"), [(0.0001, 2321.0, 7.7), (0.001, 1581.0, 4.7), (0.003, 734.0, 4.4)]
)
def test_steady_force_is_that_of_springs_in_a_row(latency, stiffness, damping):
    """Reference: within the encoder's K q."""
    wall = PenaltyWall(stiffness, damping, 1000.0, latency)
    press = HAND.press(0.1)
    found = deviation(penalty_wall(HAND, press, wall)).steady_error

    assert found == pytest.approx(HAND.steady_force(press.depth, stiffness) - 0.8, abs=stiffness * 31e-6)
    assert found < 0.0  # less than a real wall's, not more


def test_wall_of_734_newtons_a_metre_lacks_112_millinewtons():
    """As the reference values."""
    assert HAND.steady_force(HAND.press(0.1).depth, 734.0) - 0.8 == pytest.approx(-112.4e-3, abs=5e-5)


PENALTY = {  # ms: K, B, errors in %, onset in ms, penetration in mm, steady error in mN, work error in mJ
    0.1: (2321, 7.7, (7.2, 13.4, 26.2, 49.2), 1.2, (0.34, 1.96), -37, (-0.15, -2.8)),
    0.3: (2321, 9.1, (7.5, 13.6, 26.3, 49.1), 1.2, (0.35, 1.77), -34, (-0.15, -2.5)),
    1: (1581, 4.7, (8.6, 15.3, 28.9, 55.5), 2.3, (0.50, 3.42), -55, (-0.24, -6.7)),
    3: (734, 4.4, (15.2, 20.6, 33.7, 64.4), 4.3, (0.98, 5.63), -111, (-0.43, -14.5)),
    10: (232, 1.7, (35.4, 40.9, 61.3, 95.2), 12.6, (2.53, 11.4), -272, (-1.16, -38.9)),
    20: (108, 0.8, (54.4, 62.4, 80.4, 107.0), 29.5, (3.89, 13.5), -419, (-1.73, -31.3)),
    40: (108, 0.0, (57.7, 77.4, 88.6, 110.0), 53.4, (4.92, 13.5), -417, (-2.47, -22.7)),
}


@pytest.mark.parametrize("latency_ms", PENALTY)
def test_best_penalty_wall_against_latency(latency_ms):
    """Reference, 1 kHz: the same best K and B; the rest within what its 0.1 ms make of it.

    Penetration at 1 m/s and 0.3 ms is 2.17 mm here against 1.77 mm: it depends on when, after a sample, the
    contact comes. The reference does not tell; here it is a tenth of a period.
    """
    stiffness, damping, errors, onset, penetration, steady, work = PENALTY[latency_ms]
    wall = sweeps.best_penalty_wall(HAND, 1000.0, 1e-3 * latency_ms)
    row = sweeps.penalty_row(HAND, wall)
    slow, quarter, _, fast = row.deviations

    assert wall.stiffness == pytest.approx(stiffness, abs=0.5)
    assert wall.damping == pytest.approx(damping, abs=0.051)
    assert (np.abs(row.errors - np.array(errors) / 100.0) < SHIFT).all(), row.errors
    assert 1e3 * quarter.onset == pytest.approx(onset, abs=0.3)
    assert 1e3 * slow.penetration == pytest.approx(penetration[0], abs=0.021)
    assert 1e3 * fast.penetration == pytest.approx(penetration[1], rel=0.25 if latency_ms < 1 else 0.05)
    assert 1e3 * slow.steady_error == pytest.approx(steady, abs=6.0 if latency_ms < 40 else 15.0)
    # At 1 m/s half of a sample at the contact is 0.3 mJ, of the real wall and of this one.
    assert 1e3 * slow.work_error == pytest.approx(work[0], abs=0.02)
    assert 1e3 * fast.work_error == pytest.approx(work[1], abs=1.1)


@pytest.mark.parametrize(
    ("rate", "device", "latency_ms", "errors"),
    [
        (200, COUPLED_DEVICE, 0.1, (15.4, 21.5, 35.6, 70.1)),
        (200, COUPLED_DEVICE, 1, (20.4, 25.1, 37.1, 69.5)),
        (200, COUPLED_DEVICE, 10, (44.5, 51.2, 70.3, 101.0)),
        (200, COUPLED_DEVICE, 40, (58.0, 76.7, 88.0, 109.0)),
        (3000, COUPLED_DEVICE, 0.1, (5.3, 12.7, 25.9, 49.5)),
        (3000, COUPLED_DEVICE, 1, (8.6, 14.6, 27.3, 52.1)),
        (3000, COUPLED_DEVICE, 10, (35.3, 40.4, 59.1, 92.5)),
        (3000, COUPLED_DEVICE, 40, (57.6, 77.5, 88.7, 110.0)),
        (1000, MASSLESS_MOTOR, 0.1, (8.7, 12.5, 21.4, 36.8)),
        (1000, MASSLESS_MOTOR, 10, (35.2, 40.2, 58.9, 79.2)),
        (1000, MASSLESS_MOTOR, 40, (56.4, 68.3, 74.8, 83.6)),
    ],
)
def test_best_penalty_wall_against_rate_and_device(rate, device, latency_ms, errors):
    """Reference: from 1 ms of latency on it is latency that limits, not rate."""
    wall = sweeps.best_penalty_wall(HAND, float(rate), 1e-3 * latency_ms, device=device)
    found = sweeps.penalty_row(HAND, wall, device=device).errors

    assert (np.abs(found - np.array(errors) / 100.0) < SHIFT).all(), found


def test_stiff_wall_shakes_where_latency_is_long():
    """Reference: K = 1000 N/m, B = 2 N s/m at 1 kHz and 0.1 m/s."""
    found = {
        ms: deviation(penalty_wall(HAND, HAND.press(0.1), PenaltyWall(1000.0, 2.0, 1000.0, 1e-3 * ms)))
        for ms in (0.1, 0.3, 1, 3, 10, 40)
    }

    errors = [100.0 * one.error for one in found.values()]
    assert errors == pytest.approx([11.7, 11.7, 11.9, 14.7, 218.0, 470.0], rel=0.015)
    assert found[3].ripple == pytest.approx(32e-3, rel=0.1)
    assert found[10].ripple == pytest.approx(1.8, rel=0.1)  # "+-2 N"


# ---------------------------------------------------------------------------------------------- DECAFF


@pytest.mark.parametrize(
    ("target", "speed", "printed", "share"),
    [
        (Target.NAIVE, 0.1, (4.1, 93, 141, 210, 423), 0.15),
        (Target.NAIVE, 0.5, (None, 93, 133, 200, 449), 0.20),
        (Target.LATCHED, 0.1, (3.7, 5.2, 7.6, 27, 116), 0.08),
        (Target.LATCHED, 0.5, (None, 28, 39, 89, 157), 0.10),
        (Target.FEED_FORWARD, 0.1, (2.5, 2.4, 2.5, 2.7), 0.0),
        (Target.FEED_FORWARD, 0.5, (10.0, 10.1, 10.2, 10.6), 0.0),
        (Target.TIME_STAMPED, 0.1, (2.5, 2.5, 2.5, 2.5, 2.5), 0.0),
        (Target.TIME_STAMPED, 0.5, (10.0, 10.0, 10.0, 10.1, 10.1), 0.0),
    ],
)
def test_how_a_distance_is_used_decides(target, speed, printed, share):
    """As the reference values. The naive ones shake, and are met within a share of the printed figures.

    Feed-forward at 40 ms, and the shortest latency at 0.5 m/s, are looked at below.
    """
    shift = {0.1: 0.013, 0.5: 0.03}[speed]
    for latency, figure in zip(LATENCIES, printed, strict=False):
        if figure is not None:
            found = error_of(target, speed, latency=latency)
            assert found == pytest.approx(figure / 100.0, abs=shift + share * figure / 100.0), latency


def test_naive_drum_with_hardly_any_latency():
    """The reference has 34 and 22 % at 0.5 m/s and 0.1 ms, naive and latched; here 20 to 39 and 16 to 20 %.

    The target is a sawtooth of 0.5 mm then: the age of the last distance at the touch decides,
    and the reference does not tell.
    """
    phases = np.arange(10) / 10.0
    naive = [error_of(Target.NAIVE, 0.5, latency=0.0001, phase=phase) for phase in phases]
    latched = [error_of(Target.LATCHED, 0.5, latency=0.0001, phase=phase) for phase in phases]

    assert 0.2 < min(naive) < 0.34 < max(naive) < 0.4
    assert 0.16 < min(latched) < max(latched) < 0.22 + SHIFT[2]


def test_claim_holds_when_the_distance_is_used_with_its_pose_and_not_otherwise():
    """The reference in words, at 0.5 m/s: worse and worse, but for the time-stamped one."""
    for latency in LATENCIES[1:]:
        naive, latched, forward, stamped = (error_of(one, 0.5, latency=latency) for one in Target)
        assert naive > 2.0 * latched > 2.0 * forward
        assert stamped == pytest.approx(forward, abs=2e-3)
        assert naive > 0.75
    assert error_of(Target.NAIVE, 0.1, latency=0.001) > 10.0 * error_of(Target.NAIVE, 0.1, latency=0.0001)


def test_feed_forward_misleads_when_the_hand_turns_back():
    """The reference has 5.4 % at 0.1 m/s and 40 ms, 13.9 % at 0.5 m/s; here 12 % and 8.8 %.

    The touch is right. What is wrong comes after the release, while speeds are still those of the press.
    """
    response = decaff(HAND, HAND.press(0.1), with_sensing(latency=0.040), Target.FEED_FORWARD)
    real = real_wall(HAND, HAND.press(0.1), like=response)
    is_press = (response.times >= 0.0) & (response.times < response.press.release_time)

    assert drum_offset(response) == pytest.approx(0.0, abs=2e-5)
    wrong = np.square(response.force - real.force)[response.zero :]
    assert wrong[is_press[response.zero :]].sum() < 0.05 * wrong.sum()
    assert 0.05 < deviation(response, real).error < 0.15


@pytest.mark.parametrize("latency", LATENCIES)
def test_time_stamped_drum_is_in_place_at_every_speed_and_latency(latency):
    """Reference: within 0.02 mm of the wall, 0.1 to 1 m/s, up to 40 ms, told from 100 mm away."""
    for speed in SPEEDS:
        response = decaff(HAND, HAND.press(speed), with_sensing(latency=latency))
        assert abs(drum_offset(response)) < 2e-5
        assert abs(drum_lag(response)) < 2e-5


@pytest.mark.parametrize("latency", LATENCIES)
def test_time_stamped_drum_at_1_metre_a_second(latency):
    """Reference: 14.3 to 14.7 % at every latency, onset within 0.1 ms, steady error below 8 mN.

    Here 17.2 to 17.6 %, for the reason above. Its work error is at most 0.17 mJ there, 0.24 mJ here: at 1 m/s
    half a sample of 0.1 ms is 0.3 mJ.
    """
    found = deviation(decaff(HAND, HAND.press(1.0), with_sensing(latency=latency)))
    floor = deviation(ideal_drum(HAND, HAND.press(1.0)))

    assert found.error == pytest.approx(0.145, abs=SHIFT[3])
    assert found.error == pytest.approx(floor.error, abs=0.01)
    assert abs(found.onset) < 1e-4
    assert abs(found.steady_error) < 8e-3
    assert abs(found.work_error) < 0.3e-3


def test_drum_beats_the_best_penalty_wall_at_every_latency():
    for latency_ms, row in PENALTY.items():
        found = sweeps.drum_row(HAND, with_latency(GLOVE, 1e-3 * latency_ms)).errors
        assert (found < 0.68 * np.array(row[2]) / 100.0).all()
        assert found[3] < 0.2 < 0.49 <= row[2][3] / 100.0


@pytest.mark.parametrize("speed", [0.1, 0.25, 0.5])
@pytest.mark.parametrize("latency", [0.001, 0.003, 0.010])
@pytest.mark.parametrize("target", [Target.NAIVE, Target.LATCHED])
def test_naive_drum_is_late_by_what_the_finger_goes_meanwhile(target, latency, speed):
    """Reference: v (tau + 0.5 to 0.9 ms), within 10 %."""
    offset = drum_offset(decaff(HAND, HAND.press(speed), with_sensing(latency=latency), target))

    assert 0.9 * speed * (latency + 0.5e-3) < offset < 1.1 * speed * (latency + 0.9e-3)


def test_stale_offsets_of_the_printed_row():
    """Reference: mm at 0.1 m/s, for 0.1, 1, 3, 10, 40 ms; within a hundredth of them, or of a millimetre."""
    press = HAND.press(0.1)
    for latency, printed in zip(LATENCIES, (0.054, 0.152, 0.359, 1.056, 3.80), strict=True):
        found = drum_offset(decaff(HAND, press, with_sensing(latency=latency), Target.LATCHED))
        assert 1e3 * found == pytest.approx(printed, rel=0.01, abs=0.01)


def test_stale_distances_make_the_drum_chase_a_finger_that_leaves():
    """Reference: up to 6 N on retreat."""
    for target, chases in ((Target.LATCHED, True), (Target.TIME_STAMPED, False)):
        response = decaff(HAND, HAND.press(0.1), with_sensing(latency=0.040), target)
        leaving = response.force[response.times > response.press.release_time + 0.1]
        assert (leaving.max() > 3.0) == chases
        assert leaving.max() > 3.0 or leaving.max() < 0.4


# ----------------------------------------------------------------------------------------------- which drum


@pytest.mark.parametrize(
    ("name", "rate", "errors", "travel"),
    [
        ("direct", 1000, (11.1, 26.9), (1.03, 3.34)),
        ("direct", 3000, (4.1, 17.0), (0.10, 0.85)),
        ("direct", 10_000, (10.3, 17.4), (0.02, 0.27)),
        ("gear4", 1000, (1.9, None), (0.09, None)),
        ("gear4", 3000, (2.6, 14.2), (0.02, 0.18)),
        ("gear10", 1000, (1.7, None), (0.03, None)),
        ("gear10", 3000, (1.9, 14.9), (0.02, 0.19)),
    ],
)
def test_drums_and_servos(name, rate, errors, travel):
    """Reference, at 0.1 and 1 m/s: errors in %, travel past the wall in mm.

    Geared drums at 1 kHz and 1 m/s are looked at below.
    """
    row = sweeps.drum_row(HAND, with_drum(GLOVE, DRUMS[name], rate), speeds=(0.1, 1.0))
    for found, error, way, shift in zip(row.deviations, errors, travel, (0.012, 0.05), strict=True):
        if error is not None:
            assert 100.0 * found.error == pytest.approx(error, abs=100.0 * shift)
            assert 1e3 * found.penetration == pytest.approx(way, rel=0.12, abs=0.04)


def test_fast_direct_drum_rattles_with_its_encoder():
    """Reference: 83 mN of encoder noise with the direct drum at 10 kHz; here 40 to 56 mN, and none geared."""
    press = HAND.press(0.5)
    noisy = deviation(decaff(HAND, press, with_drum(GLOVE, DIRECT, 10_000.0))).ripple
    geared = deviation(decaff(HAND, press, GLOVE)).ripple

    assert 0.03 < noisy < 0.1
    assert geared < 1e-3


def test_geared_drum_at_1_khz_is_still_hunting_at_1_metre_a_second():
    """The reference has 12.7 and 13.3 %, less than its floor: its drums stand a little before the wall then.

    Here they stand 0.1 mm behind it, where they stick (see the drum's settling), and 21 % comes of it.
    """
    for name in ("gear4", "gear10"):
        response = decaff(HAND, HAND.press(1.0), with_drum(GLOVE, DRUMS[name], 1000.0))
        assert 0.05e-3 < abs(drum_lag(response)) < 0.15e-3
        assert deviation(response).error == pytest.approx(0.13, abs=0.09)


def test_direct_drum_at_1_khz_is_no_better_than_a_penalty_wall():
    """Reference: at 0.1 m/s, against 7.2 % of the best wall."""
    assert deviation(decaff(HAND, HAND.press(0.1), with_drum(GLOVE, DIRECT, 1000.0))).error > 0.072
    assert deviation(decaff(HAND, HAND.press(0.1), with_drum(GLOVE, DIRECT, 500.0))).error > 0.15


# ------------------------------------------------------------------------------------- rates and accuracy


@pytest.mark.parametrize("rate", [25.0, 100.0, 1000.0, 3000.0])
def test_time_stamped_drum_reaches_the_floor_at_any_rate(rate):
    """Reference: latency of one period; 2.1-2.6 % at 0.1 m/s, 14-15 % at 1 m/s."""
    found = sweeps.drum_row(HAND, with_latency(GLOVE, 1.0 / rate, rate), speeds=(0.1, 1.0)).errors

    assert (np.abs(found - (0.023, 0.145)) < (0.012, 0.05)).all()


def test_ten_distances_a_second_are_too_few_at_1_metre_a_second():
    """Reference: the look-ahead is used up."""
    found = sweeps.drum_row(HAND, with_latency(GLOVE, 0.1, 10.0)).errors

    assert (found[:3] < (0.03, 0.05, 0.11)).all()
    assert found[3] > 0.9


def test_feed_forward_at_25_hz():
    """The reference has 8.6 / 16 / 17 % at unnamed speeds; here 12 / 6 / 9 / 18 % at all four."""
    found = sweeps.drum_row(HAND, with_latency(GLOVE, 0.04, 25.0), Target.FEED_FORWARD).errors

    assert 0.05 < found[0] < 0.15
    assert found[3] == pytest.approx(0.17, abs=0.05)


@pytest.mark.parametrize("bias", [1e-4, 5e-4, 1e-3])
def test_bias_shifts_the_wall(bias):
    """Reference: -120 N/m times the bias: 12, 60, 120 mN; contact early or late by e/v."""
    plain = deviation(decaff(HAND, HAND.press(0.1), GLOVE))
    far, near = (deviation(decaff(HAND, HAND.press(0.1), with_sensing(bias=e))) for e in (bias, -bias))

    assert far.steady_error - plain.steady_error == pytest.approx(-120.0 * bias, abs=1e-3)
    assert near.steady_error - plain.steady_error == pytest.approx(120.0 * bias, abs=1e-3)
    assert far.onset == pytest.approx(bias / 0.1, abs=1e-4)


@pytest.mark.parametrize(("latency", "printed"), [(0.001, 0.15), (0.010, 0.90), (0.040, 3.4)])
def test_proportional_error_puts_the_drum_off(latency, printed):
    """Reference: 20 % too far at 0.5 m/s, in mm; eps/(1 + eps) v (tau + 1/2f) plus a servo's lag."""
    found = drum_offset(decaff(HAND, HAND.press(0.5), with_sensing(latency=latency, scale_error=0.2)))

    assert 1e3 * found == pytest.approx(printed, abs=0.05)
    assert found - 0.2 / 1.2 * 0.5 * (latency + 0.5e-3) == pytest.approx(0.04e-3, abs=0.02e-3)


def test_noise_of_distances():
    """Reference: 0.05 mm harmless; 0.2 mm up to doubles the peak at 0.1 m/s (1.68 N); 1 mm unusable."""

    def peaks(noise):
        seeds = range(6)
        return [
            deviation(decaff(HAND, HAND.press(0.1), with_sensing(noise=noise, seed=one))) for one in seeds
        ]

    assert max(one.peak for one in peaks(0.05e-3)) < 0.95
    assert 1.3 < max(one.peak for one in peaks(0.2e-3)) < 3.0
    assert np.mean([one.error for one in peaks(1e-3)]) > 0.2


@pytest.mark.parametrize(
    ("wall_speed", "printed"),
    [(0.05, (0.08, 0.53, 2.0)), (-0.05, (0.08, 0.53, 2.0)), (-0.2, (0.4, 2.2, 8.2))],
)
def test_moving_wall_is_missed_by_what_it_goes_meanwhile(wall_speed, printed):
    """Reference: v (tau + about 0.9 ms), in mm at 1, 10, 40 ms."""
    for latency, figure in zip((0.001, 0.010, 0.040), printed, strict=True):
        response = decaff(HAND, HAND.press(0.1), with_sensing(latency=latency, wall_speed=wall_speed))
        off = drum_offset(response, wall_speed)
        assert abs(1e3 * off) == pytest.approx(figure, rel=0.05, abs=0.06)
        assert abs(off) == pytest.approx(abs(wall_speed) * (latency + 0.9e-3), rel=0.21)
        assert off * wall_speed < 0.0


def test_noise_is_the_same_on_every_run():
    one, other = (decaff(HAND, HAND.press(1.0), with_sensing(noise=1e-4)).record for _ in range(2))

    np.testing.assert_array_equal(one, other)


# ------------------------------------------------------------------------------------------- controllers


@pytest.mark.parametrize("target", Target)
def test_policy_asked_at_every_sample_does_what_the_compiled_one_does(target):
    glove = with_sensing(latency=0.003, noise=1e-4)
    compiled = decaff(HAND, HAND.press(1.0), glove, target)
    asked = decaff(HAND, HAND.press(1.0), glove, TargetPolicy(target))

    np.testing.assert_array_equal(asked.record, compiled.record)


def test_controller_sees_what_is_known_and_no_more():
    class Watcher:
        def __init__(self):
            self.sights = []

        def command(self, distance_sample):
            self.sights.append(distance_sample)
            return DrumCommand(DriveMode.OFF)

    watcher = Watcher()
    sensing = Sensing(latency=0.004, reach=0.020)
    response = decaff(HAND, HAND.press(0.5), replace(GLOVE, sensing=sensing), watcher)
    told = [distance_sample for distance_sample in watcher.sights if distance_sample.message]

    assert watcher.sights[0].message is None
    assert len(told) > 100
    for distance_sample in told:
        message = distance_sample.message
        assert 0.004 - 1e-9 <= distance_sample.now - message.at <= 0.005 + 1e-3 / 3
        assert message.distance <= 0.020
        assert message.link + message.distance == pytest.approx(0.0, abs=1e-15)
    # A drum that nobody drives stands where it was, and is pushed out of the way.
    assert response.drum[0] == GLOVE.holding.retracted
    assert not response.contact.any()


def test_glove_without_a_servo_has_the_one_that_suits_its_drum():
    assert Decaff(DIRECT).servo == servo_for(DIRECT, 3000.0)
    assert replace(Decaff(DIRECT), sensing=Sensing(rate=100.0)).servo == servo_for(DIRECT, 3000.0)


def test_loop_can_be_taken_sample_by_sample():
    loop, policy = DecaffLoop(HAND, HAND.press(1.0), GLOVE), TargetPolicy(Target.TIME_STAMPED)
    with pytest.raises(DecaffError, match="target is 'TS', expected a Target or a controller"):
        decaff(HAND, HAND.press(1.0), GLOVE, "TS")
    assert loop.now < -0.1
    while not loop.is_over:
        loop.tick(policy.command(loop.distance_sample()))

    with pytest.raises(DecaffError, match="the press is over at"):
        loop.tick(DrumCommand())
    with pytest.raises(DecaffError, match="the press is over at"):
        loop.distance_sample()
    with pytest.raises(DecaffError, match=r"expected one that has not begun"):
        loop.run(Target.NAIVE)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Hand(stiffness=0.0), "stiffness is 0.0, expected a positive number of newtons a metre"),
        (lambda: HAND.press(-0.1), "speed is -0.1, expected a positive number of metres a second"),
        (lambda: HAND.steady_force(math.nan), "depth is nan, expected a number of metres of 0 or more"),
        (lambda: Link(mass=0.0), "mass is 0.0, expected a positive number of kilograms"),
        (lambda: PenaltyWall(-1.0, 0.0), "stiffness is -1.0, expected a number of newtons a metre of 0 or"),
        (lambda: Sensing(rate=0.0), "rate is 0.0, expected a positive number of hertz"),
        (lambda: Sensing(bias=math.inf), "bias is inf, expected a"),
        (lambda: Sensing(phase=1.0), "phase is 1.0, expected one below 1 of a period"),
        (lambda: Sensing(seed=-1), "seed is -1, expected a whole number of 0 or more"),
        (lambda: Holding(touch_gap=0.0), "touch_gap is 0.0, expected a positive number of metres"),
        (lambda: real_wall(HAND, Press()), "press touches at 0.05 s, expected one that touches at 0"),
        (lambda: real_wall(HAND, HAND.press(0.1), step=0.0), "step is 0.0, expected a positive number"),
        (lambda: critical_stiffness(HAND, COUPLED_DEVICE, 0.0), "delay is 0.0, expected a positive number"),
    ],
)
def test_what_cannot_be_is_named(make, message):
    with pytest.raises(DecaffError) as caught:
        make()

    assert message in str(caught.value)


def test_finger_that_meets_nothing_has_no_onset_and_no_offset():
    glove = replace(GLOVE, holding=Holding(retracted=0.1))
    response = decaff(HAND, HAND.press(1.0), replace(glove, sensing=Sensing(latency=0.5)))

    assert math.isnan(drum_offset(response))
    assert metrics.onset(response, threshold=100.0) == math.inf


# --------------------------------------------------------------------------------------------- compiling


PRESSES = """
import hashlib
from proximity.studies.simulation.closed_loop import decaff, ideal_drum, penalty_wall, real_wall
from proximity.studies.simulation.devices import Decaff, PenaltyWall, Sensing
from proximity.studies.simulation.hand import Hand
hand = Hand()
press = hand.press(1.0, hold=1e-3)
glove = Decaff(sensing=Sensing(reach=0.002, latency=0.0003, noise=1e-5))
digests = [
    hashlib.sha256(one.record.tobytes()).hexdigest()
    for one in (
        decaff(hand, press, glove),
        penalty_wall(hand, press, PenaltyWall(734.0, 4.4), step=1e-4),
        real_wall(hand, press, step=1e-4),
        ideal_drum(hand, press, step=1e-4),
    )
]
"""


def test_kernels_give_the_same_numbers_uncompiled():
    compiled = {}
    exec(PRESSES, compiled)
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": str(ROOT)}
    script = PRESSES + "print(*digests)"
    done = subprocess.run(
        [sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True
    )

    assert len(compiled["digests"]) == 4
    assert done.stdout.split() == compiled["digests"]
