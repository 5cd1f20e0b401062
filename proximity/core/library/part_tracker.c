/* Trackers of moving parts: the arrays of a tick, kept between ticks. A kernel computes the tick. */
#include "proximity_tracker.h"
#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WORD(address) ((int64_t)(intptr_t)(address))

_Static_assert(sizeof(proximity_connection) == sizeof(Connection), "a connection is the record that kernels fill");

struct proximity_part_tracker {
    proximity_scene *scene;
    int64_t group, records, epoch, changes; /* the last two: of the scene at the last tick; -1 before it */
    int64_t held[HELD_END], motion[GROUP_END]; /* address and lengths of each array, as kernels take them */
    HeldSettings settings;
    Connection *connections;
    int64_t *identities, *own; /* of the tracked parts, and their rows */
    int32_t *parts;            /* the rows again */
    double last_pose[16], given[6], *matrices, *offsets, *velocities, *turnings;
    HeldPair *of_scene; /* the pairs; behind them other arrays for parts and faces */
};

proximity_part_tracker_settings proximity_default_part_settings(void)
{
    proximity_part_tracker_settings settings = {INFINITY, 0.0, DEFAULT_LATENCY, PART_HORIZON, 0};
    return settings;
}

static void set_array(int64_t *table, int at, const void *array, int64_t rows, int64_t columns, int64_t last)
{
    const int64_t words[] = {WORD(array), rows, columns, last};
    memcpy(table + at, words, (size_t)(2 + (columns > 0) + (last > 0)) * sizeof *words);
}

/* Return the message of the first invalid argument, or NULL. */
static const char *unfit_argument(const proximity_scene *scene, const int32_t *parts, size_t group, size_t connections,
                                  const proximity_part_tracker_settings *settings)
{
    int has_parts = parts != NULL && group > 0 && group <= (size_t)scene->archive.part_count;
    for (size_t k = 0; has_parts && k < group; k++) {
        has_parts = parts[k] >= 0 && parts[k] < scene->archive.part_count;
        for (size_t other = 0; has_parts && other < k; other++) {
            has_parts = parts[other] != parts[k];
        }
    }
    if (!has_parts) {
        return "parts are not one number of the scene's parts, or several that differ";
    }
    if (connections == 0 || connections > MAX_RECORDS) {
        return "connections are not 1 to 16";
    }
    if (!(settings->working_range > 0.0 && settings->tolerance >= 0.0 && settings->tolerance < INFINITY)) {
        return "working_range is not above 0 m, or tolerance is not a share of 0 or more";
    }
    if (!(settings->latency >= 0.0 && settings->latency <= LONGEST_LATENCY)) {
        return "latency is not 0 to 1 s";
    }
    if (!(settings->horizon > 0.0 && settings->horizon < INFINITY)) {
        return "horizon is not a positive number of seconds";
    }
    return settings->budget >= 0 ? NULL : "budget is not a number of steps, or 0";
}

int proximity_create_part_tracker(proximity_scene *scene, const int32_t *parts, size_t group, size_t connections,
                                  const proximity_part_tracker_settings *settings, proximity_part_tracker **made,
                                  proximity_error *error)
{
    proximity_part_tracker_settings chosen = settings != NULL ? *settings : proximity_default_part_settings();
    int unusable = proximity_refuse_scene(scene, error);
    const char *unfit = unusable ? NULL : unfit_argument(scene, parts, group, connections, &chosen);
    if (unusable || unfit != NULL || made == NULL) {
        return unusable ? unusable
                        : proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "%s",
                                           unfit != NULL ? unfit : "there is no place for the tracker");
    }
    size_t of_frontiers = (1 + SIDE) * FRONTIER_ENTRIES + 3 * FRONTIER_ENTRIES / 2, reals = 38 * group + of_frontiers;
    proximity_part_tracker *tracker = calloc(1, sizeof *tracker + connections * sizeof(Connection) +
                                                    2 * group * sizeof(int64_t) + reals * sizeof(double) +
                                                    group * sizeof(int32_t));
    if (tracker == NULL) {
        return proximity_no_memory(error, "for the tracker");
    }
    proximity_keep(scene);
    tracker->scene = scene;
    tracker->group = (int64_t)group;
    tracker->records = (int64_t)connections;
    tracker->settings = (HeldSettings){.working_range = chosen.working_range,
                                       .tolerance = chosen.tolerance,
                                       .latency = chosen.latency,
                                       .horizon = chosen.horizon,
                                       .budget = chosen.budget};
    tracker->connections = (Connection *)(tracker + 1);
    tracker->identities = (int64_t *)(tracker->connections + connections);
    tracker->own = tracker->identities + group;
    double *limits = (double *)(tracker->own + group), *sides = limits + FRONTIER_ENTRIES;
    tracker->matrices = limits + of_frontiers;
    tracker->offsets = tracker->matrices + 16 * group;
    tracker->velocities = tracker->offsets + 16 * group;
    tracker->turnings = tracker->velocities + 3 * group;
    tracker->parts = (int32_t *)(tracker->turnings + 3 * group);
    for (size_t k = 0; k < group; k++) {
        tracker->own[k] = parts[k];
        tracker->identities[k] = scene->identities[parts[k]];
    }
    int64_t n = tracker->group;
    set_array(tracker->held, HELD_SETTINGS, &tracker->settings, 1, 0, 0);
    set_array(tracker->held, HELD_RECORDS, tracker->connections, tracker->records, 0, 0);
    set_array(tracker->held, HELD_LIMITS, limits, FRONTIER_ENTRIES, 0, 0);
    set_array(tracker->held, HELD_SIDES, sides, SIDE * FRONTIER_ENTRIES, 0, 0);
    set_array(tracker->held, HELD_ENTRIES, sides + SIDE * FRONTIER_ENTRIES, FRONTIER_ENTRIES, 3, 0);
    set_array(tracker->held, HELD_OWN, tracker->own, n, 0, 0);
    set_array(tracker->motion, GROUP_SETTINGS, &tracker->settings, 1, 0, 0);
    set_array(tracker->motion, GROUP_OFFSETS, tracker->offsets, n, 4, 4);
    set_array(tracker->motion, GROUP_LAST_POSE, tracker->last_pose, 4, 4, 0);
    set_array(tracker->motion, GROUP_GIVEN, tracker->given, 2, 3, 0);
    set_array(tracker->motion, GROUP_MATRICES, tracker->matrices, n, 4, 4);
    set_array(tracker->motion, GROUP_VELOCITIES, tracker->velocities, n, 3, 0);
    set_array(tracker->motion, GROUP_ANGULAR_VELOCITIES, tracker->turnings, n, 3, 0);
    int64_t words[] = {scene->model[4], scene->model[5], WORD(tracker->own), n, WORD(tracker->offsets), n, 4, 4};
    proximity_call(scene->set, RELATE_GROUP, words); /* allocates no memory */
    proximity_reset_part_tracker(tracker);
    *made = tracker;
    return PROXIMITY_OK;
}

void proximity_destroy_part_tracker(proximity_part_tracker *tracker)
{
    if (tracker != NULL) {
        proximity_release(tracker->scene);
        free(tracker->of_scene);
        free(tracker);
    }
}

void proximity_reset_part_tracker(proximity_part_tracker *tracker)
{
    if (tracker != NULL) {
        tracker->epoch = tracker->changes = -1;
        tracker->settings.has_last = 0;
        for (int64_t k = 0; k < tracker->records; k++) {
            tracker->connections[k].part = PROXIMITY_NO_PART;
        }
    }
}

/* Find the rows of the tracked parts; return whether all are in the scene. */
static int find_rows(proximity_part_tracker *tracker)
{
    const proximity_scene *scene = tracker->scene;
    for (int64_t k = 0; k < tracker->group; k++) {
        int64_t row = 0;
        while (row < scene->archive.part_count && scene->identities[row] != tracker->identities[k]) {
            row++;
        }
        if (row == scene->archive.part_count) {
            return 0;
        }
        tracker->own[k] = row;
        tracker->parts[k] = (int32_t)row;
    }
    return 1;
}

/* Adopt other parts: some were added, removed, hidden or shown, or this is the first tick. */
static int adopt_parts(proximity_part_tracker *tracker)
{
    const Archive *archive = &tracker->scene->archive;
    int64_t count = archive->part_count, rest = 0, faces = 0;
    for (int64_t part = 0; part < count; part++) {
        rest += !archive->parts[part].is_hidden;
        faces += 2 * archive->parts[part].face_count;
    }
    for (int64_t k = 0; k < tracker->group; k++) {
        rest -= !archive->parts[tracker->own[k]].is_hidden;
    }
    int64_t pairs = rest * tracker->group, numbers = 12 * count + count + 2 * (count + 1);
    HeldPair *of_scene = calloc(1, (size_t)pairs * sizeof(HeldPair) + (size_t)numbers * sizeof(double) +
                                       (size_t)faces * sizeof(int32_t));
    if (of_scene == NULL) {
        return 0;
    }
    free(tracker->of_scene);
    tracker->of_scene = of_scene;
    double *before = (double *)(of_scene + pairs), *places = before + 13 * count;
    set_array(tracker->held, HELD_PAIRS, of_scene, pairs, 0, 0);
    set_array(tracker->held, HELD_BEFORE, before, count, 12, 0);
    set_array(tracker->held, HELD_MOVED, before + 12 * count, count, 0, 0);
    set_array(tracker->held, HELD_RANGES, places, count + 1, 2, 0);
    set_array(tracker->held, HELD_FACES, places + 2 * (count + 1), faces, 0, 0);
    int64_t words[] = {WORD(tracker->scene->model), WORD(tracker->held)};
    return proximity_call(tracker->scene->set, ADOPT_ROWS, words);
}

/* Move the tracked parts; velocities that are NULL are computed from the last two poses. */
static int move_group(proximity_part_tracker *tracker, const double *matrix, int64_t pose_ns, const double *velocity,
                      const double *angular_velocity, proximity_error *error)
{
    proximity_scene *scene = tracker->scene;
    if (proximity_first_unfit(scene, 1, matrix, velocity, angular_velocity) >= 0) {
        return proximity_refuse_pose(scene->names[tracker->own[0]], matrix, velocity, angular_velocity, error);
    }
    memcpy(tracker->matrices, matrix, 16 * sizeof *matrix);
    if (velocity != NULL) {
        memcpy(tracker->given, velocity, 3 * sizeof *velocity);
    }
    if (angular_velocity != NULL) {
        memcpy(tracker->given + 3, angular_velocity, 3 * sizeof *angular_velocity);
    }
    int64_t words[] = {WORD(tracker->motion), pose_ns,
                       (velocity != NULL ? LINEAR_GIVEN : 0) | (angular_velocity != NULL ? ANGULAR_GIVEN : 0)};
    proximity_call(scene->set, MOVE_GROUP, words); /* allocates no memory */
    return proximity_move(scene, tracker->parts, (size_t)tracker->group, tracker->matrices, tracker->velocities,
                          tracker->turnings, error);
}

int proximity_tick_part(proximity_part_tracker *tracker, const double *matrix, int64_t pose_ns, int64_t now_ns,
                        const double *velocity, const double *angular_velocity, proximity_connection *connections,
                        proximity_error *error)
{
    if (tracker == NULL || connections == NULL || (matrix == NULL && (velocity != NULL || angular_velocity != NULL))) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "there is no tracker, no place for connections, or no pose that velocities belong to");
    }
    if (!(pose_ns >= -MAX_NS && pose_ns <= MAX_NS && now_ns >= -MAX_NS && now_ns <= MAX_NS)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "an instant is beyond 2^62 ns");
    }
    proximity_scene *scene = tracker->scene;
    int code = proximity_take(scene, pose_ns, error);
    int is_other = tracker->epoch != scene->epoch;
    if (code == PROXIMITY_OK && is_other && !find_rows(tracker)) {
        code = proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "a tracked part is not in the scene any more");
    }
    if (code == PROXIMITY_OK && matrix != NULL) {
        code = move_group(tracker, matrix, pose_ns, velocity, angular_velocity, error);
    }
    if (code != PROXIMITY_OK) {
        return code;
    }
    if (matrix == NULL) {
        tracker->settings.is_predicted = 1;
    }
    tracker->settings.pose_ns = pose_ns;
    tracker->settings.now_ns = now_ns;
    int64_t words[] = {WORD(scene->model), WORD(tracker->held), is_other || tracker->changes != scene->changes};
    if ((is_other && !adopt_parts(tracker)) || !proximity_call(scene->set, FOLLOW_PARTS, words)) {
        return proximity_no_memory(error, "for the tracker");
    }
    tracker->epoch = scene->epoch;
    tracker->changes = scene->changes;
    memcpy(connections, tracker->connections, (size_t)tracker->records * sizeof *connections);
    return PROXIMITY_OK;
}
