"""How parts move: how far since the tick before, how fast at most, and where they are some time ahead."""

from math import cos, sin, sqrt

from proximity.kernels.geometry.frames import ROUNDED_UP
from proximity.kernels.geometry.triangle import cross, dot
from proximity.kernels.stack_arrays import stack_f64
from proximity.native import inlined, kernel

POSE_SIZE = 12
"""Numbers of a part's pose: rotation and translation."""
STILL_ROUNDING = 2.0**-50
"""More than rounding puts a displacement off, in sizes of coordinates."""


@inlined
def _length(x, y, z):
    return sqrt(x * x + y * y + z * z)


@kernel
def displacements(frames, before, moved):
    """Fill how far anything on each part has moved since its pose was that in *before*, m, and renew that."""
    for part in range(len(moved)):
        frame = frames[part]
        moved[part] = 0.0
        for k in range(POSE_SIZE):
            now = frame.rotation[k] if k < 9 else frame.translation[k - 9]
            if now != before[part, k]:
                moved[part] = -1.0
        if moved[part] < 0.0:
            moved[part] = _displacement(frame, before, part)
            for k in range(9):
                before[part, k] = frame.rotation[k]
            for k in range(3):
                before[part, 9 + k] = frame.translation[k]


@kernel
def _displacement(frame, before, part):
    """How far the middle of a part's box has moved at most, and what the box is turned by adds."""
    total, size, step = 0.0, 0.0, stack_f64(3)
    for row in range(3):
        step[row] = frame.translation[row] - before[part, 9 + row]
        size += abs(frame.translation[row])
        for k in range(3):
            change = frame.rotation[3 * row + k] - before[part, 3 * row + k]
            step[row] += change * 0.5 * (frame.own_lower[k] + frame.own_upper[k])
    for k in range(3):
        half = 0.5 * (frame.own_upper[k] - frame.own_lower[k])
        size += half + abs(frame.own_lower[k])
        total += half * _length(
            frame.rotation[k] - before[part, k],
            frame.rotation[3 + k] - before[part, 3 + k],
            frame.rotation[6 + k] - before[part, 6 + k],
        )
    return (total + _length(step[0], step[1], step[2])) * ROUNDED_UP + STILL_ROUNDING * size


@kernel
def fastest_between(own, other, horizon):
    """Largest speed, m/s, of a point of one part as another sees it, while velocities stay, up to *horizon*.

    *own*, *other*: frames. As seen from a part that turns, points move the faster the farther they are.
    """
    vx, vy, vz = (
        own.velocity[0] - other.velocity[0],
        own.velocity[1] - other.velocity[1],
        own.velocity[2] - other.velocity[2],
    )
    speed = _length(vx, vy, vz)
    apart = _length(
        own.translation[0] - other.translation[0],
        own.translation[1] - other.translation[1],
        own.translation[2] - other.translation[2],
    )
    turn, other_turn = _turning(own), _turning(other)
    reach, other_reach = _reach(own), _reach(other)
    far = apart + speed * horizon
    as_other = turn * reach + (other_turn * (far + reach) if other_turn > 0.0 else 0.0)
    as_own = other_turn * other_reach + (turn * (far + other_reach) if turn > 0.0 else 0.0)
    return (speed + min(as_other, as_own)) * ROUNDED_UP


@inlined
def _turning(frame):
    return _length(frame.angular_velocity[0], frame.angular_velocity[1], frame.angular_velocity[2])


@inlined
def _reach(frame):
    """Distance of the farthest corner of a part's box from the part's origin."""
    return _length(
        max(abs(frame.own_lower[0]), abs(frame.own_upper[0])),
        max(abs(frame.own_lower[1]), abs(frame.own_upper[1])),
        max(abs(frame.own_lower[2]), abs(frame.own_upper[2])),
    )


@kernel
def pose_ahead(frame, t, pose):
    """Fill the pose, (`POSE_SIZE`,), that a part has after *t* seconds, while its velocities stay."""
    rate = _turning(frame)
    angle = rate * t
    for k in range(3):
        pose[9 + k] = frame.translation[k] + frame.velocity[k] * t
    for k in range(9):
        pose[k] = frame.rotation[k]
    if not angle > 0.0:
        return
    ux, uy, uz = (
        frame.angular_velocity[0] / rate,
        frame.angular_velocity[1] / rate,
        frame.angular_velocity[2] / rate,
    )
    c, s = cos(angle), sin(angle)
    for k in range(3):
        x, y, z = frame.rotation[k], frame.rotation[3 + k], frame.rotation[6 + k]
        qx, qy, qz = cross(ux, uy, uz, x, y, z)
        along = dot(ux, uy, uz, x, y, z) * (1.0 - c)
        pose[k] = x * c + qx * s + ux * along
        pose[3 + k] = y * c + qy * s + uy * along
        pose[6 + k] = z * c + qz * s + uz * along


@inlined
def velocity_at(frame, x, y, z):
    """Velocity of a part at a point of the scene's frame, m/s."""
    turned = cross(
        frame.angular_velocity[0],
        frame.angular_velocity[1],
        frame.angular_velocity[2],
        x - frame.translation[0],
        y - frame.translation[1],
        z - frame.translation[2],
    )
    return frame.velocity[0] + turned[0], frame.velocity[1] + turned[1], frame.velocity[2] + turned[2]
