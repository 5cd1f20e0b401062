"""Walls of the paper: forces, figures and energies, compared with the reference values."""

import math
import re

import numpy as np
import pytest
from scipy.integrate import quad

from proximity.errors import ArgumentError
from proximity.lab.paper import figure_5, walls
from proximity.lab.paper.trajectories import Press
from proximity.lab.paper.walls import FINGER, Convention, SpringDamper, TraditionalWall, in_series

MS, MM, MJ = 1e-3, 1e-3, 1e-3
STEP = 1e-5  # s, of the curves below, as in the reference
PRESS = Press()
TIMES = figure_5.sample_times(STEP)
CURVES = {name: curve(TIMES) for name, curve in figure_5.FIGURES.items()}
COMPARISONS = {
    name: figure_5.compare(TIMES, CURVES[name], CURVES["5a"]) for name in ("5a", "5b", "5c", "5d", "5g", "5h")
}


def test_press_has_the_instants_of_the_paper():
    deep = PRESS.deeper(figure_5.PENETRATION)

    assert deep.depth - PRESS.depth == pytest.approx(4.0 * MM, rel=1e-12)
    assert (PRESS.rise_time, PRESS.stop_time, PRESS.loss_time) == pytest.approx((0.080, 0.130, 0.360))
    assert (deep.rise_time, deep.stop_time, deep.loss_time) == pytest.approx((0.160, 0.210, 0.440))


@pytest.mark.parametrize("press", [PRESS, PRESS.deeper(0.004), Press(1.0, 0.006, 0.0, 0.5)])
def test_motion_is_smooth_and_its_derivatives_are_its_own(press):
    times = np.linspace(press.touch_time - 0.02, press.loss_time + 0.02, 40_001)
    motion, h = press.at(times), times[1] - times[0]

    for values, rates in ((motion.position, motion.velocity), (motion.velocity, motion.acceleration)):
        differences = (values[2:] - values[:-2]) / (2.0 * h)
        np.testing.assert_allclose(differences, rates[1:-1], atol=2e-3 * np.abs(rates).max())
    peak = 1.5 * press.speed / press.rise_time  # 3 X / Ta²
    assert np.abs(motion.acceleration).max() == pytest.approx(peak, rel=1e-6)
    assert (motion.position > 0.0).tolist() == (
        (times > press.touch_time) & (times < press.loss_time)
    ).tolist()


def test_rise_is_the_quintic_of_its_six_conditions():
    """Position, speed and acceleration at both ends; in this rise time the fifth power vanishes."""
    powers = np.arange(6)
    rows = []
    for s in (0.0, 1.0):
        rows += [
            s**powers,
            powers * s ** np.maximum(powers - 1, 0),
            powers * (powers - 1) * s ** np.maximum(powers - 2, 0),
        ]
    quintic = np.linalg.solve(
        np.array(rows), [0.0, PRESS.speed * PRESS.rise_time, 0.0, PRESS.depth, 0.0, 0.0]
    )
    times = np.linspace(PRESS.touch_time, PRESS.stop_time, 50)

    assert abs(quintic[5]) < 1e-15
    share = (times - PRESS.touch_time) / PRESS.rise_time
    np.testing.assert_allclose(PRESS.at(times).position, np.polyval(quintic[::-1], share), atol=1e-16)


REFUSED = [
    (lambda: PRESS.deeper(0.016),
     "release_time is 0.28 s, but the finger stops at 0.45 s: expected a press that stops before it"),
    (lambda: Press(speed=0.0), "speed is 0.0, expected a positive number of metres a second"),
    (lambda: PRESS.deeper(-0.001), "penetration is -0.001, expected a number of metres of 0 or more"),
    (lambda: Press(depth=True), "depth is True, expected a positive number of metres"),
    (lambda: TraditionalWall().force(TIMES, PRESS, "old"),
     "no convention 'old', expected one of newton, pad, printed"),
    (lambda: figure_5.simulated_wall("5x", TIMES),
     "no simulated wall is shown in figure '5x', expected one of 5b, 5c, 5d, 5g, 5h"),
    (lambda: figure_5.critical_gain(FINGER, 0.0), "step is 0.0, expected a positive number of seconds"),
    (lambda: figure_5.react(PRESS, FINGER, math.nan, 0.04, end=1.0),
     "gain is nan, expected a number of metres a newton of 0 or more"),
    (lambda: SpringDamper(-1.0, 0.0), "stiffness is -1.0, expected a number of newtons a metre of 0 or more"),
    (lambda: SpringDamper(1.0, 0.0, math.inf), "mass is inf, expected a number of kilograms of 0 or more"),
    (lambda: TraditionalWall(delay=-0.04), "delay is -0.04, expected a number of seconds of 0 or more"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        make()


def test_conventions_differ_by_the_inertia():
    force = {each: walls.contact_force(PRESS.at(TIMES), FINGER, each.value) for each in Convention}
    inertia = FINGER.mass * PRESS.at(TIMES).acceleration
    # Only times at which none of the three is clamped.
    is_pushed = (PRESS.touch_time < TIMES) & (TIMES < 0.330)

    np.testing.assert_allclose((force["newton"] - force["pad"])[is_pushed], inertia[is_pushed], atol=1e-15)
    np.testing.assert_allclose((force["pad"] - force["printed"])[is_pushed], inertia[is_pushed], atol=1e-15)
    assert np.abs(force["newton"] - force["printed"])[is_pushed].max() == pytest.approx(0.0375, rel=1e-6)
    assert force["newton"].max() == pytest.approx(0.93338, abs=5e-6)
    assert force["printed"].max() == pytest.approx(0.97065, abs=5e-6)
    assert force["pad"].max() == pytest.approx(0.95201, abs=5e-6)


def test_force_jumps_at_the_touch_and_would_pull_at_the_loss():
    after, before = PRESS.touch_time + 1e-12, PRESS.loss_time - 1e-12
    motion = PRESS.at([PRESS.touch_time, after, before])

    assert walls.contact_force(motion, FINGER)[:2] == pytest.approx([0.0, 0.6], abs=1e-9)
    assert walls.contact_force(motion, FINGER, can_pull=True)[2] == pytest.approx(-0.6, abs=1e-9)
    assert walls.contact_force(motion, FINGER)[2] == 0.0


# peak N, at ms after touch, steady N, last force ms, N at the real loss, mN·s after it, RMS error N
TABLE = {
    "5a": (0.93338, 36.66, 0.80000, 334.26, 0, 0, 0),
    "5b": (1.64876, 109.00, 1.60000, 411.42, 0.99063, 26.78, 0.758),
    "5c": (1.64876, 149.00, 1.60000, 451.42, 1.45547, 76.80, 0.921),
    "5d": (0.93338, 76.66, 0.80000, 374.26, 0.33125, 2.418, 0.341),
    "5g": (0.94269, 113.51, 0.80000, 429.18, 0.67734, 26.09, 0.407),
    "5h": (1.60000, 200.00, 1.60000, 474.95, 1.53359, 107.27, 0.952),
}


@pytest.mark.parametrize("name", TABLE)
def test_curve_has_the_numbers_of_the_paper(name):
    """The reference's impulses begin half a step after the loss: its sum omits the first instant."""
    peak, peak_ms, steady, end_ms, at_loss, impulse, rms = TABLE[name]
    found = COMPARISONS[name]

    assert (found.peak, found.steady, found.force_at_loss) == pytest.approx(
        (peak, steady, at_loss), abs=5.1e-6
    )
    assert (found.peak_time, found.end_time) == pytest.approx((peak_ms * MS, end_ms * MS), abs=1.01 * STEP)
    half_step = 0.5 * STEP * at_loss
    assert found.impulse_after_loss - half_step == pytest.approx(impulse * 1e-3, abs=5.1e-6)
    assert found.rms_error == pytest.approx(rms, abs=5.1e-4)


def test_impulse_after_the_loss_is_the_integral():
    def force(time):
        return float(figure_5.simulated_wall("5d", np.array(time)))

    exact = quad(force, PRESS.loss_time, COMPARISONS["5d"].end_time, epsabs=1e-12)[0]

    assert COMPARISONS["5d"].impulse_after_loss == pytest.approx(exact, abs=1e-9)


def test_wall_without_force_has_no_end():
    assert math.isnan(figure_5.compare(TIMES, 0.0 * TIMES, CURVES["5a"]).end_time)


def growth(finger, gain, step):
    """Return the growth per step of a disturbance during contact: the largest root."""
    damping, inertia = finger.damping / step, finger.mass / step**2
    weights = np.array([finger.stiffness + damping + inertia, -damping - 2.0 * inertia, inertia])
    return float(np.abs(np.roots([1.0, *(gain * weights)])).max())


CRITICAL = {1: 0.019157, 2: 0.061728, 5: 0.238095, 10: 0.555556, 20: 1.111111, 40: 1.904762}


@pytest.mark.parametrize("step_ms", CRITICAL)
def test_critical_gain_is_that_of_the_paper_and_of_the_roots(step_ms):
    gain = figure_5.critical_gain(FINGER, step_ms * MS)

    assert gain * 1e3 == pytest.approx(CRITICAL[step_ms], abs=5.1e-7)
    assert growth(FINGER, 0.999 * gain, step_ms * MS) < 1.0
    assert growth(FINGER, gain, step_ms * MS) == pytest.approx(1.0, abs=1e-12)
    assert growth(FINGER, 1.001 * gain, step_ms * MS) > 1.0


@pytest.mark.parametrize(("step_ms", "factor"), [(1, 1.248), (40, 1.367)])
def test_disturbance_grows_as_the_roots_say(step_ms, factor):
    step = step_ms * MS
    gain = 1.5 * figure_5.critical_gain(FINGER, step)
    press = Press(release_time=100.0)
    reaction = figure_5.react(press, FINGER, gain, step, end=PRESS.stop_time + 100 * step, can_pull=True)

    assert growth(FINGER, gain, step) == pytest.approx(factor, abs=5e-4)
    steady = FINGER.stiffness * press.depth / (1.0 + gain * FINGER.stiffness)
    disturbance = np.abs(reaction.force - steady)[-20:]
    np.testing.assert_allclose(disturbance[1:] / disturbance[:-1], factor, atol=1e-3)


def test_wall_that_cannot_pull_ends_the_growth_in_a_limit_cycle():
    step = 0.010
    gain = 1.5 * figure_5.critical_gain(FINGER, step)
    press = Press(release_time=100.0)
    force = figure_5.react(press, FINGER, gain, step, end=20.0).force

    later, last = force[1000:1500], force[1500:2000]
    assert later.max() == pytest.approx(last.max(), rel=1e-6)
    assert (later.min(), last.min()) == (0.0, 0.0)
    assert last.max() > 2.0 * FINGER.stiffness * press.depth


def test_stable_operator_comes_to_rest():
    gain = 0.5 * figure_5.critical_gain(FINGER, 0.040)
    press = Press(release_time=100.0)
    reaction = figure_5.react(press, FINGER, gain, 0.040, end=8.0)

    expected = FINGER.stiffness * press.depth / (1.0 + gain * FINGER.stiffness)
    assert reaction.force[-1] == pytest.approx(expected, rel=1e-9)
    assert reaction.position[-1] == pytest.approx(expected / FINGER.stiffness, rel=1e-9)
    assert len(reaction.times) == len(reaction.position) == len(reaction.force) == 201


def test_figure_5f_holds_the_forces_of_the_recursion():
    gain = figure_5.GAIN_SHARE * figure_5.critical_gain(FINGER, 0.040)
    deep = PRESS.deeper(figure_5.PENETRATION)  # the paper's "from the xs+f data"
    reaction = figure_5.react(deep, FINGER, gain, 0.040, end=0.520)

    np.testing.assert_array_equal(figure_5.operator_reacts(reaction.times + 0.010), reaction.force)
    assert figure_5.operator_reacts(np.array([-0.001, 0.0])).tolist() == [0.0, 0.0]
    np.testing.assert_allclose(
        figure_5.operator_reacts(TIMES, gain=0.0, step=STEP)[6000], CURVES["5b"][6000], atol=1e-3
    )


def test_limits_of_a_series_are_right():
    """The stiffness at low frequency, the damping at high frequency, and both if they are proportional."""
    wall, proportional = SpringDamper(200.0, 1.2), SpringDamper(1000.0, 30.0)
    for other, s in ((wall, 1e-3j), (wall, 1e9j), (proportional, 20j), (proportional, 200j)):
        pair = in_series(FINGER, other)
        one, two = (each.stiffness + s * each.damping for each in (FINGER, other))
        exact, found = one * two / (one + two), pair.stiffness + s * pair.damping
        assert found.real == pytest.approx(exact.real, rel=1e-9) or abs(s) > 1e8
        assert found.imag == pytest.approx(exact.imag, rel=1e-9) or abs(s) < 1.0


def test_spring_that_is_none_is_left_out_of_a_series():
    assert in_series(FINGER, SpringDamper(math.inf, math.inf)) == FINGER
    assert in_series(FINGER, SpringDamper(0.0, 0.0)) == SpringDamper(0.0, 0.0, FINGER.mass)


SMOOTH = 26 / 35  # of a press


@pytest.mark.parametrize(
    ("left", "end", "factor"),
    [
        (lambda s: math.exp(-s), math.inf, 1 / 2),
        (lambda s: 1.0 - s / 2.0, 2.0, 2 / 3),
        (lambda s: float(PRESS.at(PRESS.touch_time + s * 0.004 / 0.1).velocity) / 0.1, 2.0, SMOOTH),
    ],
)
def test_factor_of_the_loss_is_the_mean_of_the_speed_that_is_left(left, end, factor):
    assert quad(left, 0.0, end)[0] == pytest.approx(1.0)
    assert quad(lambda s: left(s) ** 2, 0.0, end)[0] == pytest.approx(factor, abs=1e-8)


def energies(press, finger):
    """Return kinetic energy at the touch, work of the hand, energy of the spring, loss of the damper, J."""

    def integral(value):
        return quad(value, press.touch_time, press.stop_time, epsabs=1e-15)[0]

    def power(t):
        motion = press.at([t])
        return float((walls.contact_force(motion, finger, can_pull=True) * motion.velocity)[0])

    loss = integral(lambda t: finger.damping * float(press.at(t).velocity) ** 2)
    spring = walls.spring_energy(finger.stiffness, press.depth)
    return 0.5 * finger.mass * press.speed**2, integral(power), spring, loss


def test_press_takes_the_muscles_work():
    """Reference on equation (12): 0.05 mJ of kinetic energy cannot supply 2.80 mJ; the hand does work."""
    kinetic, work, spring, loss = energies(PRESS, FINGER)

    assert kinetic + work == pytest.approx(spring + loss, abs=1e-13)
    assert kinetic == pytest.approx(0.05 * MJ, abs=1e-9 * MJ)
    assert spring == pytest.approx(1.600 * MJ, abs=1e-9 * MJ)
    assert loss == pytest.approx(1.782857 * MJ, abs=5.1e-7 * MJ)
    assert work == pytest.approx(3.332857 * MJ, abs=5.1e-7 * MJ)
    assert loss == pytest.approx(walls.damping_loss(6.0, 0.1, 0.004, SMOOTH), rel=1e-9)
    printed = walls.spring_energy(200.0, 0.004) + walls.damping_loss(6.0, 0.1, 0.004, 0.5)
    assert printed == pytest.approx(2.80 * MJ, rel=1e-12)


def test_energy_excess_is_that_of_the_two_presses():
    """(13) to (15) against the energies of the motions: their kinetic energy is the same."""
    real, simulated = (energies(press, FINGER)[1] for press in (PRESS, PRESS.deeper(0.004)))
    found = walls.energy_excess(PRESS, 0.004, FINGER, factor=SMOOTH)

    assert found == pytest.approx(simulated - real, abs=1e-12)
