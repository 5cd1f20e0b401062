/* proximity: a tracker, which computes for every fingertip at every tick: distances with certified bounds,
   velocities, predictions, time and location of contact. See proximity.h for errors, scenes and threads, and
   the generated proximity_message.h for the fields of a contact: it is the record of messages. */
#ifndef PROXIMITY_TRACKER_H
#define PROXIMITY_TRACKER_H

#include "proximity_message.h"
#include "proximity.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct proximity_tracker proximity_tracker;

typedef struct proximity_tracker_settings {
    double radius;           /* m, of the fingertips; 0 is a point */
    double latency;          /* s, from a tick until the controller acts: predictions are for that instant */
    double working_range;    /* m; at a larger distance only bounds are computed */
    double tolerance;        /* relative tolerance of the bounds of a finger; 0: exact */
    double horizon;          /* s: contacts are predicted up to this time ahead */
    double max_speed;        /* m/s; a faster finger is a tracking jump */
    double max_acceleration; /* m/s^2: bounds of predictions hold while no finger exceeds it */
    int64_t budget;          /* largest number of nodes and leaves visited per finger and tick */
} proximity_tracker_settings;

/* The paths of fingertips as fingers bend: polylines, a row of `corner_count` corners of 3 numbers a finger; a
   finger whose first corner is not finite has none. */
typedef struct proximity_paths {
    const double *corners;
    size_t corner_count;       /* 2 to 65536 */
    const double *path_bends;  /* bend at each corner, increasing; NULL: evenly from 0 to 1 */
    const double *bends;       /* bend of each finger at its pose; NULL: that of the nearest point of its path */
} proximity_paths;

/* The default settings of Python's Tracker. May be called at any time. */
PROXIMITY_API proximity_tracker_settings proximity_default_settings(void);

/* Make a tracker of `fingers` fingers; NULL: default settings. It keeps the scene, which is freed when it is
   closed and its last tracker is destroyed. *Reads* the scene. */
PROXIMITY_API int proximity_create_tracker(const proximity_scene *scene, size_t fingers,
                                           const proximity_tracker_settings *settings,
                                           proximity_tracker **tracker, proximity_error *error);

/* Set the radius of one fingertip, m. *Changes* the tracker. */
PROXIMITY_API int proximity_set_radius(proximity_tracker *tracker, size_t finger, double radius,
                                       proximity_error *error);

/* Exclude a part, such as one that the hand holds, from the contacts of a finger (`is_ignored` not 0), or include
   it again, from the next tick on. Other fingers are not affected. The part stays ignored when it is moved, hidden
   or shown, and when its number changes; removing it ends that. *Changes* the tracker, and *reads* the scene. */
PROXIMITY_API int proximity_ignore(proximity_tracker *tracker, size_t finger, int32_t part, int is_ignored,
                                   proximity_error *error);

/* Compute the contacts of all fingers. One thread at a time ticks a tracker; it *reads* the scene, whose
   parts may have moved since the tick before, and *changes* it if poses were posted (proximity_post). A tick
   allocates memory only if parts were hidden or shown since the last one, or paths have another number of
   corners.

   `positions` has 3 numbers a finger, m, in the scene's frame; a finger whose row is not finite is not
   tracked. `pose_ns` has the instant of each, and `now_ns` is that of the tick, on one clock, in nanoseconds,
   within 2^62; seconds are an error. `velocities` (m/s) and `paths` may be NULL: velocities are estimated
   then, and also if they are not finite. `contacts` has a record a finger. No value that a sensor may deliver
   is an error. */
PROXIMITY_API int proximity_tick(proximity_tracker *tracker, const double *positions, const int64_t *pose_ns,
                                 int64_t now_ns, const double *velocities, const proximity_paths *paths,
                                 proximity_contact *contacts, proximity_error *error);

/* Reset all fingers: the next tick is treated as the first. *Changes* the tracker. */
PROXIMITY_API void proximity_reset_tracker(proximity_tracker *tracker);

/* Destroy a tracker. NULL is allowed. */
PROXIMITY_API void proximity_destroy_tracker(proximity_tracker *tracker);

/* --- a part that moves ---------------------------------------------------------------------------------- */

/* The nearest connections of a part, or of several that move together, to the rest of a scene: Python's PartTracker. */
typedef struct proximity_part_tracker proximity_part_tracker;

typedef struct proximity_part_tracker_settings {
    double working_range; /* m; of longer connections only bounds are known */
    double tolerance;     /* share of its distance by which the bounds of a connection may differ; 0: exact */
    double latency;       /* s, from a tick until its answer is used: predictions are for that instant */
    double horizon;       /* s: contacts are predicted up to this time ahead */
    int64_t budget;       /* steps of a tick, at most, and as many for times and each depth; 0: as many as it takes */
} proximity_part_tracker_settings;

enum { PROXIMITY_FLAG_CROSSING = 4096 }; /* of a connection: the surfaces meet, and the parts share volume */

/* One connection; without one, parts and faces are -1, the distance is infinite and points are nan. */
typedef struct proximity_connection {
    uint32_t flags; /* PROXIMITY_FLAG_PREDICTED, EXACT, BOUNDED, SKIPPED, INSIDE, IN_RANGE, PART_CHANGED, CROSSING */
    uint32_t work;  /* steps */
    int32_t part, own_part;
    int32_t face, own_face;
    int64_t pose_ns, age_ns;
    double distance;         /* m: of the shortest connection found */
    double lower, upper;     /* m: the true distance to that part is between; in the first row lower holds for all parts */
    double point_on_own[3];  /* m, scene's frame: the ends */
    double point_on_part[3];
    double normal[3];        /* unit: along it the tracked part moves away; 0 where there is none */
    double approach_speed;   /* m/s; nan where velocities are not known */
    int64_t predicted_ns;    /* when the answer is used; the next three are for that instant */
    double predicted_distance, predicted_lower, predicted_upper;
    double time_to_contact;       /* s from the pose: expected; infinite if none is within the horizon */
    double time_to_contact_lower; /* s from the pose: not touched before; in the first row of all parts */
    double depth, depth_lower;    /* m along the normal until the part is free, at most and at least; 0 unless they overlap */
} proximity_connection;

/* The settings that Python's PartTracker has. May be called at any time. */
PROXIMITY_API proximity_part_tracker_settings proximity_default_part_settings(void);

/* Make a tracker of a part, or of `group` parts that move together, each answer with so many connections, 1 to 16; NULL:
   default settings. It keeps the scene as a tracker of fingers does, and its parts when others are removed. *Asks* the
   scene. */
PROXIMITY_API int proximity_create_part_tracker(proximity_scene *scene, const int32_t *parts, size_t group,
                                                size_t connections, const proximity_part_tracker_settings *settings,
                                                proximity_part_tracker **tracker, proximity_error *error);

/* Move the tracked part and answer its nearest connections, the shortest first, at most one for each other part.
   `matrix` has 16 numbers, the pose of the first part, which the others follow; NULL: the parts are where they are in the
   scene, with the velocities that they have there. `velocity` (m/s, of its origin) and `angular_velocity` (rad/s, about
   it) may be NULL: from the last two poses, if they are within 0.1 s. `pose_ns` is the instant of the pose, `now_ns` that
   of the tick, on one clock. `connections` has a row for each. One thread at a time ticks a tracker; it *changes* the
   scene. Nothing is allocated, but at the first tick, after parts were added, removed, hidden or shown, and where a part
   of the scene moves for the first time. */
PROXIMITY_API int proximity_tick_part(proximity_part_tracker *tracker, const double *matrix, int64_t pose_ns,
                                      int64_t now_ns, const double *velocity, const double *angular_velocity,
                                      proximity_connection *connections, proximity_error *error);

/* Forget everything: the next tick is treated as the first. *Changes* the tracker. */
PROXIMITY_API void proximity_reset_part_tracker(proximity_part_tracker *tracker);

/* NULL is destroyed already. */
PROXIMITY_API void proximity_destroy_part_tracker(proximity_part_tracker *tracker);

#ifdef __cplusplus
}
#endif

#endif
