"""FIG 5a to 5h of the paper as arrays, for one press on a real wall and on simulated ones.

Every function takes instants in seconds and returns forces in newtons. The paper describes its curves only in
words, and the press is assumed (docs/science/drum.md).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from proximity.checks import not_negative, positive
from proximity.errors import ArgumentError
from proximity.lab.paper.trajectories import Press
from proximity.lab.paper.walls import FINGER, SpringDamper, TraditionalWall, contact_force, in_series

PRESS = Press()
DELAY = 0.040  # s, the paper's 25 Hz
END = 0.520  # s, of the curves
PENETRATION = PRESS.speed * DELAY  # m; more than a decelerating finger moves in that time
PENETRATED = PRESS.deeper(PENETRATION)  # the paper's "xs+f data"
SOFT = in_series(FINGER, SpringDamper(stiffness=200.0, damping=np.inf))  # 5g: 100 N/m
LIGHTLY_DAMPED = in_series(FINGER, SpringDamper(stiffness=np.inf, damping=1.2))  # 5h: 1 N·s/m
GAIN_SHARE = 1.5  # of the gain at which 5f becomes unstable; assumed, as the paper gives none

SIMULATED = {
    "5b": TraditionalWall(FINGER, PENETRATION),
    "5c": TraditionalWall(FINGER, PENETRATION, DELAY),
    "5d": TraditionalWall(FINGER, delay=DELAY),
    "5g": TraditionalWall(SOFT, PENETRATION, DELAY),
    "5h": TraditionalWall(LIGHTLY_DAMPED, PENETRATION, DELAY),
}


def sample_times(step: float = 1e-5) -> np.ndarray:
    """Return evenly spaced instants from 0 to `END`, (T,), s."""
    return np.arange(round(END / step) + 1) * step


def real_wall(times: np.ndarray) -> np.ndarray:
    """Return the force on the real wall, FIG 5a, N."""
    return contact_force(PRESS.at(times), FINGER)


def simulated_wall(figure: str, times: np.ndarray) -> np.ndarray:
    """Return the force on a simulated wall, N.

    It is FIG 5b (penetrated), 5c (penetrated and late), 5d (late), 5g (soft) or 5h (lightly damped).
    """
    wall = SIMULATED.get(figure)
    if wall is None:
        raise ArgumentError(
            f"no simulated wall is shown in figure {figure!r}, expected one of {', '.join(SIMULATED)}"
        )
    return wall.force(times, PRESS)


def operator_reacts(times: np.ndarray, *, gain: float | None = None, step: float = DELAY) -> np.ndarray:
    """Return the force on an operator who draws back from it, FIG 5f, N.

    The press is that of FIG 5b. The operator reacts to the force one step ago, and the force is held during a
    step.
    """
    gain = GAIN_SHARE * critical_gain(FINGER, step) if gain is None else gain
    reaction = react(PENETRATED, FINGER, gain, step, end=float(np.max(times, initial=0.0)) + step)
    felt = np.searchsorted(reaction.times, np.asarray(times), side="right") - 1
    return np.where(felt >= 0, reaction.force[np.maximum(felt, 0)], 0.0)


FIGURES: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "5a": real_wall,
    "5b": lambda times: simulated_wall("5b", times),
    "5c": lambda times: simulated_wall("5c", times),
    "5d": lambda times: simulated_wall("5d", times),
    "5e": lambda times: simulated_wall("5b", times),  # the force experienced, drawn over 5a
    "5f": operator_reacts,
    "5g": lambda times: simulated_wall("5g", times),
    "5h": lambda times: simulated_wall("5h", times),
}
"""Curves of the figure by name, as functions of instants. All parameters are the paper's or assumed."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Measures that compare the force of a simulated wall with that of the real wall."""

    peak: float  # N
    peak_time: float  # s after the touch
    steady: float  # N, when the finger begins to leave
    end_time: float  # s, the last instant with a force
    force_at_loss: float  # N, when the finger leaves the real wall
    impulse_after_loss: float  # N·s, from then on
    rms_error: float  # N, from the touch to `ERROR_WINDOW` after the loss


ERROR_WINDOW = 0.080  # s


def compare(times: np.ndarray, force: np.ndarray, real: np.ndarray, press: Press = PRESS) -> Comparison:
    """Return the measures of a wall's force in comparison with the real wall's."""
    step = times[1] - times[0]
    half = 0.5 * step  # an instant counts as its nearest sample
    is_after = times > press.loss_time - half
    is_judged = (times > press.touch_time - half) & (times < press.loss_time + ERROR_WINDOW + half)
    felt = np.flatnonzero(force > 0.0)
    peak = int(np.argmax(force))
    return Comparison(
        peak=float(force[peak]),
        peak_time=float(times[peak] - press.touch_time),
        steady=float(np.interp(press.release_time, times, force)),
        end_time=float(times[felt[-1]]) if len(felt) else float("nan"),
        force_at_loss=float(np.interp(press.loss_time, times, force)),
        impulse_after_loss=float(np.trapezoid(force[is_after], dx=step)),
        rms_error=float(np.sqrt(np.mean((force - real)[is_judged] ** 2))),
    )


# --- FIG 5f: an operator who draws back from the force. The paper shows the growth and gives no gain.
# The position is the planned one minus a gain times the last force, which is computed by differences.


@dataclass(frozen=True, slots=True, eq=False)
class Reaction:
    """Motion and force of an operator in N steps."""

    times: np.ndarray  # (N,) s
    position: np.ndarray  # (N,) m, positive into the wall
    force: np.ndarray  # (N,) N


def critical_gain(finger: SpringDamper, step: float) -> float:
    """Return the gain above which an operator who reacts one step late is unstable, m/N."""
    now, last, before = _weights(finger, positive("step", step, "seconds"))
    return 1.0 / (now - last + before)


def react(
    press: Press, finger: SpringDamper, gain: float, step: float, *, end: float, can_pull: bool = False
) -> Reaction:
    """Simulate an operator who draws back from the force felt one step ago."""
    step, gain = positive("step", step, "seconds"), not_negative("gain", gain, "metres a newton")
    times = np.arange(int(end / step * (1.0 + 1e-12)) + 1) * step
    now, last, before = _weights(finger, step)
    planned = press.at(times).position.tolist()
    positions, forces = press.at([-2.0 * step, -step]).position.tolist(), [0.0]
    is_held = False
    for plan in planned:
        position = plan - gain * forces[-1]
        force = now * position + last * positions[-1] + before * positions[-2]
        is_held = is_held or (can_pull and position > 0.0)
        is_felt = is_held or (position > 0.0 and force > 0.0)
        positions.append(position)
        forces.append(force if is_felt else 0.0)
    return Reaction(times, np.array(positions[2:]), np.array(forces[1:]))


def _weights(finger: SpringDamper, step: float) -> tuple[float, float, float]:
    """Return the weights of the present and two earlier positions in the force.

    They are those of backward differences.
    """
    damping, inertia = finger.damping / step, finger.mass / step**2
    return finger.stiffness + damping + inertia, -damping - 2.0 * inertia, inertia
