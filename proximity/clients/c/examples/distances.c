/* Signed distances of a few points: distances SCENE.prox X Y Z [X Y Z ...], in metres. */
#include <math.h>
#include <proximity.h>
#include <stdio.h>
#include <stdlib.h>

enum { MOST = 100 };

int main(int count, char **words)
{
    double points[3 * MOST];
    proximity_closest_point found[MOST];
    proximity_error error;
    proximity_scene *scene = NULL;
    size_t rows = count > 4 ? (size_t)(count - 2) / 3 : 0;

    for (size_t k = 0; k < 3 * rows && k < 3 * MOST; k++) {
        points[k] = strtod(words[2 + k], NULL);
    }
    if (rows == 0 || rows > MOST || proximity_open(words[1], &scene, &error) != PROXIMITY_OK ||
        proximity_closest(scene, points, rows, INFINITY, found, &error) != PROXIMITY_OK) {
        fprintf(stderr, "%s\n", scene == NULL && rows == 0 ? "expected a scene and points" : error.sentence);
        proximity_close(scene);
        return 1;
    }
    for (size_t k = 0; k < rows; k++) {
        const char *name = proximity_part_name(scene, found[k].part);
        printf("%.6g m to %s, at %.6g %.6g %.6g\n", found[k].signed_distance, name != NULL ? name : "nothing",
               found[k].point[0], found[k].point[1], found[k].point[2]);
    }
    proximity_close(scene);
    return 0;
}
