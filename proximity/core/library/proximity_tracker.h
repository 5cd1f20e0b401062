/* proximity: a tracker, which answers for every fingertip at every tick: distances with certified bounds,
   velocities, predictions, time and location of contact. See proximity.h for errors, scenes and threads, and
   proximity_message.h, which is generated, for what is in a contact: the record that travels is the record here. */
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
    double tolerance;        /* share of its distance by which the bounds of a finger may differ; 0: exact */
    double horizon;          /* s: contacts are predicted up to this time ahead */
    double max_speed;        /* m/s; what seems faster is a jump of the tracking */
    double max_acceleration; /* m/s^2: bounds of predictions hold as long as no finger exceeds it */
    int64_t budget;          /* nodes and leaves visited per finger and tick, at most */
} proximity_tracker_settings;

/* The paths of fingertips as fingers bend: polylines, a row of `corner_count` corners of 3 numbers a finger; a
   finger whose first corner is not finite has none. */
typedef struct proximity_paths {
    const double *corners;
    size_t corner_count;       /* 2 to 65536 */
    const double *path_bends;  /* bend at each corner, increasing; NULL: evenly from 0 to 1 */
    const double *bends;       /* bend of each finger at its pose; NULL: that of the nearest point of its path */
} proximity_paths;

/* The settings that Python's Tracker has. May be called at any time. */
PROXIMITY_API proximity_tracker_settings proximity_default_settings(void);

/* Make a tracker of so many fingers; NULL: default settings. It keeps the scene, which is freed when it is closed
   and its last tracker is destroyed. *Asks* the scene. */
PROXIMITY_API int proximity_create_tracker(const proximity_scene *scene, size_t fingers,
                                           const proximity_tracker_settings *settings,
                                           proximity_tracker **tracker, proximity_error *error);

/* Set the radius of one fingertip, m. *Changes* the tracker. */
PROXIMITY_API int proximity_set_radius(proximity_tracker *tracker, size_t finger, double radius,
                                       proximity_error *error);

/* Have a finger ignore a part (`is_ignored` not 0), such as one that the hand holds, or heed it again, from the next tick
   on. Others see the part as before. It stays ignored when it is moved, hidden or shown, and with a new number where
   parts before it were removed; once it is removed that is forgotten. *Changes* the tracker, and *asks* the scene. */
PROXIMITY_API int proximity_ignore(proximity_tracker *tracker, size_t finger, int32_t part, int is_ignored,
                                   proximity_error *error);

/* Answer for all fingers. One thread at a time ticks a tracker; it *asks* the scene, whose parts may have moved
   since the tick before, and *changes* it if poses were posted (proximity_post). Nothing is allocated, but at the first tick after parts were hidden or shown and where
   paths have another number of corners.

   `positions` has 3 numbers a finger, m, in the scene's frame; a finger whose row is not finite is not tracked.
   `pose_ns` has the instant of each, and `now_ns` is that of the tick, on one clock, in nanoseconds, within 2^62; seconds are refused.
   `velocities` (m/s) and `paths` may be NULL: velocities are estimated then, and also where they are not finite.
   `contacts` has a record a finger. No value that a sensor may deliver is an error. */
PROXIMITY_API int proximity_tick(proximity_tracker *tracker, const double *positions, const int64_t *pose_ns,
                                 int64_t now_ns, const double *velocities, const proximity_paths *paths,
                                 proximity_contact *contacts, proximity_error *error);

/* Forget all fingers: the next tick is treated as the first. *Changes* the tracker. */
PROXIMITY_API void proximity_reset_tracker(proximity_tracker *tracker);

/* NULL is destroyed already. */
PROXIMITY_API void proximity_destroy_tracker(proximity_tracker *tracker);

#ifdef __cplusplus
}
#endif

#endif
