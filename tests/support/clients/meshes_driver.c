/* Makes scenes of sound and broken meshes, adds them to one scene, and removes them while a tracker ticks. */
#include <math.h>
#include <proximity_tracker.h>
#include <stdio.h>
#include <stdlib.h>

enum { RINGS = 14, SIDES = 9, MAX_VERTICES = 4 * RINGS * SIDES, MAX_FACES = 8 * RINGS * SIDES };

/* Write a torus without shared vertices, with some faces missing, reversed, duplicated, or with invalid numbers. */
static void write_mesh(int seed, double *vertices, size_t *vertex_count, int32_t *faces, size_t *face_count)
{
    size_t v = 0, f = 0;
    srand((unsigned)seed);
    for (int ring = 0; ring < RINGS; ring++) {
        for (int side = 0; side < SIDES; side++) {
            for (int k = 0; k < 4; k++, v++) {
                double a = 6.283185307179586 * ((ring + (k & 1)) % RINGS) / RINGS;
                double b = 6.283185307179586 * ((side + (k >> 1)) % SIDES) / SIDES, r = 1.0 + 0.3 * cos(b);
                vertices[3 * v] = r * cos(a) + (seed % 3 == 1 ? 1e-8 * (rand() % 3) : 0.0);
                vertices[3 * v + 1] = r * sin(a);
                vertices[3 * v + 2] = 0.3 * sin(b);
            }
            int32_t first = (int32_t)v - 4, corners[] = {first, first + 1, first + 2, first + 1, first + 3, first + 2};
            for (int half = 0; half < 2; half++) {
                int chance = rand() % 100, times = seed % 4 == 2 && chance < 5 ? 0 : seed % 4 == 3 && chance < 5 ? 2 : 1;
                for (; times > 0; times--, f++) {
                    for (int k = 0; k < 3; k++) faces[3 * f + (seed % 5 == 4 && chance < 8 ? 2 - k : k)] = corners[3 * half + k];
                }
            }
        }
    }
    if (seed % 7 == 6) faces[rand() % (int)(3 * f)] = rand() % 2 ? -1 : (int32_t)v;
    if (seed % 11 == 10) vertices[rand() % (int)(3 * v)] = NAN;
    *vertex_count = v;
    *face_count = f;
}

int main(void)
{
    static double vertices[3 * MAX_VERTICES];
    static int32_t faces[3 * MAX_FACES];
    double positions[6] = {1.0, 0.0, 0.5, NAN, 0.0, 0.0}, pose[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
    proximity_scene *scene = NULL;
    proximity_tracker *tracker = NULL;
    proximity_contact contacts[2];
    proximity_error error;
    int added = 0, refused = 0;
    if (proximity_new_scene(&scene, &error) != PROXIMITY_OK || proximity_create_tracker(scene, 2, NULL, &tracker, &error)) {
        return 1;
    }
    for (int seed = 0; seed < 80; seed++) {
        size_t vertex_count, face_count;
        char name[20];
        int64_t now_ns = 1000000000 + 1000000LL * seed, instants[2] = {now_ns, now_ns};
        snprintf(name, sizeof name, "mesh %d", seed);
        write_mesh(seed, vertices, &vertex_count, faces, &face_count);
        pose[3] = 0.1 * seed;
        int code = proximity_add(scene, name, vertices, vertex_count, faces, face_count, pose, NULL, &error);
        if (code != PROXIMITY_OK && code != PROXIMITY_BAD_MESH) return 2;
        added += code == PROXIMITY_OK;
        refused += code != PROXIMITY_OK;
        if (seed % 3 == 2 && proximity_remove(scene, seed % proximity_part_count(scene), &error) != PROXIMITY_OK) return 3;
        if (proximity_tick(tracker, positions, instants, now_ns, NULL, NULL, contacts, &error) != PROXIMITY_OK) return 4;
    }
    if (proximity_add(scene, NULL, vertices, 0, faces, 0, NULL, NULL, &error) != PROXIMITY_BAD_ARGUMENT ||
        proximity_add(scene, "none", vertices, 0, faces, 0, NULL, NULL, &error) != PROXIMITY_BAD_MESH) {
        return 5;
    }
    proximity_close(scene);
    proximity_destroy_tracker(tracker);
    printf("%d %d\n", added, refused);
    return 0;
}
