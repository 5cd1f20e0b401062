/* Answers queries of a scene from standard input, for emulated processors: library_server SCENE.prox. A query is a
   number, the row count, a limit, and the rows; see bench/benchmarks/digest/library_program.py. */
#include <proximity.h>
#include <stdio.h>
#include <stdlib.h>

#ifdef _WIN32
#include <fcntl.h>
#include <io.h>
#endif

typedef struct {
    int64_t question, count;
    double limit;
} Head;

static void *taken(size_t size)
{
    void *bytes = malloc(size + 1);
    if (bytes == NULL || fread(bytes, 1, size, stdin) != size) {
        exit(3);
    }
    return bytes;
}

int main(int words, char **word)
{
    static const size_t sizes[] = {sizeof(proximity_closest_point), 8, 8, 1, sizeof(proximity_ray_hit), 8,
                                   sizeof(proximity_segment_hit)};
    proximity_scene *scene = NULL;
    proximity_error error;
    Head head;
#ifdef _WIN32
    _setmode(0, _O_BINARY);
    _setmode(1, _O_BINARY);
#endif
    if (words != 2 || proximity_open(word[1], &scene, &error) != PROXIMITY_OK) {
        fprintf(stderr, "%s\n", words == 2 ? error.sentence : "expected a scene");
        return 2;
    }
    while (fread(&head, sizeof head, 1, stdin) == 1) {
        size_t count = (size_t)head.count, size = count * sizes[head.question];
        double *first = taken(24 * count), *second = head.question >= 4 ? taken(24 * count) : NULL;
        void *answers = calloc(size + 1, 1);
        int64_t code = head.question == 0   ? proximity_closest(scene, first, count, head.limit, answers, NULL)
                       : head.question == 1 ? proximity_signed_distance(scene, first, count, answers, NULL)
                       : head.question == 2 ? proximity_distance(scene, first, count, answers, NULL)
                       : head.question == 3 ? proximity_contains(scene, first, count, answers, NULL)
                       : head.question == 4
                           ? proximity_cast(scene, first, second, count, head.limit, answers, NULL)
                       : head.question == 5
                           ? proximity_cast_distance(scene, first, second, count, head.limit, answers, NULL)
                           : proximity_closest_to_segments(scene, first, second, count, head.limit, answers, NULL);
        fwrite(&code, sizeof code, 1, stdout);
        fwrite(answers, 1, size, stdout);
        fflush(stdout);
        free(first);
        free(second);
        free(answers);
    }
    proximity_close(scene);
    return 0;
}
