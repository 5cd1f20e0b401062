"""From position to force, compared with reference values, and against a detector in plain numpy."""

import math
from dataclasses import replace

import numpy as np
import pytest
from paper_drums import PAPER_GLOVE

from proximity.decaff.controller.steady_force import Handover, SteadyForce, SteadyRule
from proximity.decaff.drum.drum_command import DriveMode
from proximity.errors import ArgumentError
from proximity.lab.simulation.closed_loop import DecaffLoop
from proximity.lab.simulation.devices import Sensing
from proximity.lab.simulation.force_after_contact import ForceAfterContact, Slave, bump
from proximity.lab.simulation.hand import Hand
from proximity.lab.simulation.target_policies import DistanceSample, Holding, Target, TargetPolicy

HAND = Hand()
RATE = 3000.0
ANY_SPEED = SteadyRule(slow_speed=math.inf)  # as in the reference's table, whose rule does not ask for it
STEP_AFTER = 0.5  # s, from the switch to the step of the slave's force
HOLD = 1.8  # s


def pressed(speed, *, rule=ANY_SPEED, is_bumpless=True, hold=HOLD, retracted=0.03, beyond=math.inf):
    """A press that is held while the slave's force steps from 0.8 to 0.4 N: response, and controller.

    It is looked at until the release, or for *beyond* seconds after the switch.
    """
    holding = Holding(retracted=retracted)
    glove = replace(PAPER_GLOVE, sensing=Sensing(reach=max(0.005, 0.07 * speed)), holding=holding)
    controller = ForceAfterContact(
        TargetPolicy(Target.TIME_STAMPED),
        lambda now: Slave(0.4 if now > controller.switched_at + STEP_AFTER else 0.8),
        RATE,
        Handover(rule, is_bumpless),
    )
    loop = DecaffLoop(HAND, HAND.press(speed, hold=hold), glove)
    while loop.now < loop.response.press.release_time and not loop.now > controller.switched_at + beyond:
        loop.tick(controller.command(loop.distance_sample()))
    return loop.response, controller


SWITCHES = {  # m/s: ms after the contact, bump in mN, bumpless and not (reference value)
    0.02: (475, 21, 788),
    0.1: (123, 13, 827),
    1.0: (87, 2.1, 816),
}


@pytest.mark.parametrize("speed", SWITCHES)
def test_switch_to_force(speed):
    """Reference: when, with what bump, and 0.396-0.406 N a second after a step to 0.4 N.

    Bumps here are 23 / 12 / 1 mN: how far friction holds the drum at the switch decides.
    """
    at, printed_bump, _ = SWITCHES[speed]
    response, controller = pressed(speed)
    later = response.zero + round((controller.switched_at + STEP_AFTER + 1.0) / response.step)

    assert 1e3 * controller.switched_at == pytest.approx(at, abs=2.5)
    assert 1e3 * bump(response, controller.switched_at) == pytest.approx(printed_bump, abs=8.5)
    assert 0.396 <= response.force[later] <= 0.4065


@pytest.mark.parametrize("speed", [0.1])
def test_switch_from_nothing_drops_the_finger(speed):
    """The reference has 788 to 827 mN, all of the force, without telling its gains; here 620 to 665 mN.

    With a force integrator twice as fast it is all of it; but that rings.
    """
    response, controller = pressed(speed, is_bumpless=False, beyond=0.4)
    found = bump(response, controller.switched_at)

    assert 0.6 < found < SWITCHES[speed][2] / 1e3


AT_SWITCH = 0.040  # s, over which its speed is taken


def at_switch(speed, rule):
    response, controller = pressed(speed, rule=rule, hold=0.3, beyond=0.001)
    row = response.zero + round(controller.switched_at / response.step)
    before = round(AT_SWITCH / response.step)  # at an encoder count the finger stops for a moment
    return response.force[row], abs(response.finger_speed[row - before : row + 1].mean())


def test_finger_that_must_be_slow_makes_some_presses_wait():
    """The reference asks for less than 2 mm/s against early switches.

    It helps above 0.4 N/s, where a pad of 200 N/m gives way faster. Not so in the reference's own example:
    at 0.24 N/s the finger goes 1.2 mm/s.
    """
    for speed, before, after in ((0.005, 0.44, 0.63), (0.01, 0.69, 0.76)):
        assert at_switch(speed, ANY_SPEED)[0] == pytest.approx(before, abs=0.01)
        force, finger_speed = at_switch(speed, SteadyRule())
        assert force == pytest.approx(after, abs=0.01)
        assert finger_speed < 2e-3

    force, finger_speed = at_switch(0.002, SteadyRule())
    assert force == pytest.approx(0.06, abs=0.005)
    assert finger_speed == pytest.approx(0.24 / HAND.pad_stiffness, rel=0.02)


def test_encoder_count_at_the_switch_does_not_throw_the_finger_off():
    """A count in the sample of the switch is 4 N of damping.

    Taken into the integrator, as in the reference, that threw the finger off. Taken is what the motor did of
    late.
    """
    response, controller = pressed(0.5, retracted=1e-4, beyond=0.4)

    assert bump(response, controller.switched_at) < 0.06


def test_contact_that_is_lost_goes_back_to_position():
    """Less than 0.05 N for 20 ms, or the slave 0.5 mm off its object (reference value)."""
    modes = []
    controller = ForceAfterContact(
        TargetPolicy(Target.TIME_STAMPED), lambda now: slave, RATE, Handover(ANY_SPEED)
    )

    def take(force, count):
        for _ in range(count):
            distance_sample = DistanceSample(
                len(modes) / RATE, 0.0, 0.0, 0.0, 0.0, force, -force, -force, None
            )
            modes.append(controller.command(distance_sample).mode)
        return modes[-1]

    slave = Slave(0.8)
    assert take(0.8, 100) == DriveMode.POSITION
    assert take(0.8, 300) == DriveMode.FORCE
    assert take(0.04, 50) == DriveMode.FORCE
    assert take(0.8, 10) == DriveMode.FORCE
    assert take(0.04, 59) == DriveMode.FORCE
    assert take(0.04, 2) == DriveMode.POSITION
    assert take(0.8, 400) == DriveMode.FORCE
    slave = Slave(0.8, distance=0.4e-3)
    assert take(0.8, 5) == DriveMode.FORCE
    slave = Slave(0.8, distance=0.6e-3)
    assert take(0.8, 1) == DriveMode.POSITION
    assert take(0.8, 300) == DriveMode.POSITION and set(modes[-300:]) == {DriveMode.POSITION}


# ------------------------------------------------------------------------------------------ steady force


def steady_at(force, speed=0.0, rule=ANY_SPEED):
    watch = SteadyForce(RATE, rule)
    speeds = np.broadcast_to(speed, np.shape(force))
    return [watch.take(float(one), float(pace)) for one, pace in zip(force, speeds, strict=True)]


def oracle(force, rule=ANY_SPEED):
    """The rule in plain numpy: two one-pole low-passes, then windows."""
    share = 1.0 - math.exp(-2.0 * math.pi * rule.cutoff / RATE)
    filtered = np.zeros((2, len(force) + 1))
    for k, one in enumerate(force):
        filtered[0, k + 1] = filtered[0, k] + share * (one - filtered[0, k])
        filtered[1, k + 1] = filtered[1, k] + share * (filtered[0, k + 1] - filtered[1, k])
    size, smooth, found = round(rule.window * RATE), filtered[1, 1:], []
    for k in range(len(force)):
        past = smooth[max(0, k - size + 1) : k + 1]
        if k < size:
            found.append(False)
            continue
        varies = past.max() - past.min() >= max(rule.ripple, rule.ripple_share * past.max())
        drifts = abs(smooth[k] - smooth[k - size]) >= rule.slope * size / RATE
        found.append(bool(not varies and not drifts and past.min() > rule.least))
    return found


@pytest.mark.parametrize("seed", range(2))
def test_watch_agrees_with_plain_numpy(seed):
    rng = np.random.default_rng(seed)
    knots = np.cumsum(rng.normal(0.0, 0.06, 12)) + 0.4
    force = np.interp(np.arange(1500), np.linspace(0, 1499, 12), knots) + rng.normal(0.0, 0.01, 1500)

    found = steady_at(force)
    assert found == oracle(force)
    assert 0 < sum(found) < len(found)


def test_finger_must_be_slow_for_a_window():
    force, speed = np.full(900, 0.8), np.zeros(900)
    speed[400] = 0.01
    found = steady_at(force, speed, SteadyRule())

    assert found[399] and not any(found[400:549])
    assert found[555]


# -------------------------------------------------------------------------------------------- the servo


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: SteadyRule(window=0.0), "window is 0.0, expected a positive number of seconds"),
        (lambda: SteadyRule(ripple=-0.1), "ripple is -0.1, expected a number of newtons of 0 or more"),
        (lambda: SteadyForce(0.0), "rate is 0.0, expected a positive number of hertz"),
        (lambda: Handover(lost_time=-1.0), "lost_time is -1.0, expected a number of seconds of 0 or more"),
    ],
)
def test_what_cannot_be_is_named(make, message):
    with pytest.raises(ArgumentError) as caught:
        make()

    assert message in str(caught.value)
