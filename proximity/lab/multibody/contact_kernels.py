"""Kernels that step a planar chain of links whose tip presses against a plane.

Angles and rates are of the links themselves, counted from the x axis, not of the joints: the mass matrix is
then ``coupling[i, j] cos(a_i - a_j)``, and the Coriolis terms are ``coupling[i, j] sin(a_i - a_j) w_j²``.
Generalised forces go with them: that of a link is the torque of its joint less that of the next.

A chain of n links is one (n + 5, n) array: n rows of coupling, then the rows named below. The state is one
array: n angles, n rates, four times n integrals over time (tip force; dampers; springs and weight; the term
that comes of M changing with the angles), and two energies (work of the tip force; loss in the dampers).
"""

from math import cos, sin, sqrt

import numpy as np

from proximity.native import entry, inlined, kernel

# --- rows of a chain behind the coupling ---
CHAIN_WEIGHT = 0  # N m, what gravity turns each link with where it is level
CHAIN_LENGTH = 1  # m
CHAIN_STIFFNESS = 2  # N m/rad, of each joint
CHAIN_REST = 3  # rad, of each joint
CHAIN_DAMPING = 4  # N m s/rad, of each joint
CHAIN_ROWS = 5

# --- the plane ---
PLANE_STIFFNESS = 0  # N/m
PLANE_DAMPING = 1  # N s/m
PLANE_NORMAL_X = 2
PLANE_NORMAL_Y = 3
PLANE_OFFSET = 4  # m, normal · tip where it touches
PLANE_SIZE = 5

# --- how the force of the plane reaches the tip ---
SHOWN_AT_ONCE = 0
SHOWN_LATE = 1  # so many steps later
SHOWN_HELD = 2  # sampled each so many steps, and held
SHOWN_HELD_ON_SLOPE = 3  # as HELD, with half of the last difference added

INTEGRALS = 4


@entry("float64[:, :], float64[:], float64[:] -> float, float")
def tip_height(chain: np.ndarray, state: np.ndarray, plane: np.ndarray) -> tuple[float, float]:
    """Normal · tip, m, and its time derivative, m/s."""
    n = chain.shape[1]
    height, speed = 0.0, 0.0
    for i in range(n):
        length, c, s = chain[n + CHAIN_LENGTH, i], cos(state[i]), sin(state[i])
        height += length * (plane[PLANE_NORMAL_X] * c + plane[PLANE_NORMAL_Y] * s)
        speed += length * (plane[PLANE_NORMAL_Y] * c - plane[PLANE_NORMAL_X] * s) * state[n + i]
    return height, speed


@kernel
def plane_force(chain: np.ndarray, state: np.ndarray, plane: np.ndarray) -> float:
    """Force of the plane on the tip, N: never less than nothing."""
    height, speed = tip_height(chain, state, plane)
    depth = plane[PLANE_OFFSET] - height
    # A tip that is just on the plane and closes is damped already: the damper's force begins with a step.
    if not depth >= 0.0:
        return 0.0
    return max(0.0, plane[PLANE_STIFFNESS] * depth - plane[PLANE_DAMPING] * speed)


@inlined
def joint_torques(chain: np.ndarray, state: np.ndarray, i: int) -> tuple[float, float]:
    """Torques of spring and damper of joint *i* against its motion, N m; nothing behind the last."""
    n = chain.shape[1]
    if i == n:
        return 0.0, 0.0
    angle = state[i] - (state[i - 1] if i > 0 else 0.0)
    rate = state[n + i] - (state[n + i - 1] if i > 0 else 0.0)
    return chain[n + CHAIN_STIFFNESS, i] * (angle - chain[n + CHAIN_REST, i]), chain[
        n + CHAIN_DAMPING, i
    ] * rate


@kernel
def solve(matrix: np.ndarray, values: np.ndarray) -> None:
    """Replace *values* (n,) by the solution of a positive definite system, by Cholesky within *matrix*."""
    n = len(values)
    for j in range(n):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        matrix[j, j] = sqrt(matrix[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    for i in range(n):
        for k in range(i):
            values[i] -= matrix[i, k] * values[k]
        values[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            values[i] -= matrix[k, i] * values[k]
        values[i] /= matrix[i, i]


@kernel
def change(
    chain: np.ndarray,
    state: np.ndarray,
    force: float,
    plane: np.ndarray,
    matrix: np.ndarray,
    rate: np.ndarray,
) -> None:
    """Fill *rate* with the time derivative of *state* while *force* (N) acts on the tip along the normal."""
    n = chain.shape[1]
    loss, power = 0.0, 0.0
    spring, damper = joint_torques(chain, state, 0)
    for i in range(n):
        c, s, w = cos(state[i]), sin(state[i]), state[n + i]
        next_spring, next_damper = joint_torques(chain, state, i + 1)
        coriolis, geometric = 0.0, 0.0
        for j in range(n):
            turn = chain[i, j] * sin(state[i] - state[j])
            coriolis += turn * state[n + j] * state[n + j]
            geometric -= turn * w * state[n + j]
            matrix[i, j] = chain[i, j] * cos(state[i] - state[j])
        contact = chain[n + CHAIN_LENGTH, i] * (plane[PLANE_NORMAL_Y] * c - plane[PLANE_NORMAL_X] * s) * force
        static = spring - next_spring + chain[n + CHAIN_WEIGHT, i] * c
        rate[i] = w
        rate[n + i] = contact - coriolis - (damper - next_damper) - static
        rate[2 * n + i] = contact
        rate[3 * n + i] = damper - next_damper
        rate[4 * n + i] = static
        rate[5 * n + i] = geometric
        power += contact * w
        loss += (damper - next_damper) * w
        spring, damper = next_spring, next_damper
    rate[(2 + INTEGRALS) * n] = power
    rate[(2 + INTEGRALS) * n + 1] = loss
    solve(matrix, rate[n : 2 * n])


@inlined
def shown_force(display: int, lag: int, k: int, felt: np.ndarray, held: float) -> tuple[float, float]:
    """Force shown at the tip at the begin and at the end of step *k*, N, after it was felt up to there."""
    if display == SHOWN_LATE:
        return felt[k - lag] if k >= lag else 0.0, felt[k - lag + 1] if k + 1 >= lag else 0.0
    if display == SHOWN_AT_ONCE:
        return felt[k], felt[k]
    if k % lag:
        return held, held
    before = felt[k - lag] if k >= lag else 0.0
    force = felt[k] if display == SHOWN_HELD else max(0.0, 1.5 * felt[k] - 0.5 * before)
    return force, force


@entry("float64[:, :], float64[:], int, int, float, float64[:, :], float64[:]", makes_arrays=True)
def press(
    chain: np.ndarray,
    plane: np.ndarray,
    display: int,
    lag: int,
    step: float,
    states: np.ndarray,
    forces: np.ndarray,
) -> None:
    """Fill *states* from its first row on, and *forces* (N), what the tip is shown; classical Runge-Kutta.

    *display* is how the force is shown, *lag* its steps: 1 or more.
    """
    count, size = states.shape
    matrix = np.zeros((chain.shape[1], chain.shape[1]))
    rates, trial, felt = np.zeros((4, size)), np.zeros(size), np.zeros(count)
    held = 0.0
    for k in range(count):
        felt[k] = plane_force(chain, states[k], plane)
        begin, end = shown_force(display, lag, k, felt, held)
        forces[k] = held = begin
        if k + 1 == count:
            return
        for stage in range(4):
            reach = 0.0 if stage == 0 else step if stage == 3 else 0.5 * step
            for i in range(size):
                trial[i] = states[k, i] + (reach * rates[stage - 1, i] if stage > 0 else 0.0)
            force = begin + (end - begin) * reach / step
            if display == SHOWN_AT_ONCE:
                force = plane_force(chain, trial, plane)
            change(chain, trial, force, plane, matrix, rates[stage])
        for i in range(size):
            slopes = rates[0, i] + 2.0 * rates[1, i] + 2.0 * rates[2, i] + rates[3, i]
            states[k + 1, i] = states[k, i] + step / 6.0 * slopes
