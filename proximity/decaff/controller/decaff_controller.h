/*
 * decaff_controller.h: the controller of contact drums in C99, for a simulation, a service, or a microcontroller.
 *
 * Frames are verified and aged, the place of contact is taken with the instant of its pose, and the drum holds or
 * retracts where anything is uncertain. It uses no heap, no files, no threads, no clock, and of <math.h> `sqrt`
 * alone. What is not known is NaN: -ffast-math breaks it. Lengths are in metres, angles in radians, instants in
 * nanoseconds.
 *
 * Signs. Positions lie on the finger's path and grow from the flat hand to the fist. The drum's angle grows with
 * the position at which it meets the finger: greater is away from the finger, in front of it. A force of the motor
 * (decaff_servo_step) is positive away from the finger, and so are decaff_motor_torque() of it and the torque that
 * decaff_start_step() returns: a positive torque must turn the drum to greater angles, which decaff_start_step()
 * tests. What presses finger and drum together (seen.force, seen.motor_force, action.force, action.torque) is
 * positive where it presses.
 *
 * A wire format of doubles and a bound of a nanometre ask for a processor with double precision, such as a
 * Cortex-M7 (-mfpu=fpv5-d16 -mfloat-abi=hard). Step each finger at the rate of its settings, give instants of a
 * monotonic clock of your own, and call all functions of one subscriber from one context.
 *
 *   static decaff_subscriber frames;                       // one for all fingers, of both hands
 *   static decaff_start start;                             // one a finger, as all below
 *   static decaff_controller finger;
 *   static decaff_servo servo;
 *
 *   decaff_subscriber_begin(&frames, false, key);          // the service is another machine's; NULL: no key
 *   decaff_start_begin(&start, &decaff_paths[0], 1.9, false); // rad, of the stop behind the retracted drum; no index
 *   decaff_controller_begin(&finger, &decaff_paths[0]);
 *
 *   decaff_subscriber_take(&frames, datagram, size, clock_ns());     // whenever a datagram has come
 *
 *   if (start.state < DECAFF_START_DONE) {                 // at each sample of the servo, before all else
 *       torque = decaff_start_step(&start, angle_of_encoder(), bend_of_potentiometer(), false);
 *       mode = start.mode;
 *       decaff_servo_begin(&servo, &decaff_paths[0], decaff_drum_position(&decaff_paths[0], start.angle));
 *   } else {
 *       decaff_observation seen;
 *       decaff_subscriber_look(&frames, 0u, clock_ns(), &seen);
 *       seen.bend = bend_of_potentiometer();
 *       seen.drum_angle = angle_of_encoder() + start.offset;
 *       seen.force = NAN;                                  // or measured
 *       seen.motor_force = -force;                         // of the last sample; used where none is measured
 *       seen.has_fault = motor_has_fault() || start.state != DECAFF_START_DONE;
 *       decaff_controller_step(&finger, &seen, &action);
 *       force = decaff_servo_step(&servo, &action, decaff_drum_position(finger.path, seen.drum_angle), seen.force);
 *       torque = decaff_motor_torque(finger.path, seen.drum_angle, force);
 *       mode = action.mode;
 *   }
 *   set_motor_mode(mode);                                  // free, braked, or else driven by the torque
 *   set_motor_torque(torque);
 *   restart_watchdog();                                    // of the hardware: it brakes all motors after 1 ms
 *
 * Without power a motor is braked for as long as it has none, also by watchdog and emergency stop: both low sides of
 * its bridge are on, or a relay shorts its windings. A motor that is cut off coasts, and a gear of 51:1 carries 0.2 J;
 * one that is freed later springs back from its stop. A finger can push a braked drum away, slowly.
 * What a frame has as `mode` is not followed but for PROXIMITY_MODE_HOLD, which says that the finger is not tracked: with
 * PROXIMITY_MODE_RETRACT the drum still goes where the record has the contact.
 */
#ifndef DECAFF_CONTROLLER_H
#define DECAFF_CONTROLLER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "proximity_message.h"

#ifdef __cplusplus
extern "C" {
#endif

/* --- constants --- */

#define DECAFF_LEAST_BEND (-0.1)              /* no hand bends farther than these; assumed */
#define DECAFF_MOST_BEND 1.1
#define DECAFF_MOST_RATE 100.0                /* 1/s: no finger bends faster; assumed */
#define DECAFF_MOST_LENGTH 100.0              /* m: no distance that is measured is greater; assumed */
#define DECAFF_LEAST_CLOSING 1e-3             /* m/s: slower, the finger is not closing; assumed */
#define DECAFF_TABLE_ERROR 1e-5               /* of a bend, that goes to a position and back */
#define DECAFF_MIN_TRAVEL 3e-3                /* m to the contact: nearer, the incidence is uncertain; assumed */
#define DECAFF_LEAST_INCIDENCE 0.3            /* of a part that is followed: flatter, it slides; assumed */
#define DECAFF_FOLLOW_NS INT64_C(50000000)    /* so long a drum still goes where a part that stopped is */
#define DECAFF_GAP_PERIODS 1.5                /* between two samples of the servo: more, and one was left out */
#define DECAFF_BRAKE_FROM 0.2                 /* of the speed cap, in force mode; assumed */
#define DECAFF_BRAKE_DAMPING 2.0              /* of the servo's damping, with which it brakes then; assumed */
#define DECAFF_FADE_FROM 0.6                  /* of the speed cap, from which a drum is pushed less to the finger, */
#define DECAFF_FADE_TO 0.9                    /* and not at all; assumed */
#define DECAFF_FADE_TO_FORCE 0.6              /* the same in force mode, where it begins with the brake; assumed */
#define DECAFF_SLOPE_BEND 1e-3                /* of the path, by which its slope is taken */
#define DECAFF_MOST_FORCE 1000.0              /* N: no sensor of a finger measures more; assumed */
#define DECAFF_COOL_HEAT 0.81                 /* of a motor, from which on it has its force again */
#define DECAFF_LARGEST_POSITION_ERROR 5e-3    /* m: less certain a contact does not come nearer; assumed */
#define DECAFF_DRUM_DAMPING 0.0               /* N s/m, of the drum itself: it has Coulomb friction only */
#define DECAFF_PAD_DAMPING 2.0                /* N s/m, counted on of a fingertip's 6; assumed */
#define DECAFF_DAMPING_SHARE 0.5              /* of that damping, which the surface's may take; assumed */
#define DECAFF_STRAY_ANGLE 3.141592653589793  /* rad beyond the path: a drum is not parked farther off; assumed */
#define DECAFF_START_SHARE 0.1                /* of the motor's torque, at most, before it is homed; assumed */
#define DECAFF_START_RAMP 0.5                 /* s, in which that torque comes */
#define DECAFF_START_TURN 0.012               /* rad of the drum, by which the sign shows; assumed */
#define DECAFF_START_PLAY 0.005               /* rad of the drum, that a hand turns it before the link counts; assumed */
#define DECAFF_START_PUSH 0.1                 /* rad of the drum, by which a hand pushes it with the link; assumed */
#define DECAFF_START_PUSHED 0.02              /* rad of the drum, by which a motor may push the link; assumed */
#define DECAFF_START_SPEED 0.4                /* rad/s of the drum, on its way to the stop; assumed */
#define DECAFF_START_STILL 0.1                /* s without a turn: it is at the stop */
#define DECAFF_START_LONGEST 20.0             /* s, after which nothing is found any more */
#define DECAFF_STANDING 1e-6                  /* m/s: slower, the servo's reference stands */

#ifndef DECAFF_MOST_FINGERS
#define DECAFF_MOST_FINGERS 10u /* of a frame, two hands; one of more is refused */
#endif
#ifndef DECAFF_MOST_STEADY
#define DECAFF_MOST_STEADY 1024u /* samples that a steady force is looked back on: 50 ms at 20 kHz */
#endif

/* The type of all that is computed. */
typedef double decaff_real;

/* State of a drum. */
enum decaff_drum_state {
    DECAFF_DRUM_STATE_RETRACTED = 0,        /* out of the finger's path, or on its path there */
    DECAFF_DRUM_STATE_APPROACH = 1,         /* stands, or goes to, where the finger will touch */
    DECAFF_DRUM_STATE_CONTACT_POSITION = 2, /* the finger touches; the drum stands where the part is */
    DECAFF_DRUM_STATE_CONTACT_FORCE = 3,    /* the finger touches; a force is served */
    DECAFF_DRUM_STATE_HOLD = 4,             /* the finger touches, and what is known is old: nothing advances */
    DECAFF_DRUM_STATE_FREEZE = 5,           /* nothing is known: a moment as it was, then without force */
    DECAFF_DRUM_STATE_FAULT = 6             /* braked until the controller is reset */
};

/* Trust in a finger's newest frames. */
enum decaff_trust {
    DECAFF_TRUST_FRESH = 0, /* sound, tracked, and young enough to be acted upon */
    DECAFF_TRUST_OLD = 1,   /* sound; older than that */
    DECAFF_TRUST_STALE = 2, /* too old, or the service knows nothing */
    DECAFF_TRUST_LOST = 3   /* the finger is not tracked, or there never was a frame */
};

/* What the motor's driver does. Without power a motor brakes itself: one that is free coasts on. */
enum decaff_drive_mode {
    DECAFF_DRIVE_MODE_FREE = 0, /* no power: both low sides are open; only at the start, where a hand turns the drum */
    DECAFF_DRIVE_MODE_POSITION = 1,
    DECAFF_DRIVE_MODE_FORCE = 2,
    DECAFF_DRIVE_MODE_BRAKED = 3 /* no power: both low sides are on, which shorts the windings */
};

/* --- what the drum is set to; `proximity controller` writes it into decaff_glove.c --- */

typedef struct decaff_settings {
    decaff_real period;              /* s between two samples of controller and servo */
    int64_t fresh_ns;                /* age of a pose: younger, all is normal */
    int64_t stale_ns;                /* older, nothing is known */
    int64_t future_ns;               /* farther in the future, the frame is wrong */
    int64_t freeze_ns;               /* in contact, nothing known: so long nothing changes */
    int64_t ramp_ns;                 /* then the force limit goes to nothing */
    int64_t watchdog_ns;             /* between two samples of the servo, at most */
    decaff_real touch_gap;           /* m of finger and drum: nearer is touching */
    decaff_real release_gap;         /* m, farther is released */
    decaff_real touch_force;         /* N */
    decaff_real gone_force;          /* N: with less, a drum that froze retracts */
    decaff_real standoff;            /* m, from a finger that began inside */
    decaff_real max_speed;           /* m/s of whatever moves: a contact that comes nearer faster is a jump */
    decaff_real object_speed;        /* m/s of objects in old frames */
    decaff_real speed_error;         /* of old frames, times the finger's speed */
    decaff_real late_speed;          /* m/s, of a drum that comes late */
    decaff_real late_force;          /* N, likewise */
    decaff_real late_gap;            /* m, that counts as being there */
    decaff_real near_gap;            /* m: nearer, the energy of a bump is limited */
    decaff_real near_motor_speed;    /* rad/s of the motor's shaft, at which rotor and gear have that energy */
    decaff_real continuous_force;    /* N at the fingertip */
    decaff_real peak_force;          /* N at the fingertip */
    decaff_real force_time;          /* s, over which a force is continuous */
    decaff_real heat_force;          /* N of the motor that it holds for ever; a gear that drives passes on its
                                        efficiency's share: that much presses on the finger */
    decaff_real heat_time;           /* s, in which the motor warms up */
    decaff_real follow_speed;        /* m/s: slower, a part that is touched is at rest */
    decaff_real speed_decay;         /* 1/s, of the low-pass of the finger's speed */
    decaff_real braking;             /* m/s2, that the drum is counted on to brake with near the finger */
    decaff_real unbraked_speed;      /* m/s: what it brakes too late, in a sample and the servo's lag */
    decaff_real shorted_rate;        /* 1/s: what the drum loses of its speed a metre, with its windings shorted */
    decaff_real shorted_late;        /* m/s, that it gains before, where its chip hangs */
    decaff_real cable_stiffness;     /* N/m at the fingertip; inf: no stretch is made up for */
    decaff_real cable_decay;         /* 1/s, of two low-passes of the force that stretches it */
    uint32_t steady_samples;         /* that a steady force is looked back on; DECAFF_MOST_STEADY at most */
    decaff_real steady_share;        /* of two low-passes in a row */
    decaff_real steady_ripple;       /* N that it may vary by */
    decaff_real steady_ripple_share; /* of the force, if that is more */
    decaff_real steady_slope_of_window; /* N that it may drift by */
    decaff_real steady_least;        /* N that it must have */
    decaff_real steady_slow_speed;   /* m/s of the finger */
    decaff_real lost_force;          /* N: with less, for a while, the contact of teleoperation is lost */
    decaff_real lost_time;           /* s */
    decaff_real lost_distance;       /* m of the slave from its object: more, and the contact is lost */
    decaff_real servo_stiffness;     /* N/m */
    decaff_real servo_damping;       /* N s/m */
    decaff_real servo_integral;      /* N/(m s) */
    decaff_real servo_integral_limit; /* N: a drum that is held, as at its stop, does not wind it up further */
    decaff_real servo_acceleration;  /* m/s2, of the reference */
    decaff_real servo_speed;         /* m/s, of the reference */
    decaff_real servo_force_gain;    /* 1/s */
    decaff_real servo_force_damping; /* N s/m */
    decaff_real servo_force_slew;    /* N/s, of a handover */
    decaff_real servo_deadband;      /* m */
    decaff_real servo_smoothing_share; /* of the low-pass of what the motor does */
    decaff_real drum_force_limit;    /* N at the fingertip */
    decaff_real drum_ratio;          /* turns of the motor to one of the drum */
    decaff_real drum_efficiency;     /* of the gear that drives */
    decaff_real drum_latency;        /* s, from a torque that is commanded to one that acts */
    decaff_real motor_torque;        /* N m at its shaft, at most */
    decaff_real motor_speed;         /* rad/s at its shaft, at most */
} decaff_settings;

/* The bound of passivity of surfaces is that of one sample of delay, when what the servo computes acts, and of the
 * drum's latency. */

/* Why the motor has no power. */
enum decaff_fault {
    DECAFF_FAULT_NONE = 0,
    DECAFF_FAULT_WATCHDOG, /* the servo was too long from its last sample, or its clock ran back */
    DECAFF_FAULT_NO_BEND,  /* the potentiometer reads no bend */
    DECAFF_FAULT_BEND,     /* the potentiometer reads a bend that no finger has */
    DECAFF_FAULT_NO_ANGLE, /* the encoder reads no drum angle */
    DECAFF_FAULT_ANGLE,    /* the encoder reads a drum angle far off the finger's path */
    DECAFF_FAULT_MOTOR     /* the motor reports a fault */
};

/* What became of a datagram. Up to CONTENT as enum proximity_flaw. */
enum decaff_reason {
    DECAFF_REASON_USED = 0,
    DECAFF_REASON_UNVERIFIED = PROXIMITY_FLAW_CONTENT + 1, /* not verified by the key */
    DECAFF_REASON_OTHER, /* a description: names, of which nothing is needed */
    DECAFF_REASON_COUNT
};

/* --- the finger's path, from decaff_glove.c --- */

/* Bends, positions and drum angles, each rising; between two rows lies a line. */
typedef struct decaff_path {
    size_t count;
    const decaff_real *bends;
    const decaff_real *positions; /* m */
    const decaff_real *angles;    /* rad, of the drum where it meets the finger */
    const decaff_settings *settings;
} decaff_path;

/* Of decaff_glove.c: one for all fingers, or one each. */
extern const decaff_path decaff_paths[];
extern const size_t decaff_path_count;

/* Where the drum meets the finger at an angle, m; beyond the path, as at the stop, with its last slope. */
decaff_real decaff_drum_position(const decaff_path *path, decaff_real angle);

/* --- the subscriber: the newest frame, and how far it can be trusted --- */

typedef struct decaff_subscriber {
    uint32_t counts[DECAFF_REASON_COUNT]; /* of datagrams, by enum decaff_reason */
    proximity_receiver receiver;          /* of the service's runs and its clock; has numbers that were lost */
    proximity_frame_header header;        /* of the newest frame that was used */
    proximity_contact contacts[DECAFF_MOST_FINGERS];

    bool has_key;
    uint8_t key[PROXIMITY_KEY_BYTES];
} decaff_subscriber;

/* What is known at a sample of the servo. The subscriber writes all but the last five. */
typedef struct decaff_observation {
    int64_t sample_ns;             /* of this machine's monotonic clock */
    int64_t now_ns;                /* the same instant on the clock of the frames */
    enum proximity_state state;       /* of the newest frame, at that instant */
    const proximity_contact *contact; /* this finger's; NULL: no frame yet */
    uint64_t session;              /* of its frame */
    uint64_t sequence;
    int64_t start_ns;
    decaff_real bend;              /* of the finger, by the potentiometer; NaN: a fault */
    decaff_real drum_angle;        /* rad, by the encoder; NaN: a fault */
    decaff_real force;             /* N, between finger and drum; NaN: not measured */
    bool has_fault;                /* of motor or current */
    decaff_real motor_force;       /* N, by which the motor presses on the finger; NaN: not known */
} decaff_observation;

/* `shares_clock`: the service runs on this very clock. `key`: PROXIMITY_KEY_BYTES bytes, or NULL. */
void decaff_subscriber_begin(decaff_subscriber *frames, bool shares_clock, const uint8_t *key);

/* Take a datagram that arrived at an instant; why it is not used. It need not be aligned. */
enum decaff_reason decaff_subscriber_take(decaff_subscriber *frames, const void *datagram, size_t size,
                                          int64_t now_ns);

/* Say what is known of a finger at a sample; of the rest of `seen` bend, angle, forces and fault are unknown. */
void decaff_subscriber_look(const decaff_subscriber *frames, size_t finger, int64_t sample_ns,
                            decaff_observation *seen);

/* --- the controller of one finger --- */

/* A position of contact on the finger's path. */
typedef struct decaff_location {
    decaff_real bend;         /* at pose_ns */
    decaff_real rate;         /* 1/s, by which it drifts */
    decaff_real error;        /* by which the bend may be off */
    decaff_real finger_speed; /* m/s, when it was reported */
    decaff_real incidence;    /* cosine between path and normal; NaN: too near to tell */
    decaff_real drift;        /* m/s along the path, with the part's velocity; 0: it rests, or nobody knows */
    int64_t pose_ns;
    int64_t start_ns;         /* of the tick that reported it */
} decaff_location;

/* What a record says of a touch. */
typedef struct decaff_contact_reading {
    bool is_known;
    uint8_t surface;
    uint8_t source;
    decaff_real distance;  /* m */
    decaff_real lower;     /* m */
    decaff_real stiffness; /* N/m */
    decaff_real damping;   /* N s/m */
    decaff_real force;     /* N; NaN: not reported */
} decaff_contact_reading;

/* The frames of one finger, as far as they are believed. */
typedef struct decaff_frame_trust {
    decaff_contact_reading reading; /* by the record that was believed last */
    bool has_location;              /* else nothing will be touched */
    bool has_pending;
    decaff_location location;
    decaff_location pending;        /* to be confirmed by a frame of a second pose */
    bool was_outside;
    bool has_pose;
    int64_t pose_ns;                /* that is believed */
    bool has_frame;
    uint64_t session;               /* of the frame that was looked at last */
    uint64_t sequence;
    int64_t start_ns;
    bool has_newest;
    uint64_t newest_sequence;       /* of this run of the service */
    int64_t newest_pose_ns;
    bool is_distrusted;
    enum decaff_trust distrust;
    uint32_t dropped;               /* records that could not be */
    uint32_t awaited;               /* contacts that came nearer than can be, until confirmed */
} decaff_frame_trust;

/* Watches a force until it is steady. */
typedef struct decaff_steady {
    decaff_real once;  /* N, low-passed once */
    decaff_real twice; /* N, low-passed twice */
    decaff_real window[DECAFF_MOST_STEADY];
    uint32_t count;    /* samples so far, no more than the window has */
    uint32_t next;     /* row of the window that is the oldest */
    uint32_t slow_count;
} decaff_steady;

typedef struct decaff_controller {
    const decaff_path *path;
    enum decaff_drum_state state;
    enum decaff_trust trust;
    enum decaff_fault fault;
    decaff_frame_trust frames;
    bool is_stopped;
    bool is_late;
    bool has_sample;
    int64_t sample_ns;
    bool is_anew;            /* samples were left out before this one */
    decaff_real target;      /* m */
    decaff_real force;       /* N, of the last sample; inf: none was served */
    decaff_real finger;      /* m */
    decaff_real speed;       /* m/s, of the finger */
    decaff_real motor_lever; /* m of fingertip to a radian of the motor, where the drum stands */
    bool serves_force;
    decaff_real weak_for;    /* s */
    decaff_steady steady;
    bool is_releasing;
    int64_t release_ns;      /* since when nothing is known */
    decaff_real share;       /* of the force that is left */
    decaff_real mean_force;  /* N */
    decaff_real heat;        /* of the motor, low-passed square of its force over the one it holds for ever */
    bool is_hot;
    bool is_following;       /* a part that moves while it is touched */
    int64_t moved_ns;        /* when it was seen to move last */
    bool is_budget_spent;
    decaff_real pressing_once;  /* N, that stretches the cable, low-passed once */
    decaff_real pressing_twice; /* N, low-passed twice */
    decaff_real stretch;        /* m, by which the drum is brought nearer */
} decaff_controller;

/* What the drum shall do until the next sample. */
typedef struct decaff_action {
    enum decaff_drum_state state;
    enum decaff_drive_mode mode;
    decaff_real position;        /* m, where the drum shall stand */
    decaff_real angle;           /* rad, of the drum, there */
    decaff_real force;           /* N to press with, in force mode */
    decaff_real speed_cap;       /* m/s at the fingertip */
    decaff_real force_cap;       /* N at the fingertip */
    decaff_real start_force;     /* N that a change to force starts from */
    decaff_real torque;          /* N m at the motor's shaft that presses with that force */
    decaff_real torque_cap;      /* N m at the motor's shaft, at most */
    decaff_real motor_speed_cap; /* rad/s of the motor's shaft, at most */
    decaff_real force_slew;      /* N/s, of the force; 0: the servo's own, inf: at once */
    decaff_real heat;            /* of the motor; from 1 on its force is limited to what it holds for ever */
    bool is_hot;                 /* the force is limited so, until the motor is cooler */
    bool is_anew;                /* samples were left out: the servo knows no speed, and starts its mode anew */
} decaff_action;

void decaff_controller_begin(decaff_controller *finger, const decaff_path *path);

/* Take a sample of a force; whether it is steady now. */
bool decaff_is_steady(decaff_steady *watch, const decaff_settings *set, decaff_real force, decaff_real speed);

/* What is displayed of a surface's stiffness, N/m, and damping, N s/m: as much as is passive. */
void decaff_displayed(const decaff_settings *set, decaff_real stiffness, decaff_real damping, decaff_real *k,
                      decaff_real *b);

/* Start anew after a fault or an emergency stop, retracted, with nothing believed. */
void decaff_controller_reset(decaff_controller *finger);

/* The emergency stop: retract and stay there until the reset. */
void decaff_controller_stop(decaff_controller *finger);

void decaff_controller_step(decaff_controller *finger, const decaff_observation *seen, decaff_action *action);

/* --- the servo of one drum --- */

typedef struct decaff_servo {
    const decaff_settings *settings;
    enum decaff_drive_mode last_mode;
    decaff_real demanded;        /* N, for the next sample */
    decaff_real reference;       /* m */
    decaff_real reference_speed; /* m/s */
    decaff_real integrated;      /* N */
    decaff_real last_position;   /* m */
    decaff_real force_reference; /* N */
    decaff_real smoothed;        /* N, what the motor did of late */
} decaff_servo;

/* A drum at rest where it should be. */
void decaff_servo_begin(decaff_servo *servo, const decaff_path *path, decaff_real position);

/*
 * The motor's force from now on, N at the fingertip, positive away from the finger: what the last sample demanded.
 * `position`: where the drum is by its encoder, m; `force`: between finger and drum, N, used in force mode only.
 */
decaff_real decaff_servo_step(decaff_servo *servo, const decaff_action *action, decaff_real position,
                              decaff_real force);

/*
 * The motor's torque for a force at the fingertip while the drum stands at an angle, rad: N m at its shaft, of the
 * same sign, no more than it may; 0 where angle or force is no number.
 */
decaff_real decaff_motor_torque(const decaff_path *path, decaff_real angle, decaff_real force);

/* The motor's speed for one of the fingertip, m/s, likewise: rad/s at its shaft, no more than it has. */
decaff_real decaff_motor_speed(const decaff_path *path, decaff_real angle, decaff_real speed);

/* --- the start: which way the motor turns, and where the drum is --- */

enum decaff_start_state {
    DECAFF_START_BY_HAND = 0, /* free: push link and drum together by hand, until encoder and potentiometer agree */
    DECAFF_START_SIGN, /* a small torque, that grows, away from the finger: the angle must grow */
    DECAFF_START_HOME, /* slowly away from the finger, until the index or the mechanical stop */
    DECAFF_START_DONE, /* the offset is known; the torque is 0 */
    DECAFF_START_WRONG_SIGN, /* the drum turned, or came, the wrong way: motor, encoder or potentiometer is reversed */
    DECAFF_START_STUCK,   /* it does not turn, or neither index nor stop came within the path's length */
    DECAFF_START_NO_ANGLE /* encoder or potentiometer gives no number */
};

typedef struct decaff_start {
    const decaff_path *path;
    enum decaff_start_state state;
    enum decaff_drive_mode mode; /* of the motor's driver: free, driven by the torque, or braked */
    decaff_real angle;  /* rad, of the drum as far as it is known: when done, that of the controller */
    decaff_real offset; /* rad, to be added to the encoder */
    decaff_real home;   /* rad, of index or stop */
    decaff_real first;  /* rad of the encoder, where it began */
    decaff_real first_link; /* rad of the drum, where it would have met the finger then */
    decaff_real last;   /* rad of the encoder, a sample ago */
    decaff_real speed;  /* rad/s, low-passed */
    decaff_real time;   /* s, in this state */
    decaff_real still;  /* s, that it has not turned */
    bool has_angle;
} decaff_start;

/* `home`: the drum's angle where the index is seen, or at the stop, beyond the one where it is retracted.
 * `has_index`: there is one, so that no hand needs to show which way is which. */
void decaff_start_begin(decaff_start *start, const decaff_path *path, decaff_real home, bool has_index);

/*
 * The motor's torque at a sample, N m at its shaft, positive to greater angles; 0 where it is done or has failed.
 * `encoder`: rad of the drum, from wherever it counts; `bend`: by the potentiometer; `is_at_index`: false where
 * there is none. Keep the finger out of the drum's path, and the link still once the motor turns.
 */
decaff_real decaff_start_step(decaff_start *start, decaff_real encoder, decaff_real bend, bool is_at_index);

#ifdef __cplusplus
}
#endif

#endif
