/* An approaching part: moving SCENE.prox, whose first part is moved towards a point next to it. */
#include <proximity.h>
#include <stdio.h>

int main(int count, char **words)
{
    proximity_error error;
    proximity_scene *scene = NULL;
    double lower[3], upper[3], pose[16], velocity[3] = {0.1, 0.0, 0.0}, distance;
    const int32_t part = 0;

    if (count != 2 || proximity_open(words[1], &scene, &error) != PROXIMITY_OK) {
        fprintf(stderr, "%s\n", count != 2 ? "expected a scene" : error.sentence);
        return 1;
    }
    proximity_bounds(scene, lower, upper);
    double size = upper[0] - lower[0];
    double point[3] = {upper[0] + size, 0.5 * (lower[1] + upper[1]), 0.5 * (lower[2] + upper[2])};
    int code = proximity_pose(scene, part, pose, &error);
    for (int step = 0; step < 5 && code == PROXIMITY_OK; step++) {
        code = proximity_signed_distance(scene, point, 1, &distance, &error);
        if (code == PROXIMITY_OK) {
            printf("%s at x = %.6g m: %.6g m\n", proximity_part_name(scene, part), pose[3], distance);
            pose[3] += 0.1 * size; /* the first row's last number is x */
            code = proximity_move(scene, &part, 1, pose, velocity, NULL, &error);
        }
    }
    if (code != PROXIMITY_OK) {
        fprintf(stderr, "%s\n", error.sentence);
    }
    proximity_close(scene);
    return code != PROXIMITY_OK;
}
