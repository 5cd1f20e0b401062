"""How parts move at an instant: the velocity of a point, and a speed that no part exceeds."""

from math import sqrt

from proximity.kernels.compiling import inlined, kernel
from proximity.kernels.layout import (
    ANGULAR_VELOCITY,
    IS_HIDDEN,
    OWN_LOWER,
    OWN_UPPER,
    TRANSLATION,
    VELOCITY,
)
from proximity.kernels.triangle import dot


@inlined
def velocity_of_part(frames, part, x, y, z):
    """Velocity of a part at a point of the scene's frame, m/s."""
    rx, ry, rz = (
        x - frames[part, TRANSLATION],
        y - frames[part, TRANSLATION + 1],
        z - frames[part, TRANSLATION + 2],
    )
    wx, wy, wz = (
        frames[part, ANGULAR_VELOCITY],
        frames[part, ANGULAR_VELOCITY + 1],
        frames[part, ANGULAR_VELOCITY + 2],
    )
    return (
        frames[part, VELOCITY] + wy * rz - wz * ry,
        frames[part, VELOCITY + 1] + wz * rx - wx * rz,
        frames[part, VELOCITY + 2] + wx * ry - wy * rx,
    )


@kernel
def gather_moving(frames, parts, moving):
    """Fill *moving* (P,) with the parts that have a velocity; how many there are, and whether any stands."""
    count, stands = 0, False
    for part in range(len(parts) - 1):
        if parts[part, IS_HIDDEN]:
            continue
        moves = False
        for k in range(6):
            moves |= frames[part, VELOCITY + k] != 0.0
        if moves:
            moving[count] = part
            count += 1
        else:
            stands = True
    return count, stands


@kernel
def drift_from(frames, moving, count, stands, ux, uy, uz):
    """The speed, m/s, that no point of any part exceeds relative to *u*; see `gather_moving`."""
    fastest = sqrt(dot(ux, uy, uz, ux, uy, uz)) if stands else 0.0
    for i in range(count):
        part = moving[i]
        reach_sq = 0.0
        for axis in range(3):
            reach = max(abs(frames[part, OWN_LOWER + axis]), abs(frames[part, OWN_UPPER + axis]))
            reach_sq += reach * reach
        wx, wy, wz = (
            frames[part, ANGULAR_VELOCITY],
            frames[part, ANGULAR_VELOCITY + 1],
            frames[part, ANGULAR_VELOCITY + 2],
        )
        vx, vy, vz = (
            frames[part, VELOCITY] - ux,
            frames[part, VELOCITY + 1] - uy,
            frames[part, VELOCITY + 2] - uz,
        )
        speed = sqrt(dot(vx, vy, vz, vx, vy, vz)) + sqrt(dot(wx, wy, wz, wx, wy, wz) * reach_sq)
        fastest = max(fastest, speed)
    return fastest * (1.0 + 1e-12)
