/* Scenes whose parts are added and removed at run time: the arrays are assembled again. */
#include "assembled.h"

#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "entry_points.h"

#define WORD(address) ((int64_t)(intptr_t)(address))

enum { LINE = 64 }; /* bytes; alignment of arrays */

/* The results of `plan_scene`, see kernels.scene.assembly. */
typedef struct {
    int64_t static_nodes[2], entries[3], reals, words;
    Owner *owners[2];
} Plan;

static size_t on_line(size_t bytes)
{
    return (bytes + LINE - 1) / LINE * LINE;
}

static void write_source(Source *source, const proximity_scene *scene, int64_t row)
{
    source->model = scene->model;
    source->row = row;
    source->name = scene->names[row];
    source->reason = scene->reasons != NULL ? scene->reasons[row] : "";
    proximity_pose(scene, (int32_t)row, source->matrix, NULL);
}

/* --- the model ------------------------------------------------------------------------------------------ */

/* Write the rows of parts, and their nodes in sequence. */
static float *collect(const InstructionSet *set, const Source *sources, Archive *made)
{
    double rounding = EXACT_ENOUGH;
    int64_t last[6] = {WORD(made->frames), made->frame_count, WORD(made->parts), made->part_rows}, nodes = 0;
    memcpy(last + 5, &rounding, sizeof rounding);
    for (int64_t k = 0; k < made->part_count; k++) {
        int64_t words[] = {WORD(sources[k].model), sources[k].row, last[0], last[1], last[2], last[3], k,
                           WORD(sources[k].matrix), 4, 4, last[5]};
        if (!proximity_call(set, WRITE_PART_ROW, words)) {
            return NULL;
        }
        nodes += made->parts[k].node_count;
    }
    int64_t numbers = NODE_STRIDE * nodes;
    float *collected = malloc((size_t)numbers * sizeof *collected);
    for (int64_t k = 0; collected != NULL && k < made->part_count; k++) {
        int64_t words[] = {WORD(sources[k].model), sources[k].row, WORD(collected), numbers, last[2], last[3], k};
        proximity_call(set, COPY_NODES, words); /* allocates no memory */
    }
    return collected;
}

static int plan(const InstructionSet *set, const float *nodes, int64_t numbers, const Archive *made, Plan *plan)
{
    int64_t words[15] = {WORD(nodes), numbers, WORD(made->frames), made->frame_count, WORD(made->parts), made->part_rows};
    if (!proximity_call(set, PLAN_SCENE, words)) {
        return 0;
    }
    memcpy(plan->static_nodes, words + 6, sizeof plan->static_nodes);
    plan->owners[0] = (Owner *)(intptr_t)words[8];
    memcpy(plan->entries, words + 9, sizeof plan->entries);
    plan->owners[1] = (Owner *)(intptr_t)words[12];
    plan->reals = words[13];
    plan->words = words[14];
    return 1;
}

void *proximity_take_rows(Archive *made, int64_t part_count)
{
    size_t rows = (size_t)part_count + 1;
    char *space = calloc(rows, sizeof(Frame) + sizeof(Part));
    if (space != NULL) {
        made->frames = (Frame *)space;
        made->parts = (Part *)(space + rows * sizeof(Frame));
        made->frame_count = made->part_rows = (int64_t)rows;
        made->part_count = part_count;
    }
    return space;
}

void *proximity_take_block(Archive *made, int64_t real_count, int64_t word_count)
{
    size_t reals = on_line((size_t)real_count * sizeof(double)), words = on_line((size_t)word_count * sizeof(float));
    size_t frames = (size_t)made->frame_count * sizeof(Frame), parts = (size_t)made->part_rows * sizeof(Part);
    char *block = malloc(reals + words + on_line(frames) + parts + LINE);
    if (block == NULL) {
        return NULL;
    }
    char *at = block + (LINE - (uintptr_t)block % LINE) % LINE;
    made->reals = (double *)at;
    made->real_count = real_count;
    made->words = (float *)(at + reals);
    made->word_count = word_count;
    made->frames = memcpy(at + reals + words, made->frames, frames);
    made->parts = memcpy(at + reals + words + on_line(frames), made->parts, parts);
    return block;
}

/* Copy arrays into a planned model, and complete it. */
static int fill(proximity_scene *scene, const Source *sources, const float *nodes, int64_t numbers, const Plan *plan)
{
    for (int64_t k = 0; k < scene->archive.part_count; k++) {
        int64_t words[] = {WORD(sources[k].model), sources[k].row, WORD(scene->model), k};
        proximity_call(scene->set, COPY_PART, words);
    }
    int64_t words[] = {WORD(scene->model), WORD(nodes), numbers, plan->static_nodes[0], plan->static_nodes[1],
                       plan->entries[0], plan->entries[1], plan->entries[2]};
    return proximity_call(scene->set, FINISH_SCENE, words);
}

/* Store names and reasons, each terminated by a zero. */
static int copy_texts(proximity_scene *scene, const Source *sources)
{
    int64_t count = scene->archive.part_count;
    size_t names = 1, reasons = (size_t)count * sizeof(char *);
    for (int64_t k = 0; k < count; k++) {
        names += strlen(sources[k].name) + 1;
        reasons += strlen(sources[k].reason) + 1;
    }
    char *name = scene->archive.names = malloc(names);
    const char **kept = scene->reasons = malloc(reasons);
    if (name == NULL || kept == NULL) {
        return 0;
    }
    char *reason = (char *)(kept + count);
    for (int64_t k = 0; k < count; k++) {
        strcpy(name, sources[k].name);
        name += strlen(name) + 1;
        kept[k] = strcpy(reason, sources[k].reason);
        reason += strlen(reason) + 1;
    }
    return 1;
}

proximity_scene *proximity_assemble(const InstructionSet *set, const Source *sources, int64_t count, int *is_far)
{
    proximity_scene *scene = calloc(1, sizeof *scene);
    *is_far = 0;
    if (scene == NULL) {
        return NULL;
    }
    Archive *made = &scene->archive;
    scene->references = 1;
    scene->set = set;
    void *space = proximity_take_rows(made, count);
    float *nodes = space != NULL ? collect(set, sources, made) : NULL;
    Plan planned = {0};
    int64_t numbers = nodes != NULL ? NODE_STRIDE * (made->parts[count - 1].root + made->parts[count - 1].node_count) : 0;
    int is_done = nodes != NULL && plan(set, nodes, numbers, made, &planned);
    *is_far = is_done && planned.reals == 0;
    if (is_done && !*is_far) {
        scene->copies = proximity_take_block(made, planned.reals, planned.words);
    }
    is_done = scene->copies != NULL && copy_texts(scene, sources);
    if (is_done) {
        proximity_write_model(scene->model, made);
        is_done = fill(scene, sources, nodes, numbers, &planned) && proximity_begin_changes(scene);
    }
    for (int k = 0; k < 2; k++) {
        if (planned.owners[k] != NULL) {
            release_owner(planned.owners[k]);
        }
    }
    free(nodes);
    free(space);
    if (!is_done) {
        proximity_release(scene);
        return NULL;
    }
    return scene;
}

/* Move the parts of another scene to a scene; the other one is freed with the previous parts. */
static void exchange(proximity_scene *scene, proximity_scene *made)
{
    proximity_scene before = *scene;
    *scene = *made;
    scene->set = before.set;
    scene->log = before.log;
    scene->log_user = before.log_user;
    scene->noted = before.noted;
    scene->references = before.references;
    scene->changes = before.changes + 1;
    scene->epoch = before.epoch + 1;
    *made = before;
    made->references = 1;
    proximity_release(made);
}

/* --- the interface -------------------------------------------------------------------------------------- */

const char *proximity_sign_reason(const proximity_scene *scene, int32_t part)
{
    int is_known = scene != NULL && scene->reasons != NULL && part >= 0 && part < scene->archive.part_count;
    return is_known && *scene->reasons[part] != '\0' ? scene->reasons[part] : NULL;
}

int proximity_new_scene(proximity_scene **scene, proximity_error *error)
{
    if (scene == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there is no place for the scene");
    }
    proximity_scene *made = calloc(1, sizeof *made);
    if (made == NULL) {
        return proximity_no_memory(error, "for the scene");
    }
    made->references = 1;
    if ((made->archive.names = calloc(1, 1)) == NULL || !proximity_begin_changes(made)) {
        proximity_close(made);
        return proximity_no_memory(error, "for the scene");
    }
    int code = proximity_choose_set(made, error);
    if (code != PROXIMITY_OK) {
        proximity_close(made);
        return code;
    }
    *scene = made;
    return PROXIMITY_OK;
}

/* The matrix of an added part: that of the addition, times its own. */
static void multiply(const double *outer, double *own)
{
    double product[16];
    for (int row = 0; row < 4; row++) {
        for (int column = 0; column < 4; column++) {
            double sum = 0.0;
            for (int k = 0; k < 4; k++) {
                sum += outer[4 * row + k] * own[4 * k + column];
            }
            product[4 * row + column] = sum;
        }
    }
    memcpy(own, product, sizeof product);
}

static int is_identity(const double *matrix)
{
    for (int k = 0; k < 16; k++) {
        if (matrix[k] != (k % 5 == 0 ? 1.0 : 0.0)) {
            return 0;
        }
    }
    return 1;
}

static int check_added(const proximity_scene *scene, const proximity_scene *added, Source *sources, const double *matrix,
                       proximity_error *error)
{
    for (int64_t k = 0; k < added->archive.part_count; k++) {
        if (proximity_find_part(scene, added->names[k]) != PROXIMITY_NO_PART) {
            return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                    "the scene has a part named '%.80s', expected another name", added->names[k]);
        }
        write_source(&sources[k], added, k);
        if (matrix != NULL && !is_identity(matrix)) {
            multiply(matrix, sources[k].matrix);
        }
        if (proximity_first_unfit(added, 1, sources[k].matrix, NULL, NULL) >= 0) {
            return proximity_refuse_pose(added->names[k], matrix != NULL ? matrix : sources[k].matrix, NULL, NULL, error);
        }
    }
    return PROXIMITY_OK;
}

/* Replace the parts of a scene. */
static int rebuild(proximity_scene *scene, const Source *sources, int64_t count, proximity_error *error)
{
    int is_far;
    proximity_scene *made = proximity_assemble(scene->set, sources, count, &is_far);
    if (made == NULL) {
        return is_far ? proximity_refuse(error, PROXIMITY_BAD_POSE, "the parts are too far apart to be in one scene")
                      : proximity_no_memory(error, "for the scene");
    }
    made->next_identity = scene->next_identity;
    for (int64_t k = 0; k < count; k++) {
        made->identities[k] = sources[k].model == scene->model ? scene->identities[sources[k].row] : made->next_identity++;
    }
    exchange(scene, made);
    return PROXIMITY_OK;
}

int proximity_add_scene(proximity_scene *scene, const proximity_scene *added, const double *matrix, int32_t *first,
                        proximity_error *error)
{
    if (scene == NULL || added == NULL || scene == added || scene->is_broken || added->archive.part_count == 0) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "there is no scene, or nothing to add: expected two scenes, the added one with parts");
    }
    int64_t before = scene->archive.part_count, count = before + added->archive.part_count;
    Source *sources = malloc((size_t)count * sizeof *sources);
    if (sources == NULL) {
        return proximity_no_memory(error, "for the scene");
    }
    for (int64_t k = 0; k < before; k++) {
        write_source(&sources[k], scene, k);
    }
    int code = check_added(scene, added, sources + before, matrix, error);
    if (code == PROXIMITY_OK) {
        code = rebuild(scene, sources, count, error);
    }
    if (code == PROXIMITY_OK && first != NULL) {
        *first = (int32_t)before;
    }
    free(sources);
    return code;
}

int proximity_add(proximity_scene *scene, const char *name, const double *vertices, size_t vertex_count,
                  const int32_t *faces, size_t face_count, const double *matrix, int32_t *first, proximity_error *error)
{
    proximity_scene *added;
    int code = proximity_from_mesh(name, vertices, vertex_count, faces, face_count, &added, error);
    if (code == PROXIMITY_OK) {
        code = proximity_add_scene(scene, added, matrix, first, error);
        proximity_close(added);
    }
    return code;
}

int proximity_remove(proximity_scene *scene, int32_t part, proximity_error *error)
{
    int unusable = proximity_refuse_scene(scene, error);
    if (unusable) {
        return unusable;
    }
    int64_t count = scene->archive.part_count;
    if (part < 0 || part >= count) {
        return proximity_no_such_part(scene, part, error);
    }
    if (count == 1) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "it is the only part, expected one that leaves others; close the scene, or hide the part");
    }
    Source *sources = malloc((size_t)count * sizeof *sources);
    if (sources == NULL) {
        return proximity_no_memory(error, "for the scene");
    }
    for (int64_t k = 0, to = 0; k < count; k++) {
        if (k != part) {
            write_source(&sources[to++], scene, k);
        }
    }
    int code = rebuild(scene, sources, count - 1, error);
    free(sources);
    return code;
}
