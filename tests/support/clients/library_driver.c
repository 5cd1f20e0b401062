/* Opens each file as it is, and with a byte changed here and there, from the path and as bytes. */
#include <math.h>
#include <proximity_tracker.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
static void use(proximity_scene *scene)
{
    double points[150], distances[50], pose[16];
    proximity_closest_point found[50];
    uint8_t inside[50];
    const int32_t part = 0;
    decaff_contact contacts[50];
    int64_t instants[50], now_ns = 1000000000;
    proximity_paths paths = {points, 2, NULL, NULL};
    proximity_tracker *tracker = NULL;
    proximity_create_tracker(scene, 25, NULL, &tracker, NULL);
    for (int k = 0; k < 150; k++) points[k] = 0.001 * (k * 7919 % 200) - 0.1;
    for (int step = 0; step < 3; step++) {
        now_ns += 1000000;
        for (int k = 0; k < 50; k++) instants[k] = now_ns;
        proximity_tick(tracker, points, instants, now_ns, NULL, step ? &paths : NULL, contacts, NULL);
        proximity_closest(scene, points, 50, INFINITY, found, NULL);
        proximity_contains(scene, points, 50, inside, NULL);
        proximity_cast_distance(scene, points, points + 3, 49, INFINITY, distances, NULL);
        proximity_pose(scene, part, pose, NULL);
        pose[3] += 10.0 * step;
        proximity_move(scene, &part, 1, pose, NULL, NULL, NULL);
        proximity_hide(scene, proximity_part_count(scene) - 1, step & 1, NULL);
    }
    proximity_destroy_tracker(tracker);
}
int main(int count, char **paths)
{
    int opened = 0, refused = 0;
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
            proximity_close(scene);
            free(copy);
        }
        proximity_scene *scene = NULL;
        if (proximity_open(paths[k], &scene, NULL) == PROXIMITY_OK) { opened++; use(scene); }
        proximity_close(scene);
        free(bytes);
    }
    printf("%d %d\n", opened, refused);
    return 0;
}
