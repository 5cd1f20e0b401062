/* The controller in C with a simulated plant, see drum_in_plant.py. Motor and gear are given by macros. The rotor and the
 * arm, coupled through the gear's backlash, are two masses, in radians of the drum; finger and link are a third, in
 * metres. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "decaff_controller.h"

#ifdef BEFORE /* a controller that coasts without power, and has no comparison by hand */
#define DECAFF_DRIVE_MODE_FREE DECAFF_DRIVE_MODE_OFF
#define DECAFF_DRIVE_MODE_BRAKED DECAFF_DRIVE_MODE_OFF
#define WATCHDOG_SAMPLES 30
#define BEGIN_START(start, path, home, has_index) decaff_start_begin(start, path, home)
#define STEP_START(start, encoder, bend, index) decaff_start_step(start, encoder, index)
#define MODE_OF(start) ((start).state <= DECAFF_START_DONE ? DECAFF_DRIVE_MODE_FORCE : DECAFF_DRIVE_MODE_OFF)
#define IS_BY_HAND(start) ((start).state < DECAFF_START_SIGN)
#else
#define WATCHDOG_SAMPLES 3
#define BEGIN_START decaff_start_begin
#define STEP_START decaff_start_step
#define MODE_OF(start) (start).mode
#define IS_BY_HAND(start) ((start).state == DECAFF_START_BY_HAND)
#endif

#define STEPS 30              /* of the plant, per sample */
#define ARM 1.6e-5            /* kg m2: a roller of 10 g */
#define COMES 0.05            /* s, when frames of a press first predict the contact */
#define ARM_FRICTION 0.002    /* N m; assumed */
#define GEAR 300.0            /* N m/rad, of the gear beyond its backlash; assumed */
#define GEAR_DAMPING 0.02     /* N m s/rad */
#define STICTION 1.5          /* relative to the friction of a rotating rotor; assumed */
#define STOP 1.9              /* rad */
#define STOP_STIFFNESS 300.0  /* N m/rad, of rubber */
#define STOP_DAMPING 1.4      /* N m s/rad */
#define MASS 0.015            /* kg, of finger and link */
#define TOUCH 50000.0         /* N/m, of link on drum */
#define TOUCH_DAMPING 20.0    /* N s/m */
#define COUNT (6.283185307179586 / ENCODER_COUNTS / RATIO)
#define POTENTIOMETER 9e-6 /* m */

static double rotor, rotor_speed, arm, arm_speed, torque, asked; /* rad and N m, at the drum except the torques */
static double finger, finger_speed, contact;                     /* m and N */
static double hand, hand_speed, hand_stiffness, hand_damping;    /* of the hand's target */
static double turns = 1.0, counts = 1.0;                         /* -1: the motor, or the encoder, is reversed */
static enum decaff_drive_mode mode;
static bool is_touching; /* link and drum */
static double worst[2]; /* J, of hits with and without power */
static int hits;
static bool lists_hits;
static double stop = STOP; /* rad, of the mechanical stop */
static double max_asked;  /* N m, while the drum starts */

static const decaff_path *path;
static const decaff_settings *set;
static uint64_t seed;

static double between(double least, double most)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return least + (most - least) * ((double)((seed * 0x2545f4914f6cdd1du) >> 11) / 9007199254740992.0);
}

/* Interpolate a table linearly, extrapolating beyond its ends. */
static double looked_up(double x, const double *xs, const double *ys)
{
    size_t low = 0, high = path->count - 1;

    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (x < xs[middle])
            high = middle;
        else
            low = middle;
    }
    return ys[low] + (ys[low + 1] - ys[low]) * (x - xs[low]) / (xs[low + 1] - xs[low]);
}

static bool is_driven(void)
{
    return mode == DECAFF_DRIVE_MODE_POSITION || mode == DECAFF_DRIVE_MODE_FORCE;
}

/* The speed after a step under torque and friction, which stops motion but never reverses it. */
static double slid(double speed, double pull, double friction, double inertia, double step)
{
    double free = speed + pull / inertia * step, held = (fabs(speed) < 1e-4 ? STICTION : 1.0) * friction / inertia * step;

    return free > held ? free - held : (free < -held ? free + held : 0.0);
}

/* Energy of rotor and arm in a hit, J, from their speed or their speed relative to the finger, whichever is less. */
static double energy_of_hit(double lever)
{
    double rotor_comes = fmax(0.0, fmin(-rotor_speed, finger_speed / lever - rotor_speed));
    double arm_comes = fmax(0.0, fmin(-arm_speed, finger_speed / lever - arm_speed));

    return 0.5 * (INERTIA * RATIO * RATIO * rotor_comes * rotor_comes + ARM * arm_comes * arm_comes);
}

/* Step the plant with the arm near an angle, at which the finger meets it at a position. */
static void push(double lever, double angle, double position, double step)
{
    double twist = rotor - arm, gear = 0.0, drum = position + lever * (arm - angle);
    double volts = is_driven() ? STALL : 0.0, lost = STALL * rotor_speed * RATIO / SPEED, stopped = 0.0;
    bool touches = finger > drum;

    if (mode == DECAFF_DRIVE_MODE_FREE)
        torque = 0.0;
    else
        torque += step * fmax((-volts - lost - torque) / ELECTRICAL_TIME,
                              fmin((volts - lost - torque) / ELECTRICAL_TIME,
                                   is_driven() ? CURRENT_RATE * (asked - torque) : INFINITY));
    if (fabs(twist) > 0.5 * BACKLASH)
        gear = GEAR * (twist - copysign(0.5 * BACKLASH, twist)) + GEAR_DAMPING * (rotor_speed - arm_speed);
    if (gear * twist < 0.0)
        gear = 0.0;
    contact = touches ? fmax(0.0, TOUCH * (finger - drum) + TOUCH_DAMPING * (finger_speed - lever * arm_speed)) : 0.0;
    if (arm > stop)
        stopped = fmax(0.0, STOP_STIFFNESS * (arm - stop) + STOP_DAMPING * arm_speed);
    if (touches && !is_touching && hand_stiffness > 0.0) {
        double energy = energy_of_hit(lever);

        hits++;
        worst[is_driven() ? 0 : 1] = fmax(worst[is_driven() ? 0 : 1], energy);
        if (lists_hits)
            printf("%d %.4f\n", is_driven() ? 0 : 1, 1e3 * energy);
    }
    is_touching = touches;
    rotor_speed = slid(rotor_speed, torque * RATIO - gear, FRICTION * RATIO + (1.0 / EFFICIENCY - 1.0) * fabs(gear),
                       INERTIA * RATIO * RATIO, step);
    arm_speed = slid(arm_speed, gear - stopped + contact * lever, ARM_FRICTION, ARM, step);
    rotor += rotor_speed * step;
    arm += arm_speed * step;
    finger_speed += (hand_stiffness * (hand - finger) + hand_damping * (hand_speed - finger_speed) - contact) / MASS * step;
    finger += finger_speed * step;
    hand += hand_speed * step;
}

/* Run the plant for one sample. */
static void run_plant(void)
{
    double position = looked_up(arm, path->angles, path->positions), angle = arm, lever;
    int i;

    lever = (looked_up(arm + 1e-4, path->angles, path->positions) - position) / 1e-4;
    for (i = 0; i < STEPS; i++)
        push(lever, angle, position, set->period / STEPS);
}

static double encoder(void)
{
    return counts * COUNT * floor(rotor / COUNT + 0.5);
}

static double bend(void)
{
    return looked_up(POTENTIOMETER * floor(finger / POTENTIOMETER + 0.5), path->positions, path->bends);
}

static void put_drum(double angle)
{
    rotor = arm = angle;
    rotor_speed = arm_speed = torque = asked = 0.0;
    mode = DECAFF_DRIVE_MODE_FREE;
}

/* Run the start of the guide's listing, with the link of an empty glove in front of the drum, or flat; return the
 * drum's approach by its motor, m. */
static double start_drum(decaff_start *start, double angle, double index, double link)
{
    double nearest, before;
    int i;

    put_drum(angle);
    hand_stiffness = hand_damping = hand_speed = finger_speed = 0.0;
    finger = looked_up(link, path->angles, path->positions);
    BEGIN_START(start, path, isnan(index) ? STOP : index, !isnan(index));
    for (i = 0; i < 6000 && IS_BY_HAND(*start); i++) { /* a hand rotates the drum to the link, and pushes both */
        put_drum(angle - 0.3 * i * set->period);
        finger = fmin(finger, looked_up(arm, path->angles, path->positions));
        STEP_START(start, encoder(), bend(), false);
    }
    nearest = angle = before = arm;
    for (i = 0; i < 90000 && (start->state < DECAFF_START_DONE || fabs(rotor_speed) > 0.0); i++) {
        asked = turns * STEP_START(start, encoder(), bend(), (before - index) * (arm - index) < 0.0);
        max_asked = fmax(max_asked, fabs(asked));
        before = arm;
        mode = MODE_OF(*start);
        run_plant();
        finger = fmin(finger, looked_up(arm, path->angles, path->positions)); /* the link stays where it was pushed */
        finger_speed = 0.0;
        nearest = fmin(nearest, arm);
    }
    asked = 0.0;
    return looked_up(angle, path->angles, path->positions) - looked_up(nearest, path->angles, path->positions);
}

enum fault { NONE, LATE, NO_ENCODER, NO_BEND, MOTOR, STOPPED, CUT, SILENT, FAULTS };

typedef struct press {
    double wall, speed, depth, stiffness, back; /* bend, m/s, m, N/m; s, when it returns */
    double latency;                             /* s, of frames */
    double surface, appears;                    /* N/m, 0: rigid; m beyond the wall, first reported position */
    bool has_sensor, is_slave;
    enum fault fault;
    double at, lasts; /* s */
} press;

static decaff_controller controller;
static decaff_servo servo;
static decaff_start start;
static int64_t now_ns = 1000000000;
static uint64_t sequence;

static void write_frame(proximity_contact *c, const press *p, double at, double pose_speed, int64_t pose_ns, bool is_there)
{
    double distance = looked_up(p->wall, path->bends, path->positions) - at, bent = looked_up(at, path->positions, path->bends);

    memset(c, 0, sizeof *c);
    c->flags = PROXIMITY_FLAG_TRACKED | PROXIMITY_FLAG_ON_PATH;
    c->pose_ns = pose_ns;
    c->signed_distance = c->lower = c->upper = distance;
    c->normal[2] = -1.0;
    c->velocity[2] = pose_speed;
    c->approach_speed = pose_speed;
    c->bend = bent;
    c->bend_rate = pose_speed / 0.2;
    c->contact_bend = is_there && -distance >= p->appears ? p->wall : (double)NAN;
    if (isnan(c->contact_bend))
        c->signed_distance = c->lower = c->upper = 0.02;
    else
        c->flags |= PROXIMITY_FLAG_CONTACT_FOUND;
    c->surface = (uint8_t)(p->surface > 0.0 ? PROXIMITY_SURFACE_DEFORMABLE : PROXIMITY_SURFACE_RIGID);
    c->stiffness = p->surface;
    c->source = (uint8_t)(p->is_slave ? PROXIMITY_SOURCE_TELEOPERATION : PROXIMITY_SOURCE_GEOMETRY);
    c->force = p->is_slave ? fmax(0.0, -200.0 * distance) : 0.0;
    c->force_is_valid = p->is_slave ? 1u : 0u;
    c->mode = PROXIMITY_MODE_POSITION;
}

/* Run one sample of the guide's listing. */
static void sample(decaff_observation *seen, double measured)
{
    static double force;
    decaff_action action;

    seen->sample_ns = seen->now_ns = now_ns;
    seen->motor_force = -force;
    seen->force = measured;
    decaff_controller_step(&controller, seen, &action);
    force = decaff_servo_step(&servo, &action, decaff_drum_position(path, seen->drum_angle), seen->force);
    asked = decaff_motor_torque(path, seen->drum_angle, force);
    mode = action.mode;
}

/* Press from in front of the wall to a depth behind it and return; then the drum has time to retract. */
static void run_press(const press *p)
{
    static double poses[256], speeds[256];
    int samples = (int)((p->back + 0.7) / set->period), late = (int)(p->latency / set->period), hung = 0, i;
    double wall = looked_up(p->wall, path->bends, path->positions), fist = looked_up(1.0, path->bends, path->positions);
    double aim = fmin(wall + p->depth, fist), begin = fmax(0.0, wall - fmin(0.06, 0.6 * p->speed * (p->back - 0.15)));
    proximity_contact contacts[2];
    decaff_observation seen;

    memset(&seen, 0, sizeof seen);
    hand_stiffness = p->stiffness, hand_damping = 0.6 * sqrt(p->stiffness * MASS);
    hand = finger = fmin(begin, looked_up(arm, path->angles, path->positions) - 0.005);
    finger_speed = 0.0;
    is_touching = false;
    for (i = 0; i < 256; i++)
        poses[i] = finger, speeds[i] = 0.0;
    for (i = 0; i < samples; i++) {
        double time = i * set->period;
        bool is_faulty = p->fault != NONE && time >= p->at && time < p->at + p->lasts;

        now_ns += (int64_t)(1e9 * set->period);
        poses[i % 256] = finger, speeds[i % 256] = finger_speed;
        hand_speed = time < 0.15 ? 0.0 : (time < p->back ? p->speed : -p->speed);
        if ((hand >= aim && hand_speed > 0.0) || (hand <= begin && hand_speed < 0.0))
            hand_speed = 0.0;
        if (i % 3 == 0 && !(is_faulty && p->fault == SILENT)) {
            int pose = (i + 256 - late) % 256;

            write_frame(&contacts[0], p, poses[pose], speeds[pose], now_ns - (int64_t)(1e9 * late * set->period),
                        time > COMES && time < p->back + 0.2);
            sequence++;
        }
        seen.state = PROXIMITY_STATE_OK;
        seen.contact = &contacts[0];
        seen.sequence = sequence;
        seen.start_ns = contacts[0].pose_ns;
        seen.session = 1;
        seen.bend = is_faulty && p->fault == NO_BEND ? (double)NAN : bend();
        seen.drum_angle = is_faulty && p->fault == NO_ENCODER ? (double)NAN : encoder() + start.offset;
        seen.has_fault = is_faulty && p->fault == MOTOR;
        if (is_faulty && p->fault == STOPPED)
            decaff_controller_stop(&controller);
        if (is_faulty && p->fault == LATE) { /* the chip hangs and keeps its torque until the watchdog acts */
            hung++;
            if (hung > WATCHDOG_SAMPLES)
                mode = DECAFF_DRIVE_MODE_BRAKED;
        } else {
            sample(&seen, p->has_sensor ? contact : (double)NAN);
        }
        if (p->fault == CUT && time >= p->at)
            mode = DECAFF_DRIVE_MODE_BRAKED; /* the relay shorts the windings */
        run_plant();
    }
}

/* Restart, homed. */
static void home(void)
{
    start_drum(&start, 1.0, NAN, 0.7);
    if (start.state != DECAFF_START_DONE)
        abort();
    decaff_controller_begin(&controller, path);
    decaff_servo_begin(&servo, path, decaff_drum_position(path, start.angle));
}

/* Re-enable the drum after a fault, where a hand left it. */
static void go_on(void)
{
    decaff_controller_reset(&controller);
    decaff_servo_begin(&servo, path, decaff_drum_position(path, encoder() + start.offset));
}

static press any_press(void)
{
    press p = {0};

    p.wall = between(0.15, 0.98);
    p.speed = between(0.0, 1.0) < 0.5 ? between(0.02, 0.3) : between(0.3, 1.2);
    p.depth = between(0.001, 0.012);
    p.stiffness = 300.0 * pow(10.0, between(0.0, 1.0));
    p.back = between(0.3, 0.6);
    p.latency = between(0.0005, 0.012);
    p.surface = between(0.0, 1.0) < 0.4 ? 100.0 * pow(30.0, between(0.0, 1.0)) : 0.0;
    p.appears = between(0.0, 1.0) < 0.25 ? between(0.0, 0.008) : -INFINITY;
    p.has_sensor = between(0.0, 1.0) < 0.5;
    p.is_slave = p.surface == 0.0 && between(0.0, 1.0) < 0.2;
    if (between(0.0, 1.0) < 0.6)
        p.fault = (enum fault)(1 + (int)between(0.0, FAULTS - 1));
    p.at = between(0.0, 1.0) < 0.5 ? COMES + between(0.0, 0.04) : between(COMES, p.back + 0.2); /* often during the approach */
    p.lasts = p.fault == LATE ? between(set->period, 0.015) : between(set->period, 0.2);
    return p;
}

static void forget(void)
{
    worst[0] = worst[1] = 0.0;
    hits = 0;
}

int main(int count, char **words)
{
    press p = {0.9, 0.1, 0.004, 1000.0, 0.4, 0.001, 0.0, -INFINITY, true, false, NONE, 0.0, 0.0};
    double nearer;
    int i, number = count > 3 ? atoi(words[3]) : 0;

    path = &decaff_paths[0];
    set = path->settings;
    seed = 0x9e3779b97f4a7c15u + (count > 2 ? strtoull(words[2], NULL, 10) : 0u);
    for (i = 0; i < 20; i++)
        between(0.0, 1.0);
    if (count > 7 && strcmp(words[1], "start") == 0) { /* turns, counts, angle, index, link, stop */
        turns = atof(words[2]), counts = atof(words[3]);
        stop = atof(words[7]);
        nearer = start_drum(&start, atof(words[4]), atof(words[5]), atof(words[6]));
        printf("%d %.5f %.6f %d %.6f\n", (int)start.state, encoder() + start.offset - rotor, nearer, (int)MODE_OF(start), max_asked);
    } else if (count > 3 && strcmp(words[1], "episodes") == 0) { /* seed, number */
        lists_hits = true;
        for (i = 0; i < number; i++) {
            if (i % 25 == 0)
                home();
            p = any_press();
            run_press(&p);
            go_on();
        }
    } else if (count > 2 && strcmp(words[1], "hazards") == 0) {
        home();
        run_press(&p); /* the first retraction */
        go_on();
        printf("parked %.2f\n", 1e3 * (looked_up(rotor, path->angles, path->positions) - path->positions[path->count - 1]));
        for (i = 0, forget(); i < 12; i++) {
            p.wall = 0.74 + 0.02 * i, p.speed = 0.01;
            run_press(&p);
        }
        printf("approach %.3f\n", 1e3 * worst[0]);
        for (i = 0, forget(), p.fault = LATE; i < 120; i++) { /* every other chip recovers before the fault is detected */
            p.wall = 0.3 + 0.12 * (i % 6), p.at = COMES + 0.003 * (i / 6), p.lasts = i % 2 == 0 ? 0.012 : 0.0085;
            run_press(&p);
            go_on();
        }
        printf("late %.3f\n", 1e3 * fmax(worst[0], worst[1]));
        for (i = 0, forget(), p.fault = MOTOR, p.lasts = 0.2, p.speed = 1.0, p.depth = 0.01; i < 24; i++) {
            p.wall = 0.86 + 0.01 * (i % 12), p.at = COMES + 0.01 * (i / 12);
            run_press(&p);
            go_on();
        }
        printf("sprung %.3f\n", 1e3 * worst[1]);
        p.fault = NONE, p.surface = 2000.0, p.stiffness = 1e5, p.depth = 0.006, p.speed = 0.3, p.back = 2.0;
        for (i = 0, forget(); i < 5; i++) {
            p.wall = 0.3 + 0.1 * i, p.appears = 0.004;
            run_press(&p);
        }
        printf("unyielding %.3f %.1f\n", 1e3 * worst[0], hits / 5.0);
        printf("heat %.3f\n", set->heat_force / (CONTINUOUS * RATIO / 0.1219));
    } else {
        return 2;
    }
    return 0;
}
