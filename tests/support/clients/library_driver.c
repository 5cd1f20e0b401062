/* Opens each file unchanged and with bytes changed, by path and from memory. */
#include <math.h>
#include <proximity_tracker.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
/* Query a scene, and close it before the last tick of its tracker. */
static void use(proximity_scene *scene)
{
    double points[150], distances[50], pose[16];
    proximity_closest_point found[50];
    uint8_t inside[50];
    const int32_t part = 0;
    proximity_contact contacts[50];
    int64_t instants[50], now_ns = 1000000000;
    proximity_paths paths = {points, 2, NULL, NULL};
    proximity_tracker *tracker = NULL;
    proximity_part_tracker *held = NULL;
    proximity_connection connections[4];
    proximity_clearance_answer pairs[5];
    proximity_penetration_answer depth;
    int32_t parts[10];
    size_t pair_count;
    proximity_create_tracker(scene, 25, NULL, &tracker, NULL);
    proximity_create_part_tracker(scene, &part, 1, 4, NULL, &held, NULL);
    for (int k = 0; k < 150; k++) points[k] = 0.001 * (k * 7919 % 200) - 0.1;
    for (int step = 0; step < 3; step++) {
        now_ns += 1000000;
        for (int k = 0; k < 50; k++) instants[k] = now_ns;
        proximity_tick(tracker, points, instants, now_ns, NULL, step ? &paths : NULL, contacts, NULL);
        proximity_closest(scene, points, 50, INFINITY, found, NULL);
        proximity_contains(scene, points, 50, inside, NULL);
        proximity_closest_without(scene, points, 50, INFINITY, &part, 1, found, NULL);
        proximity_cast_distance_without(scene, points, points + 3, 49, INFINITY, &part, 1, distances, NULL);
        proximity_ignore(tracker, 3 + step, part, step != 1, NULL);
        proximity_cast_distance(scene, points, points + 3, 49, INFINITY, distances, NULL);
        proximity_pose(scene, part, pose, NULL);
        proximity_tick_part(held, step ? pose : NULL, now_ns, now_ns, NULL, NULL, connections, NULL);
        proximity_closest_pairs(scene, step ? part : PROXIMITY_NO_PART, 0.1 * step, 5, parts, pairs, &pair_count, NULL);
        proximity_penetration(scene, part, proximity_part_count(scene) - 1, NULL, 0.1, &depth, NULL);
        pose[3] += 10.0 * step;
        proximity_post(scene, part, pose, now_ns, points, points + 3, NULL);
        proximity_move(scene, &part, 1, pose, NULL, NULL, NULL);
        proximity_hide(scene, proximity_part_count(scene) - 1, step & 1, NULL);
    }
    proximity_close(scene);
    if (tracker != NULL && proximity_tick(tracker, points, instants, now_ns + 1000, NULL, NULL, contacts, NULL) == 1)
        exit(3);
    proximity_destroy_tracker(tracker);
    if (held != NULL && proximity_tick_part(held, NULL, now_ns, now_ns, NULL, NULL, connections, NULL) == 1) exit(5);
    proximity_reset_part_tracker(held);
    proximity_destroy_part_tracker(held);
}
/* Pass NULL to every function that reports it. */
static int all_nulls_are_told(void)
{
    double numbers[16] = {0};
    const int32_t part = 0;
    int64_t instant = 0;
    proximity_contact contact;
    proximity_closest_point found;
    proximity_tracker *tracker;
    proximity_error error;
    proximity_bounds(NULL, numbers, numbers + 3);
    proximity_reset_tracker(NULL);
    proximity_reset_part_tracker(NULL);
    proximity_destroy_part_tracker(NULL);
    return proximity_closest(NULL, numbers, 1, INFINITY, &found, &error) == PROXIMITY_BAD_ARGUMENT &&
           strcmp(error.sentence, "the scene is NULL, expected one that is open") == 0 &&
           proximity_cast_distance(NULL, numbers, numbers, 1, INFINITY, numbers, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_pose(NULL, 0, numbers, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_move(NULL, &part, 1, numbers, NULL, NULL, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_post(NULL, 0, numbers, 0, NULL, NULL, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_take(NULL, 0, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_hide(NULL, 0, 1, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_set_surface(NULL, 0, 0.0, 0.0, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_use_instructions(NULL, "v3", NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_create_tracker(NULL, 1, NULL, &tracker, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_set_radius(NULL, 0, 0.0, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_ignore(NULL, 0, 0, 1, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_distance_without(NULL, numbers, 1, &part, 1, numbers, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_tick(NULL, numbers, &instant, 0, NULL, NULL, &contact, &error) == PROXIMITY_BAD_ARGUMENT &&
           proximity_tick_part(NULL, NULL, 0, 0, NULL, NULL, NULL, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_create_part_tracker(NULL, &part, 1, 1, NULL, NULL, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_closest_pairs(NULL, -1, 0.0, 0, NULL, NULL, NULL, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_penetration(NULL, 0, 1, NULL, 0.0, NULL, NULL) == PROXIMITY_BAD_ARGUMENT &&
           proximity_part_count(NULL) == 0 && proximity_find_part(NULL, "a") == PROXIMITY_NO_PART &&
           proximity_part_name(NULL, 0) == NULL && proximity_face_count(NULL, 0) == 0 &&
           proximity_is_hidden(NULL, 0) == 0 && proximity_instructions(NULL) == NULL;
}
int main(int count, char **paths)
{
    int opened = 0, refused = 0;
    if (!all_nulls_are_told()) return 4;
    for (int k = 1; k < count; k++) {
        FILE *file = fopen(paths[k], "rb");
        fseek(file, 0, SEEK_END);
        size_t size = (size_t)ftell(file);
        rewind(file);
        unsigned char *bytes = malloc(size);
        if (fread(bytes, 1, size, file) != size) return 2;
        fclose(file);
        for (size_t at = 0; at < 6000; at += at < 64 ? 1 : 37) {
            proximity_scene *scene = NULL;
            proximity_error error;
            unsigned char *copy = malloc(size);
            memcpy(copy, bytes, size);
            copy[at % size] ^= at ? 1 << at % 8 : 0;
            if (proximity_open_bytes(copy, at % 5 == 4 ? size / 2 : size, &scene, &error) == PROXIMITY_OK) {
                opened++;
                use(scene);
            } else refused++;
            free(copy);
        }
        proximity_scene *scene = NULL;
        if (proximity_open(paths[k], &scene, NULL) == PROXIMITY_OK) { opened++; use(scene); }
        free(bytes);
    }
    printf("%d %d\n", opened, refused);
    return 0;
}
