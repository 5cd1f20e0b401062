/* Scenes: opening them, and moving and hiding their parts. */
#include "scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WORD(address) ((int64_t)(intptr_t)(address))

static int64_t word_of(double value)
{
    int64_t word;
    memcpy(&word, &value, sizeof word);
    return word;
}

void proximity_write_model(int64_t *model, const Archive *a)
{
    int64_t words[] = {WORD(a->reals), a->real_count, WORD(a->words), a->word_count,
                       WORD(a->frames), a->frame_count, WORD(a->parts), a->part_rows};
    memcpy(model, words, sizeof words);
}

/* --- opening ------------------------------------------------------------------------------------------- */

/* Copy the arrays that a scene changes, so that the caller's bytes stay unchanged. */
static int copy_changed(proximity_scene *scene)
{
    Archive *archive = &scene->archive;
    size_t words = (size_t)archive->word_count * sizeof(float), gap = (size_t)PAGE;
    size_t frames = (size_t)archive->frame_count * sizeof(Frame), parts = (size_t)archive->part_rows * sizeof(Part);
    char *copy = scene->copies = malloc(words + frames + parts + gap);
    if (copy == NULL) {
        return 0;
    }
    copy += (gap - (size_t)((uintptr_t)copy % gap)) % gap;
    archive->frames = memcpy(copy, archive->frames, frames);
    archive->parts = memcpy(copy + frames, archive->parts, parts);
    archive->words = memcpy(copy + frames + parts, archive->words, words);
    return 1;
}

static void list_dynamic(proximity_scene *scene)
{
    int64_t count = 0;
    for (int64_t part = 0; part < scene->archive.part_count; part++) {
        if (scene->archive.parts[part].is_dynamic) {
            scene->rows[count] = part;
            scene->order[count] = count;
            count++;
        }
    }
    scene->dynamic[1] = scene->dynamic[3] = scene->dynamic[5] = count;
    scene->sort_steps = count * count;
}

/* Allocate the arrays that depend on the poses. */
int proximity_begin_changes(proximity_scene *scene)
{
    size_t count = (size_t)scene->archive.part_count;
    scene->versions = calloc(5 * count + 1, sizeof(int64_t));
    scene->boxes = calloc(6 * count + 1, sizeof(float));
    scene->names = calloc(count + 1, sizeof(char *));
    if (scene->versions == NULL || scene->boxes == NULL || scene->names == NULL) {
        return 0;
    }
    scene->rows = scene->versions + count + 1;
    scene->order = scene->rows + count;
    scene->keys = scene->order + count;
    scene->identities = scene->keys + count;
    scene->next_identity = (int64_t)count;
    scene->dynamic[0] = WORD(scene->rows);
    scene->dynamic[2] = WORD(scene->order);
    scene->dynamic[4] = WORD(scene->keys);
    scene->boxes_version = NEVER;
    const char *name = scene->archive.names;
    for (size_t part = 0; part < count; part++, name += strlen(name) + 1) {
        scene->names[part] = name;
        scene->identities[part] = (int64_t)part;
    }
    list_dynamic(scene);
    return 1;
}

/* Validate the model with kernels, and complete it. */
static int complete(proximity_scene *scene, proximity_error *error)
{
    Archive *a = &scene->archive;
    int64_t fault[FAULT_SIZE + 2] = {0};
    int64_t words[] = {WORD(a->reals), a->real_count, WORD(a->words), a->word_count, WORD(a->frames), a->frame_count,
                       WORD(a->parts), a->part_rows, WORD(a->parts), a->part_rows, PART_COLUMNS, a->part_count,
                       word_of(ORTHONORMAL_TOLERANCE), word_of(FARTHEST_MOVE), word_of(FASTEST_MOVE), WORD(fault),
                       FAULT_SIZE, 0};
    if (!proximity_call(scene->set, COMPLETE_MODEL, words)) {
        return proximity_no_memory(error, "for the scene");
    }
    int64_t kind = words[17], part = fault[0];
    if (kind == SOUND) {
        memcpy(scene->model, words, sizeof scene->model);
        return PROXIMITY_OK;
    }
    if (part < 0 || part > a->part_count || part >= a->part_rows) {
        return proximity_refuse_kind(error, kind, fault + 1, "", "");
    }
    fault[FAULT_SIZE] = a->parts[part].node_count;
    fault[FAULT_SIZE + 1] = a->parts[part].block_count;
    if (part == a->part_count) {
        return proximity_refuse_kind(error, kind, fault + 1, "", "the trees over the parts: ");
    }
    char where[128];
    const char *name = a->names;
    for (int64_t k = 0; k < part; k++) {
        name += strlen(name) + 1;
    }
    snprintf(where, sizeof where, "part %lld '%.80s': ", (long long)part, name);
    return proximity_refuse_kind(error, kind, fault + 1, "", where);
}

int proximity_refuse_processor(proximity_error *error)
{
    return proximity_refuse(error, PROXIMITY_NO_PROCESSOR,
                            "this processor has none of the instructions that the library was compiled for");
}

int proximity_choose_set(proximity_scene *scene, proximity_error *error)
{
    scene->set = proximity_best_set(NULL);
    return scene->set != NULL ? PROXIMITY_OK : proximity_refuse_processor(error);
}

/* Open bytes owned by the scene or by the caller. */
static int open_scene(uint8_t *bytes, size_t size, int is_own, proximity_scene **opened, proximity_error *error)
{
    proximity_scene *scene = calloc(1, sizeof *scene);
    if (scene == NULL) {
        return proximity_no_memory(error, "for the scene");
    }
    int code;
    scene->references = 1;
    code = proximity_choose_set(scene, error);
    if (code == PROXIMITY_OK) {
        code = proximity_read_archive(scene->set, bytes, size, &scene->archive, error);
    }
    if (code == PROXIMITY_OK && !is_own && !copy_changed(scene)) {
        code = proximity_no_memory(error, "for the scene");
    }
    if (code == PROXIMITY_OK) {
        code = complete(scene, error);
    }
    if (code == PROXIMITY_OK && !proximity_begin_changes(scene)) {
        code = proximity_no_memory(error, "for the scene");
    }
    if (code != PROXIMITY_OK) {
        proximity_close(scene);
        return code;
    }
    *opened = scene;
    return PROXIMITY_OK;
}

/* Prefix an error message with the file name; a message that is too long is cut. */
static void name_file(const char *path, proximity_error *error)
{
    if (error != NULL) {
        proximity_error told = *error;
        proximity_refuse(error, told.code, "%.200s: %s", path, told.sentence);
    }
}

int proximity_open(const char *path, proximity_scene **scene, proximity_error *error)
{
    uint8_t *bytes;
    size_t size;
    if (path == NULL || scene == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there is no path, or no place for the scene");
    }
    int code = proximity_map_file(path, &bytes, &size, error);
    if (code != PROXIMITY_OK) {
        return code;
    }
    code = open_scene(bytes, size, 1, scene, error);
    if (code != PROXIMITY_OK) {
        name_file(path, error);
        proximity_unmap(bytes, size);
        return code;
    }
    (*scene)->mapped = bytes;
    (*scene)->mapped_size = size;
    return PROXIMITY_OK;
}

int proximity_open_bytes(const void *bytes, size_t size, proximity_scene **scene, proximity_error *error)
{
    if (bytes == NULL || scene == NULL || (uintptr_t)bytes % 8 != 0) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "there are no bytes, or no place for the scene; or the bytes do not lie at a multiple "
                                "of 8");
    }
    return open_scene((uint8_t *)(uintptr_t)bytes, size, 0, scene, error);
}

proximity_scene *proximity_scene_over(const int64_t *model)
{
    proximity_scene *scene = calloc(1, sizeof *scene);
    if (scene == NULL) {
        return NULL;
    }
    Archive *archive = &scene->archive;
    scene->references = 1;
    memcpy(scene->model, model, sizeof scene->model);
    archive->frames = (Frame *)(intptr_t)model[4];
    archive->parts = (Part *)(intptr_t)model[6];
    archive->frame_count = model[5];
    archive->part_rows = model[7];
    archive->part_count = model[7] - 1;
    archive->names = calloc((size_t)model[7], 1); /* empty names, which are not used */
    scene->set = proximity_best_set(NULL);
    if (archive->names == NULL || scene->set == NULL || !proximity_begin_changes(scene)) {
        proximity_close(scene);
        return NULL;
    }
    return scene;
}

void proximity_keep(const proximity_scene *scene)
{
    __atomic_add_fetch(&((proximity_scene *)(uintptr_t)scene)->references, 1, __ATOMIC_RELAXED);
}

void proximity_release(const proximity_scene *kept)
{
    proximity_scene *scene = (proximity_scene *)(uintptr_t)kept;
    if (scene != NULL && __atomic_sub_fetch(&scene->references, 1, __ATOMIC_ACQ_REL) == 0) {
        if (scene->mapped != NULL) {
            proximity_unmap(scene->mapped, scene->mapped_size);
        }
        free(scene->archive.names);
        free(scene->versions);
        free(scene->boxes);
        free(scene->names);
        free(scene->reasons);
        free(scene->copies);
        free(scene->posts);
        free(scene);
    }
}

void proximity_close(proximity_scene *scene)
{
    proximity_release(scene);
}

int proximity_use_instructions(proximity_scene *scene, const char *name, proximity_error *error)
{
    if (scene == NULL) {
        return proximity_refuse_scene(scene, error);
    }
    const InstructionSet *set = name != NULL ? proximity_best_set(name) : NULL;
    if (set == NULL) {
        return proximity_refuse(error, PROXIMITY_NO_PROCESSOR,
                                "there are no instructions %s that the library was compiled for and this processor has",
                                name != NULL ? name : "without a name");
    }
    scene->set = set;
    return PROXIMITY_OK;
}

/* --- changes ------------------------------------------------------------------------------------------- */

int proximity_refuse_scene(const proximity_scene *scene, proximity_error *error)
{
    if (scene == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "the scene is NULL, expected one that is open");
    }
    if (scene->archive.part_count == 0) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "the scene has no parts, expected at least one: add a mesh");
    }
    return scene->is_broken
               ? proximity_refuse(error, PROXIMITY_BROKEN, "a change of the scene failed half way; close it")
               : PROXIMITY_OK;
}

static int fail_half_way(proximity_scene *scene, proximity_error *error)
{
    scene->is_broken = 1;
    return proximity_refuse(error, PROXIMITY_BROKEN, "a change of the scene failed half way; close it");
}

/* The copy of the static tree that the model is not using. */
static int64_t next_static(const proximity_scene *scene, int *is_done)
{
    int64_t words[] = {scene->model[6], scene->model[7], 0, 0};
    *is_done = proximity_call(scene->set, COPIES_IN_USE, words);
    return (words[3] + 1) % STATIC_COPIES;
}

static int make_tree(proximity_scene *scene)
{
    int is_done;
    int64_t copy = next_static(scene, &is_done);
    int64_t words[] = {scene->model[2], scene->model[3], scene->model[4], scene->model[5],
                       scene->model[6], scene->model[7], copy, 0};
    if (!is_done || !proximity_call(scene->set, MAKE_STATIC, words)) {
        return 0;
    }
    if (!(words[7] & 1)) { /* no space: then it is empty, and each part is separate */
        for (int64_t part = 0; part < scene->archive.part_count; part++) {
            scene->archive.parts[part].is_dynamic = 1;
        }
        if (!proximity_call(scene->set, MAKE_STATIC, words) || !(words[7] & 1)) {
            return 0;
        }
    }
    scene->boxes_version = NEVER;
    return 1;
}

static int thin_tree(proximity_scene *scene)
{
    int is_done;
    int64_t copy = next_static(scene, &is_done);
    int64_t words[] = {scene->model[2], scene->model[3], scene->model[6], scene->model[7], copy};
    return is_done && proximity_call(scene->set, THIN_STATIC, words);
}

/* Update all that depends on the poses; return the extent of the parts, or nan. */
static double bring_up_to_date(proximity_scene *scene)
{
    Archive *a = &scene->archive;
    int64_t words[] = {scene->model[2], scene->model[3], WORD(a->frames), a->frame_count, WORD(a->parts), a->part_rows,
                       WORD(scene->versions), a->part_rows, scene->boxes_version, WORD(scene->boxes), a->part_count, 6,
                       WORD(scene->dynamic), scene->sort_steps, a->parts[a->part_count].super_node, INT64_MAX,
                       WORD(a->frames), a->frame_count, WORD(a->parts), a->part_rows, 0};
    double reach = NAN;
    if (proximity_call(scene->set, BRING_UP_TO_DATE, words)) {
        memcpy(&reach, &words[20], sizeof reach);
    }
    return reach;
}

/* Update the trees over the parts. */
static int settle(proximity_scene *scene, proximity_error *error)
{
    int is_right = 1;
    if (scene->archive.part_count > 1 && scene->tree != RIGHT) { /* a single part has no tree above it */
        is_right = scene->tree == THINNER ? thin_tree(scene) : make_tree(scene);
        list_dynamic(scene);
    }
    scene->tree = RIGHT;
    double reach = is_right ? bring_up_to_date(scene) : NAN;
    if (reach > 1.0) { /* a part has left the scene's frame */
        is_right = make_tree(scene);
        list_dynamic(scene);
        reach = is_right ? bring_up_to_date(scene) : NAN;
    }
    scene->boxes_version = scene->changes;
    scene->sort_steps = SORT_STEPS * scene->dynamic[1];
    return reach <= 1.0 ? PROXIMITY_OK : fail_half_way(scene, error);
}

int proximity_no_such_part(const proximity_scene *scene, int32_t part, proximity_error *error)
{
    return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "there is no part %d, expected 0 to %d", (int)part,
                            (int)scene->archive.part_count - 1);
}

int64_t proximity_first_unfit(const proximity_scene *scene, int64_t n, const double *matrices, const double *velocities,
                              const double *angular_velocities)
{
    int64_t words[] = {WORD(matrices), n, 4, 4, WORD(velocities), velocities != NULL ? n : 0, 3,
                       WORD(angular_velocities), angular_velocities != NULL ? n : 0, 3, word_of(SINGLE_TOLERANCE),
                       word_of(FARTHEST_MOVE), word_of(FASTEST_MOVE), 0};
    return proximity_call(scene->set, FIRST_UNFIT, words) ? words[13] : 0;
}

/* Write valid poses; return whether that succeeded. */
static int write_poses(proximity_scene *scene, const int64_t *rows, int64_t n, const double *matrices,
                       const double *velocities, const double *angular_velocities)
{
    int64_t words[] = {scene->model[4], scene->model[5], scene->model[6], scene->model[7], WORD(scene->versions),
                       scene->archive.part_rows, scene->changes, WORD(rows), n, WORD(matrices), n, 4, 4,
                       WORD(velocities), velocities != NULL ? n : 0, 3, WORD(angular_velocities),
                       angular_velocities != NULL ? n : 0, 3, word_of(EXACT_ENOUGH), 0};
    if (!proximity_call(scene->set, MOVE_PARTS, words)) {
        return 0;
    }
    scene->tree = words[20] && scene->tree == RIGHT ? THINNER : scene->tree;
    return 1;
}

void proximity_put_parts(proximity_scene *scene, const int64_t *rows, int64_t count, const double *matrices,
                         const double *velocities, const double *angular_velocities)
{
    scene->changes++;
    scene->is_broken |= proximity_first_unfit(scene, count, matrices, velocities, angular_velocities) >= 0 ||
                        !write_poses(scene, rows, count, matrices, velocities, angular_velocities);
}

void proximity_settle(proximity_scene *scene)
{
    if (!scene->is_broken) {
        settle(scene, NULL);
    }
}

int proximity_move(proximity_scene *scene, const int32_t *parts, size_t count, const double *matrices,
                   const double *velocities, const double *angular_velocities, proximity_error *error)
{
    int unusable = proximity_refuse_scene(scene, error);
    if (unusable) {
        return unusable;
    }
    for (size_t k = 0; k < count; k++) {
        if (parts[k] < 0 || parts[k] >= scene->archive.part_count) {
            return proximity_no_such_part(scene, parts[k], error);
        }
    }
    int64_t unfit = proximity_first_unfit(scene, (int64_t)count, matrices, velocities, angular_velocities);
    if (unfit >= 0) {
        return proximity_refuse_pose(scene->names[parts[unfit]], matrices + 16 * unfit,
                                     velocities != NULL ? velocities + 3 * unfit : NULL,
                                     angular_velocities != NULL ? angular_velocities + 3 * unfit : NULL, error);
    }
    scene->changes++;
    for (size_t k = 0; k < count; k++) {
        int64_t row = parts[k];
        proximity_discard_posts(scene, parts[k]);
        if (!write_poses(scene, &row, 1, matrices + 16 * k, velocities != NULL ? velocities + 3 * k : NULL,
                         angular_velocities != NULL ? angular_velocities + 3 * k : NULL)) {
            return fail_half_way(scene, error);
        }
    }
    return settle(scene, error);
}

int proximity_set_surface(proximity_scene *scene, int32_t part, double stiffness, double damping,
                          proximity_error *error)
{
    if (scene == NULL) {
        return proximity_refuse_scene(scene, error);
    }
    if (part < 0 || part >= scene->archive.part_count) {
        return proximity_no_such_part(scene, part, error);
    }
    if (!(stiffness >= 0.0 && stiffness < INFINITY && damping >= 0.0 && damping < INFINITY) ||
        (stiffness == 0.0 && damping > 0.0)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT,
                                "stiffness is %g and damping %g, expected numbers above 0, or 0 and 0 of a rigid part",
                                stiffness, damping);
    }
    Frame *frame = &scene->archive.frames[part];
    frame->surface = stiffness > 0.0 ? SURFACE_DEFORMABLE : SURFACE_RIGID;
    frame->stiffness = stiffness;
    frame->damping = damping;
    return PROXIMITY_OK;
}

int proximity_hide(proximity_scene *scene, int32_t part, int is_hidden, proximity_error *error)
{
    int unusable = proximity_refuse_scene(scene, error);
    if (unusable) {
        return unusable;
    }
    if (part < 0 || part >= scene->archive.part_count) {
        return proximity_no_such_part(scene, part, error);
    }
    Part *row = &scene->archive.parts[part];
    if (row->is_hidden == (is_hidden != 0)) {
        return PROXIMITY_OK;
    }
    row->is_hidden = is_hidden != 0;
    scene->versions[part] = ++scene->changes;
    scene->epoch++;
    if (!row->is_dynamic) {
        scene->tree = is_hidden ? THINNER : NEW;
    }
    return settle(scene, error);
}
