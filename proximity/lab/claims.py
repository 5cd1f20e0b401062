"""Claims of the paper, checked with the models under stated conditions (docs/science/paper.md).

``python -m proximity.lab.claims`` prints the table for the documentation.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from proximity.decaff.drum import sampled_mass
from proximity.decaff.drum.drum_model import Drum, Gear, with_random_phases
from proximity.decaff.drum.servo import SERVO_RATE, servo_for
from proximity.decaff.glove.glove import Glove
from proximity.lab.paper import figure_5
from proximity.lab.paper.walls import FINGER, energy_excess, steady_excess
from proximity.lab.simulation import devices
from proximity.lab.simulation.closed_loop import Response, coupled_wall, decaff, ideal_drum, real_wall
from proximity.lab.simulation.devices import Decaff, Hand, Link, Sensing, TipCable
from proximity.lab.simulation.metrics import FELT_SWING, deviation, drum_offset
from proximity.lab.simulation.sweeps import (
    SPEEDS,
    Stretch,
    best_coupled_wall,
    coupled_row,
    drum_row,
    needed_cable,
    with_transmission,
)
from proximity.lab.simulation.target_policies import Target
from proximity.lab.stability import largest_damping

YES, PARTLY, NO = "yes", "yes, if", "no"
TIMES = (0.0, 0.520, 1e-5)  # s, start, end and step of the curves
HAND = Hand()
PHASES = 16  # of the encoder, at random
SHAKING = 0.1  # N rms
GLOVE = Glove()
DRUM = GLOVE.tip_drum()
CABLE = TipCable.of(GLOVE)
GEARINGS = (2, 4, 6, 8, 10, 12, 14, 16, 20)  # total ratios; the smallest that suffices is searched
NEAR_FLOOR = 0.01  # of force error, above a drum that never moves
FREE = 0.010  # s before the touch, the end of free motion
STIFFEST_CABLE = 1e6  # N/m, practically rigid
RESTED = 0.5  # s of hold, after which the slowest compensation has settled
SYMBOLS = (
    "x_f: compression of the fingertip on a real wall; x_s: how deep the finger enters the simulated one.",
    "k_f: stiffness of the fingertip; k_eq: that of fingertip and wall in series.",
    "Numbers in brackets after a claim are the paper's equations; 5a to 5h are its figures.",
)
HOW = "All of this comes from models of this project; nothing was measured on hardware or with people."
SMOOTH_STOP = 26.0 / 35.0  # factor of the damper's loss, the mean share of the speed over a press's path
PAIR = sampled_mass.Gains(3900.0, 60.0)  # the paper's


@dataclass(frozen=True, slots=True)
class Claim:
    """One claim of the paper."""

    paper: str  # the paper's statement
    holds: str  # ``yes``, ``yes, if`` or ``no``
    here: str  # the result here; after ``yes, if`` it begins with the condition


def claims() -> list[Claim]:
    """Return all claims with newly computed figures, which takes a few seconds."""
    return [claim() for claim in _CLAIMS]


def markdown(found: list[Claim]) -> str:
    """Return claims as a Markdown table."""
    rows = [f"| {one.paper} | {one.holds} | {one.here} |" for one in found]
    return "\n".join(["| the paper says | holds | here |", "|---|---|---|", *rows])


def _stiffest() -> Claim:
    device = sampled_mass.SampledMass()
    best = sampled_mass.maximum_stiffness(device)
    radius = np.abs(np.roots(sampled_mass.characteristic(device, PAIR.stiffness, PAIR.damping))).max()
    return Claim(
        "stiffest wall 3900 N/m with 60 N s/m at 200 Hz, 0.7 kg, marginally stable",
        YES,
        f"{best.stiffness:.1f} N/m at {best.damping:.2f} N s/m; the paper's pair is just inside (spectral "
        f"radius {radius:.4f}), and it is equation (1) with its sample of delay",
    )


def _max_damping() -> Claim:
    largest = largest_damping(sampled_mass.SampledMass())
    return Claim(
        "60 N s/m is the largest damping",
        PARTLY,
        f"the wall is the stiffest one: a wall without stiffness may have up to {largest:.1f} N s/m",
    )


def _love_and_book() -> Claim:
    least, most = sampled_mass.damping_window(sampled_mass.SampledMass(), 2000.0)
    return Claim(
        "too stiff, too little and too much damping each make it unstable (Love and Book)",
        YES,
        f"at 2000 N/m it is stable from {least:.2f} to {most:.2f} N s/m",
    )


def _steady_excess() -> Claim:
    depth = figure_5.PRESS.depth
    excess = steady_excess(depth, figure_5.PENETRATION, FINGER, FINGER)
    press = HAND.press(0.1)
    wall = best_coupled_wall(HAND, 1000.0, 0.003)
    same_hand = deviation(coupled_wall(HAND, press, wall)).steady_error
    return Claim(
        "a simulated wall's steady force is too high by k_f x_s (9, 10)",
        PARTLY,
        f"the finger's motion is prescribed: {excess:.1f} N, exactly. A hand that means the same is pushed "
        f"less, by {-1e3 * same_hand:.0f} mN at the best wall of 3 ms",
    )


def _energy() -> Claim:
    press = figure_5.PRESS
    printed = energy_excess(press, press.depth, FINGER)
    right = energy_excess(press, press.depth, FINGER, factor=SMOOTH_STOP)
    # From there on the excess is mostly quadratic in the penetration.
    turns = 2.0 * (press.depth + 0.5 * FINGER.damping * press.speed / FINGER.stiffness)
    return Claim(
        "the energy's error grows with the square of x_s (15)",
        PARTLY,
        f"x_s is beyond {1e3 * turns:.0f} mm; before, the linear terms are larger. At x_s = "
        f"{1e3 * press.depth:.0f} mm it is {1e3 * printed:.3f} mJ as printed, {1e3 * right:.3f} "
        "mJ with the damping of a smooth stop",
    )


def _late_force() -> Claim:
    late = _figure("5d").end_time - _figure("5a").end_time
    return Claim(
        "a delay keeps a force on the finger after contact is lost",
        YES,
        f"for as long as the delay: {1e3 * late:.2f} ms of {1e3 * figure_5.DELAY:.0f} ms",
    )


def _penetration() -> Claim:
    press = figure_5.PRESS
    depth = float(press.at(press.touch_time + figure_5.DELAY).position)
    return Claim(
        "penetration during the delay is speed times delay",
        PARTLY,
        f"the speed stays: {1e3 * figure_5.PENETRATION:.2f} mm; a finger that slows down goes "
        f"{1e3 * depth:.2f} mm",
    )


def _longer() -> Claim:
    longer = _figure("5b").end_time - _figure("5a").end_time
    return Claim(
        "penetration alone prolongs the force, too (5e)",
        PARTLY,
        f"the finger leaves from deeper at the same speed: {1e3 * longer:.1f} ms longer; not where x_s is in "
        "proportion to x_f",
    )


def _operator() -> Claim:
    gains = [figure_5.critical_gain(FINGER, step) for step in (0.001, 0.040)]
    return Claim(
        "an operator who draws back late makes it unstable, growing (5f)",
        PARTLY,
        f"he gives way by more than {1e3 * gains[0]:.4f} mm/N at 1 ms, {1e3 * gains[1]:.3f} mm/N at 40 ms; "
        "it grows into a limit cycle, since walls do not pull",
    )


def _soft() -> Claim:
    share = _figure("5g").steady / _figure("5c").steady
    return Claim(
        "a soft wall lowers the steady force (5g)",
        YES,
        f"to {share:.1f}, k_eq over k_f; that it is the real wall's here is chance",
    )


def _slow() -> Claim:
    hard, light = (_half_times(name) for name in ("5c", "5h"))
    return Claim(
        "a lightly damped wall rises more slowly and stays longer (5h)",
        YES,
        f"half of the force comes {1e3 * (light[0] - hard[0]):.1f} ms later and stays "
        f"{1e3 * (light[1] - hard[1]):.1f} ms longer",
    )


def _exact_match() -> Claim:
    floor = [_error(ideal_drum(HAND, HAND.press(speed))) for speed in (0.1, 1.0)]
    quick = [deviation(decaff(HAND, HAND.press(0.25), glove)) for glove in _reported(0.001)]
    found, lowest = max(one.error for one in quick), min(quick, key=lambda one: one.peak)
    real = lowest.peak - lowest.peak_error
    coupled = _error(coupled_wall(HAND, HAND.press(0.25), best_coupled_wall(HAND, 1000.0, 0.001)))
    press = HAND.press(0.1, hold=0.5)
    swings = [deviation(decaff(HAND, press, glove)).swing for glove in _reported(0.001)]
    return Claim(
        "the drum gives exactly the force of the real wall (16)",
        PARTLY,
        f"it is stiff and in place: with {DRUM.words}, {found:.0%} rms at 0.25 m/s and 1 ms, where the best "
        f"coupled wall is off by {coupled:.1%}. That hides the first instant: in the worst of {PHASES} "
        f"phases of the encoder the peak is {1.0 - lowest.peak / real:.0%} below the "
        f"{real:.1f} N of the real wall. The link's 5 g alone are {floor[0]:.1%} at 0.1 m/s and "
        f"{floor[1]:.0%} at 1 m/s. Half a second after the touch it swings by {1e3 * max(swings):.1f} mN p-p "
        f"at most; {1e3 * FELT_SWING:.0f} mN are felt",
    )


def _gearing() -> Claim:
    wall = best_coupled_wall(HAND, 1000.0, 0.001)
    rival, floor = coupled_row(HAND, wall).errors, [_error(ideal_drum(HAND, HAND.press(v))) for v in SPEEDS]
    found = {ratio: drum_row(HAND, Decaff(_geared(ratio))).errors for ratio in GEARINGS}
    least = next(ratio for ratio, errors in found.items() if (errors < rival).all())
    enough = next(ratio for ratio, errors in found.items() if (errors < floor + np.array(NEAR_FLOOR)).all())
    slight, toothed = _geared(4), replace(with_random_phases(DRUM, 1)[0], has_teeth=True)
    return Claim(
        "a motor moves the drum; no gear is mentioned",
        PARTLY,
        f"it is geared: a radian of the drum is {1e3 * DRUM.lever:.0f} mm of fingertip. At 4:1 the motor "
        f"weighs {1e3 * slight.mass:.1f} g at the fingertip, its servo has "
        f"{1e-3 * servo_for(slight, SERVO_RATE).stiffness:.2f} kN/m, and the force is off by "
        f"{_percents(found[4])} at 0.1, 0.25, 0.5 and 1 m/s, the best coupled wall's by "
        f"{_percents(rival)}. From {least}:1 on the drum is better at each speed, from {enough}:1 on within "
        f"a point of a drum that never moves. At {DRUM.gear.ratio:g}:1 it bears "
        f"{DRUM.continuous_force:.1f} N continuously and 20 N for {DRUM.overload_time(20.0):.1f} s; its "
        f"backlash is {1e3 * DRUM.play:.1f} mm of fingertip, and where no spring takes it up the force "
        f"at rest is {-1e3 * _rest_with_play():.0f} mN too small. With the gear's play and teeth, its arm "
        f"and stiction simulated, it is off by {_percents(drum_row(HAND, Decaff(toothed)).errors)}: the arm "
        "bounces",
    )


def _exact_match_by_cable() -> Claim:
    slow, quick = HAND.press(0.1), HAND.press(0.25)
    wall = best_coupled_wall(HAND, 1000.0, 0.001)
    rivals = [_error(coupled_wall(HAND, press, wall)) for press in (slow, quick)]
    ways = {
        Stretch.LEFT: "",
        Stretch.TORQUE: "made up for by the motor's torque, ",
        Stretch.SENSOR: "by a force sensor, ",
    }
    found = []
    for way, words in ways.items():
        errors = [
            max(_error(decaff(HAND, press, glove)) for glove in _built(0.001, way)) for press in (slow, quick)
        ]
        found.append(f"{words}{errors[0]:.0%} and {errors[1]:.0%} ({1e3 * _rest(way):.0f} mN)")
    glove = _reported(0.001)[0]
    needed = [needed_cable(HAND, glove, 0.1, rivals[0], way) for way in (Stretch.LEFT, Stretch.TORQUE)]
    rigid = with_transmission(glove, replace(CABLE, stiffness=STIFFEST_CABLE))
    rubbed, bare = (_error(decaff(HAND, slow, each)) for each in (rigid, glove))
    return Claim(
        "the same, with cable, sheath, potentiometer and the motor's current in the loop",
        NO,
        f"with {1e-3 * GLOVE.cable.stiffness:.0f} N/mm, {CABLE.stiffness:.0f} N/m at the fingertip, it is "
        f"off by {found[0]} at 0.1 and 0.25 m/s (after {RESTED} s at rest), the best coupled wall without a "
        f"cable by {rivals[0]:.0%} and {rivals[1]:.0%}. With the stretch {found[1]}; {found[2]}. To beat "
        f"that wall at 0.1 m/s it takes {_two_digits(needed[0])} N/m at the fingertip, "
        f"{_two_digits(needed[1])} with the torque. However stiff the cable, friction in the sheath leaves "
        f"{rubbed:.0%} instead of {bare:.0%} at 0.1 m/s",
    )


def _delay() -> Claim:
    stamped, naive = (_largest_error(0.5, 0.010, use) for use in (Target.TIME_STAMPED, Target.NAIVE))
    press = HAND.press(0.5)
    late = max(drum_offset(decaff(HAND, press, glove, Target.NAIVE)) for glove in _reported(0.003))
    latency, ripple = _shaking()
    late_cable, early_cable = (
        max(_error(decaff(HAND, press, glove)) for glove in _built(seconds, Stretch.TORQUE))
        for seconds in (0.010, 0.0001)
    )
    return Claim(
        "it greatly reduces the delay of (11)",
        PARTLY,
        "a distance is taken with the pose of its own instant and held in contact: "
        f"{stamped:.0%} at 0.5 m/s and 10 ms, as at no delay; with the cable {late_cable:.0%} at 10 ms, "
        f"{early_cable:.0%} at 0.1 ms. Used naively {naive:.0%}: the drum is "
        f"{1e3 * late:.1f} mm late at 3 ms, and shakes, by {ripple:.1f} N rms, from {1e3 * latency:.1f} "
        "ms on",
    )


def _transparency() -> Claim:
    (glove, *_) = _built(0.001, Stretch.LEFT)
    press = decaff(HAND, HAND.press(0.1), glove)
    drag = float(np.median(press.force[press.times < -FREE]))
    return Claim(
        "it is highly transparent in free motion",
        PARTLY,
        f"the sheath is slippery: with a friction of {devices.FRICTION:g} over "
        f"{np.degrees(devices.WRAP):.0f} degrees the cable drags with {1e3 * drag:.0f} mN at the fingertip "
        f"all the time. As assumed, not computed, {1e3 * Link().mass:.0f} g move with the finger, not "
        f"{1e3 * devices.COUPLED_DEVICE.mass:.0f} g of link and rotor; the geared drum's "
        f"{1e3 * DRUM.mass:.0f} g move beside it",
    )


def _load() -> Claim:
    return Claim(
        "computing the distance is a small load",
        YES,
        "the paper leaves that open; not computed but [measured elsewhere](../performance/results.md): a "
        "hundredth of a millisecond for five fingers at a part of 87 k faces, and bounded everywhere",
    )


_CLAIMS: tuple[Callable[[], Claim], ...] = (
    _exact_match, _exact_match_by_cable, _gearing, _delay, _transparency, _load, _stiffest, _max_damping,
    _love_and_book, _steady_excess, _energy, _late_force, _penetration, _longer, _operator, _soft, _slow,
)  # fmt: skip


def _curve(name: str) -> tuple[np.ndarray, np.ndarray]:
    begin, end, step = TIMES
    times = np.arange(begin, end, step)
    return times, figure_5.FIGURES[name](times)


def _figure(name: str) -> figure_5.Comparison:
    times, force = _curve(name)
    return figure_5.compare(times, force, figure_5.real_wall(times))


def _half_times(name: str) -> tuple[float, float]:
    """Return the times at which half of the steady force of a figure is reached and lost, s."""
    times, force = _curve(name)
    rows = np.flatnonzero(force >= 0.5 * _figure(name).steady)
    return float(times[rows[0]]), float(times[rows[-1]])


def _reported(latency: float) -> list[Decaff]:
    """Return gloves with a latency, whose walls are at random positions within a count of the encoder."""
    sensing = Sensing(latency=latency)
    return [Decaff(drum, sensing=sensing) for drum in with_random_phases(DRUM, PHASES)]


def _geared(ratio: float) -> Drum:
    """Return the drum with its motor behind another gear, which has no losses and no mass."""
    return replace(with_random_phases(DRUM, 1)[0], gear=Gear(f"{ratio:g}:1", ratio))


def _percents(errors: np.ndarray) -> str:
    return ", ".join(f"{100.0 * error:.0f}" for error in errors) + " %"


def _rest_with_play() -> float:
    """Return the force at rest minus that of a real wall, N, with an unknown, uncompensated gear play."""
    sensing = Sensing(latency=0.001, bias=DRUM.play)
    press = HAND.press(0.1, hold=RESTED)
    return deviation(decaff(HAND, press, replace(_reported(0.001)[0], sensing=sensing))).steady_error


def _built(latency: float, stretch: Stretch) -> list[Decaff]:
    """Return gloves with a latency, and with cable, sheath, potentiometer, winding and current loop."""
    return [with_transmission(glove, CABLE, stretch) for glove in _reported(latency)]


def _rest(stretch: Stretch) -> float:
    """Return the largest difference between the force at rest and that of a real wall, N.

    The maximum is over all phases of the encoder.
    """
    press = HAND.press(0.1, hold=RESTED)
    found = [deviation(decaff(HAND, press, glove)).steady_error for glove in _built(0.001, stretch)]
    return max(found, key=abs)


def _two_digits(number: float) -> str:
    return f"{float(f'{number:.1e}'):.0f}"


def _largest_error(speed: float, latency: float, target: Target) -> float:
    """Return the largest force error over all phases of the encoder."""
    press = HAND.press(speed)
    return max(_error(decaff(HAND, press, glove, target)) for glove in _reported(latency))


def _shaking() -> tuple[float, float]:
    """Return the latency at which a naive drum begins to shake, s, within 0.1 ms, and the amplitude, N."""
    for tenths in range(11):
        press, gloves = HAND.press(0.5), _reported(1e-4 * tenths)
        ripple = max(deviation(decaff(HAND, press, glove, Target.NAIVE)).ripple for glove in gloves)
        if ripple > SHAKING:
            return 1e-4 * tenths, ripple
    return np.inf, 0.0


def _error(response: Response) -> float:
    return deviation(response, real_wall(HAND, response.press, like=response)).error


if __name__ == "__main__":
    print(markdown(claims()))
