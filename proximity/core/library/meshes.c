/* The bodies of a mesh as a scene: kernels split, weld, sign and build; this file allocates memory between them. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "assembled.h"
#include "entry_points.h"

#define WORD(address) ((int64_t)(intptr_t)(address))

enum { REASON_SIZE = 400, BODIES_WORDS = 25, PLAN_WORDS = 23 };

/* A body: its model, and the memory of that. */
typedef struct {
    const double *vertices;
    int32_t *faces;
    int64_t vertex_count, face_count, model[8];
    Archive archive;
    void *rows, *block; /* from `proximity_take_rows` and `proximity_take_block` */
    char reason[REASON_SIZE];
} Body;

typedef struct {
    const InstructionSet *set;
    proximity_error *error;
    int64_t given_faces, count;
    Body *bodies;
    int64_t split[BODIES_WORDS]; /* arguments and results of `split_faces` */
} Split;

/* Free an array of a kernel by its owner in a word, unless that is 0. */
static void give_back(int64_t word)
{
    if (word != 0) {
        release_owner((Owner *)(intptr_t)word);
    }
}

/* --- arguments ------------------------------------------------------------------------------------------- */

static int check_faces(const int32_t *faces, int64_t count, int64_t vertices, proximity_error *error)
{
    for (int64_t k = 0; k < 3 * count; k++) {
        if (faces[k] < 0 || faces[k] >= vertices) {
            return proximity_refuse(error, PROXIMITY_BAD_MESH, "face %lld refers to vertex %d, but the mesh has %lld vertices",
                                    (long long)(k / 3), (int)faces[k], (long long)vertices);
        }
    }
    return PROXIMITY_OK;
}

/* Report the first face with a vertex that is not finite. */
static int check_vertices(const double *vertices, const int32_t *faces, int64_t count, proximity_error *error)
{
    for (int64_t k = 0; k < 3 * count; k++) {
        const double *at = vertices + 3 * (int64_t)faces[k];
        if (!isfinite(at[0]) || !isfinite(at[1]) || !isfinite(at[2])) {
            return proximity_refuse(error, PROXIMITY_BAD_MESH, "vertex %d of face %lld is not finite: (%g, %g, %g)",
                                    (int)faces[k], (long long)(k / 3), at[0], at[1], at[2]);
        }
    }
    return PROXIMITY_OK;
}

static int check_mesh(const char *name, const double *vertices, size_t vertex_count, const int32_t *faces,
                      size_t face_count, proximity_scene **scene, proximity_error *error)
{
    if (name == NULL || vertices == NULL || faces == NULL || scene == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there is no name, no array, or no place for the scene");
    }
    if (face_count == 0) {
        return proximity_refuse(error, PROXIMITY_BAD_MESH, "the mesh has no faces, expected at least one");
    }
    if (face_count > INT32_MAX || vertex_count > INT32_MAX) {
        return proximity_refuse(error, PROXIMITY_BAD_MESH, "the mesh has more than 2147483647 faces or vertices");
    }
    int code = check_faces(faces, (int64_t)face_count, (int64_t)vertex_count, error);
    return code != PROXIMITY_OK ? code : check_vertices(vertices, faces, (int64_t)face_count, error);
}

/* --- bodies ---------------------------------------------------------------------------------------------- */

static int split_faces(Split *split, const double *vertices, int64_t vertex_count, const int32_t *faces)
{
    int64_t given[] = {WORD(vertices), vertex_count, 3, WORD(faces), split->given_faces, 3};
    int64_t *words = split->split;
    memcpy(words, given, sizeof given);
    if (!proximity_call(split->set, SPLIT_FACES, words)) {
        words[9] = words[13] = words[16] = words[20] = words[24] = 0;
        return proximity_no_memory(split->error, "for the mesh");
    }
    split->count = words[18];
    if (split->count == 0) {
        return proximity_refuse(split->error, PROXIMITY_BAD_MESH,
                                "none of the %lld faces has an area, expected at least one that has",
                                (long long)split->given_faces);
    }
    split->bodies = calloc((size_t)split->count, sizeof *split->bodies);
    if (split->bodies == NULL) {
        return proximity_no_memory(split->error, "for the mesh");
    }
    const int64_t *ends = (const int64_t *)(intptr_t)words[17];
    int64_t vertex = 0, face = 0;
    for (int64_t k = 0; k < split->count; k++) {
        Body *body = &split->bodies[k];
        body->vertices = (const double *)(intptr_t)words[6] + 3 * vertex;
        body->faces = (int32_t *)(intptr_t)words[10] + 3 * face;
        body->vertex_count = ends[2 * k] - vertex;
        body->face_count = ends[2 * k + 1] - face;
        vertex = ends[2 * k];
        face = ends[2 * k + 1];
    }
    return PROXIMITY_OK;
}

/* The frame shared by several bodies: centre and scale; scale 0: separate frames. */
static int choose_frame(const Split *split, double *frame)
{
    double lower[3] = {INFINITY, INFINITY, INFINITY}, upper[3] = {-INFINITY, -INFINITY, -INFINITY};
    const Body *last = &split->bodies[split->count - 1];
    const double *first = split->bodies[0].vertices;
    int64_t words[] = {WORD(lower), 3, WORD(upper), 3, WORD(frame), 3, 0};
    memset(frame, 0, 4 * sizeof *frame);
    if (split->count == 1) {
        return 1;
    }
    for (const double *at = first; at < last->vertices + 3 * last->vertex_count; at += 3) {
        for (int axis = 0; axis < 3; axis++) {
            lower[axis] = fmin(lower[axis], at[axis]);
            upper[axis] = fmax(upper[axis], at[axis]);
        }
    }
    proximity_call(split->set, FRAME_OF_BOX, words); /* allocates no memory */
    memcpy(&frame[3], &words[6], sizeof(double));
    frame[3] *= MOVING_MARGIN;
    return frame[3] > 0.0;
}

/* Reverse all faces. */
static void flip(Body *body)
{
    for (int32_t *face = body->faces; face < body->faces + 3 * body->face_count; face += 3) {
        int32_t first = face[0];
        face[0] = face[2];
        face[2] = first;
    }
}

/* Connections between the faces of a body: words of `face_topology`, whose arrays the caller frees. */
static int connect(const Split *split, const Body *body, int64_t *words)
{
    int64_t given[] = {WORD(body->faces), body->face_count, 3};
    memcpy(words, given, sizeof given);
    if (!proximity_call(split->set, FACE_TOPOLOGY, words)) {
        words[6] = words[9] = 0;
        return 0;
    }
    return 1;
}

static int is_inside_out(const Split *split, const Body *body)
{
    double volume;
    int64_t words[] = {WORD(body->vertices), body->vertex_count, 3, WORD(body->faces), body->face_count, 3, 0};
    int is_done = proximity_call(split->set, SIGNED_VOLUME, words);
    memcpy(&volume, &words[6], sizeof volume);
    return is_done && volume < 0.0;
}

/* The rows of a body, and its tree: words of `plan_part`, whose arrays the caller frees. */
static int plan(const Split *split, Body *body, double *frame, int64_t *words)
{
    Archive *archive = &body->archive;
    body->rows = proximity_take_rows(archive, 1);
    if (body->rows == NULL) {
        return 0;
    }
    int64_t given[] = {WORD(body->vertices), body->vertex_count, 3, WORD(body->faces), body->face_count, 3, WORD(frame), 4,
                       WORD(archive->frames), 2, WORD(archive->parts), 2};
    memcpy(words, given, sizeof given);
    if (!proximity_call(split->set, PLAN_PART, words)) {
        words[14] = words[17] = words[20] = 0;
        return 0;
    }
    return 1;
}

/* Fill a body's arrays and choose its sign; *edges*: words of `face_topology`. */
static int fill(const Split *split, Body *body, const int64_t *planned, const int64_t *edges, int is_flipped)
{
    const int64_t *counts = (const int64_t *)(intptr_t)edges[7];
    proximity_write_model(body->model, &body->archive);
    int64_t words[] = {WORD(body->model), planned[12], planned[13], planned[15], planned[16], planned[18], planned[19],
                       WORD(body->vertices), body->vertex_count, 3, WORD(body->faces), body->face_count, 3,
                       edges[3], edges[4], edges[5]};
    int64_t asked[] = {WORD(body->model), counts[1] + counts[2] + counts[3] == 0, counts[4] == 0, 0, 0, 0, 0, 0, 0};
    if (!proximity_call(split->set, FILL_PART, words) || !proximity_call(split->set, CHOOSE_SIGN, asked)) {
        return 0;
    }
    double share;
    memcpy(&share, &asked[8], sizeof share);
    proximity_write_reason(body->reason, sizeof body->reason, asked + 3, share, is_flipped);
    return 1;
}

/* Build one body. */
static int build(const Split *split, Body *body, double *frame)
{
    int64_t edges[10] = {0}, planned[PLAN_WORDS] = {0};
    int is_done = connect(split, body, edges), is_flipped = 0, is_far = 0;
    if (is_done && ((const int64_t *)(intptr_t)edges[7])[4] == 0 && is_inside_out(split, body)) {
        is_flipped = 1;
        flip(body);
        give_back(edges[6]);
        give_back(edges[9]);
        is_done = connect(split, body, edges);
    }
    is_done = is_done && plan(split, body, frame, planned);
    is_far = is_done && planned[21] == 0;
    body->block = is_done && !is_far ? proximity_take_block(&body->archive, planned[21], planned[22]) : NULL;
    is_done = body->block != NULL && fill(split, body, planned, edges, is_flipped);
    give_back(edges[6]);
    give_back(edges[9]);
    give_back(planned[14]);
    give_back(planned[17]);
    give_back(planned[20]);
    if (is_far) {
        return proximity_refuse(split->error, PROXIMITY_BAD_MESH,
                                "the part is too far from the origin or too small to be computed with; expected "
                                "coordinates up to %g m and sizes from %g m", MAX_COORDINATE, SMALLEST_SIZE);
    }
    return is_done ? PROXIMITY_OK : proximity_no_memory(split->error, "for the mesh");
}

/* --- the scene of them ----------------------------------------------------------------------------------- */

static int assemble(const Split *split, const char *name, proximity_scene **scene)
{
    int is_far = 0;
    size_t count = (size_t)split->count, length = strlen(name) + 24;
    char *names = malloc(count * length);
    Source *sources = calloc(count, sizeof *sources);
    proximity_scene *made = NULL;
    for (size_t k = 0; names != NULL && sources != NULL && k < count; k++) {
        char *own = names + k * length;
        snprintf(own, length, count == 1 ? "%s" : "%s.%zu", name, k + 1);
        sources[k].model = split->bodies[k].model;
        sources[k].name = own;
        sources[k].reason = split->bodies[k].reason;
        for (int axis = 0; axis < 4; axis++) {
            sources[k].matrix[5 * axis] = 1.0;
        }
    }
    if (names != NULL && sources != NULL) {
        made = proximity_assemble(split->set, sources, split->count, &is_far);
    }
    free(names);
    free(sources);
    if (made == NULL) {
        return is_far ? proximity_refuse(split->error, PROXIMITY_BAD_MESH, "the bodies of the mesh are too far apart")
                      : proximity_no_memory(split->error, "for the mesh");
    }
    *scene = made;
    return PROXIMITY_OK;
}

static int build_all(Split *split, const char *name, proximity_scene **scene)
{
    double frame[4];
    if (!choose_frame(split, frame)) {
        return proximity_refuse(split->error, PROXIMITY_BAD_MESH,
                                "the mesh is too far from the origin or too small to be computed with; expected "
                                "coordinates up to %g m and sizes from %g m", MAX_COORDINATE, SMALLEST_SIZE);
    }
    for (int64_t k = 0; k < split->count; k++) {
        int code = build(split, &split->bodies[k], frame);
        if (code != PROXIMITY_OK) {
            return code;
        }
    }
    return assemble(split, name, scene);
}

int proximity_from_mesh(const char *name, const double *vertices, size_t vertex_count, const int32_t *faces,
                        size_t face_count, proximity_scene **scene, proximity_error *error)
{
    int code = check_mesh(name, vertices, vertex_count, faces, face_count, scene, error);
    Split split = {proximity_best_set(NULL), error, (int64_t)face_count, 0, NULL, {0}};
    if (code == PROXIMITY_OK && split.set == NULL) {
        return proximity_refuse_processor(error);
    }
    if (code == PROXIMITY_OK) {
        code = split_faces(&split, vertices, (int64_t)vertex_count, faces);
    }
    if (code == PROXIMITY_OK) {
        code = build_all(&split, name, scene);
    }
    for (int64_t k = 0; split.bodies != NULL && k < split.count; k++) {
        free(split.bodies[k].rows);
        free(split.bodies[k].block);
    }
    free(split.bodies);
    static const int owners[] = {9, 13, 16, 20, 24};
    for (size_t k = 0; k < sizeof owners / sizeof *owners; k++) {
        give_back(split.split[owners[k]]);
    }
    return code;
}
