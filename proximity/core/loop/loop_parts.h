/* Moving parts: set to their reported poses and extrapolated; bounds widen by the uncertainty. */
#ifndef PROXIMITY_LOOP_PARTS_H
#define PROXIMITY_LOOP_PARTS_H

#include "loop_poses.h"
#include "scene.h"

#ifdef __clang__
#pragma STDC FP_CONTRACT OFF
#endif

static const double ROUNDED_DOWN = 1.0 - 1e-12, ROUNDED_UP = 1.0 + 1e-12;

static proximity_scene *scene_of(const LoopSource *source)
{
    return POINTER(source->scene);
}

static int is_carried(const LoopMotion *motion)
{
    return motion->number != 0 && motion->is_moving;
}

static int is_silent(const LoopMotion *motion, int64_t now_ns)
{
    return motion->ends_ns <= now_ns;
}

/* The instant for which a moving part is placed. */
static int64_t instant_of(const LoopMotion *motion, int64_t instant_ns, int64_t now_ns)
{
    return is_silent(motion, now_ns) || instant_ns > motion->ends_ns ? motion->ends_ns : instant_ns;
}

static void add_row(LoopSource *source, int64_t at, int64_t part, const LoopMotion *motion)
{
    ((int64_t *)POINTER(source->rows))[at] = part;
    memcpy((double *)POINTER(source->matrices) + 16 * at, motion->matrix, sizeof motion->matrix);
    memcpy((double *)POINTER(source->velocities) + 3 * at, motion->velocity, sizeof motion->velocity);
    memcpy((double *)POINTER(source->turnings) + 3 * at, motion->turning, sizeof motion->turning);
}

/* Rotate and translate the last row added to its pose at an instant. */
static void carry_row(LoopSource *source, int64_t at, const LoopMotion *motion, int64_t at_ns, int stands)
{
    double *matrix = (double *)POINTER(source->matrices) + 16 * at, seconds = 1e-9 * (double)(at_ns - motion->pose_ns);
    double *velocity = (double *)POINTER(source->velocities) + 3 * at, *turning = (double *)POINTER(source->turnings) + 3 * at;
    for (int row = 0; row < 3; row++) {
        matrix[4 * row + 3] += velocity[row] * seconds;
    }
    if (motion->turn_rate > 0.0) {
        double angle = motion->turn_rate * seconds, sine = sin(angle), rest = 1.0 - cos(angle);
        for (int k = 0; k < 9; k++) {
            double across = sine * motion->across[k], back = rest * motion->back[k];
            matrix[4 * (k / 3) + k % 3] += across + back;
        }
    }
    for (int axis = 0; axis < 3 && stands; axis++) {
        velocity[axis] *= 0.0;
        turning[axis] *= 0.0;
    }
}

/* Move the parts of the rows that were added. */
static void put_rows(LoopSource *source, int64_t count)
{
    if (count > 0) {
        source->is_moved = 1;
        proximity_put_parts(scene_of(source), POINTER(source->rows), count, POINTER(source->matrices),
                            POINTER(source->velocities), POINTER(source->turnings));
    }
}

/* Switch to newly reported motions; move these parts to their reported poses. */
static void take_motions(LoopSource *source)
{
    int64_t next = __atomic_load_n(&source->next_motions, __ATOMIC_ACQUIRE), count = 0, *applied = POINTER(source->applied);
    if (next != 0) {
        source->motions = next; /* a thread that tests whether it was read finds this */
        __atomic_compare_exchange_n(&source->next_motions, &next, 0, 0, __ATOMIC_RELEASE, __ATOMIC_RELAXED);
    } else if (source->has_looked) {
        return;
    }
    const LoopMotion *motions = POINTER(source->motions);
    const Part *parts = scene_of(source)->archive.parts;
    source->has_looked = 1;
    source->all_stand = 0;
    for (int64_t part = 0; motions != NULL && part < scene_of(source)->archive.part_count; part++) {
        if (motions[part].number != applied[part]) {
            applied[part] = motions[part].number;
            if (!motions[part].is_moving || !parts[part].is_dynamic) { /* others are extrapolated anyway */
                add_row(source, count++, part, &motions[part]);
            }
        }
    }
    put_rows(source, count);
}

/* Switch the tracker to other parts, and keep the state of its fingers. */
static void adopt_parts(Loop *loop, LoopSource *source)
{
    const int64_t *table = POINTER(source->tracker), *rows_after = POINTER(source->rows_after);
    Track *tracks = POINTER(table[AT_TRACKS]);
    for (int64_t k = 0; rows_after != NULL && k < loop->count; k++) {
        if (tracks[k].reported_part >= 0) {
            tracks[k].reported_part = rows_after[tracks[k].reported_part];
        }
    }
    int64_t words[] = {(int64_t)(intptr_t)scene_of(source)->model, source->tracker};
    proximity_call(set_of(loop), ADOPT_PARTS, words);
    source->is_edited = 0;
    source->is_moved = 1;
}

/* Place parts at the newest instant of a finger, for which distances are computed; return that instant. */
static int64_t carry_parts(Loop *loop, int64_t now_ns)
{
    LoopSource *source = POINTER(loop->source);
    proximity_scene *scene = scene_of(source);
    int64_t instant_ns = proximity_newest_instant(POINTER(loop->positions), POINTER(loop->pose_ns), loop->count, now_ns);
    int64_t count = 0, all_silent = 1;
    if (scene == NULL) {
        return instant_ns;
    }
    scene->set = set_of(loop);
    take_motions(source);
    const LoopMotion *motions = POINTER(source->motions);
    loop->is_late = 0;
    for (int64_t part = 0; motions != NULL && part < scene->archive.part_count; part++) {
        const LoopMotion *motion = &motions[part];
        if (is_carried(motion)) {
            int stands = is_silent(motion, now_ns);
            all_silent &= stands;
            loop->is_late |= stands && !motion->is_hidden;
            if (!source->all_stand) {
                add_row(source, count, part, motion);
                carry_row(source, count++, motion, instant_of(motion, instant_ns, now_ns), stands);
            }
        }
    }
    put_rows(source, count);
    source->all_stand |= count > 0 && all_silent;
    if (source->is_moved) {
        proximity_settle(scene);
    }
    if (source->is_edited) {
        adopt_parts(loop, source);
    }
    return instant_ns;
}

/* Minimum as in NumPy: nan stays nan. */
static double lesser(double a, double b)
{
    return a < b || isnan(a) ? a : b;
}

/* Reduce the claims of a contact to those of its widened bounds. */
static void promise_less(proximity_contact *contact, double fastest)
{
    double lower = contact->lower > 0.0 || isnan(contact->lower) ? contact->lower : 0.0, *v = contact->velocity;
    double speed = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) + fastest;
    if ((contact->flags & PROXIMITY_FLAG_EXACT) != 0) {
        contact->flags ^= PROXIMITY_FLAG_EXACT | PROXIMITY_FLAG_BOUNDED;
    }
    contact->flags &= ~(uint32_t)PROXIMITY_FLAG_CONTACT_FOUND;
    contact->contact_bend_error += INFINITY; /* nan stays nan */
    double free_s = (contact->flags & PROXIMITY_FLAG_PREDICTED) != 0 ? lower * ROUNDED_DOWN / speed : 0.0;
    contact->time_to_contact_lower = lesser(contact->time_to_contact_lower, free_s);
}

/* Widen bounds for parts that are placed at another instant than the finger's, by their motion in between.
   For a part without further reports that is the motion since then. */
static void widen_bounds(Loop *loop, proximity_contact *contacts, int64_t now_ns, int64_t instant_ns)
{
    const LoopSource *source = POINTER(loop->source);
    const LoopMotion *motions = source->scene != 0 ? POINTER(source->motions) : NULL;
    for (int64_t k = 0; motions != NULL && k < loop->count; k++) {
        proximity_contact *contact = &contacts[k];
        double off = 0.0, off_then = 0.0, fastest = 0.0;
        for (int64_t part = 0; part < scene_of(source)->archive.part_count; part++) {
            const LoopMotion *motion = &motions[part];
            if (is_carried(motion) && !motion->is_hidden) {
                int64_t off_ns = contact->pose_ns - instant_of(motion, instant_ns, now_ns);
                off_ns = off_ns < 0 ? -off_ns : off_ns;
                /* A part that is static in the scene may in fact move on: predictions ignore that. */
                int64_t lead_ns = is_silent(motion, now_ns) ? contact->predicted_ns - contact->pose_ns : 0;
                off = fmax(off, (double)off_ns * motion->top_speed);
                off_then = fmax(off_then, (double)(off_ns + lead_ns) * motion->top_speed);
                fastest = fmax(fastest, motion->top_speed);
            }
        }
        if ((contact->flags & PROXIMITY_FLAG_TRACKED) != 0 && off_then > 0.0) {
            double error = 1e-9 * off * ROUNDED_UP, error_then = 1e-9 * off_then * ROUNDED_UP;
            contact->lower -= error;
            contact->upper += error;
            contact->predicted_lower -= error_then;
            contact->predicted_upper += error_then;
            promise_less(contact, fastest);
        }
    }
}

#endif
