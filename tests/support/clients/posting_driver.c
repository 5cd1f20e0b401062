/* One thread posts poses of two parts while another ticks: poses are never torn, and never go back in time. */
#include <math.h>
#include <proximity_tracker.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

enum { POSTS = 100000, FINGERS = 3 };
static int posts_done;

static void *post_all(void *given)
{
    proximity_scene *scene = given;
    double pose[16] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}, turning[3] = {0.0, 0.0, 1.0};
    for (int k = 1; k <= POSTS; k++) {
        pose[3] = pose[7] = pose[11] = 1e-6 * k;
        int code = proximity_post(scene, k & 1, pose, 1000000LL * k, NULL, k & 1 ? NULL : turning, NULL);
        if (code != PROXIMITY_OK) return given;
    }
    __atomic_store_n(&posts_done, 1, __ATOMIC_RELEASE);
    return NULL;
}

int main(int count, char **paths)
{
    proximity_scene *scene;
    proximity_tracker *tracker;
    proximity_contact contacts[FINGERS];
    double positions[3 * FINGERS], pose[16], before[2] = {-1.0, -1.0};
    int64_t instants[FINGERS];
    pthread_t posting;
    if (count != 2 || proximity_open(paths[1], &scene, NULL) != PROXIMITY_OK) return 2;
    if (proximity_create_tracker(scene, FINGERS, NULL, &tracker, NULL) != PROXIMITY_OK) return 3;
    for (int k = 0; k < 3 * FINGERS; k++) positions[k] = 0.01 * k;
    if (pthread_create(&posting, NULL, post_all, scene) != 0) return 4;
    int ticks = 0, is_last = 0;
    while (!is_last) {
        is_last = __atomic_load_n(&posts_done, __ATOMIC_ACQUIRE);
        for (int k = 0; k < FINGERS; k++) instants[k] = 1000000LL * ++ticks;
        if (proximity_tick(tracker, positions, instants, instants[0], NULL, NULL, contacts, NULL) != PROXIMITY_OK) return 5;
        for (int part = 0; part < 2 && ticks > 3000; part++) {
            if (proximity_pose(scene, part, pose, NULL) != PROXIMITY_OK) return 6;
            if (pose[3] != pose[7] || pose[3] != pose[11] || pose[3] < before[part]) return 7;
            before[part] = pose[3];
        }
    }
    void *failed;
    pthread_join(posting, &failed);
    proximity_destroy_tracker(tracker);
    proximity_close(scene);
    printf("%d %.6f %.6f\n", ticks, before[0], before[1]);
    return failed != NULL;
}
