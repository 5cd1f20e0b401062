/* Feeds mutated frames to decaff_controller.h and checks at each sample that the finger is safe, see
 * test_decaff_fuzz.py. Arguments: seconds, and a seed. A valid frame is changed in a few places and sealed again, so
 * that its checksum does not reject the changes. */
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "decaff_controller.h"

#define FINGERS 3u
#define WALL 0.5 /* bend */
#define PERIOD_NS 333333
#define SAMPLES_A_LIFE 20000

typedef struct message {
    proximity_frame_header header;
    proximity_contact contacts[FINGERS];
} message;

static uint64_t state;
static unsigned long states[7]; /* samples, by enum decaff_drum_state */

static uint64_t next(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state * 0x2545f4914f6cdd1du;
}

static unsigned below(unsigned count)
{
    return (unsigned)(next() >> 33) % count;
}

static double between(double least, double most)
{
    return least + (most - least) * ((double)(next() >> 11) / 9007199254740992.0);
}

static double wild_real(void)
{
    static const double wild[] = {0.0, -0.0, 1e-320, 1e-9, -1e-9, 1.0, -1.0, 1e3, -1e3, 1e15, 1e300, -1e300};
    switch (below(6)) {
    case 0:
        return (double)NAN;
    case 1:
        return below(2) ? (double)INFINITY : -(double)INFINITY;
    case 2:
        return between(-2.0, 2.0);
    default:
        return wild[below(sizeof wild / sizeof wild[0])];
    }
}

static int64_t wild_instant(int64_t now_ns)
{
    static const int64_t wild[] = {INT64_MIN, INT64_MIN + 1, -1, 0, 1, INT64_MAX, INT64_MAX - 1, INT64_MAX / 2,
                                   INT64_MAX / 4, INT64_MAX / 4 + 1, INT64_MIN / 2, 1000000000};
    switch (below(3)) {
    case 0:
        return (int64_t)next();
    case 1:
        return now_ns + (int64_t)below(400000000) - 200000000;
    default:
        return wild[below(sizeof wild / sizeof wild[0])];
    }
}

static void fail(const char *what)
{
    fprintf(stderr, "unsafe: %s\n", what);
    abort();
}

#define SAFE(condition)    \
    do {                   \
        if (!(condition))  \
            fail(#condition); \
    } while (0)

static bool is_driven(enum decaff_drive_mode mode)
{
    return mode == DECAFF_DRIVE_MODE_POSITION || mode == DECAFF_DRIVE_MODE_FORCE;
}

/* Fingertip position at a bend, m; the rows of the table are evenly spaced. */
static double position_of(double bend)
{
    const decaff_path *path = &decaff_paths[0];
    return path->positions[(size_t)((bend - path->bends[0]) / (path->bends[1] - path->bends[0]))];
}

/* The drum's angle at a position, rad. */
static double angle_of(double position)
{
    const decaff_path *path = &decaff_paths[0];
    size_t row = 0;

    while (row + 1u < path->count && path->positions[row] < position)
        row++;
    return path->angles[row];
}

/* Write a frame of fingers approaching a wall, which may move. */
static void write_frame(message *frame, int64_t now_ns, double bend, unsigned surface, unsigned source)
{
    size_t i, axis;

    memset(frame, 0, sizeof *frame);
    frame->header.pose_ns = frame->header.start_ns = frame->header.publish_ns = now_ns;
    frame->header.valid_until_ns = now_ns + 20000000;
    frame->header.state = PROXIMITY_STATE_OK;
    frame->header.count = FINGERS;
    for (i = 0; i < FINGERS; i++) {
        proximity_contact *c = &frame->contacts[i];
        double distance = position_of(WALL) - position_of(bend);

        c->flags = PROXIMITY_FLAG_TRACKED | (below(50) ? 0u : (uint32_t)(next() & 0x7ffu));
        c->pose_ns = now_ns;
        c->signed_distance = c->lower = c->upper = c->predicted_distance = distance;
        c->predicted_lower = c->predicted_upper = distance;
        c->normal[2] = -1.0;
        c->part_velocity[2] = below(3) ? 0.0 : between(-0.2, 0.2);
        c->velocity[2] = between(-0.5, 0.5);
        c->bend = bend;
        c->bend_rate = between(-5.0, 5.0);
        c->contact_bend = below(50) ? WALL : (double)NAN;
        c->contact_bend_rate = below(2) ? 0.0 : between(-3.0, 3.0);
        c->stiffness = between(0.0, 2000.0);
        c->damping = between(0.0, 2.0);
        c->force = between(0.0, 3.0);
        c->surface = (uint8_t)surface;
        c->mode = (uint8_t)(below(500) ? PROXIMITY_MODE_POSITION : PROXIMITY_MODE_HOLD);
        c->source = (uint8_t)source;
        c->force_is_valid = (uint8_t)below(2);
        for (axis = 0; axis < 3; axis++)
            c->position[axis] = 0.01 * (double)axis;
    }
}

static void disturb(message *frame, int64_t now_ns)
{
    unsigned changes = below(10) ? 0u : 1u + below(3);
    static const size_t reals[] = {
        offsetof(proximity_contact, signed_distance), offsetof(proximity_contact, lower), offsetof(proximity_contact, bend),
        offsetof(proximity_contact, bend_rate), offsetof(proximity_contact, contact_bend),
        offsetof(proximity_contact, contact_bend_error), offsetof(proximity_contact, contact_bend_rate),
        offsetof(proximity_contact, normal), offsetof(proximity_contact, part_velocity),
        offsetof(proximity_contact, velocity), offsetof(proximity_contact, approach_speed),
        offsetof(proximity_contact, stiffness), offsetof(proximity_contact, damping), offsetof(proximity_contact, force),
        offsetof(proximity_contact, predicted_lower), offsetof(proximity_contact, time_to_contact)};
    static const size_t instants[] = {
        offsetof(message, header.pose_ns), offsetof(message, header.start_ns),
        offsetof(message, header.publish_ns), offsetof(message, header.valid_until_ns),
        offsetof(message, contacts[0].pose_ns), offsetof(message, contacts[1].predicted_ns)};
    uint8_t *bytes = (uint8_t *)frame;
    double real;
    int64_t instant;

    for (; changes > 0u; changes--) {
        switch (below(4)) {
        case 0:
            real = wild_real();
            memcpy(bytes + offsetof(message, contacts) + below(FINGERS) * sizeof(proximity_contact)
                       + reals[below(sizeof reals / sizeof reals[0])],
                   &real, sizeof real);
            break;
        case 1:
            instant = wild_instant(now_ns);
            memcpy(bytes + instants[below(sizeof instants / sizeof instants[0])], &instant, sizeof instant);
            break;
        default:
            bytes[sizeof(proximity_prefix) + below(sizeof *frame - sizeof(proximity_prefix))] = (uint8_t)next();
        }
    }
}

/* Send a frame in separate unaligned memory, so that sanitizers detect accesses beyond it. */
static void send(decaff_subscriber *frames, message *frame, int64_t now_ns, uint64_t *session, uint64_t *sequence)
{
    size_t size = sizeof *frame;
    uint64_t number = ++*sequence;
    uint8_t *datagram;

    if (below(200) == 0)
        number = below(2) ? next() : UINT64_MAX - below(3);
    if (below(2000) == 0)
        *session += below(3);
    proximity_seal(frame, size, PROXIMITY_FRAME_MAGIC, sizeof frame->header, *session, number);
    if (below(100) == 0)
        size = below(sizeof *frame + 1);
    datagram = malloc(size + 1);
    if (datagram == NULL)
        abort();
    memcpy(datagram + 1, frame, size);
    if (below(100) == 0 && size > 0)
        datagram[1 + below((unsigned)size)] ^= (uint8_t)(1u << below(8));
    decaff_subscriber_take(frames, datagram + 1, size, now_ns);
    free(datagram);
}

/* Call the other functions for messages, at any time. */
static void read_message(const message *frame, proximity_clock *clock, int64_t now_ns)
{
    int64_t at_ns = below(2) ? now_ns : wild_instant(now_ns);

    if (frame->header.count <= FINGERS)
        (void)proximity_content_flaw(&frame->header, frame->contacts, at_ns);
    (void)proximity_state_at(&frame->header, at_ns, PROXIMITY_STALE_AFTER_NS);
    (void)proximity_lower_at(&frame->contacts[0], at_ns, 2.0, 50.0);
    proximity_clock_hear(clock, frame->header.session, frame->header.publish_ns, at_ns);
    (void)proximity_clock_theirs(clock, at_ns);
}

static unsigned long live(unsigned long *used)
{
    decaff_subscriber frames;
    proximity_clock clock = {0};
    decaff_controller finger;
    decaff_servo servo;
    decaff_start start;
    const decaff_path *path = &decaff_paths[0];
    const decaff_settings *set = path->settings;
    decaff_action action = {0};
    decaff_observation seen;
    message frame;
    int64_t now_ns = (int64_t)(next() >> (4 + below(60))), away_ns = below(2) ? 0 : (int64_t)(next() >> 6);
    uint64_t session = next() >> 1, sequence = 0;
    double drum = path->positions[path->count - 1u], force = 0.0, cap = 0.0, bend, read, position = drum;
    unsigned long sample;
    unsigned surface = below(3), source = below(3);

    decaff_subscriber_begin(&frames, below(2) != 0, NULL);
    decaff_controller_begin(&finger, path);
    decaff_servo_begin(&servo, path, drum);
    decaff_start_begin(&start, path, below(20) ? 1.9 : wild_real(), below(2) != 0);
    for (sample = 0; sample < SAMPLES_A_LIFE; sample++) {
        now_ns += below(5000) ? PERIOD_NS : (int64_t)below(30000000);
        bend = sample % 3000 < 1000 ? 0.35 + 0.00016 * (double)(sample % 3000) : 0.51; /* closes, then presses */
        if (below(3) == 0 && sample % 7000 < 6000) {
            write_frame(&frame, frames.receiver.shares_clock ? now_ns : now_ns + away_ns, bend, surface, source);
            disturb(&frame, now_ns);
            send(&frames, &frame, now_ns, &session, &sequence);
            read_message(&frame, &clock, now_ns);
        }
        decaff_subscriber_look(&frames, below(500) ? 0u : FINGERS, now_ns, &seen);
        seen.bend = below(3000) ? bend : wild_real();
        seen.drum_angle = below(3000) ? angle_of(drum) : wild_real();
        seen.force = below(200) ? fmax(0.0, 200.0 * (position_of(bend) - drum)) : wild_real();
        seen.motor_force = below(50) ? -force : wild_real();
        seen.has_fault = below(9000) == 0;
        decaff_controller_step(&finger, &seen, &action);

        SAFE(isfinite(action.position) && isfinite(action.angle) && isfinite(action.force));
        SAFE(action.position <= path->positions[path->count - 1u]);
        SAFE(action.force >= 0.0 && action.force <= set->continuous_force && isfinite(action.torque));
        SAFE(action.speed_cap >= 0.0 && action.force_cap >= 0.0 && isfinite(action.heat));
        SAFE(isfinite(action.torque_cap) && isfinite(action.motor_speed_cap));
        SAFE(action.position >= position || finger.trust == DECAFF_TRUST_FRESH || finger.fault != 0);
        SAFE(!(isnan(seen.drum_angle) || isnan(seen.bend)) || !is_driven(action.mode));
        SAFE(is_driven(action.mode) || (action.torque == 0.0 && action.torque_cap == 0.0));
        SAFE(action.mode != DECAFF_DRIVE_MODE_FREE);
        position = action.position;

        read = below(2000) ? decaff_drum_position(path, seen.drum_angle) : wild_real();
        force = decaff_servo_step(&servo, &action, read, seen.force);
        SAFE(isfinite(read) || force == 0.0);
        SAFE(isfinite(force) && fabs(force) <= set->drum_force_limit && fabs(force) <= cap);
        SAFE(is_driven(action.mode) || force == 0.0);
        SAFE(isfinite(decaff_motor_torque(path, seen.drum_angle, force)));
        SAFE(fabs(decaff_start_step(&start, seen.drum_angle, seen.bend, below(9000) == 0))
             <= 0.1 * set->motor_torque);
        cap = action.force_cap;
        drum += fmax(-0.0005, fmin(action.position - drum, 0.0005));
        states[action.state]++;
        if ((finger.fault != DECAFF_FAULT_NONE || finger.is_stopped) && below(30) == 0)
            decaff_controller_reset(&finger);
        if (below(20000) == 0)
            decaff_controller_stop(&finger);
    }
    *used += frames.counts[DECAFF_REASON_USED];
    return sample;
}

int main(int count, char **words)
{
    double seconds = count > 1 ? atof(words[1]) : 1.0;
    time_t began = time(NULL);
    unsigned long samples = 0, used = 0;
    size_t i;

    state = 0x9e3779b97f4a7c15u + (count > 2 ? strtoull(words[2], NULL, 10) : 0u);
    do {
        samples += live(&used);
    } while (difftime(time(NULL), began) < seconds || samples < 25ul * SAMPLES_A_LIFE);
    printf("%lu samples, %lu frames used, no unsafe state; by state of the drum:", samples, used);
    for (i = 0; i < sizeof states / sizeof states[0]; i++)
        printf(" %lu", states[i]);
    printf("\n");
    return 0;
}
