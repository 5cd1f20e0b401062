/* The loop of a service as a thread of compiled code: what Python fills in, and what it reads while the loop runs.
   All fields are of eight bytes; addresses are those of NumPy's arrays. `service/loop_memory.py` reads this file. */
#ifndef PROXIMITY_LOOP_H
#define PROXIMITY_LOOP_H

#include <stdint.h>

#define LOOP_BINS 1216
#define LOOP_RUNS 64
#define LOOP_OUTPUTS 8
#define LOOP_HOSTS 4
#define LOOP_DEFECTS 9
#define LOOP_STATES 6


/* What was reported of a part. */
typedef struct LoopMotion {
    int64_t number;  /* of the report; 0: there was none */
    int64_t pose_ns, ends_ns; /* it is believed to go on until then */
    int64_t is_moving, is_hidden;
    double matrix[16], velocity[3], turning[3]; /* world_from_part, m; m/s, of the origin, and rad/s about it */
    double across[9], back[9];      /* what turning adds: by the sine of the angle, and by one less its cosine */
    double turn_rate, top_speed;    /* rad/s; m/s, of any point of it */
} LoopMotion;

/* A sensor that measures distances, in place of a scene. */
typedef struct LoopSensor {
    int64_t motions, error_sums, unknown; /* of each finger: estimates, and the contact of one that is not known */
    int64_t latency_ns;
    double horizon, max_speed, max_acceleration;
} LoopSensor;

/* A scene and its tracker. The loop goes over to another one between two ticks; the one before is Python's again. */
typedef struct LoopSource {
    int64_t sensor;       /* 0: there is a scene */
    int64_t model;        /* words of its arrays, as kernels take them */
    int64_t tracker;      /* likewise, as `TrackerArrays` */
    int64_t bend_motions; /* estimates of the bends, two a finger */
    int64_t epoch;        /* of the scene */
    int64_t is_moved;     /* whether the tracker has not seen where parts stand */
    int64_t answers;      /* bits of the answers of all ticks */
    int64_t scene;        /* a proximity_scene, in which the loop moves parts; 0: they stand */
    int64_t motions, next_motions; /* a LoopMotion a part: in use, and newer ones; 0: there are none */
    int64_t applied;      /* numbers of the reports that parts were put at */
    int64_t rows, matrices, velocities, turnings; /* of parts that are put elsewhere: scratch */
    int64_t has_looked, all_stand; /* whether `motions` were applied; and whether nothing more is reported of any */
    int64_t is_edited, rows_after; /* whether it is the source before with other parts; the rows that those have now */
} LoopSource;

/* Contacts that were made beside the loop; the records are behind it. */
typedef struct LoopContacts {
    int64_t source, epoch; /* the LoopSource that they are of */
    int64_t is_late;
    int64_t spent_ns;      /* that a simulated clock went on while they were made */
} LoopContacts;

typedef struct LoopOutput {
    int64_t socket;  /* that is connected; -1: none */
    int64_t box;     /* a decaff_mailbox that is open for writing; 0: none */
    int64_t key;     /* 32 bytes; 0: no tags */
    int64_t session; /* ns of the calendar */
    int64_t sequences[2]; /* the next numbers of frames and of descriptions */
    int64_t awake_ns; /* of the calendar on the monotonic clock, at the message before */
    int64_t failures; /* frames that were not sent, and why the first was not (errno) */
    int64_t first_failure;
    int64_t lost; /* for which the system had no room */
} LoopOutput;

typedef struct LoopRun {
    int64_t kind;
    uint64_t session, sequence;
} LoopRun;

/* Of one kind of messages: the last one that was used. */
typedef struct LoopSeen {
    int64_t is_any;
    uint64_t session, sequence;
    int64_t sent_ns, taken_ns;
} LoopSeen;

typedef struct LoopInput {
    int64_t is_measured; /* whether messages are of a sensor, not of poses */
    int64_t socket; /* -1: none */
    int64_t timer;  /* by which waiting at the socket ends */
    int64_t box;    /* a decaff_mailbox to read, open or not; 0: none */
    int64_t name;   /* of the mailbox; 0: it is in the memory of this process */
    int64_t hosts[LOOP_HOSTS], host_count, port; /* IPv4, in the order of the network; 0: any port */
    int64_t key;
    int64_t message, longest; /* where a message is read to, and how long it may be */
    int64_t received, lost, sessions, refused, unverified, unserved, failures, first_failure;
    int64_t flawed[LOOP_DEFECTS];
    uint64_t newest_session;
    LoopSeen seen[3];
    LoopRun ended[LOOP_RUNS];
    int64_t ended_count, looked_ns;
} LoopInput;

/* Poses that were recorded, and are played by their times. */
typedef struct LoopRecording {
    int64_t times_ns, positions, rows; /* from 0 on; of all fingers; 0: there is none */
    int64_t latency_ns, round_ns; /* how old a pose is when it comes; from one beginning to the next, 0: there is one */
    int64_t row, start_ns, has_begun, is_over; /* the last row that was played, and the instant of the first */
} LoopRecording;

typedef struct LoopTimes {
    int64_t count, max_ns;
    int64_t bins[LOOP_BINS];
} LoopTimes;

typedef struct Loop {
    int64_t instructions; /* name of the set of instructions */
    int64_t set;          /* that set, once it was looked for: to ask the processor takes long */
    int64_t count;        /* of fingers */
    int64_t period_ns, valid_for_ns, stale_after_ns;
    int64_t is_simulated, simulated_ns; /* a clock that stands, and jumps to the next instant */
    int64_t is_coarse;    /* whether the system's monotonic clock is the coarse one of Windows */
    int64_t is_ahead;     /* whether that clock runs ahead of the one that readers of frames have */
    int64_t counts_processor; /* whether ticks are timed by the processor's time for the thread */
    int64_t is_given;     /* whether contacts are made beside the loop, and come as messages: LoopContacts */
    int64_t is_polled;    /* whether poses that come do not wake it: they are given when a thread asks for them */
    int64_t is_late;      /* whether what contacts are made of is too old already */
    int64_t frame;        /* the message */
    int64_t pose_ns, positions, width, refused_ns, row_of; /* of the newest poses, a row a finger; or distances */
    int64_t measured;     /* newest measurements */
    int64_t velocities, paths, bends, has_velocities, has_paths, has_bends;
    int64_t given_ns, given, fingers, defects; /* of the poses of a message */
    int64_t lost_hand;    /* defect of a pose, as the kernels have it, of a hand that is lost */
    double metres_a_bend; /* by which bends are followed as positions are */
    int64_t next, source; /* the source that is to be used from the next tick on; and the one in use */
    int64_t stop, ticks_wanted; /* -1: no limit */
    int64_t pending, pending_size; /* a message of the description, to be sent behind the next frame */
    int64_t is_begun, due_ns, posed_ns, epoch_offset, epoch;
    int64_t has_started, reported_missed;
    int64_t ticks, missed, states[LOOP_STATES];
    int64_t future, backwards, too_old, lost_hands;
    int64_t first_off_ns[4]; /* of the first ones of these kinds */
    LoopTimes compute, lateness;
    LoopInput input;
    LoopRecording recording;
    LoopOutput outputs[LOOP_OUTPUTS];
    int64_t output_count;
    int64_t log; /* a decaff_mailbox without a file, for frames as the first output has sealed them; 0: none */
    int64_t datagram; /* where tagged messages are put together */
} Loop;

#endif
