"""Motion of a finger: velocity estimated from its poses, and a predicted position with an error bound.

The velocity is the slope of a straight line fitted to the poses, each weighted by its age. With poses 8 ms
apart this is nearly the last difference; with poses each millisecond it is an average over some 2 ms. The fit
is exact for a constant velocity, at any sample times, and both of its errors are bounded:

- The slope is an average of past velocities with non-negative weights. Among motions that accelerate by at
  most ``max_acceleration``, steady acceleration therefore gives the largest error, a sum of powers of the
  ages (the *lag*).
- Noise of the poses passes through the weights, which are known.

Measured (2026-11) on 15 000 poses of real fingers, 8.5 ms apart, predicted over 9 ms while they move faster
than 0.1 m/s; 95th percentile of the error, mm: last pose 8.54, last difference 2.60, this estimate 2.56.
Tried and dropped: lines over 18 ms 3.0; constant-velocity Kalman filters 2.7 to 2.8, with fading acceleration
2.7 to 4.3; one-euro filters 2.6 to 2.9; alpha-beta-gamma 3.1 to 4.0; parabolas 3.7 to 3.9. The acceleration
of one frame predicts little of the next.

A finger has two *estimates*, a row of records: the present one, and the one before the last jump, which
resumes if the jump was only one or two outlier poses. A record of zeros has no pose yet. Times are integer
nanoseconds: a float would lose them in weeks.
"""

import math

from proximity.kernels.contact_record import JUMPED, PREDICTED, TRACKED
from proximity.native import entry, inlined, kernel, record

ESTIMATE = record(
    "Estimate",
    position="(3,)f8",  # m, the last pose
    velocity="(3,)f8",  # m/s; zero while unknown
    velocity_error="f8",  # m/s, bound of the error
    surprise="f8",  # m/s, part of the error seen in the poses and not explained by acceleration
    weights="(4,)f8",  # sums of weight times age to the power 0, 1, 2, 3; ages are negative, s
    squares="(3,)f8",  # sums of squared weight times age to the power 0, 1, 2
    moments="(3,)f8",  # sums of weight times position relative to the last pose, m
    age_moments="(3,)f8",  # sums of weight times age times position
    slack_used="f8",  # m of `JUMP_SLACK` used by the last poses
    pose_ns="i8",  # time of the last pose
    pose_count="i8",  # poses in the estimate, up to `ENOUGH`
    is_known="i8",  # 1 if the velocity is known
)
ESTIMATES = 2
"""Records per finger: see above."""

# --- status bits, in addition to TRACKED, PREDICTED (the velocity is known) and JUMPED of a contact ---
STARTED = 1 << 16
"""The estimate restarts at this pose: the first one, after a gap, back in time, or after a jump. A jump
without this bit returned to the previous estimate."""
REPEATED = 1 << 17
"""The pose has the time of the one before and changes no state."""

# --- defects of a pose's time ---
USABLE = 0
FUTURE = 1
TOO_OLD = 2
BACKWARDS = 3  # before the last pose of that finger

MAX_SPEED = 3.0
"""m/s: 99.99 % of the recorded motion is below 1.94; the fastest outlier pose reached 4.5."""
MAX_ACCELERATION = 120.0
"""m/s²: 99 % of the recorded motion is below 40, 99.9 % below 105. The bound of `predict` holds for 99.95 %
of the recorded poses; the remaining ones are corrections of a centimetre by the tracking."""

MEMORY = 1.2e-3
"""s. Shorter memories pass on noise, longer ones lag. Poses each millisecond with noise of 0.05 mm are
predicted best with 1.0 to 1.2 ms: 95 % of the errors over 9 ms are below 1.2 mm, 2.0 mm with the last
difference."""
MIN_WEIGHT = 1e-3
"""Minimum weight of the previous pose, so that after a pause two poses close together do not hide it."""
NOISE = 0.15e-3
"""m, of one pose: three times the scatter of a sensor at 1 kHz. Recorded fingers at rest have 0.02 mm."""
MAX_NOISE_SPEED = 0.3
"""m/s: a velocity counts as unknown while noise alone may cause a larger error."""
MAX_SURPRISE = 1e3
"""m/s. Only a given velocity can be off by this value; an infinite error would never fade."""
ENOUGH = 3
"""Poses before an estimate and its error are trusted: sensors report a hand's first pose twice."""
MAX_GAP_NS = 100_000_000
"""The estimate restarts after a longer gap between poses."""
JUMP_SLACK = 5e-3
"""m that a pose may lie beyond the reach of `max_speed`: tracking that recovers a finger corrects it by
this."""
SLACK_RATE = JUMP_SLACK / 0.5e-3
"""m/s at which used slack recovers: fully between poses half a millisecond apart or more. A hand whose times
are in microseconds, or in the 100 ns of .NET, uses it up within some poses and jumps from then on."""
COAST = 0.1
"""s in which a finger would stop at the initial deceleration of recorded fingers; shortens 9 ms by 4 %."""
MOTION_HORIZON = 0.05
"""s after the pose; the predicted position stays constant beyond, where extrapolation only adds jitter."""


@inlined
def instant_defect(pose_ns, last_ns, oldest_ns, latest_ns):
    """Return the defect of a pose's time, given the finger's last one; `USABLE` if it has none."""
    if pose_ns > latest_ns:
        return FUTURE
    if pose_ns < oldest_ns:
        return TOO_OLD
    return BACKWARDS if pose_ns < last_ns else USABLE


@inlined
def _start(estimate, t_ns, x, y, z, max_speed):
    """Restart an estimate at a pose."""
    estimate.position[0], estimate.position[1], estimate.position[2] = x, y, z
    estimate.velocity_error, estimate.surprise, estimate.slack_used = max_speed, 0.0, 0.0
    for axis in range(3):
        estimate.velocity[axis] = estimate.moments[axis] = estimate.age_moments[axis] = 0.0
        estimate.weights[axis + 1] = estimate.squares[axis] = 0.0
    estimate.weights[0] = estimate.squares[0] = 1.0
    estimate.pose_ns, estimate.pose_count, estimate.is_known = t_ns, 1, 0


@inlined
def _slack_used(estimate, t_ns, x, y, z, max_speed):
    """Return the slack, m, used by a finger that moves from the estimate's last pose to this one."""
    elapsed = 1e-9 * (t_ns - estimate.pose_ns)
    used = max(estimate.slack_used - SLACK_RATE * elapsed, 0.0)
    dx, dy, dz = x - estimate.position[0], y - estimate.position[1], z - estimate.position[2]
    step_sq, reach = dx * dx + dy * dy + dz * dz, max_speed * elapsed
    if step_sq <= reach * reach:
        return used
    if used == 0.0 and step_sq <= (reach + JUMP_SLACK) * (reach + JUMP_SLACK):
        return min(math.sqrt(step_sq) - reach, JUMP_SLACK)
    return used + math.sqrt(step_sq) - reach if used > 0.0 else math.inf


@inlined
def _continues(estimate, t_ns):
    """Test whether the estimate has a pose before *t_ns* within `MAX_GAP_NS`."""
    return estimate.pose_count > 0 and t_ns - MAX_GAP_NS <= estimate.pose_ns < t_ns


@inlined
def _age(estimate, weight, dt):
    """Age all sums by *dt* and multiply their weights."""
    sums = estimate.weights
    s0, s1, s2, s3 = sums[0], sums[1], sums[2], sums[3]
    sums[0] = weight * s0
    sums[1] = weight * (s1 - dt * s0)
    sums[2] = weight * (s2 - dt * (2.0 * s1 - dt * s0))
    sums[3] = weight * (s3 - dt * (3.0 * s2 - dt * (3.0 * s1 - dt * s0)))
    sums = estimate.squares
    s0, s1, s2 = sums[0], sums[1], sums[2]
    weight *= weight
    sums[0] = weight * s0
    sums[1] = weight * (s1 - dt * s0)
    sums[2] = weight * (s2 - dt * (2.0 * s1 - dt * s0))


@inlined
def _follow(estimate, x, y, z, dt, max_acceleration):
    """Add the next pose to an estimate; return the velocity error, m/s, that noise alone may cause."""
    # Approximates exp(-dt / MEMORY), with the same rounding on every machine.
    weight = 1.0 / (1.0 + dt * (0.125 / MEMORY))
    weight *= weight
    weight *= weight
    weight = max(weight * weight, MIN_WEIGHT)
    weights, squares = estimate.weights, estimate.squares
    s0, s1 = weights[0], weights[1]
    _age(estimate, weight, dt)

    # Shift the sums to the new pose, and measure its distance from the extrapolated one.
    miss_sq = 0.0
    for axis in range(3):
        value = x if axis == 0 else (y if axis == 1 else z)
        step = value - estimate.position[axis]
        miss = step - dt * estimate.velocity[axis]
        miss_sq += miss * miss
        moment = estimate.moments[axis] - s0 * step
        turn = estimate.age_moments[axis] - s1 * step - dt * moment
        estimate.moments[axis] = weight * moment
        estimate.age_moments[axis] = weight * turn
        estimate.position[axis] = value
    weights[0] += 1.0
    squares[0] += 1.0

    s0, s1, s2, s3 = weights[0], weights[1], weights[2], weights[3]
    per_spread = 1.0 / (s0 * s2 - s1 * s1)
    for axis in range(3):
        estimate.velocity[axis] = (s0 * estimate.age_moments[axis] - s1 * estimate.moments[axis]) * per_spread

    # Variance: squared weight times (s0 age - s1) squared, summed.
    variance = s1 * s1 * squares[0] - 2.0 * s0 * s1 * squares[1]
    noise_error = NOISE * math.sqrt(variance + s0 * s0 * squares[2]) * per_spread
    lag = 0.5 * (s1 * s2 - s0 * s3) * per_spread

    # A deviation that neither acceleration nor noise explains may be an outlier: the share of it that entered
    # the velocity counts as error, and fades with the pose.
    explained = (estimate.velocity_error + 0.5 * max_acceleration * dt) * dt + 2.0 * NOISE
    surprise = min(max(math.sqrt(miss_sq) - explained, 0.0) * (-s1 * per_spread), MAX_SURPRISE)
    surprise = max(surprise, estimate.surprise * weight * (1.0 + dt / MEMORY))
    estimate.surprise = surprise
    estimate.velocity_error = max_acceleration * lag + noise_error + surprise
    return noise_error


@entry("Estimate[:, 2], int, int, float, float, float, float, float -> int")
def observe(motions, row, t_ns, x, y, z, max_speed, max_acceleration):
    """Add the pose of a finger at *t_ns* to its estimate; return status bits.

    A position that is not finite changes no state and returns 0. A pose out of reach at *max_speed* (m/s)
    returns JUMPED and restarts the estimate. The previous estimate is kept, and resumes if the finger returns
    to it within 0.1 s, before three consecutive poses elsewhere. *max_acceleration* (m/s²) only affects the
    error.
    """
    if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
        return 0
    status, present, before = TRACKED, motions[row, 0], motions[row, 1]
    if present.pose_count > 0 and t_ns == present.pose_ns:
        return status | REPEATED | (PREDICTED if present.is_known == 1 else 0)
    if not _continues(present, t_ns):
        _start(present, t_ns, x, y, z, max_speed)
        before.pose_count = 0
        return status | STARTED
    slack_used = _slack_used(present, t_ns, x, y, z, max_speed)
    if not slack_used <= JUMP_SLACK:
        status |= JUMPED
        slack_used = math.inf
        # Consecutive poses are not outliers: the previous estimate does not resume.
        if present.pose_count < ENOUGH and _continues(before, t_ns):
            slack_used = _slack_used(before, t_ns, x, y, z, max_speed)
        if not slack_used <= JUMP_SLACK:
            # A single pose is not worth resuming; the estimate before it may be.
            if present.pose_count > 1:
                motions[row, 1] = present
            _start(present, t_ns, x, y, z, max_speed)
            present.slack_used = JUMP_SLACK
            return status | STARTED
        motions[row, 0] = before
    present.slack_used = slack_used

    noise_error = _follow(present, x, y, z, 1e-9 * (t_ns - present.pose_ns), max_acceleration)
    present.pose_ns = t_ns
    present.pose_count = min(present.pose_count + 1, ENOUGH)
    present.is_known = 1 if noise_error <= MAX_NOISE_SPEED else 0
    if present.is_known == 0:
        for axis in range(3):
            present.velocity[axis] = 0.0
    if present.is_known == 0 or present.pose_count < ENOUGH:
        # Bounds any motion: the finger may move at full speed against the estimated velocity.
        present.velocity_error = max_speed + _speed(present)
    return status | (PREDICTED if present.is_known == 1 else 0)


@kernel
def observe_with_velocity(motions, row, t_ns, x, y, z, velocity, max_speed, max_acceleration):
    """Apply `observe` with a given velocity, (x, y, z) m/s, which is taken as exact.

    A velocity that is not finite is estimated from the poses instead.
    """
    status = observe(motions, row, t_ns, x, y, z, max_speed, max_acceleration)
    vx, vy, vz = velocity
    if status == 0 or not (math.isfinite(vx) and math.isfinite(vy) and math.isfinite(vz)):
        return status
    present = motions[row, 0]
    present.velocity[0], present.velocity[1], present.velocity[2] = vx, vy, vz
    present.velocity_error, present.is_known = 0.0, 1
    return status | PREDICTED


@inlined
def _speed(estimate):
    vx, vy, vz = estimate.velocity[0], estimate.velocity[1], estimate.velocity[2]
    return math.sqrt(vx * vx + vy * vy + vz * vz)


@inlined
def predict(estimate, h, max_speed, max_acceleration):
    """Predict the displacement of a finger *h* seconds after its last pose: dx, dy, dz, and *rho*, all m.

    The finger will be within *rho* of that position if it accelerates by at most *max_acceleration* (m/s²)
    and does not exceed *max_speed* (m/s); a finger already above *max_speed* is bounded by its acceleration
    alone. A negative *h* counts as 0. The position is a little short of linear extrapolation, which *rho*
    includes. A record of zeros has no position.
    """
    if not h > 0.0:
        return 0.0, 0.0, 0.0, 0.0
    ahead = min(h, MOTION_HORIZON)
    ahead -= ahead * ahead * (0.5 / COAST)
    vx, vy, vz = estimate.velocity[0], estimate.velocity[1], estimate.velocity[2]
    speed = _speed(estimate)
    # The bound is derived for linear extrapolation; add the distance by which the reported position is short.
    rho = (estimate.velocity_error + 0.5 * max_acceleration * h) * h + speed * (h - ahead)
    if speed <= max_speed:
        rho = min(rho, max_speed * h + speed * ahead)
    return vx * ahead, vy * ahead, vz * ahead, rho
