/* Pairs of parts: the nearest pairs of a scene, and the penetration of two parts. */
#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WORD(address) ((int64_t)(intptr_t)(address))

int proximity_closest_pairs(const proximity_scene *scene, int32_t part, double max_distance, size_t capacity,
                            int32_t *parts, proximity_clearance_answer *answers, size_t *count, proximity_error *error)
{
    int unusable = proximity_refuse_scene(scene, error);
    if (unusable) {
        return unusable;
    }
    const Archive *archive = &scene->archive;
    if (part != PROXIMITY_NO_PART && (part < 0 || part >= archive->part_count)) {
        return proximity_no_such_part(scene, part, error);
    }
    if (count == NULL || (capacity > 0 && (parts == NULL || answers == NULL)) || !(max_distance >= 0.0)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "max_distance is %g, expected a length of 0 m or more, and arrays for parts, answers "
                                "and the count", max_distance);
    }
    int64_t others = archive->part_count - 1, places = archive->part_count + 1, faces = 0;
    int64_t pairs = part != PROXIMITY_NO_PART ? others : others * (others + 1) / 2;
    int64_t rows = capacity < (size_t)pairs ? (int64_t)capacity : pairs;
    for (int64_t k = 0; k < archive->part_count; k++) {
        faces += 2 * archive->parts[k].face_count;
    }
    int64_t *numbers = malloc((size_t)(2 * pairs + 2 * places) * sizeof *numbers + (size_t)faces * sizeof(int32_t));
    if (numbers == NULL) {
        return proximity_no_memory(error, "for the pairs");
    }
    int64_t *gaps = numbers + pairs, *surfaces = gaps + pairs;
    PairSearch search = {.limit = max_distance, .only = part};
    int64_t table[] = {WORD(&search), 1, WORD(gaps), pairs, WORD(numbers), pairs, WORD(surfaces + 2 * places), faces,
                       WORD(surfaces), places, 2, WORD(parts), rows, 2, WORD(answers), rows};
    int64_t words[] = {WORD(scene->model), WORD(table), 0};
    proximity_call(scene->set, LIST_PAIRS, words); /* neither allocates memory */
    do {
        proximity_call(scene->set, CONNECT_PAIRS, words);
    } while (words[2] & 1);
    free(numbers);
    *count = (size_t)search.found;
    return PROXIMITY_OK;
}

int proximity_penetration(const proximity_scene *scene, int32_t first, int32_t second, const double *direction,
                          double tolerance, proximity_penetration_answer *answer, proximity_error *error)
{
    static const double any[3] = {0.0, 0.0, 0.0};
    int unusable = proximity_refuse_scene(scene, error);
    unusable = unusable ? unusable : proximity_refuse_pair(scene, first, second, error);
    if (unusable) {
        return unusable;
    }
    const double *d = direction != NULL ? direction : any;
    double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    if (answer == NULL || !(tolerance >= 0.0) || (direction != NULL && !(length > 0.0 && length < INFINITY))) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "tolerance is %g and the direction %g long, expected 0 or more, and a finite vector with "
                                "a length or NULL", tolerance, length);
    }
    tolerance = tolerance > MIN_TOLERANCE ? tolerance : MIN_TOLERANCE;
    const int32_t parts[] = {first, second};
    ExitAnswer way;
    DeepestAnswer deepest = {.point = {NAN, NAN, NAN}};
    int64_t words[] = {WORD(scene->model), first, second, 0, 0, 0, 0, WORD(d), 3, 0, 0, WORD(&way), 1};
    int64_t rest[] = {WORD(scene->model), first, second, 0, DEEPEST_BUDGET, WORD(&deepest), 1};
    memcpy(words + 9, &tolerance, sizeof tolerance);
    memcpy(rest + 3, &tolerance, sizeof tolerance);
    int32_t *surfaces = proximity_surfaces_of(scene, parts, words + 3);
    int is_done = surfaces != NULL && proximity_call(scene->set, FIND_EXIT, words) &&
                  (!(way.depth > 0.0) || proximity_call(scene->set, DEEPEST_POINT, rest));
    free(surfaces);
    if (!is_done) {
        return proximity_no_memory(error, "for the surfaces");
    }
    proximity_penetration_answer found = {.depth = way.depth,
                                          .lower = way.lower,
                                          .deepest = deepest.upper,
                                          .deepest_lower = deepest.lower};
    memcpy(found.direction, way.direction, sizeof found.direction);
    memcpy(found.deepest_point, deepest.point, sizeof found.deepest_point);
    *answer = found;
    return PROXIMITY_OK;
}
