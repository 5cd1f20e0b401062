/* Notes: sentences on suspicious input, each kind once. */
#include "scene.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#define MS(ns) (1e-6 * (double)(ns))
static const char two_clocks[] = "pose_ns and now_ns may be of two clocks: take both from one, such as CLOCK_MONOTONIC";

void proximity_set_log(proximity_scene *scene, proximity_log *log, void *user)
{
    if (scene != NULL) {
        scene->log = log;
        scene->log_user = user;
    }
}

/* Return the new bits of `kinds`, and add them to `noted`. */
static int64_t new_kinds(const proximity_scene *scene, int64_t *noted, int64_t kinds)
{
    return scene->log != NULL && kinds != 0 ? kinds & ~__atomic_fetch_or(noted, kinds, __ATOMIC_RELAXED) : 0;
}

static void note(const proximity_scene *scene, const char *sentence, ...)
{
    char text[400];
    va_list values;
    va_start(values, sentence);
    vsnprintf(text, sizeof text, sentence, values);
    va_end(values);
    scene->log(scene->log_user, text);
}

static void note_far(const proximity_scene *scene, const char *what, double distance, double size, const char *names)
{
    note(scene, "%s is %.3g m from the nearest part, %.0f times the size of the scene: %s are metres", what, distance,
         distance / size, names);
}

/* Diagonal of the box of all parts, m. */
static double size_of(const proximity_scene *scene)
{
    const Frame *box = &scene->archive.frames[scene->archive.part_count];
    double sum = 0.0;
    for (int axis = 0; axis < 3; axis++) {
        sum += (box->box_upper[axis] - box->box_lower[axis]) * (box->box_upper[axis] - box->box_lower[axis]);
    }
    return sqrt(sum);
}

void proximity_note_points(const proximity_scene *scene, const double *answers, size_t count, int64_t width)
{
    double nearest = INFINITY, size = scene->log != NULL ? size_of(scene) : 0.0;
    for (size_t k = 0; scene->log != NULL && k < count; k++) {
        nearest = fmin(nearest, answers[(int64_t)k * width]);
    }
    int is_far = nearest > MILLIMETRES_FROM * size && nearest < MILLIMETRES_TO * size;
    if (new_kinds(scene, &((proximity_scene *)(uintptr_t)scene)->noted, is_far ? NOTED_POINTS : 0)) {
        note_far(scene, "the nearest point", nearest, size, "points");
    }
}

void proximity_note_post(proximity_scene *scene, int64_t part, int64_t pose_ns, int64_t instant_ns)
{
    int64_t off_ns = proximity_time_between(pose_ns, instant_ns);
    int is_apart = off_ns > OTHER_CLOCK_NS || off_ns < -OTHER_CLOCK_NS;
    if (new_kinds(scene, &scene->noted, is_apart ? NOTED_POSTS : 0)) {
        note(scene, "the pose posted of part '%.80s' is %.3g s %s the fingers: %s", scene->names[part],
             1e-9 * fabs((double)off_ns), off_ns > 0 ? "older than" : "ahead of", two_clocks);
    }
}

void proximity_note_tick(const proximity_scene *scene, int64_t *noted, int64_t answer, const proximity_contact *contacts,
                         size_t count)
{
    int64_t kinds = new_kinds(scene, noted, answer & ~(int64_t)DONE);
    int64_t min_ns = INT64_MAX, max_ns = INT64_MIN;
    const proximity_contact *nearest = NULL;
    for (size_t k = 0; kinds != 0 && k < count; k++) {
        const proximity_contact *c = &contacts[k];
        if (isfinite(c->position[0]) && isfinite(c->position[1]) && isfinite(c->position[2])) {
            min_ns = c->age_ns < min_ns ? c->age_ns : min_ns;
            max_ns = c->age_ns > max_ns ? c->age_ns : max_ns;
        }
        if ((c->flags & PROXIMITY_FLAG_TRACKED) != 0 &&
            (nearest == NULL || c->signed_distance < nearest->signed_distance)) {
            nearest = c;
        }
    }
    if (kinds & HAS_DEFECT << FUTURE && min_ns < -OTHER_CLOCK_NS) {
        note(scene, "poses from the future are not used (by %.0f s; %s)", -1e-3 * MS(min_ns), two_clocks);
    } else if (kinds & HAS_DEFECT << FUTURE) {
        note(scene, "poses from the future are predicted for their own instant (by %.1f ms; give the instant at which the "
                    "hand was there, not the predicted display time)", -MS(min_ns));
    }
    if (kinds & HAS_DEFECT << TOO_OLD) {
        note(scene, "poses older than 1 s are not used (%.0f s old; %s)", 1e-3 * MS(max_ns), two_clocks);
    }
    if (kinds & ALL_IN_MILLIMETRES && nearest != NULL) {
        char what[32];
        snprintf(what, sizeof what, "finger %u", (unsigned)nearest->finger);
        note_far(scene, what, nearest->signed_distance, size_of(scene), "positions");
    }
}
