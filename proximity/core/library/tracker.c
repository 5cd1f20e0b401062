/* Trackers: the arrays of a tick, kept between ticks. A kernel computes the tick. */
#include "proximity_tracker.h"
#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WORD(address) ((int64_t)(intptr_t)(address))

_Static_assert(sizeof(proximity_contact) == CONTACT_SIZE, "a contact is the record that kernels fill");

enum { MAX_CORNERS = 1 << 16 }; /* of a path */

struct proximity_tracker {
    const proximity_scene *scene;
    size_t count;
    int64_t table[AT_END]; /* address and length of each array, as in `track.TrackerArrays` */
    Settings settings;
    Track *tracks;
    Estimate *motions;
    double *balls, *no_velocities, *bends, *of_parts, *of_corners;
    float *frontiers, *workspace;
    int64_t corners;          /* capacity of the paths */
    int64_t changes, epoch;   /* of the scene at the last tick; -1 before it */
    int64_t last_now_ns;      /* of the last tick */
    int64_t noted;            /* bits of answers of ticks */
    int64_t *identities;      /* of the scene's parts at the last tick */
    int64_t part_count;
    uint8_t *ignored;         /* for each finger, 1 for each part that it ignores; NULL if none ever did */
    Part *heeded;             /* rows of parts, with those that a finger ignores hidden */
    size_t ignored_count;
};

static void set_array(proximity_tracker *tracker, int at, const void *array, int64_t rows)
{
    tracker->table[at] = WORD(array);
    tracker->table[at + 1] = rows;
}

proximity_tracker_settings proximity_default_settings(void)
{
    proximity_tracker_settings settings = {DEFAULT_RADIUS,  DEFAULT_LATENCY,       DEFAULT_WORKING_RANGE,
                                           DEFAULT_TOLERANCE, DEFAULT_HORIZON,     DEFAULT_MAX_SPEED,
                                           DEFAULT_MAX_ACCELERATION, DEFAULT_BUDGET};
    return settings;
}

/* The message of the first invalid setting; NULL if all are valid. */
static const char *unfit_setting(const proximity_tracker_settings *settings)
{
    if (!(settings->radius >= 0.0 && settings->radius <= MAX_RADIUS)) {
        return "radius is not 0 to 0.1 m: was it meant in millimetres?";
    }
    if (!(settings->latency >= 0.0 && settings->latency <= LONGEST_LATENCY)) {
        return "latency is not 0 to 1 s";
    }
    if (!(settings->working_range >= 0.0 && settings->working_range <= MAX_WORKING_RANGE)) {
        return "working_range is not 0 to 10 m: was it meant in millimetres?";
    }
    if (!(settings->tolerance >= 0.0 && settings->tolerance < INFINITY)) {
        return "tolerance is not a share of 0 or more";
    }
    if (!(settings->horizon > 0.0 && settings->horizon < INFINITY)) {
        return "horizon is not a positive number of seconds";
    }
    if (!(settings->max_speed > 0.0 && settings->max_speed < INFINITY) ||
        !(settings->max_acceleration > 0.0 && settings->max_acceleration < INFINITY)) {
        return "max_speed or max_acceleration is not a positive number";
    }
    return settings->budget > 0 ? NULL : "budget is not a positive number of nodes and leaves";
}

static void write_settings(proximity_tracker *tracker, const proximity_tracker_settings *from)
{
    Settings *to = &tracker->settings;
    to->working_range = from->working_range;
    to->latency = from->latency;
    to->tolerance = from->tolerance;
    to->horizon = from->horizon;
    to->max_speed = from->max_speed;
    to->max_acceleration = from->max_acceleration;
    to->budget = (double)(from->budget < MAX_BUDGET ? from->budget : MAX_BUDGET);
    to->ahead_ns = AHEAD_NS;
    to->other_clock_ns = OTHER_CLOCK_NS;
    for (size_t k = 0; k < tracker->count; k++) {
        tracker->tracks[k].radius = from->radius;
    }
}

static int has_arrays(proximity_tracker *tracker, size_t count)
{
    tracker->tracks = calloc(count, sizeof *tracker->tracks);
    tracker->motions = calloc(count * ESTIMATES, sizeof *tracker->motions);
    tracker->balls = calloc(count * BALLS_SIZE, sizeof(double));
    tracker->no_velocities = calloc(3 * count, sizeof(double));
    tracker->bends = calloc(count, sizeof(double));
    tracker->frontiers = calloc((count <= CROWD ? count : 0) * FRONTIER_SIZE + 1, sizeof(float));
    tracker->workspace = calloc(WORKSPACE_SIZE, sizeof(float));
    return tracker->tracks && tracker->motions && tracker->balls && tracker->no_velocities && tracker->bends &&
           tracker->frontiers && tracker->workspace;
}

int proximity_create_tracker(const proximity_scene *scene, size_t fingers, const proximity_tracker_settings *settings,
                             proximity_tracker **made, proximity_error *error)
{
    proximity_tracker_settings chosen = settings != NULL ? *settings : proximity_default_settings();
    const char *unfit = scene == NULL || made == NULL || fingers == 0 || fingers > 1u << 24
                            ? "there is no scene, no place for the tracker, or no finger"
                            : unfit_setting(&chosen);
    if (unfit != NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "%s", unfit);
    }
    proximity_tracker *tracker = calloc(1, sizeof *tracker);
    if (tracker == NULL || !has_arrays(tracker, fingers)) {
        proximity_destroy_tracker(tracker);
        return proximity_no_memory(error, "for the tracker");
    }
    int64_t count = (int64_t)fingers;
    proximity_keep(scene);
    tracker->scene = scene;
    tracker->count = fingers;
    tracker->changes = tracker->epoch = -1;
    for (size_t k = 0; k < fingers; k++) {
        tracker->bends[k] = NAN;
    }
    write_settings(tracker, &chosen);
    set_array(tracker, AT_SETTINGS, &tracker->settings, 1);
    set_array(tracker, AT_MOTIONS, tracker->motions, count);
    set_array(tracker, AT_TRACKS, tracker->tracks, count);
    set_array(tracker, AT_BALLS, tracker->balls, count);
    set_array(tracker, AT_FRONTIERS, tracker->frontiers, count <= CROWD ? count : 0);
    set_array(tracker, AT_UNKNOWN, proximity_unknown_contact, 1);
    set_array(tracker, AT_WORKSPACE, tracker->workspace, WORKSPACE_SIZE);
    tracker->table[AT_VELOCITIES + 2] = tracker->table[AT_PATHS + 3] = 3;
    tracker->table[AT_MOTIONS + 2] = ESTIMATES;
    tracker->table[AT_BALLS + 2] = BALLS_SIZE;
    tracker->table[AT_FRONTIERS + 2] = FRONTIER_SIZE;
    tracker->table[AT_BEFORE + 2] = POSE_COLUMNS;
    proximity_reset_tracker(tracker);
    *made = tracker;
    return PROXIMITY_OK;
}

void proximity_destroy_tracker(proximity_tracker *tracker)
{
    if (tracker != NULL) {
        proximity_release(tracker->scene);
        free(tracker->tracks);
        free(tracker->motions);
        free(tracker->balls);
        free(tracker->no_velocities);
        free(tracker->bends);
        free(tracker->frontiers);
        free(tracker->workspace);
        free(tracker->of_parts);
        free(tracker->identities);
        free(tracker->of_corners);
        free(tracker->ignored);
        free(tracker->heeded);
        free(tracker);
    }
}

void proximity_reset_tracker(proximity_tracker *tracker)
{
    if (tracker == NULL) {
        return;
    }
    memset(tracker->motions, 0, tracker->count * ESTIMATES * sizeof *tracker->motions);
    for (size_t k = 0; k < tracker->count; k++) {
        tracker->tracks[k].reported_part = PROXIMITY_NO_PART;
    }
    tracker->settings.first_finger = tracker->settings.adaptive_tolerance = 0.0;
    tracker->last_now_ns = -MAX_NS;
    int64_t words[] = {WORD(tracker->tracks), (int64_t)tracker->count, WORD(tracker->balls), (int64_t)tracker->count,
                       BALLS_SIZE};
    proximity_call(tracker->scene->set, FORGET_SURFACES, words); /* allocates no memory */
}

int proximity_set_radius(proximity_tracker *tracker, size_t finger, double radius, proximity_error *error)
{
    if (tracker == NULL || finger >= tracker->count || !(radius >= 0.0 && radius <= MAX_RADIUS)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there is no such tracker or finger, or radius is not 0 to 0.1 m");
    }
    tracker->tracks[finger].radius = radius;
    return PROXIMITY_OK;
}

/* Update the part numbers in the last answers. */
static void renumber_parts(proximity_tracker *tracker, const int64_t *identities, int64_t part_count)
{
    for (size_t k = 0; k < tracker->count; k++) {
        int64_t before = tracker->tracks[k].reported_part, now = 0;
        if (before >= 0) {
            while (now < part_count && identities[now] != tracker->identities[before]) {
                now++;
            }
            tracker->tracks[k].reported_part = now < part_count ? now : PART_GONE;
        }
    }
}

/* Allocate the rows of ignored parts for a new number of parts, and copy those of remaining parts; return whether
   there is memory. */
static int renumber_ignored(proximity_tracker *tracker, const int64_t *identities, int64_t part_count)
{
    uint8_t *ignored = calloc(tracker->count, (size_t)part_count);
    Part *heeded = malloc(((size_t)part_count + 1) * sizeof *heeded);
    if (ignored == NULL || heeded == NULL) {
        free(ignored);
        free(heeded);
        return 0;
    }
    size_t left = 0;
    for (int64_t before = 0; tracker->ignored != NULL && before < tracker->part_count; before++) {
        for (int64_t now = 0; now < part_count; now++) {
            for (size_t k = 0; k < tracker->count && identities[now] == tracker->identities[before]; k++) {
                uint8_t is_ignored = tracker->ignored[k * (size_t)tracker->part_count + (size_t)before];
                ignored[k * (size_t)part_count + (size_t)now] = is_ignored;
                left += is_ignored;
            }
        }
    }
    free(tracker->ignored);
    free(tracker->heeded);
    tracker->ignored = ignored;
    tracker->heeded = heeded;
    tracker->ignored_count = left;
    return 1;
}

/* Pass the rows of ignored parts to ticks, if there are any. */
static void set_ignored(proximity_tracker *tracker)
{
    int is_any = tracker->ignored_count > 0;
    set_array(tracker, AT_IGNORED, tracker->ignored, (int64_t)tracker->count);
    tracker->table[AT_IGNORED + 2] = is_any ? tracker->part_count : 0;
    set_array(tracker, AT_HEEDED, tracker->heeded, is_any ? tracker->part_count + 1 : 0);
}

/* Update poses, part numbers of the last answers and ignored parts from the scene; return whether there is memory. */
static int read_parts(proximity_tracker *tracker)
{
    const Archive *archive = &tracker->scene->archive;
    int64_t poses = archive->part_count * POSE_COLUMNS;
    int64_t movers = archive->part_count / LANES + 2;
    size_t kept = (size_t)archive->part_count * sizeof(int64_t);
    if (tracker->part_count != archive->part_count || memcmp(tracker->identities, tracker->scene->identities, kept) != 0) {
        double *of_parts = calloc(1, (size_t)poses * sizeof(double) + (size_t)movers * sizeof(EightMovers));
        int64_t *identities = malloc(kept);
        if (identities != NULL) {
            memcpy(identities, tracker->scene->identities, kept);
        }
        if (of_parts == NULL || identities == NULL ||
            (tracker->ignored != NULL && !renumber_ignored(tracker, identities, archive->part_count))) {
            free(of_parts);
            free(identities);
            return 0;
        }
        renumber_parts(tracker, identities, archive->part_count);
        free(tracker->of_parts);
        free(tracker->identities);
        tracker->of_parts = of_parts;
        tracker->identities = identities;
        tracker->part_count = archive->part_count;
    }
    set_array(tracker, AT_BEFORE, tracker->of_parts, archive->part_count);
    set_array(tracker, AT_MOVERS, tracker->of_parts + poses, movers);
    set_ignored(tracker);
    return 1;
}

/* Adopt other parts: some were added, removed, hidden or shown, or this is the first tick. */
static int adopt_parts(proximity_tracker *tracker)
{
    if (!read_parts(tracker)) {
        return 0;
    }
    int64_t words[] = {WORD(tracker->scene->model), WORD(tracker->table)};
    return proximity_call(tracker->scene->set, ADOPT_PARTS, words);
}

int proximity_ignore(proximity_tracker *tracker, size_t finger, int32_t part, int is_ignored, proximity_error *error)
{
    if (tracker == NULL || finger >= tracker->count) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there is no such tracker or finger");
    }
    if (part < 0 || part >= tracker->scene->archive.part_count) {
        return proximity_no_such_part(tracker->scene, part, error);
    }
    if ((tracker->epoch != tracker->scene->epoch && !read_parts(tracker)) ||
        (tracker->ignored == NULL && !renumber_ignored(tracker, tracker->identities, tracker->part_count))) {
        return proximity_no_memory(error, "for the tracker");
    }
    uint8_t *place = &tracker->ignored[finger * (size_t)tracker->part_count + (size_t)part];
    if (*place != (is_ignored != 0)) {
        *place = is_ignored != 0;
        tracker->ignored_count = *place ? tracker->ignored_count + 1 : tracker->ignored_count - 1;
        set_ignored(tracker);
        int64_t words[] = {WORD(tracker->tracks + finger), 1, WORD(tracker->balls + finger * BALLS_SIZE), 1, BALLS_SIZE};
        proximity_call(tracker->scene->set, FORGET_SURFACES, words); /* which needs no memory */
    }
    return PROXIMITY_OK;
}

/* Set the velocities and paths that ticks read; return whether there is memory for the corners. */
static int read_from(proximity_tracker *tracker, const double *velocities, const proximity_paths *paths)
{
    static const double nowhere[6] = {NAN, NAN, NAN, NAN, NAN, NAN}, ends[2] = {0.0, 1.0};
    int64_t count = (int64_t)tracker->count, corners = paths != NULL ? (int64_t)paths->corner_count : 2;
    tracker->settings.has_velocities = velocities != NULL;
    tracker->settings.has_paths = paths != NULL;
    set_array(tracker, AT_VELOCITIES, velocities != NULL ? velocities : tracker->no_velocities, count);
    if (tracker->corners < corners) {
        double *space = realloc(tracker->of_corners, 2 * (size_t)corners * sizeof(double));
        if (space == NULL) {
            return 0;
        }
        tracker->of_corners = space;
        tracker->corners = corners;
    }
    double *bends = tracker->of_corners + corners;
    for (int64_t k = 0; k < corners; k++) {
        bends[k] = k == corners - 1 ? 1.0 : (double)k * (1.0 / (double)(corners - 1));
    }
    set_array(tracker, AT_PATHS, paths != NULL ? paths->corners : nowhere, paths != NULL ? count : 1);
    tracker->table[AT_PATHS + 2] = corners;
    set_array(tracker, AT_PATH_BENDS, paths == NULL ? ends : paths->path_bends != NULL ? paths->path_bends : bends, corners);
    set_array(tracker, AT_BENDS, paths != NULL && paths->bends != NULL ? paths->bends : tracker->bends, count);
    set_array(tracker, AT_PATH_LENGTHS, tracker->of_corners, corners);
    return 1;
}

/* The message of the first invalid argument of a tick; NULL if all are valid. */
static const char *unfit_tick(const proximity_tracker *tracker, const int64_t *pose_ns, int64_t now_ns,
                              const proximity_paths *paths)
{
    int is_apart = !(now_ns >= -MAX_NS && now_ns <= MAX_NS);
    for (size_t k = 0; k < tracker->count; k++) {
        is_apart = is_apart || !(pose_ns[k] >= -MAX_NS && pose_ns[k] <= MAX_NS);
    }
    if (is_apart) {
        return "an instant is beyond 2^62 ns";
    }
    if (paths != NULL && (paths->corners == NULL || paths->corner_count < 2)) {
        return "paths have less than two corners";
    }
    if (paths != NULL && paths->corner_count > MAX_CORNERS) {
        return "paths have more than 2^16 corners";
    }
    for (size_t k = 0; paths != NULL && paths->path_bends != NULL && k < paths->corner_count; k++) {
        double bend = paths->path_bends[k];
        if (!(fabs(bend) < INFINITY) || (k > 0 && !(bend > paths->path_bends[k - 1]))) {
            return "path_bends do not increase, or are not finite";
        }
    }
    return NULL;
}

/* The name of an instant, of the poses or of the tick, that is probably in seconds; NULL if none is. As in Python. */
static const int64_t *instant_in_seconds(const proximity_tracker *tracker, const int64_t *pose_ns, const int64_t *now_ns)
{
    int64_t off_ns = proximity_time_between(*pose_ns, *now_ns), newest_ns = INT64_MIN;
    int64_t since_ns = proximity_time_between(tracker->last_now_ns, *now_ns);
    int is_apart = off_ns > OTHER_CLOCK_NS || off_ns < -OTHER_CLOCK_NS;
    int is_too_soon = since_ns > 0 && since_ns < SHORTEST_NS && *now_ns > 0 && *now_ns < MAX_SECONDS;
    if ((*now_ns > 0 && *now_ns < (is_apart ? EARLY_NS : SHORTEST_NS)) || is_too_soon) {
        return now_ns;
    }
    for (size_t k = 0; k < tracker->count; k++) {
        newest_ns = pose_ns[k] > newest_ns ? pose_ns[k] : newest_ns;
    }
    return is_apart && *pose_ns > 0 && newest_ns < EARLY_NS ? pose_ns : NULL;
}

int proximity_tick(proximity_tracker *tracker, const double *positions, const int64_t *pose_ns, int64_t now_ns,
                   const double *velocities, const proximity_paths *paths, proximity_contact *contacts,
                   proximity_error *error)
{
    if (tracker == NULL || positions == NULL || pose_ns == NULL || contacts == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "there is no tracker, no positions or instants, or no place for contacts");
    }
    const proximity_scene *scene = tracker->scene;
    const char *unfit = scene->is_broken ? "a change of the scene failed half way; close it"
                                         : unfit_tick(tracker, pose_ns, now_ns, paths);
    if (unfit != NULL) {
        return proximity_refuse(error, scene->is_broken ? PROXIMITY_BROKEN : PROXIMITY_BAD_ARGUMENT, "%s", unfit);
    }
    const int64_t *seconds = instant_in_seconds(tracker, pose_ns, &now_ns);
    if (seconds != NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "%s is %lld, expected nanoseconds of a monotonic clock: it looks like seconds",
                                seconds == pose_ns ? "pose_ns" : "now_ns", (long long)*seconds);
    }
    int64_t instant_ns = proximity_newest_instant(positions, pose_ns, (int64_t)tracker->count, now_ns);
    int code = proximity_take((proximity_scene *)(uintptr_t)scene, instant_ns, error);
    if (code != PROXIMITY_OK) {
        return code;
    }
    int is_moved = tracker->changes != scene->changes;
    set_array(tracker, AT_RECORDS, contacts, (int64_t)tracker->count);
    if (!read_from(tracker, velocities, paths) || (tracker->epoch != scene->epoch && !adopt_parts(tracker))) {
        return proximity_no_memory(error, "for the tracker");
    }
    int64_t words[] = {WORD(scene->model), WORD(tracker->table), WORD(positions), (int64_t)tracker->count, 3,
                       WORD(pose_ns), (int64_t)tracker->count, now_ns, is_moved, 0};
    if (!proximity_call(scene->set, TICK, words)) {
        return proximity_no_memory(error, "for the tracker");
    }
    tracker->changes = scene->changes;
    tracker->epoch = scene->epoch;
    tracker->last_now_ns = now_ns;
    proximity_note_tick(scene, &tracker->noted, words[9], contacts, tracker->count);
    return PROXIMITY_OK;
}
