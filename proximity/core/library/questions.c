/* Queries of a scene: its parts, points, rays and segments. */
#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "entry_points.h"

#define WORD(address) ((int64_t)(intptr_t)(address))

/* --- parts --------------------------------------------------------------------------------------------- */

static int is_part(const proximity_scene *scene, int32_t part)
{
    return scene != NULL && part >= 0 && part < scene->archive.part_count;
}

const char *proximity_instructions(const proximity_scene *scene)
{
    return scene != NULL ? scene->set->name : NULL;
}

int32_t proximity_part_count(const proximity_scene *scene)
{
    return scene != NULL ? (int32_t)scene->archive.part_count : 0;
}

const char *proximity_part_name(const proximity_scene *scene, int32_t part)
{
    return is_part(scene, part) ? scene->names[part] : NULL;
}

int32_t proximity_find_part(const proximity_scene *scene, const char *name)
{
    for (int32_t part = 0; scene != NULL && name != NULL && part < scene->archive.part_count; part++) {
        if (strcmp(scene->names[part], name) == 0) {
            return part;
        }
    }
    return PROXIMITY_NO_PART;
}

int32_t proximity_face_count(const proximity_scene *scene, int32_t part)
{
    return is_part(scene, part) ? (int32_t)scene->archive.parts[part].face_count : 0;
}

int proximity_is_hidden(const proximity_scene *scene, int32_t part)
{
    return is_part(scene, part) && scene->archive.parts[part].is_hidden != 0;
}

int proximity_pose(const proximity_scene *scene, int32_t part, double *matrix, proximity_error *error)
{
    if (scene == NULL) {
        return proximity_refuse_scene(scene, error);
    }
    if (!is_part(scene, part)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there is no part %d, expected 0 to %d", (int)part,
                                (int)scene->archive.part_count - 1);
    }
    const Frame *frame = &scene->archive.frames[part];
    for (int row = 0; row < 4; row++) {
        for (int column = 0; column < 4; column++) {
            matrix[4 * row + column] = row == 3      ? (column == 3 ? 1.0 : 0.0)
                                       : column == 3 ? frame->translation[row]
                                                     : frame->rotation[3 * row + column];
        }
    }
    return PROXIMITY_OK;
}

static void widen_to(double *lower, double *upper, const double *least, const double *most)
{
    for (int axis = 0; axis < 3; axis++) {
        lower[axis] = least[axis] < lower[axis] ? least[axis] : lower[axis];
        upper[axis] = most[axis] > upper[axis] ? most[axis] : upper[axis];
    }
}

/* The kernels' box of a rotated part encloses its rotated box, which is larger: here it encloses the corners,
   rounded as in Python. */
void proximity_bounds(const proximity_scene *scene, double *lower, double *upper)
{
#pragma STDC FP_CONTRACT OFF
    for (int axis = 0; axis < 3; axis++) {
        lower[axis] = INFINITY;
        upper[axis] = -INFINITY;
    }
    if (scene == NULL) {
        return;
    }
    const Archive *archive = &scene->archive;
    for (int64_t row = 0; row < archive->part_count; row++) {
        const Part *part = &archive->parts[row];
        const Frame *frame = &archive->frames[row];
        const double *local = archive->reals + part->corners, *turn = frame->rotation;
        if (!part->is_turned) {
            widen_to(lower, upper, frame->box_lower, frame->box_upper);
            continue;
        }
        for (int64_t k = 0; k < part->corner_count; k++, local += 3) {
            double own[3], point[3];
            for (int axis = 0; axis < 3; axis++) {
                own[axis] = local[axis] / frame->scale + frame->centre[axis];
            }
            for (int axis = 0; axis < 3; axis++) {
                point[axis] = turn[3 * axis] * own[0] + turn[3 * axis + 1] * own[1] + turn[3 * axis + 2] * own[2] +
                              frame->translation[axis];
            }
            widen_to(lower, upper, point, point);
        }
    }
}

/* --- batches ------------------------------------------------------------------------------------------- */

enum { BLOCK = 1 << 20 }; /* rows that are sorted together */

typedef struct {
    int entry, order_entry, row_arrays;
    int64_t width, item_bytes; /* of an answer */
    int64_t sort_from;         /* rows */
} Question;

/* Run a query for rows that are sorted together; return the rejected row, or another result of the kernel. */
static int ask_block(const proximity_scene *scene, const int64_t *model, const Question *question,
                     const double *const *rows, int64_t count, double limit, void *answers, int64_t *said)
{
    int64_t words[20] = {WORD(model)}, order[10] = {WORD(scene->model)}, at = 1;
    int of_rays = question->order_entry == RAY_ORDER, taken = of_rays ? 1 : 0;
    Owner *owner = NULL;
    for (int k = 0; k < question->row_arrays; k++) {
        int64_t array[] = {WORD(rows[k]), count, 3};
        memcpy(words + at, array, sizeof array);
        if (k == 0 || of_rays) {
            memcpy(order + taken, array, sizeof array);
            taken += 3;
        }
        at += 3;
    }
    words[at] = words[at + 1] = 0; /* unordered */
    if (count >= question->sort_from) {
        if (!proximity_call(scene->set, question->order_entry, order)) {
            return 0;
        }
        words[at] = order[taken];
        words[at + 1] = order[taken + 1];
        owner = (Owner *)(intptr_t)order[taken + 2];
    }
    int64_t rest[] = {WORD(&limit), 1, WORD(answers), count, question->width, 0};
    memcpy(words + at + 2, rest, sizeof rest);
    int is_done = proximity_call(scene->set, question->entry, words);
    *said = words[at + 7];
    if (owner != NULL) {
        release_owner(owner);
    }
    return is_done;
}

static int ask_model(const proximity_scene *scene, const int64_t *model, const Question *question, const double *first,
                     const double *second, size_t count, double limit, void *answers, proximity_error *error)
{
    if (count > 0 && (first == NULL || answers == NULL || (question->row_arrays == 2 && second == NULL))) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there are no rows, or no place for answers");
    }
    if (!(limit >= 0.0)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "max_distance is %g, expected a length of 0 m or more",
                                limit);
    }
    int64_t zero_row = NO_ROW;
    for (size_t done = 0; done < count; done += BLOCK) {
        const double *rows[] = {first + 3 * done, second != NULL ? second + 3 * done : NULL};
        int64_t part = (int64_t)(count - done < BLOCK ? count - done : BLOCK), said;
        char *to = (char *)answers + (int64_t)done * question->width * question->item_bytes;
        if (!ask_block(scene, model, question, rows, part, limit, to, &said)) {
            return proximity_no_memory(error, "to sort the rows");
        }
        if (question->entry == CONTAINS_BATCH && said != NO_ROW) {
            return proximity_refuse(error, PROXIMITY_NO_INSIDE,
                                    "no part has an inside, so that nothing can be contained");
        }
        if (said >= 0 && zero_row == NO_ROW) {
            zero_row = (int64_t)done + said;
        }
    }
    if (zero_row != NO_ROW) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "direction %lld is zero, expected a vector with a length", (long long)zero_row);
    }
    if (question->row_arrays == 1 && question->item_bytes == 8) {
        proximity_note_points(scene, answers, count, question->width);
    }
    return PROXIMITY_OK;
}

static int ask(const proximity_scene *scene, const Question *question, const double *first, const double *second,
               size_t count, double limit, const int32_t *ignored, size_t ignored_count, void *answers,
               proximity_error *error)
{
    int code = proximity_refuse_scene(scene, error);
    if (code || ignored_count == 0) {
        return code ? code : ask_model(scene, scene->model, question, first, second, count, limit, answers, error);
    }
    if (ignored == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there are no numbers of ignored parts");
    }
    const Archive *archive = &scene->archive;
    for (size_t k = 0; k < ignored_count; k++) {
        if (!is_part(scene, ignored[k])) {
            return proximity_no_such_part(scene, ignored[k], error);
        }
    }
    /* Copy the rows and mark these parts as hidden, and the scene's row as having such parts. */
    Archive heeded = *archive;
    size_t size = (size_t)archive->part_rows * sizeof *heeded.parts;
    heeded.parts = malloc(size);
    if (heeded.parts == NULL) {
        return proximity_no_memory(error, "to ignore parts");
    }
    memcpy(heeded.parts, archive->parts, size);
    heeded.parts[archive->part_count].is_hidden = 1;
    for (size_t k = 0; k < ignored_count; k++) {
        heeded.parts[ignored[k]].is_hidden = 1;
    }
    int64_t model[8];
    proximity_write_model(model, &heeded);
    code = ask_model(scene, model, question, first, second, count, limit, answers, error);
    free(heeded.parts);
    return code;
}

static int ask_points(const proximity_scene *scene, int entry, const double *points, size_t count, double limit,
                      const int32_t *ignored, size_t ignored_count, int64_t width, int64_t item_bytes, void *answers,
                      proximity_error *error)
{
    Question question = {entry, MORTON_ORDER, 1, width, item_bytes, SORT_FROM};
    return ask(scene, &question, points, NULL, count, limit, ignored, ignored_count, answers, error);
}

static int ask_rays(const proximity_scene *scene, const double *origins, const double *directions, size_t count,
                    double limit, const int32_t *ignored, size_t ignored_count, int64_t width, void *answers,
                    proximity_error *error)
{
    int is_large = scene != NULL && scene->archive.real_count * 8 >= SORT_RAYS_IN;
    Question question = {CAST_BATCH, RAY_ORDER, 2, width, 8, is_large ? SORT_RAYS_FROM : INT64_MAX};
    return ask(scene, &question, origins, directions, count, limit, ignored, ignored_count, answers, error);
}

int proximity_closest_without(const proximity_scene *scene, const double *points, size_t count, double max_distance,
                              const int32_t *ignored, size_t ignored_count, proximity_closest_point *answers,
                              proximity_error *error)
{
    return ask_points(scene, CLOSEST_BATCH, points, count, max_distance, ignored, ignored_count, sizeof *answers / 8, 8,
                      answers, error);
}

int proximity_closest(const proximity_scene *scene, const double *points, size_t count, double max_distance,
                      proximity_closest_point *answers, proximity_error *error)
{
    return proximity_closest_without(scene, points, count, max_distance, NULL, 0, answers, error);
}

int proximity_signed_distance_without(const proximity_scene *scene, const double *points, size_t count,
                                      const int32_t *ignored, size_t ignored_count, double *distances,
                                      proximity_error *error)
{
    return ask_points(scene, SIGNED_BATCH, points, count, INFINITY, ignored, ignored_count, 1, 8, distances, error);
}

int proximity_signed_distance(const proximity_scene *scene, const double *points, size_t count, double *distances,
                              proximity_error *error)
{
    return proximity_signed_distance_without(scene, points, count, NULL, 0, distances, error);
}

int proximity_distance_without(const proximity_scene *scene, const double *points, size_t count, const int32_t *ignored,
                               size_t ignored_count, double *distances, proximity_error *error)
{
    return ask_points(scene, DISTANCE_BATCH, points, count, INFINITY, ignored, ignored_count, 1, 8, distances, error);
}

int proximity_distance(const proximity_scene *scene, const double *points, size_t count, double *distances,
                       proximity_error *error)
{
    return proximity_distance_without(scene, points, count, NULL, 0, distances, error);
}

int proximity_contains_without(const proximity_scene *scene, const double *points, size_t count, const int32_t *ignored,
                               size_t ignored_count, uint8_t *is_inside, proximity_error *error)
{
    return ask_points(scene, CONTAINS_BATCH, points, count, INFINITY, ignored, ignored_count, 1, 1, is_inside, error);
}

int proximity_contains(const proximity_scene *scene, const double *points, size_t count, uint8_t *is_inside,
                       proximity_error *error)
{
    return proximity_contains_without(scene, points, count, NULL, 0, is_inside, error);
}

int proximity_cast_without(const proximity_scene *scene, const double *origins, const double *directions, size_t count,
                           double max_distance, const int32_t *ignored, size_t ignored_count, proximity_ray_hit *answers,
                           proximity_error *error)
{
    return ask_rays(scene, origins, directions, count, max_distance, ignored, ignored_count, sizeof *answers / 8, answers,
                    error);
}

int proximity_cast(const proximity_scene *scene, const double *origins, const double *directions, size_t count,
                   double max_distance, proximity_ray_hit *answers, proximity_error *error)
{
    return proximity_cast_without(scene, origins, directions, count, max_distance, NULL, 0, answers, error);
}

int proximity_cast_distance_without(const proximity_scene *scene, const double *origins, const double *directions,
                                    size_t count, double max_distance, const int32_t *ignored, size_t ignored_count,
                                    double *distances, proximity_error *error)
{
    return ask_rays(scene, origins, directions, count, max_distance, ignored, ignored_count, 1, distances, error);
}

int proximity_cast_distance(const proximity_scene *scene, const double *origins, const double *directions,
                            size_t count, double max_distance, double *distances, proximity_error *error)
{
    return proximity_cast_distance_without(scene, origins, directions, count, max_distance, NULL, 0, distances, error);
}

int proximity_closest_to_segments_without(const proximity_scene *scene, const double *starts, const double *ends,
                                          size_t count, double max_distance, const int32_t *ignored,
                                          size_t ignored_count, proximity_segment_hit *answers, proximity_error *error)
{
    Question question = {SEGMENT_BATCH, MORTON_ORDER, 2, sizeof *answers / 8, 8, SORT_FROM};
    return ask(scene, &question, starts, ends, count, max_distance, ignored, ignored_count, answers, error);
}

int proximity_closest_to_segments(const proximity_scene *scene, const double *starts, const double *ends, size_t count,
                                  double max_distance, proximity_segment_hit *answers, proximity_error *error)
{
    return proximity_closest_to_segments_without(scene, starts, ends, count, max_distance, NULL, 0, answers, error);
}

/* --- two parts ----------------------------------------------------------------------------------------- */

_Static_assert(sizeof(proximity_clearance_answer) == sizeof(ClearanceAnswer), "an answer is the record of kernels");

int32_t *proximity_surfaces_of(const proximity_scene *scene, const int32_t *parts, int64_t *words)
{
    int64_t counts[2], most = 0;
    for (int k = 0; k < 2; k++) {
        counts[k] = scene->archive.parts[parts[k]].face_count;
        most = counts[k] > most ? counts[k] : most;
    }
    int32_t *found = malloc((size_t)(counts[0] + counts[1] + most) * sizeof *found);
    for (int k = 0; found != NULL && k < 2; k++) {
        int32_t *faces = found + most + k * counts[0];
        int64_t surfaces[] = {WORD(scene->model), parts[k], WORD(found), counts[k], WORD(faces), counts[k], 0};
        proximity_call(scene->set, SURFACE_FACES, surfaces); /* which needs no memory */
        words[2 * k] = WORD(faces);
        words[2 * k + 1] = surfaces[6];
    }
    return found;
}

int proximity_refuse_pair(const proximity_scene *scene, int32_t first, int32_t second, proximity_error *error)
{
    if (is_part(scene, first) && is_part(scene, second) && first != second) {
        return PROXIMITY_OK;
    }
    return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                            "parts are %d and %d, expected two different numbers from 0 to %d", (int)first, (int)second,
                            (int)scene->archive.part_count - 1);
}

int proximity_clearance(const proximity_scene *scene, int32_t first, int32_t second, double max_distance,
                        double tolerance, size_t budget, proximity_clearance_answer *answer, proximity_error *error)
{
    proximity_clearance_answer found;
    int unusable = proximity_refuse_scene(scene, error);
    if (unusable) {
        return unusable;
    }
    if (answer == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "answer is NULL, expected an address");
    }
    unusable = proximity_refuse_pair(scene, first, second, error);
    if (unusable) {
        return unusable;
    }
    if (!(max_distance >= 0.0) || !(tolerance >= 0.0)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "max_distance is %g and tolerance %g, expected 0 or more each", max_distance,
                                tolerance);
    }
    int64_t limits[2];
    memcpy(limits, &max_distance, sizeof max_distance);
    memcpy(limits + 1, &tolerance, sizeof tolerance);
    int64_t words[] = {WORD(scene->model), first, second, limits[0], limits[1], (int64_t)budget, WORD(&found),
                       1, 0};
    if (!proximity_call(scene->set, CONNECT_PARTS, words)) {
        return proximity_no_memory(error, "for the clearance");
    }
    if (found.unused) { /* one part may be inside the other */
        const int32_t parts[] = {first, second};
        int64_t more[] = {WORD(scene->model), first, second, 0, 0, 0, 0, WORD(&found), 1};
        int32_t *surfaces = proximity_surfaces_of(scene, parts, more + 3);
        int is_done = surfaces != NULL && proximity_call(scene->set, DECIDE_INSIDE, more);
        free(surfaces);
        if (!is_done) {
            return proximity_no_memory(error, "for the surfaces");
        }
    }
    *answer = found;
    return PROXIMITY_OK;
}
