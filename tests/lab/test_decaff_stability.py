"""Limits of sampled and delayed walls, derived and compared with reference values."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sampled_walls import is_stable, stiffness_limit

from proximity.decaff.drum import sampled_mass, servo
from proximity.decaff.drum.sampled_mass import Gains, SampledMass
from proximity.errors import ArgumentError
from proximity.lab import stability
from proximity.lab.stability import Verdict

PAPER_WALL = SampledMass()  # 0.7 kg, 200 Hz, the one sample of equation (1)
UNIT = {d: SampledMass(1.0, 1.0, d) for d in (0, 1, 2, 3, 4, 8)}


def radius(device, stiffness, damping):
    return float(sampled_mass.spectral_radius(sampled_mass.characteristic(device, stiffness, damping)))


def test_polynomial_of_equation_1_is_the_printed_one():
    a, b = 0.07, 0.2
    found = sampled_mass.characteristic(UNIT[1], a * UNIT[1].stiffness_unit, b * UNIT[1].damping_unit)

    np.testing.assert_allclose(found, [1.0, -2.0, 1.0 + a + b, a, -b], rtol=1e-15)


@pytest.mark.parametrize("delay_samples", [0, 1, 3])
def test_polynomial_is_that_of_the_motion(delay_samples):
    """The long-term growth of a mass stepped sample by sample is that of the largest root."""
    device = SampledMass(0.7, 0.005, delay_samples)
    for share in (0.5, 1.3):
        gains = sampled_mass.maximum_stiffness(device)
        stiffness = share * gains.stiffness
        positions, position, velocity, force = [0.0] * (delay_samples + 1), 1e-3, 0.0, 0.0
        logs = []
        for step in range(2000):
            positions.append(position)
            last, before = positions[-1 - delay_samples], positions[-2 - delay_samples]
            force = stiffness * last + gains.damping * (last - before) / device.period
            position += velocity * device.period - 0.5 * force / device.mass * device.period**2
            velocity -= force / device.mass * device.period
            scale = math.hypot(position, velocity * device.period)
            if step % 100 == 99:  # neither underflow nor overflow
                positions = [each / scale for each in positions]
                position, velocity = position / scale, velocity / scale
                logs.append(math.log(scale) / 100.0)
        assert np.mean(logs[5:]) == pytest.approx(
            math.log(radius(device, stiffness, gains.damping)), abs=2e-3
        )


REFUSED = [
    (lambda: SampledMass(mass=-1), "mass is -1, expected a positive number of kilograms"),
    (lambda: SampledMass(period="1"), "period is '1', expected a positive number of seconds"),
    (lambda: SampledMass(delay_samples=1.5), "delay_samples is 1.5, expected a whole number of 0 or more"),
    (lambda: SampledMass(delay_samples=-1), "delay_samples is -1, expected a whole number of 0 or more"),
    (lambda: stability.boundary(PAPER_WALL, 1), "count is 1, expected a whole number of 2 or more"),
    (lambda: sampled_mass.damping_window(PAPER_WALL, 0.0),
     "stiffness is 0.0, expected a positive number of newtons a metre"),
    (lambda: stability.verdict(PAPER_WALL, Gains(100.0, math.nan)),
     "damping is nan, expected a number of newton seconds a metre"),
    (lambda: stability.slowest_period(0.7, Gains(100.0, 0.0)),
     "damping is 0.0, expected a positive number of newton seconds a metre"),
    (lambda: servo.best_damped(PAPER_WALL, 1.0),
     "share is 1.0, expected one below 1 of the largest stiffness"),
]  # fmt: skip


@pytest.mark.parametrize(("make", "message"), REFUSED, ids=[message for _, message in REFUSED])
def test_what_cannot_be_is_refused(make, message):
    with pytest.raises(ArgumentError, match=re.escape(message)):
        make()


def is_within_by_jury(coefficients):
    """Test whether all roots are within the unit circle, without computing them.

    Jury 1964, in the form of Schur and Cohn: the last coefficient must be smaller than the first, and
    likewise in the polynomial of the next lower degree, after elimination of the last.
    """
    rows = np.asarray(coefficients, np.float64)
    is_within = np.ones(rows.shape[:-1], bool)
    while rows.shape[-1] > 1:
        # Scaled, so that the coefficients of high degrees neither underflow nor overflow.
        rows = rows / np.where(rows[..., :1] == 0.0, 1.0, rows[..., :1])
        last = rows[..., -1:]
        is_within &= np.abs(last[..., 0]) < 1.0
        rows = np.where(is_within[..., None], rows - last * rows[..., ::-1], 1.0)[..., :-1]
    return is_within


def test_jury_and_roots_agree_on_random_walls():
    """40 000 of equation (1), near its region; and some with other delays."""
    rng = np.random.default_rng(7)
    for delay_samples, count in ((1, 40_000), (0, 4000), (2, 4000), (5, 4000)):
        device = SampledMass(1.0, 1.0, delay_samples)
        limit = sampled_mass.maximum_stiffness(device)
        stiffness = rng.uniform(-0.2, 1.5, count) * limit.stiffness
        damping = rng.uniform(-0.2, 1.2, count) * stability.largest_damping(device)
        polynomials = sampled_mass.characteristic(device, stiffness, damping)
        by_roots = sampled_mass.spectral_radius(polynomials)
        # At a root on the circle within rounding either answer is right.
        is_clear = np.abs(by_roots - 1.0) > 1e-9
        by_jury = is_within_by_jury(polynomials)
        assert is_clear.mean() > 0.999
        np.testing.assert_array_equal(by_jury[is_clear], by_roots[is_clear] < 1.0)
        assert 0.1 < by_jury.mean() < 0.9


@given(
    st.lists(st.complex_numbers(max_magnitude=1.5), min_size=1, max_size=4),
    st.floats(-3.0, 3.0).filter(lambda first: abs(first) > 1e-3),
)
def test_jury_tells_where_roots_are(half, first):
    modulus = np.abs(half)
    if (np.abs(modulus - 1.0) < 1e-3).any():
        return
    polynomial = first * np.poly(np.concatenate([half, np.conj(half)])).real

    assert is_within_by_jury(polynomial) == (modulus < 1.0).all()


def jury_limit(b):
    """Return the largest a of equation (1), from the active inequality in Jury's table."""
    p = 3.0 + b**2
    return 0.5 * (-p + math.sqrt(p**2 + 8.0 * b - 16.0 * b**2 - 8.0 * b**3))


@pytest.mark.parametrize(
    ("b", "expected"),
    [
        (0.05, 0.0295999477), (0.1, 0.0516068868), (0.2, 0.0719798994), (0.3, 0.0590651483),
        (0.4, 0.0100943368),
    ],
)  # fmt: skip
def test_limit_of_equation_1(b, expected):
    found = stiffness_limit(UNIT[1], b * UNIT[1].damping_unit) / UNIT[1].stiffness_unit

    assert found == pytest.approx(expected, abs=1e-9)
    assert found == pytest.approx(jury_limit(b), rel=1e-11)


@pytest.mark.parametrize("delay_samples", UNIT)
def test_region_is_what_the_boundary_encloses(delay_samples):
    device = UNIT[delay_samples]
    rng = np.random.default_rng(7)
    dampings = rng.uniform(0.0, 1.1, 200) * stability.largest_damping(device)
    limits = stiffness_limit(device, dampings)
    top = sampled_mass.maximum_stiffness(device).stiffness
    stiffness = rng.uniform(0.0, 1.3, (30, 200)) * top
    is_clear = np.abs(stiffness - limits) > 1e-6 * top

    found = is_stable(device, stiffness, np.broadcast_to(dampings, stiffness.shape))
    np.testing.assert_array_equal(found[is_clear], (stiffness < limits)[is_clear])


def test_boundary_is_where_the_radius_is_one():
    stiffness, damping = stability.boundary(PAPER_WALL, 50)

    inner = sampled_mass.spectral_radius(sampled_mass.characteristic(PAPER_WALL, stiffness, damping))
    np.testing.assert_allclose(inner, 1.0, atol=3e-7)  # the double root at the start splits by rounding
    assert (stiffness[0], damping[0], stiffness[-1]) == (0.0, 0.0, 0.0)
    assert damping[-1] == stability.largest_damping(PAPER_WALL)
    assert stiffness.max() <= sampled_mass.maximum_stiffness(PAPER_WALL).stiffness


def test_walls_with_no_damping_or_too_much_have_no_stiffness():
    limits = stiffness_limit(PAPER_WALL, [0.0, 116.0, 115.9])

    assert limits[:2] == pytest.approx([0.0, 0.0], abs=1e-9) and limits[2] > 0.0


@pytest.mark.parametrize(
    ("delay_samples", "stiffness", "damping", "paper_stiffness", "paper_damping"),
    [
        (0, 0.68629150, 0.82842713, 19216.16, 115.980),
        (1, 0.14446935, 0.42469379, 4045.14, 59.457),
        (2, 0.06243049, 0.29139223, 1748.05, 40.795),
        (3, 0.03478169, 0.22238429, 973.89, 31.134),
        (4, 0.02216247, 0.17994448, 620.55, 25.192),
        (8, 0.00680357, 0.10218729, 190.50, 14.306),
    ],
)
def test_largest_stiffness_by_delay(delay_samples, stiffness, damping, paper_stiffness, paper_damping):
    unit = sampled_mass.maximum_stiffness(UNIT[delay_samples])
    paper = sampled_mass.maximum_stiffness(SampledMass(0.7, 0.005, delay_samples))

    assert (unit.stiffness, unit.damping) == pytest.approx((stiffness, damping), abs=1e-8)
    assert (unit.stiffness, unit.damping) == pytest.approx((stiffness, damping), rel=1e-6)
    assert paper.stiffness == pytest.approx(paper_stiffness, abs=5.1e-3)
    assert paper.damping == pytest.approx(paper_damping, abs=5.1e-4)


@pytest.mark.parametrize(
    ("stiffness", "low", "high"), [(100, 0.755, 115.3), (3900, 48.396, 70.41), (4000, 53.301, 65.58)]
)
def test_damping_window(stiffness, low, high):
    found = sampled_mass.damping_window(PAPER_WALL, stiffness)

    assert found[0] == pytest.approx(low, abs=5.1e-4)
    assert found[1] == pytest.approx(high, abs=5.1e-2 if stiffness == 100 else 5.1e-3)
    for edge in found:
        assert radius(PAPER_WALL, stiffness, edge) == pytest.approx(1.0, abs=1e-9)


def test_wall_above_the_limit_has_no_window():
    assert np.isnan(sampled_mass.damping_window(PAPER_WALL, 4050.0)).all()


@pytest.mark.parametrize("delay_samples", UNIT)
def test_soft_walls_need_damping_for_their_delay(delay_samples):
    """kv > kp times the mean delay; and at most tan(pi/(4(d+1))) 2m/T: 115.98 for the paper's wall."""
    device = SampledMass(0.7, 0.005, delay_samples)
    stiffness = 1e-6 * device.stiffness_unit
    low, high = sampled_mass.damping_window(device, stiffness)

    assert low == pytest.approx(stiffness * (delay_samples + 0.5) * device.period, rel=1e-3)
    assert high == pytest.approx(stability.largest_damping(device), rel=1e-3)
    if delay_samples == 1:
        assert high == pytest.approx(115.98, abs=5e-3)


@pytest.mark.parametrize(
    ("stiffness", "damping", "expected"),
    [
        (3900.0, 60.0, Verdict.STABLE),
        (5000.0, 60.0, Verdict.TOO_STIFF),
        (3900.0, 45.0, Verdict.TOO_LITTLE_DAMPING),
        (3900.0, 75.0, Verdict.TOO_MUCH_DAMPING),
    ],
)
def test_love_and_book_say_what_destabilises(stiffness, damping, expected):
    found = stability.verdict(PAPER_WALL, Gains(stiffness, damping))

    assert found is expected
    assert bool(is_stable(PAPER_WALL, stiffness, damping)) is (expected is Verdict.STABLE)


@given(
    st.floats(-3.0, 12.0).map(lambda power: 10.0**power),
    st.floats(-3.0, 6.0).map(lambda power: 10.0**power),
    st.sampled_from([0, 1, 2, 7]),
)
def test_sampling_faster_restores_any_wall_with_damping(stiffness, damping, delay_samples):
    period = stability.slowest_period(0.7, Gains(stiffness, damping), delay_samples)

    def state(share):
        return stability.verdict(SampledMass(0.7, share * period, delay_samples), Gains(stiffness, damping))

    assert [state(share) for share in (0.01, 0.5, 0.999)] == [Verdict.STABLE] * 3
    assert Verdict.STABLE not in [state(share) for share in (1.001, 2.0, 50.0)]


def test_slowest_period_of_the_largest_stiffness_is_its_own():
    gains = sampled_mass.maximum_stiffness(PAPER_WALL)
    assert stability.slowest_period(0.7, gains) == pytest.approx(0.005, rel=1e-9)


def test_best_damped_servo():
    """Reference for the drum's servo: a fifth of the largest stiffness."""
    found = servo.best_damped(PAPER_WALL)

    assert found.stiffness / PAPER_WALL.stiffness_unit == pytest.approx(0.01445, abs=5.1e-6)
    assert found.damping / PAPER_WALL.damping_unit == pytest.approx(0.12576, abs=5.1e-6)
    assert radius(PAPER_WALL, found.stiffness, found.damping) == pytest.approx(0.7736, abs=5.1e-5)
    settled = math.log(0.02) / math.log(radius(PAPER_WALL, found.stiffness, found.damping))
    assert settled == pytest.approx(15.2, abs=0.051)  # samples
