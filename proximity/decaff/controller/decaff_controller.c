/*
 * decaff_controller.c: see decaff_controller.h. The same code runs in simulations, drums of a service and chips.
 */
#include "decaff_controller.h"

#include <math.h>
#include <string.h>

/* --- numbers --- */

/* Return the smaller of two numbers, or the first if one is NaN. */
static decaff_real lesser(decaff_real a, decaff_real b)
{
    return (b < a) ? b : a;
}

/* Return the larger of two numbers, or the first if one is NaN. */
static decaff_real greater(decaff_real a, decaff_real b)
{
    return (b > a) ? b : a;
}

/* Limit the magnitude of a number. NaN becomes 0. */
static decaff_real within(decaff_real number, decaff_real most)
{
    return isnan(number) ? 0.0 : greater(-most, lesser(most, number));
}

static decaff_real magnitude(decaff_real number)
{
    return (number < 0.0) ? -number : number;
}

static bool is_finite(decaff_real number)
{
    return isfinite(number) != 0;
}

/* Return a measured force, or NaN if it is impossible. */
static decaff_real force_of(decaff_real force)
{
    return (magnitude(force) <= DECAFF_MAX_FORCE) ? force : (decaff_real)NAN;
}

static decaff_real or_zero(decaff_real number)
{
    return is_finite(number) ? number : 0.0;
}

static int64_t within_ns(int64_t time_ns, int64_t max_ns)
{
    int64_t positive_ns = (time_ns > 0) ? time_ns : 0;

    return (positive_ns < max_ns) ? positive_ns : max_ns;
}

static decaff_real seconds(int64_t time_ns)
{
    return 1e-9 * (decaff_real)time_ns;
}

/* Return 1 - exp(-x) for x > 0, by a Taylor series of a small part of x and repeated doubling. */
static decaff_real share_of(decaff_real x)
{
    decaff_real small = x, share = 1.0;
    uint32_t doublings = 0u, term;

    while ((small > 0.0625) && (doublings < 16u)) {
        small *= 0.5;
        doublings++;
    }
    if (small > 0.0625) {
        doublings = 0u; /* x is beyond a thousand: the share is 1 */
    } else {
        share = 0.0;
        for (term = 9u; term > 0u; term--) {
            share = small / (decaff_real)term * (1.0 - share);
        }
        for (; doublings > 0u; doublings--) {
            share *= 2.0 - share;
        }
    }
    return share;
}

/* Return the length of a vector, without overflow. */
static decaff_real length_of(decaff_real x, decaff_real y, decaff_real z)
{
    decaff_real largest = greater(greater(magnitude(x), magnitude(y)), magnitude(z));
    decaff_real length = 0.0;

    if (largest > 0.0) {
        length = largest
                 * sqrt(((x / largest) * (x / largest)) + ((y / largest) * (y / largest))
                        + ((z / largest) * (z / largest)));
    }
    return length;
}

/* --- the finger's path --- */

/* Return the last row before x, or beyond the ends the first and the last but one. Constant time for even rows. */
static size_t row_of(decaff_real x, const decaff_real *xs, size_t count)
{
    size_t low = 0u, high = count - 1u;
    decaff_real share = (x - xs[0]) / (xs[high] - xs[0]) * (decaff_real)high;

    if ((share > 0.0) && (share < (decaff_real)high)) {
        size_t even = (size_t)share;

        if (x < xs[even]) {
            high = even;
        } else {
            low = even;
            high = (x < xs[even + 1u]) ? (even + 1u) : high;
        }
    }
    while ((high - low) > 1u) {
        size_t middle = low + ((high - low) / 2u);

        if (x < xs[middle]) {
            high = middle;
        } else {
            low = middle;
        }
    }
    return low;
}

/* Interpolate linearly, and extrapolate beyond the ends with the last slope. NaN stays NaN. */
static decaff_real along(decaff_real x, const decaff_real *xs, const decaff_real *ys, size_t count)
{
    size_t low = row_of(x, xs, count);

    return is_finite(x) ? (ys[low] + ((ys[low + 1u] - ys[low]) * ((x - xs[low]) / (xs[low + 1u] - xs[low])))) : x;
}

/* Interpolate linearly, with constant values beyond the ends. */
static decaff_real between(decaff_real x, const decaff_real *xs, const decaff_real *ys, size_t count)
{
    return along(greater(lesser(x, xs[count - 1u]), xs[0]), xs, ys, count);
}

static decaff_real position_of_bend(const decaff_path *path, decaff_real bend)
{
    return between(bend, path->bends, path->positions, path->count);
}

static decaff_real bend_of_position(const decaff_path *path, decaff_real position)
{
    return between(position, path->positions, path->bends, path->count);
}

static decaff_real angle_of_position(const decaff_path *path, decaff_real position)
{
    return along(position, path->positions, path->angles, path->count);
}

decaff_real decaff_drum_position(const decaff_path *path, decaff_real angle)
{
    return along(angle, path->angles, path->positions, path->count);
}

/* Return the metres of fingertip per radian of the motor, by the path's slope at a drum angle; also N m per N. */
static decaff_real motor_lever(const decaff_path *path, decaff_real angle)
{
    size_t row = row_of(angle, path->angles, path->count);
    decaff_real along = path->positions[row + 1u] - path->positions[row];

    along /= (path->angles[row + 1u] - path->angles[row]) * path->settings->drum_ratio;
    return isnan(angle) ? angle : along;
}

static decaff_real retracted(const decaff_path *path)
{
    return path->positions[path->count - 1u];
}

/* --- the subscriber --- */

void decaff_subscriber_begin(decaff_subscriber *frames, bool shares_clock, const uint8_t *key)
{
    (void)memset(frames, 0, sizeof *frames);
    frames->receiver.shares_clock = shares_clock ? 1 : 0;
    frames->receiver.is_keyed = (key != NULL) ? 1 : 0;
    frames->has_key = (key != NULL);
    if (key != NULL) {
        (void)memcpy(frames->key, key, sizeof frames->key);
    }
}

enum decaff_reason decaff_subscriber_take(decaff_subscriber *frames, const void *datagram, size_t size,
                                          int64_t now_ns)
{
    const uint8_t *message = (const uint8_t *)datagram;
    size_t message_size = frames->has_key ? proximity_verified(frames->key, datagram, size) : size;
    enum decaff_reason reason = DECAFF_REASON_UNVERIFIED;
    proximity_prefix prefix;

    if ((message_size > 0u) || !frames->has_key) {
        reason = (enum decaff_reason)proximity_take_frame(&frames->receiver, message, message_size,
                                                          DECAFF_MAX_FINGERS, now_ns);
    }
    if (reason == DECAFF_REASON_USED) {
        (void)memcpy(&frames->header, message, sizeof frames->header);
        (void)memcpy(frames->contacts, &message[sizeof frames->header],
                     frames->header.count * sizeof(proximity_contact));
    } else if (reason == (enum decaff_reason)PROXIMITY_FLAW_MAGIC) {
        (void)memcpy(&prefix, message, sizeof prefix);
        if (prefix.magic == PROXIMITY_DESCRIPTION_MAGIC) {
            reason = DECAFF_REASON_OTHER;
        }
    } else {
        /* refused */
    }
    frames->counts[reason]++;
    return reason;
}

void decaff_subscriber_look(const decaff_subscriber *frames, size_t finger, int64_t sample_ns,
                            decaff_observation *seen)
{
    bool is_known = (frames->receiver.received > 0u) && (finger < (size_t)frames->header.count);

    (void)memset(seen, 0, sizeof *seen);
    seen->sample_ns = sample_ns;
    seen->now_ns = proximity_theirs(&frames->receiver, sample_ns);
    seen->state = proximity_trust(&frames->receiver, &frames->header, seen->now_ns, PROXIMITY_STALE_AFTER_NS);
    seen->contact = is_known ? &frames->contacts[finger] : NULL;
    seen->session = frames->header.session;
    seen->sequence = frames->header.sequence;
    seen->start_ns = frames->header.start_ns;
    seen->bend = NAN;
    seen->drum_angle = NAN;
    seen->force = NAN;
    seen->motor_force = NAN;
}

/* --- the position of contact --- */

/* Return whether a number is unknown or within bounds. */
static bool may_be(decaff_real number, decaff_real least, decaff_real most)
{
    return isnan(number) || ((least <= number) && (number <= most));
}

/* Return whether a normal is a unit vector, or unknown. */
static bool may_be_normal(const double *normal)
{
    decaff_real x = normal[0], y = normal[1], z = normal[2];
    bool is_unknown = isnan(x) || isnan(y) || isnan(z);
    bool is_small = greater(greater(magnitude(x), magnitude(y)), magnitude(z)) < 2.0;
    decaff_real length = is_small ? sqrt((x * x) + (y * y) + (z * z)) : (decaff_real)INFINITY;

    return is_unknown || (magnitude(length - 1.0) <= PROXIMITY_UNIT_ERROR);
}

/* Return whether the values in a tracked finger's record are possible. */
static bool is_sound(const proximity_contact *c, const decaff_settings *set, int64_t now_ns)
{
    decaff_real distance = c->signed_distance;

    return (proximity_time_between(now_ns, c->pose_ns) <= set->future_ns) && (distance >= -DECAFF_MAX_LENGTH)
           && ((distance <= DECAFF_MAX_LENGTH) || !is_finite(distance)) /* inf: out of reach */
           && (c->mode <= (uint8_t)PROXIMITY_MODE_HOLD) && (c->surface <= (uint8_t)PROXIMITY_SURFACE_DEFORMABLE)
           && (c->source <= (uint8_t)PROXIMITY_SOURCE_TELEOPERATION) && may_be_normal(c->normal)
           && may_be(c->bend, DECAFF_LEAST_BEND, DECAFF_MOST_BEND)
           && may_be(c->contact_bend, DECAFF_LEAST_BEND, DECAFF_MOST_BEND)
           && may_be(c->bend_rate, -DECAFF_MAX_RATE, DECAFF_MAX_RATE)
           && may_be(c->contact_bend_rate, -DECAFF_MAX_RATE, DECAFF_MAX_RATE)
           && !(c->contact_bend_error < 0.0);
}

/* Return whether the service knows the finger's position. */
static bool is_tracked(const proximity_contact *c)
{
    return ((c->flags & (uint32_t)PROXIMITY_FLAG_TRACKED) != 0u) && (c->mode != (uint8_t)PROXIMITY_MODE_HOLD);
}

/* Return the bend at contact, b + d/(-n.p'), or NaN if the finger does not close. */
static decaff_real extrapolated(const proximity_contact *c, decaff_real bend, decaff_real distance)
{
    decaff_real closing = -((c->normal[0] * c->velocity[0]) + (c->normal[1] * c->velocity[1])
                            + (c->normal[2] * c->velocity[2]));
    decaff_real answer = NAN;

    if (!is_finite(closing)) {
        closing = c->approach_speed;
    }
    if ((distance > 0.0) && is_finite(distance) && (closing > DECAFF_MIN_CLOSING) && is_finite(closing)
        && (c->bend_rate > 0.0)) {
        answer = bend + ((distance * c->bend_rate) / closing);
    }
    return answer;
}

/* Return the speed of the contact along the finger's path as the part moves, m/s, or 0 if at rest or unknown. */
static decaff_real drift_of(const proximity_contact *c, const decaff_settings *set, decaff_real incidence)
{
    decaff_real coming = (c->normal[0] * c->part_velocity[0]) + (c->normal[1] * c->part_velocity[1])
                         + (c->normal[2] * c->part_velocity[2]);
    decaff_real drift = -or_zero(coming) / greater(or_zero(incidence), DECAFF_MIN_INCIDENCE);

    return (magnitude(drift) < set->follow_speed) ? 0.0
                                                  : greater(-set->max_speed, lesser(set->max_speed, drift));
}

/* Compute the position of contact from a record. Return false if there is none before the fist. */
static bool locate(const proximity_contact *c, const decaff_path *path, decaff_location *found)
{
    decaff_real bend = c->bend, distance = c->signed_distance, contact_bend = c->contact_bend;
    decaff_real clearance = lesser(c->lower, distance), travel = NAN;
    bool is_on_path = (c->flags & (uint32_t)PROXIMITY_FLAG_ON_PATH) != 0u;
    bool is_found = (c->flags & (uint32_t)PROXIMITY_FLAG_CONTACT_FOUND) != 0u;
    /* A path without a contact up to the limit of steps has no drift. */
    bool is_open = is_on_path && !is_found && isnan(c->contact_bend_rate);

    found->rate = 0.0;
    found->error = 0.0;
    if (isnan(contact_bend) && is_on_path) {
        return false; /* the path is free up to the fist: no extrapolation */
    }
    if (is_finite(contact_bend) && !is_open) {
        found->rate = or_zero(c->contact_bend_rate);
        found->error = or_zero(c->contact_bend_error);
    } else {
        contact_bend = greater(extrapolated(c, bend, distance),
                               isnan(contact_bend) ? -(decaff_real)INFINITY : contact_bend);
    }
    if (is_finite(bend) && (clearance > 0.0)) {
        /* Independently of its reported displacement, a free finger certainly moves this far before it touches. */
        decaff_real nearest = bend_of_position(path, position_of_bend(path, bend) + clearance);

        if (contact_bend < (nearest - DECAFF_TABLE_ERROR)) {
            contact_bend = nearest;
        }
    }
    if (!(contact_bend <= 1.0)) {
        return false;
    }
    if (is_finite(bend)) {
        travel = position_of_bend(path, contact_bend) - position_of_bend(path, bend);
    }
    found->incidence = ((travel > DECAFF_MIN_TRAVEL) && (distance < (decaff_real)INFINITY))
                           ? lesser(greater(distance / travel, 0.0), 1.0)
                           : (decaff_real)NAN;
    found->bend = contact_bend;
    found->pose_ns = c->pose_ns;
    found->finger_speed = length_of(or_zero(c->velocity[0]), or_zero(c->velocity[1]), or_zero(c->velocity[2]));
    return true;
}

/* --- trust in frames --- */

/* Discard the position of contact until another record is accepted. */
static void forget_location(decaff_frame_trust *frames)
{
    frames->has_location = false;
    frames->has_pending = false;
    frames->was_outside = false;
}

/* Reset the trust in frames, except for its counts. */
static void forget_frames(decaff_frame_trust *frames)
{
    uint32_t dropped = frames->dropped, awaited = frames->awaited;

    (void)memset(frames, 0, sizeof *frames);
    frames->dropped = dropped;
    frames->awaited = awaited;
}

/* Return the age of the last accepted pose, ns. */
static int64_t age_of(const decaff_frame_trust *frames, int64_t now_ns)
{
    return frames->has_pose ? proximity_time_between(frames->pose_ns, now_ns) : now_ns;
}

/* Return the expected position of contact, m, or inf if none is expected. */
static decaff_real predicted_position(const decaff_frame_trust *frames, const decaff_path *path, int64_t now_ns)
{
    const decaff_settings *set = path->settings;
    const decaff_location *location = &frames->location;
    decaff_real answer = (decaff_real)INFINITY;

    if (frames->has_location) {
        int64_t since_ns = within_ns(proximity_time_between(location->pose_ns, now_ns), set->fresh_ns);
        decaff_real bend = location->bend + (location->rate * 1e-9 * (decaff_real)since_ns);

        if (bend <= 1.0) {
            decaff_real elapsed = seconds(within_ns(age_of(frames, now_ns), set->fresh_ns));
            /* Limit the reported drift: a contact does not approach faster. */
            decaff_real nearest = position_of_bend(path, location->bend) - (set->max_speed * elapsed);

            answer = greater(position_of_bend(path, bend), nearest);
        }
    }
    return answer;
}

static enum decaff_trust trust_at(decaff_frame_trust *frames, const decaff_settings *set, int64_t now_ns)
{
    enum decaff_trust trust = DECAFF_TRUST_STALE;

    if (frames->is_distrusted) {
        trust = frames->distrust;
    } else if (!frames->has_pose) {
        trust = DECAFF_TRUST_LOST;
    } else {
        int64_t age_ns = proximity_time_between(frames->pose_ns, now_ns);

        if (age_ns >= -set->future_ns) { /* else the clock has been replaced */
            if (age_ns <= set->fresh_ns) {
                trust = DECAFF_TRUST_FRESH;
            } else if (age_ns <= set->stale_ns) {
                trust = DECAFF_TRUST_OLD;
            } else {
                /* too old */
            }
        }
        if (trust == DECAFF_TRUST_STALE) {
            forget_location(frames);
        }
    }
    return trust;
}

/* Return whether an earlier contact may have moved to its present position. `by_pose`: by the times of poses only. */
static bool may_follow(const decaff_location *before, const decaff_location *found, const decaff_path *path,
                       bool by_pose)
{
    const decaff_settings *set = path->settings;
    int64_t elapsed_ns = proximity_time_between(before->pose_ns, found->pose_ns);
    int64_t started_ns = proximity_time_between(before->start_ns, found->start_ns);
    decaff_real position = position_of_bend(path, found->bend);
    decaff_real error = lesser(position_of_bend(path, found->bend + found->error) - position,
                               DECAFF_MAX_POSITION_ERROR);
    decaff_real nearer = position_of_bend(path, before->bend) - position;

    if (!by_pose && (started_ns > elapsed_ns)) {
        elapsed_ns = started_ns;
    }
    if (elapsed_ns > set->fresh_ns) {
        elapsed_ns = set->fresh_ns;
    }
    return nearer <= ((set->max_speed * 1e-9 * (decaff_real)elapsed_ns) + error);
}

/* Return the rate of a bend, 1/s, for a speed of its position, m/s. */
static decaff_real rate_of(const decaff_path *path, decaff_real bend, decaff_real speed)
{
    decaff_real slope = (position_of_bend(path, bend + DECAFF_SLOPE_BEND) - position_of_bend(path, bend))
                        / DECAFF_SLOPE_BEND;

    return (slope > 0.0) ? (speed / slope) : 0.0;
}

/* Move the contact of a touched part. The surface stays in place unless the part moves. It then moves with the part's
 * velocity and, at most half as fast, towards the measured distance, as distances are uncertain inside. */
static void follow_part(decaff_location *at, const proximity_contact *c, const decaff_path *path, int64_t start_ns)
{
    decaff_real drift = drift_of(c, path->settings, at->incidence);
    decaff_real elapsed = seconds(within_ns(proximity_time_between(at->pose_ns, c->pose_ns), path->settings->stale_ns));

    if ((magnitude(drift) > 0.0) || (magnitude(at->drift) > 0.0)) {
        decaff_real position = position_of_bend(path, at->bend) + (0.5 * (at->drift + drift) * elapsed);
        decaff_real away = position_of_bend(path, c->bend) - position
                           + (c->signed_distance / greater(at->incidence, DECAFF_MIN_INCIDENCE));
        decaff_real most = 0.5 * magnitude(drift) * elapsed;

        position += is_finite(away) ? greater(-most, lesser(most, away)) : 0.0;
        at->bend = bend_of_position(path, position);
        at->rate = rate_of(path, at->bend, drift);
        at->drift = drift;
        at->error = 0.0;
        at->pose_ns = c->pose_ns;
        at->start_ns = start_ns;
    }
}

/* Accept a position of contact. The first one, and one nearer than is possible, must be confirmed by a second pose. */
static void take_location(decaff_frame_trust *frames, const proximity_contact *c, const decaff_path *path,
                          int64_t start_ns)
{
    bool is_outside = c->signed_distance > 0.0;
    decaff_location found;

    if (!is_outside && frames->has_location) {
        follow_part(&frames->location, c, path, start_ns);
    } else if (!locate(c, path, &found)) {
        frames->has_pending = false;
        if (is_outside) {
            frames->has_location = false;
        }
    } else {
        bool is_same_pose = frames->has_pending && (frames->pending.pose_ns == found.pose_ns);

        found.start_ns = start_ns;
        if (isnan(found.incidence)) {
            found.incidence = frames->has_location ? frames->location.incidence : 1.0;
        }
        found.drift = drift_of(c, path->settings, found.incidence);
        if (isnan(c->contact_bend_rate)) {
            found.rate = rate_of(path, found.bend, found.drift);
        }
        if ((frames->has_location && may_follow(&frames->location, &found, path, is_same_pose))
            || (!is_same_pose && frames->has_pending && may_follow(&frames->pending, &found, path, false))) {
            frames->location = found;
            frames->has_location = true;
            frames->has_pending = false;
        } else {
            if (frames->has_location && !is_outside) {
                frames->was_outside = false; /* a part was placed at the finger */
            }
            frames->pending = found;
            frames->has_pending = true;
            frames->awaited += is_same_pose ? 0u : 1u;
        }
    }
}

static void take_reading(decaff_contact_reading *reading, const proximity_contact *c)
{
    reading->is_known = true;
    reading->surface = c->surface;
    reading->source = c->source;
    reading->distance = c->signed_distance;
    reading->lower = c->lower;
    reading->stiffness = c->stiffness;
    reading->damping = c->damping;
    reading->force = ((c->force_is_valid != 0u) && is_finite(c->force)) ? c->force : (decaff_real)NAN;
}

/* Read a record once, and accept it if it is valid and in order. */
static void take_record(decaff_frame_trust *frames, const decaff_observation *seen, const decaff_path *path)
{
    const decaff_settings *set = path->settings;
    const proximity_contact *c = seen->contact;
    bool is_backward, is_wild;

    if (frames->has_frame && (frames->session == seen->session) && (frames->sequence == seen->sequence)
        && (frames->start_ns == seen->start_ns)) {
        return; /* seen before */
    }
    if (!frames->has_frame || (frames->session != seen->session)) {
        frames->has_newest = false; /* another run may have another clock */
        frames->newest_pose_ns = INT64_MIN;
    }
    frames->has_frame = true;
    frames->session = seen->session;
    frames->sequence = seen->sequence;
    frames->start_ns = seen->start_ns;
    is_wild = frames->has_newest && (seen->sequence > frames->newest_sequence)
              && ((seen->sequence - frames->newest_sequence) > (uint64_t)PROXIMITY_MAX_SKIPPED);
    is_backward = (frames->has_newest && (seen->sequence <= frames->newest_sequence))
                  || (c->pose_ns < frames->newest_pose_ns);
    if (!frames->has_newest || ((seen->sequence > frames->newest_sequence) && !is_wild)) {
        frames->newest_sequence = seen->sequence;
    }
    frames->has_newest = true;
    if (is_backward || is_wild || !is_sound(c, set, seen->now_ns)) {
        frames->dropped++;
        return;
    }
    if (proximity_time_between(c->pose_ns, seen->now_ns) > set->stale_ns) {
        return; /* too old to be informative */
    }
    if ((c->flags & (uint32_t)PROXIMITY_FLAG_JUMPED) != 0u) {
        frames->was_outside = false;
    }
    if ((c->signed_distance > 0.0) && ((c->flags & (uint32_t)PROXIMITY_FLAG_INSIDE) == 0u)) {
        frames->was_outside = true;
    }
    take_location(frames, c, path, seen->start_ns);
    frames->has_pose = true;
    frames->pose_ns = c->pose_ns;
    frames->is_distrusted = false;
    frames->newest_pose_ns = c->pose_ns;
    take_reading(&frames->reading, c);
}

/* Read a new record, and return the trust in the newest frames. */
static enum decaff_trust take_frames(decaff_frame_trust *frames, const decaff_observation *seen,
                                     const decaff_path *path)
{
    enum decaff_trust trust = DECAFF_TRUST_FRESH;
    bool is_silent = (seen->state == PROXIMITY_STATE_STARTING) || (seen->state == PROXIMITY_STATE_STALE)
                     || (seen->state == PROXIMITY_STATE_STOPPING);

    if (seen->contact == NULL) {
        trust = trust_at(frames, path->settings, seen->now_ns);
    } else if (is_silent || !is_tracked(seen->contact)) {
        trust = is_silent ? DECAFF_TRUST_STALE : DECAFF_TRUST_LOST;
        forget_location(frames);
        frames->is_distrusted = true;
        frames->distrust = trust;
    } else {
        if (seen->state != PROXIMITY_STATE_LATE) {
            take_record(frames, seen, path);
        }
        trust = trust_at(frames, path->settings, seen->now_ns);
    }
    return trust;
}

/* --- a steady force, and the force of a surface --- */

/* Add a sample of a force, and return whether the force is steady. */
bool decaff_is_steady(decaff_steady *watch, const decaff_settings *set, decaff_real force, decaff_real speed)
{
    bool is_full = watch->count >= set->steady_samples;
    decaff_real oldest = watch->window[watch->next], low, high;
    bool varies, drifts;
    uint32_t i;

    watch->once += set->steady_share * (force - watch->once);
    watch->twice += set->steady_share * (watch->once - watch->twice);
    watch->window[watch->next] = watch->twice;
    watch->next = ((watch->next + 1u) < set->steady_samples) ? (watch->next + 1u) : 0u;
    watch->count += is_full ? 0u : 1u;
    if (!(magnitude(speed) < set->steady_slow_speed)) {
        watch->slow_count = 0u;
    } else if (watch->slow_count < set->steady_samples) {
        watch->slow_count++;
    } else {
        /* slow for the whole window */
    }
    if (!is_full) {
        return false;
    }
    low = watch->window[0];
    high = watch->window[0];
    for (i = 1u; i < set->steady_samples; i++) {
        low = lesser(low, watch->window[i]);
        high = greater(high, watch->window[i]);
    }
    varies = (high - low) >= greater(set->steady_ripple, set->steady_ripple_share * high);
    drifts = magnitude(watch->twice - oldest) >= set->steady_slope_of_window;
    return (low > set->steady_least) && !varies && !drifts && (watch->slow_count >= set->steady_samples);
}

static decaff_real usable(decaff_real number)
{
    return (is_finite(number) && (number > 0.0)) ? number : 0.0;
}

/* Limit the damping of a surface, and its stiffness by the bound of passivity for this damping. */
void decaff_displayed(const decaff_settings *set, decaff_real stiffness, decaff_real damping, decaff_real *k,
                      decaff_real *b)
{
    decaff_real own = DECAFF_DRUM_DAMPING + DECAFF_PAD_DAMPING, most;

    *b = lesser(usable(damping), DECAFF_DAMPING_SHARE * own);
    /* Colgate: K T/2 + K T c - B (2 c c - 1) is at most the device's own, for every cosine c. */
    most = (own >= (5.0 * *b)) ? ((own + *b) / 1.5) : (sqrt(*b * ((8.0 * own) - (4.0 * *b))) - (2.0 * *b));
    *k = lesser(usable(stiffness), most / (set->period + (set->drum_latency / 1.5)));
}

/* Return the force of a surface along the finger's path, N. */
static decaff_real surface_force(const decaff_settings *set, const decaff_contact_reading *surface,
                                 decaff_real depth, decaff_real speed, decaff_real incidence)
{
    decaff_real k, b, force = 0.0;

    if (depth > 0.0) {
        decaff_displayed(set, surface->stiffness, surface->damping, &k, &b);
        force = greater(0.0, incidence * incidence * ((k * depth) + (b * speed)));
    }
    return force;
}

/* --- the stretch of the cable --- */

static void forget_stretch(decaff_controller *finger)
{
    finger->pressing_once = 0.0;
    finger->pressing_twice = 0.0;
    finger->stretch = 0.0;
}

/* Update the stretch of the cable. The drum comes nearer only while the frames are fresh. */
static void take_stretch(decaff_controller *finger, const decaff_observation *seen, decaff_real elapsed)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real share = share_of(set->cable_decay * elapsed);
    decaff_real force = or_zero(isnan(seen->force) ? seen->motor_force : seen->force), stretch;

    finger->pressing_once += share * (force - finger->pressing_once);
    finger->pressing_twice += share * (finger->pressing_once - finger->pressing_twice);
    stretch = lesser(greater(finger->pressing_twice, 0.0), set->continuous_force)
              / set->cable_stiffness;
    finger->stretch = (finger->trust == DECAFF_TRUST_FRESH) ? stretch : lesser(stretch, finger->stretch);
}

/* Return the target, moved nearer by the stretch of the cable. */
static decaff_real sent(const decaff_controller *finger)
{
    return finger->target - finger->stretch;
}

/* --- the controller --- */

static bool is_in_contact(enum decaff_drum_state state)
{
    return (state == DECAFF_DRUM_STATE_CONTACT_POSITION) || (state == DECAFF_DRUM_STATE_CONTACT_FORCE)
           || (state == DECAFF_DRUM_STATE_HOLD) || (state == DECAFF_DRUM_STATE_FREEZE);
}

static void leave_contact(decaff_controller *finger)
{
    finger->serves_force = false;
    finger->weak_for = 0.0;
    (void)memset(&finger->steady, 0, sizeof finger->steady);
    finger->is_releasing = false;
    finger->is_following = false;
    finger->share = 1.0;
}

void decaff_controller_begin(decaff_controller *finger, const decaff_path *path)
{
    (void)memset(finger, 0, sizeof *finger);
    finger->path = path;
    decaff_controller_reset(finger);
}

void decaff_controller_reset(decaff_controller *finger)
{
    finger->state = DECAFF_DRUM_STATE_RETRACTED;
    finger->trust = DECAFF_TRUST_LOST;
    finger->fault = DECAFF_FAULT_NONE;
    forget_frames(&finger->frames);
    finger->is_stopped = false;
    finger->target = retracted(finger->path);
    finger->force = (decaff_real)INFINITY;
    finger->is_late = false;
    finger->has_sample = false;
    finger->finger = NAN;
    finger->speed = NAN;
    leave_contact(finger);
    finger->mean_force = 0.0;
    finger->is_budget_spent = false;
    forget_stretch(finger);
}

void decaff_controller_stop(decaff_controller *finger)
{
    finger->is_stopped = true;
}

static enum decaff_fault fault_of(const decaff_controller *finger, const decaff_observation *seen)
{
    const decaff_settings *set = finger->path->settings;
    int64_t late_ns = finger->has_sample ? proximity_time_between(finger->sample_ns, seen->sample_ns) : 0;
    decaff_real least = finger->path->angles[0], most = finger->path->angles[finger->path->count - 1u];
    enum decaff_fault fault = DECAFF_FAULT_NONE;

    if ((late_ns < 0) || (late_ns > set->watchdog_ns)) {
        fault = DECAFF_FAULT_WATCHDOG;
    } else if (!is_finite(seen->bend)) {
        fault = DECAFF_FAULT_NO_BEND;
    } else if ((seen->bend < DECAFF_LEAST_BEND) || (seen->bend > DECAFF_MOST_BEND)) {
        fault = DECAFF_FAULT_BEND;
    } else if (!is_finite(seen->drum_angle)) {
        fault = DECAFF_FAULT_NO_ANGLE;
    } else if ((seen->drum_angle < (least - DECAFF_STRAY_ANGLE))
               || (seen->drum_angle > (most + DECAFF_STRAY_ANGLE))) {
        fault = DECAFF_FAULT_ANGLE;
    } else if (seen->has_fault) {
        fault = DECAFF_FAULT_MOTOR;
    } else {
        /* none */
    }
    return fault;
}

/* Update the finger's position by the potentiometer, and its low-passed speed. */
static void follow_finger(decaff_controller *finger, const decaff_observation *seen, decaff_real elapsed)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real before = finger->finger;

    finger->finger = position_of_bend(finger->path, seen->bend);
    if (isnan(before)) {
        finger->speed = 0.0;
    } else if (elapsed > 0.0) {
        finger->speed += (((finger->finger - before) / elapsed) - finger->speed)
                         * share_of(set->speed_decay * elapsed);
    } else {
        /* unchanged */
    }
}

/* Update the heat of the motor, i2t, by its force relative to the continuous one. If only the force on the finger is
 * known, the motor's is larger by the gear's loss. Without either, no heat is added. */
static void keep_heat(decaff_controller *finger, decaff_real motor_force, decaff_real force, decaff_real elapsed)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real share = (is_finite(motor_force) ? motor_force : (force / set->drum_efficiency)) / set->heat_force;

    if (is_finite(share) && (elapsed > 0.0)) {
        finger->heat += ((share * share) - finger->heat) * share_of(elapsed / set->heat_time);
    }
    finger->is_hot = finger->heat >= (finger->is_hot ? DECAFF_COOL_HEAT : 1.0);
}

/* Return the largest permitted force. It is the peak for a while, then the continuous one. A hot motor is limited to
 * its own continuous force. */
static decaff_real budget_cap(decaff_controller *finger, decaff_real force, decaff_real elapsed)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real cap = set->continuous_force;

    if (is_finite(force)) {
        decaff_real threshold = (finger->is_budget_spent ? 0.9 : 1.0) * set->continuous_force;

        finger->mean_force += (magnitude(force) - finger->mean_force)
                              * share_of(elapsed / set->force_time);
        finger->is_budget_spent = finger->mean_force >= threshold;
        cap = finger->is_budget_spent ? set->continuous_force : set->peak_force;
    }
    return finger->is_hot ? lesser(cap, set->heat_force) : cap;
}

/* Return whether finger and object are certainly apart. A drum in contact with the finger is then in its way. */
static bool is_clear(const decaff_controller *finger, const decaff_observation *seen)
{
    const decaff_settings *set = finger->path->settings;
    return finger->frames.reading.is_known && (finger->trust == DECAFF_TRUST_FRESH) && (seen->contact != NULL)
           && (finger->frames.reading.lower > set->release_gap);
}

static bool touches(const decaff_controller *finger, const decaff_observation *seen, decaff_real drum)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real gap = drum - finger->finger;

    return (gap < set->touch_gap)
           || ((seen->force > set->touch_force) && (gap < set->release_gap));
}

/* Return the permitted target, which comes nearer to the finger only while the frames are fresh. */
static decaff_real allowed(const decaff_controller *finger, decaff_real position)
{
    decaff_real target = finger->target;

    if (is_finite(position)) {
        target = (finger->trust == DECAFF_TRUST_FRESH) ? position : greater(position, finger->target);
    }
    return target;
}

/* Update whether the drum is late. It is late if the finger passes the target first, until the drum reaches it. */
static void mark_late(decaff_controller *finger, decaff_real drum, bool may_begin)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real reached = finger->target + set->late_gap;

    if (drum <= reached) {
        finger->is_late = false;
    } else if (may_begin) {
        finger->is_late = finger->finger > reached;
    } else {
        /* unchanged */
    }
}

/* Return the speed at which rotor and gear have the permitted energy of a bump, m/s, at the drum's present lever. */
static decaff_real near_speed(const decaff_controller *finger)
{
    return finger->path->settings->near_motor_speed * finger->motor_lever;
}

/* Return the maximum speed of the drum towards the finger. Near the finger it has little energy; farther away it can
 * brake in time, with and without power. In force mode it follows a receding finger. */
static decaff_real closing_cap(const decaff_controller *finger, decaff_real gap, bool follows)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real coming = greater(0.0, finger->speed); /* while the drum brakes, the finger still moves */
    decaff_real going = follows ? lesser(0.0, finger->speed) : 0.0;
    decaff_real slowest = greater(coming, near_speed(finger) - going);
    decaff_real free_gap = greater(0.0, gap - set->near_gap);
    decaff_real braked = sqrt((slowest * slowest) + (set->unbraked_speed * set->unbraked_speed)
                              + (2.0 * set->braking * free_gap))
                         - set->unbraked_speed;

    /* A drum that loses its power is braked by its motor. */
    return greater(slowest, lesser(braked, slowest + greater(0.0, (set->shorted_rate * gap) - set->shorted_late)))
           - coming;
}

/* Return the maximum speed towards the finger of a drum that may be late. */
static decaff_real approach_cap(const decaff_controller *finger, decaff_real gap, bool follows)
{
    decaff_real speed = closing_cap(finger, gap, follows);

    return finger->is_late ? lesser(speed, finger->path->settings->late_speed) : speed;
}

static void write_action(const decaff_controller *finger, decaff_action *action, enum decaff_drive_mode mode,
                         decaff_real speed, decaff_real cap)
{
    const decaff_settings *set = finger->path->settings;
    bool is_force = mode == DECAFF_DRIVE_MODE_FORCE;
    bool is_surface = finger->frames.reading.is_known
                      && (finger->frames.reading.surface == (uint8_t)PROXIMITY_SURFACE_DEFORMABLE);

    action->state = finger->state;
    action->mode = mode;
    action->position = sent(finger);
    action->angle = angle_of_position(finger->path, sent(finger));
    action->force = is_force ? finger->force : 0.0;
    action->speed_cap = speed;
    action->force_cap = cap;
    action->start_force = is_force ? finger->steady.twice : (decaff_real)NAN;
    action->torque = within(lesser(action->force, cap) * finger->motor_lever, set->motor_torque);
    action->torque_cap = within(cap * finger->motor_lever, set->motor_torque);
    action->motor_speed_cap = within(speed / finger->motor_lever, set->motor_speed);
    action->force_slew = (is_force && is_surface) ? (decaff_real)INFINITY : 0.0;
    action->heat = finger->heat;
    action->is_hot = finger->is_hot;
    action->is_anew = finger->is_anew;
}

static void act_at_position(const decaff_controller *finger, decaff_action *action, decaff_real drum,
                            decaff_real most)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real speed = (decaff_real)INFINITY, cap = most, gap = drum - finger->finger;

    if (sent(finger) < drum) {
        speed = approach_cap(finger, gap, false);
        /* Farther away no force acts, and a motor with that cap could not brake. */
        if (finger->is_late && (gap <= set->near_gap)) {
            cap = lesser(cap, set->late_force);
        }
    }
    write_action(finger, action, DECAFF_DRIVE_MODE_POSITION, speed, cap);
}

static void act_free(decaff_controller *finger, decaff_action *action, decaff_real position, decaff_real drum,
                     decaff_real most)
{
    const decaff_settings *set = finger->path->settings;
    decaff_real cap = most;

    finger->force = (decaff_real)INFINITY;
    forget_stretch(finger);
    finger->target = allowed(finger, position);
    mark_late(finger, drum, finger->state == DECAFF_DRUM_STATE_APPROACH);
    if ((sent(finger) >= drum) || ((drum - finger->finger) > set->near_gap)) {
        cap = (decaff_real)INFINITY; /* the motor accelerates only the drum's mass */
    }
    act_at_position(finger, action, drum, cap);
}

/* Return the force measured at the far end while it is displayed, from a steady contact until its loss, or NaN. */
static decaff_real slave_force(decaff_controller *finger, const decaff_observation *seen, decaff_real elapsed,
                               bool has_steadied)
{
    const decaff_settings *set = finger->path->settings;
    const decaff_contact_reading *reading = &finger->frames.reading;
    bool is_known = is_finite(reading->force);
    bool is_off = reading->distance > set->lost_distance;
    decaff_real force = NAN;

    if (finger->serves_force) {
        /* Without a measured force the contact is lost after a while. */
        finger->weak_for = (seen->force >= set->lost_force) ? 0.0 : (finger->weak_for + elapsed);
        finger->serves_force = !is_off && !(finger->weak_for >= set->lost_time);
    } else if (has_steadied && is_known && !is_off && (finger->trust == DECAFF_TRUST_FRESH)
               && is_finite(seen->force)) {
        finger->serves_force = true;
        finger->weak_for = 0.0;
    } else {
        /* the position is held */
    }
    if (finger->serves_force) {
        force = is_known ? greater(0.0, reading->force) : finger->force;
    }
    return force;
}

/* Return the force to display, N, or NaN if the position is held. */
static decaff_real force_wanted(decaff_controller *finger, const decaff_observation *seen, decaff_real drum,
                                decaff_real elapsed)
{
    const decaff_settings *set = finger->path->settings;
    const decaff_contact_reading *reading = &finger->frames.reading;
    bool has_steadied = decaff_is_steady(&finger->steady, set, or_zero(seen->force),
                                         finger->speed);
    bool has_served = finger->force < (decaff_real)INFINITY;
    decaff_real force = NAN;

    if (!reading->is_known || ((finger->trust != DECAFF_TRUST_FRESH) && !has_served)) {
        /* an uncertain contact starts no force */
    } else if (reading->surface == (uint8_t)PROXIMITY_SURFACE_DEFORMABLE) {
        /* The force of a surface that is not yet reached would not hold a drum that came too near. The limit for
         * leaving force mode is nearer, so that position and force do not alternate. */
        if (!(drum < (sent(finger) - (set->late_gap * (has_served ? 1.0 : 0.5))))) {
            finger->serves_force = true;
            force = surface_force(set, reading, finger->finger - finger->target, finger->speed,
                                  finger->frames.has_location ? finger->frames.location.incidence : 1.0);
        }
    } else if (reading->source != (uint8_t)PROXIMITY_SOURCE_TELEOPERATION) {
        finger->serves_force = false; /* a rigid part of the scene */
    } else {
        force = slave_force(finger, seen, elapsed, has_steadied);
    }
    return force;
}

/* Return the remaining share of the force. Without data it is 1 at first, then ramped to zero. */
static decaff_real released_share(decaff_controller *finger, int64_t sample_ns)
{
    const decaff_settings *set = finger->path->settings;
    if ((finger->trust == DECAFF_TRUST_FRESH)
        || ((finger->trust == DECAFF_TRUST_OLD) && !finger->is_releasing)) {
        finger->is_releasing = false;
        finger->share = 1.0;
    } else {
        int64_t ramped_ns;

        if (!finger->is_releasing) {
            finger->is_releasing = true;
            finger->release_ns = sample_ns;
        }
        ramped_ns = proximity_time_between(finger->release_ns, sample_ns) - set->freeze_ns;
        finger->share = lesser(
            greater(1.0 - ((decaff_real)ramped_ns / (decaff_real)set->ramp_ns), 0.0), 1.0);
    }
    return finger->share;
}

/* Let the target follow the contact of a moving part, no faster than drum and finger may approach, until the target
 * has reached the contact and the part has been at rest for a while. */
static void follow_contact(decaff_controller *finger, const decaff_observation *seen, decaff_real elapsed)
{
    const decaff_settings *set = finger->path->settings;
    const decaff_frame_trust *frames = &finger->frames;

    if (frames->has_location && (magnitude(frames->location.drift) > 0.0)) {
        finger->is_following = true;
        finger->moved_ns = seen->sample_ns;
    }
    if (finger->is_following && frames->has_location && (finger->trust == DECAFF_TRUST_FRESH)) {
        decaff_real position = lesser(predicted_position(frames, finger->path, seen->now_ns), retracted(finger->path));

        finger->target = greater(finger->target - (near_speed(finger) * elapsed),
                                 lesser(finger->target + (set->max_speed * elapsed), position));
        if ((magnitude(finger->target - position) < set->touch_gap)
            && (proximity_time_between(finger->moved_ns, seen->sample_ns) > DECAFF_FOLLOW_NS)) {
            finger->is_following = false;
        }
    }
}

/* Hold the position, or display a force. Old data neither move the drum nearer nor increase the force, which is
 * finally ramped down. */
static void act_in_contact(decaff_controller *finger, const decaff_observation *seen, decaff_action *action,
                           decaff_real drum, decaff_real cap, decaff_real elapsed)
{
    const decaff_settings *set = finger->path->settings;
    bool has_waned = finger->share < 1.0, is_fresh = finger->trust == DECAFF_TRUST_FRESH;
    decaff_real share = released_share(finger, seen->sample_ns), force;

    finger->is_late = finger->is_late || (has_waned && !(share < 1.0));
    if (!(share > 0.0) || ((share < 1.0) && (seen->force < set->gone_force))) {
        leave_contact(finger);
        finger->state = DECAFF_DRUM_STATE_RETRACTED;
        act_free(finger, action, retracted(finger->path), drum, cap);
        return;
    }
    follow_contact(finger, seen, elapsed);
    mark_late(finger, drum, !is_in_contact(finger->state));
    take_stretch(finger, seen, elapsed);
    force = force_wanted(finger, seen, drum, elapsed);
    if (is_fresh) {
        finger->state = isnan(force) ? DECAFF_DRUM_STATE_CONTACT_POSITION : DECAFF_DRUM_STATE_CONTACT_FORCE;
    } else {
        finger->state = (finger->trust == DECAFF_TRUST_OLD) ? DECAFF_DRUM_STATE_HOLD
                                                            : DECAFF_DRUM_STATE_FREEZE;
    }
    if (isnan(force)) {
        if (finger->force < (decaff_real)INFINITY) { /* after force mode the finger may have moved farther */
            mark_late(finger, drum, true);
        }
        finger->force = (decaff_real)INFINITY;
        act_at_position(finger, action, drum, share * cap);
    } else {
        if (!is_fresh) {
            force = lesser(force, finger->force);
        }
        finger->force = lesser(lesser(force, finger->is_late ? set->late_force : set->continuous_force), share * cap);
        write_action(finger, action, DECAFF_DRIVE_MODE_FORCE, approach_cap(finger, drum - finger->finger, true),
                     share * cap);
        if (!is_finite(seen->force)) {
            action->start_force = NAN; /* an unmeasured force would not be corrected later */
        }
    }
}

/* Return the target of the drum while the finger does not touch. */
static decaff_real position_wanted(const decaff_controller *finger, int64_t now_ns)
{
    const decaff_settings *set = finger->path->settings;
    const decaff_frame_trust *frames = &finger->frames;
    decaff_real farthest = retracted(finger->path), position = farthest;

    if (finger->trust > DECAFF_TRUST_OLD) {
        /* no data */
    } else if (!frames->was_outside) {
        /* Inside, the side of the surface is unknown. The drum comes no nearer, and stays off the finger. */
        position = greater(finger->target, finger->finger + set->standoff);
    } else {
        position = lesser(predicted_position(frames, finger->path, now_ns), farthest);
        if ((finger->trust == DECAFF_TRUST_OLD) && frames->has_location) {
            int64_t age_ns = age_of(frames, now_ns);
            decaff_real speed = set->object_speed
                                + (set->speed_error * magnitude(frames->location.finger_speed));

            position += speed * 1e-9 * (decaff_real)((age_ns > 0) ? age_ns : 0);
        }
    }
    return lesser(position, farthest);
}

static void act_out_of_contact(decaff_controller *finger, const decaff_observation *seen, decaff_action *action,
                               decaff_real drum, decaff_real cap, decaff_real elapsed)
{
    decaff_real position = position_wanted(finger, seen->now_ns);
    bool is_touched = false;

    if (position < retracted(finger->path)) {
        finger->state = DECAFF_DRUM_STATE_APPROACH;
        finger->target = allowed(finger, position);
        is_touched = touches(finger, seen, drum) && !is_clear(finger, seen);
    } else {
        finger->state = DECAFF_DRUM_STATE_RETRACTED;
    }
    if (is_touched) {
        act_in_contact(finger, seen, action, drum, cap, elapsed);
    } else {
        act_free(finger, action, position, drum, cap);
    }
}

void decaff_controller_step(decaff_controller *finger, const decaff_observation *given, decaff_action *action)
{
    const decaff_settings *set = finger->path->settings;
    decaff_observation checked = *given;
    const decaff_observation *seen = &checked;
    decaff_real elapsed, cap, drum;

    checked.force = force_of(given->force);
    checked.motor_force = force_of(given->motor_force);

    if (finger->fault == DECAFF_FAULT_NONE) {
        finger->fault = fault_of(finger, seen);
    }
    elapsed = finger->has_sample ? seconds(proximity_time_between(finger->sample_ns, seen->sample_ns)) : 0.0;
    finger->is_anew = elapsed > (DECAFF_GAP_PERIODS * set->period);
    finger->has_sample = true;
    finger->sample_ns = seen->sample_ns;
    keep_heat(finger, seen->motor_force, seen->force, elapsed);
    if (finger->fault != DECAFF_FAULT_NONE) {
        finger->state = DECAFF_DRUM_STATE_FAULT;
        write_action(finger, action, DECAFF_DRIVE_MODE_BRAKED, 0.0, 0.0);
        return;
    }
    follow_finger(finger, seen, elapsed);
    finger->trust = take_frames(&finger->frames, seen, finger->path);
    cap = budget_cap(finger, seen->force, elapsed);
    finger->motor_lever = motor_lever(finger->path, seen->drum_angle);
    drum = decaff_drum_position(finger->path, seen->drum_angle);
    if (finger->is_stopped) {
        finger->state = DECAFF_DRUM_STATE_RETRACTED;
        act_free(finger, action, retracted(finger->path), drum, cap);
    } else if (is_in_contact(finger->state) && !((drum - finger->finger) > set->release_gap)
               && !is_clear(finger, seen)) {
        act_in_contact(finger, seen, action, drum, cap, elapsed);
    } else {
        if (is_in_contact(finger->state)) {
            leave_contact(finger);
        }
        act_out_of_contact(finger, seen, action, drum, cap, elapsed);
    }
}

/* --- the motor --- */

decaff_real decaff_motor_torque(const decaff_path *path, decaff_real angle, decaff_real force)
{
    return within(force * motor_lever(path, angle), path->settings->motor_torque);
}

decaff_real decaff_motor_speed(const decaff_path *path, decaff_real angle, decaff_real speed)
{
    return within(speed / motor_lever(path, angle), path->settings->motor_speed);
}

/* --- the servo --- */

void decaff_servo_begin(decaff_servo *servo, const decaff_path *path, decaff_real position)
{
    (void)memset(servo, 0, sizeof *servo);
    servo->settings = path->settings;
    servo->last_mode = DECAFF_DRIVE_MODE_POSITION;
    servo->reference = position;
    servo->last_position = position;
}

/* Enter a mode, whose state begins with that of the last one. */
static void enter_mode(decaff_servo *servo, const decaff_action *action, enum decaff_drive_mode mode,
                       decaff_real position, decaff_real speed)
{
    const decaff_settings *set = servo->settings;
    bool is_bumpless = !isnan(action->start_force);

    if (mode == DECAFF_DRIVE_MODE_POSITION) {
        servo->reference = position;
        servo->reference_speed = within(speed, set->servo_speed);
        servo->integrated = 0.0;
    } else if (mode == DECAFF_DRIVE_MODE_FORCE) {
        servo->force_reference = is_bumpless ? action->start_force : 0.0;
        servo->integrated = is_bumpless ? (-servo->smoothed - action->start_force) : 0.0;
    } else {
        /* without power */
    }
    servo->last_mode = mode;
}

/* Move the reference towards the target at the maximum speed from which it can stop there, in whole samples. */
static void shape_reference(decaff_servo *servo, const decaff_action *action)
{
    const decaff_settings *set = servo->settings;
    decaff_real away = action->position - servo->reference;
    decaff_real half = 0.5 * set->servo_acceleration * set->period;
    decaff_real wanted = sqrt((half * half) + (2.0 * set->servo_acceleration * magnitude(away))) - half;
    decaff_real change;

    wanted = lesser(lesser(lesser(wanted, set->servo_speed), action->speed_cap),
                    magnitude(away) / set->period);
    change = ((away > 0.0) ? wanted : -wanted) - servo->reference_speed;
    servo->reference_speed += within(change, set->servo_acceleration * set->period);
    servo->reference += servo->reference_speed * set->period;
}

/* Return the force demanded by stiffness, damping and integral against the shaped reference, N. Towards the finger the
 * lead of the reference is limited by the damping at the permitted speed, so that a blocked drum gains no speed when
 * it is freed. */
static decaff_real demand_position(decaff_servo *servo, const decaff_action *action, decaff_real position,
                                   decaff_real speed, decaff_real limit)
{
    const decaff_settings *set = servo->settings;
    decaff_real lead = limit / set->servo_stiffness, error, demand;
    decaff_real nearer = lesser(lead, action->speed_cap * set->servo_damping / set->servo_stiffness);

    servo->reference = greater(position - nearer, lesser(position + lead, servo->reference));
    error = servo->reference - position;
    if ((magnitude(error) <= set->servo_deadband) && (magnitude(servo->reference_speed) <= DECAFF_STANDING)) {
        error = 0.0;
    }
    demand = (set->servo_stiffness * error) + (set->servo_damping * (servo->reference_speed - speed))
             + servo->integrated;
    if (magnitude(demand) <= limit) {
        servo->integrated = within(servo->integrated + (set->servo_integral * error * set->period),
                                   set->servo_integral_limit);
    }
    return demand;
}

/* Return the speed of one count of the encoder per sample, m/s. */
static decaff_real one_count(const decaff_settings *set)
{
    return 2.0 * set->servo_deadband / set->period;
}

/* Return the demanded force, N: the slewed reference, with an integral of the error, damping, and a brake. */
static decaff_real demand_force(decaff_servo *servo, const decaff_action *action, decaff_real speed,
                                decaff_real force, decaff_real limit)
{
    const decaff_settings *set = servo->settings;
    decaff_real slew = (action->force_slew > 0.0) ? action->force_slew : set->servo_force_slew, demand;
    /* Towards a finger that the drum may have lost, a proportional brake begins before the speed cap. If the finger
     * is felt, it begins at one count of the encoder per sample, as single counts would else push the drum off. */
    decaff_real count = (force > set->touch_force) ? one_count(set) : 0.0;
    decaff_real too_fast = greater(-speed - greater(DECAFF_BRAKE_FROM * action->speed_cap, count), 0.0);

    servo->force_reference += within(action->force - servo->force_reference, slew * set->period);
    demand = -servo->force_reference - servo->integrated - (set->servo_force_damping * speed);
    if ((magnitude(demand) <= limit) && is_finite(force)) { /* an unmeasured force has no error */
        servo->integrated += set->servo_force_gain * (servo->force_reference - force) * set->period;
    }
    return demand + (DECAFF_BRAKE_DAMPING * set->servo_damping * too_fast);
}

/* Return the share of the push towards the finger that remains near the maximum speed. It falls to 0, so that a chip
 * that hangs leaves no push, and a light drum gains no speed in the play of its gear. */
static decaff_real push_share(const decaff_settings *set, enum decaff_drive_mode mode, decaff_real cap,
                              decaff_real coming, decaff_real force)
{
    bool is_force = mode == DECAFF_DRIVE_MODE_FORCE;
    decaff_real count = (is_force && !(force > set->touch_force)) ? 0.0 : one_count(set);
    decaff_real first = greater((is_force ? DECAFF_BRAKE_FROM : DECAFF_FADE_FROM) * cap, count);
    decaff_real last = greater((is_force ? DECAFF_FADE_TO_FORCE : DECAFF_FADE_TO) * cap, 1.5 * count);
    decaff_real share = 1.0;

    if (is_finite(cap) && (coming > first)) {
        share = (coming < last) ? ((last - coming) / (last - first)) : 0.0;
    }
    return share;
}

decaff_real decaff_servo_step(decaff_servo *servo, const decaff_action *action, decaff_real position,
                              decaff_real force)
{
    const decaff_settings *set = servo->settings;
    decaff_real limit = lesser(set->drum_force_limit, action->force_cap), speed = 0.0;
    decaff_real demand = 0.0, applied = action->is_anew ? 0.0 : servo->demanded;
    enum decaff_drive_mode mode = is_finite(position) ? action->mode : DECAFF_DRIVE_MODE_BRAKED;
    bool is_driven = (mode == DECAFF_DRIVE_MODE_POSITION) || (mode == DECAFF_DRIVE_MODE_FORCE);

    if (is_finite(position)) {
        speed = action->is_anew ? 0.0 : ((position - servo->last_position) / set->period);
        servo->last_position = position;
    }
    if ((mode != servo->last_mode) || action->is_anew) {
        enter_mode(servo, action, mode, position, speed);
    }
    if (mode == DECAFF_DRIVE_MODE_POSITION) {
        demand = demand_position(servo, action, position, speed, limit);
        shape_reference(servo, action);
    } else if (mode == DECAFF_DRIVE_MODE_FORCE) {
        demand = demand_force(servo, action, speed, force, limit);
    } else {
        /* without power */
    }
    if (demand < 0.0) {
        demand *= push_share(set, mode, action->speed_cap, -speed, force);
    }
    servo->smoothed += set->servo_smoothing_share * (applied - servo->smoothed);
    servo->demanded = within(demand, limit);
    return is_driven ? applied : 0.0; /* without power immediately */
}

/* --- the start --- */

void decaff_start_begin(decaff_start *start, const decaff_path *path, decaff_real home, bool has_index)
{
    (void)memset(start, 0, sizeof *start);
    start->path = path;
    start->home = home;
    start->angle = path->angles[path->count - 1u];
    start->state = has_index ? DECAFF_START_SIGN : DECAFF_START_BY_HAND;
}

static void enter_start(decaff_start *start, enum decaff_start_state state)
{
    start->state = state;
    start->time = 0.0;
    start->still = 0.0;
}

/* Set the drum's angle, which is known at its index or stop. */
static void set_home(decaff_start *start, decaff_real encoder)
{
    start->offset = start->home - encoder;
    start->angle = start->home;
    enter_start(start, DECAFF_START_DONE);
}

/* Compare encoder and potentiometer, which must turn alike while a hand pushes link and unpowered drum together. */
static void compare_by_hand(decaff_start *start, decaff_real encoder, decaff_real link)
{
    decaff_real turned = encoder - start->first, pushed = link - start->first_link;

    if (magnitude(turned) < DECAFF_START_PLAY) {
        start->first_link = link; /* still apart */
    } else if (magnitude(turned) > DECAFF_START_PUSH) {
        if ((magnitude(pushed) > (0.5 * magnitude(turned))) && (magnitude(pushed) < (2.0 * magnitude(turned)))) {
            enter_start(start, ((pushed * turned) > 0.0) ? DECAFF_START_SIGN : DECAFF_START_WRONG_SIGN);
        }
        start->first = encoder;
        start->first_link = link;
    } else {
        /* on its way */
    }
}

/* Return a torque away from the finger first and, if the drum is blocked, as at the stop, in the other direction. */
static decaff_real try_sign(decaff_start *start, decaff_real encoder, decaff_real most)
{
    decaff_real share = start->time / DECAFF_START_RAMP, torque = 0.0;
    decaff_real turned = (share < 1.0) ? (encoder - start->first) : (start->first - encoder);

    if (turned > DECAFF_START_TURN) {
        enter_start(start, DECAFF_START_HOME);
    } else if (turned < -DECAFF_START_TURN) {
        enter_start(start, DECAFF_START_WRONG_SIGN);
    } else if (share > 2.0) {
        enter_start(start, DECAFF_START_STUCK);
    } else { /* no faster than on the way to the stop, in either direction */
        torque = most * ((share < 1.0) ? share : (1.0 - share))
                 * greater(1.0 - (magnitude(start->speed) / DECAFF_START_SPEED), 0.0);
    }
    return torque;
}

decaff_real decaff_start_step(decaff_start *start, decaff_real encoder, decaff_real bend, bool is_at_index)
{
    const decaff_path *path = start->path;
    const decaff_settings *set = path->settings;
    decaff_real most = DECAFF_START_SHARE * set->motor_torque, torque = 0.0;
    decaff_real link = between(bend, path->bends, path->angles, path->count);

    if (start->state < DECAFF_START_DONE) {
        if (!start->has_angle) {
            start->has_angle = true;
            start->first = encoder;
            start->last = encoder;
            start->first_link = link;
        }
        start->speed += (((encoder - start->last) / set->period) - start->speed)
                        * share_of(set->speed_decay * set->period);
        start->last = encoder;
        start->time += set->period;
        start->still = (magnitude(start->speed) < (0.1 * DECAFF_START_SPEED)) ? (start->still + set->period) : 0.0;
        if (!is_finite(encoder) || !is_finite(link)) {
            enter_start(start, DECAFF_START_NO_ANGLE);
        } else if (start->state == DECAFF_START_BY_HAND) {
            compare_by_hand(start, encoder, link);
        } else if ((start->first_link - link) > DECAFF_START_PUSHED) {
            enter_start(start, DECAFF_START_WRONG_SIGN); /* the drum pushes the link: it moves towards the finger */
        } else if (!((encoder - start->first) <= ((start->home - path->angles[0]) + DECAFF_START_PUSHED))) {
            enter_start(start, DECAFF_START_STUCK); /* home is farther than the length of the finger's path */
        } else if (is_at_index) {
            set_home(start, encoder);
        } else if (start->time > DECAFF_START_LONGEST) {
            enter_start(start, DECAFF_START_STUCK);
        } else if (start->state == DECAFF_START_SIGN) {
            torque = try_sign(start, encoder, most);
        } else if ((start->still > DECAFF_START_STILL) && (start->time > DECAFF_START_RAMP)) {
            set_home(start, encoder);
        } else {
            torque = within(most * (1.0 - (start->speed / DECAFF_START_SPEED)), most);
        }
    }
    if (start->state == DECAFF_START_BY_HAND) {
        start->mode = DECAFF_DRIVE_MODE_FREE;
    } else {
        start->mode = (start->state > DECAFF_START_DONE) ? DECAFF_DRIVE_MODE_BRAKED : DECAFF_DRIVE_MODE_FORCE;
    }
    return torque;
}
