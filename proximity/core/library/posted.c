/* Poses of parts posted by another thread: the newest pose of each part wins, without a lock. */
#include "scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { IS_NEW = 4, PARTS_A_WORD = 64 };
static const int64_t CARRIED_NS = 100000000; /* extrapolation after the instant of a pose */

typedef struct {
    int64_t pose_ns;
    double matrix[16], velocity[3], turning[3];
} Pose;

/* A triple buffer: one pose is written, one is read, and one is exchanged between the threads. */
typedef struct {
    Pose poses[3];
    int32_t written, read, between; /* index of the writer, of the reader, and of both (atomic, with IS_NEW) */
    int32_t is_listed, is_carried;  /* used by the reader */
} Slot;

struct Posts {
    uint64_t *new_parts; /* one bit per part (atomic) */
    int64_t *listed, *rows;
    int64_t listed_count;
    double *matrices, *velocities, *turnings;
    Slot *slots;
};

static struct Posts *create_posts(size_t parts)
{
    size_t words = parts / PARTS_A_WORD + 1, rows = words + 2 * parts;
    struct Posts *posts = calloc(1, sizeof *posts + rows * sizeof(int64_t) + 22 * parts * sizeof(double) +
                                        parts * sizeof(Slot));
    if (posts == NULL) {
        return NULL;
    }
    posts->new_parts = (uint64_t *)(posts + 1);
    posts->listed = (int64_t *)(posts->new_parts + words);
    posts->rows = posts->listed + parts;
    posts->matrices = (double *)(posts->rows + parts);
    posts->velocities = posts->matrices + 16 * parts;
    posts->turnings = posts->velocities + 3 * parts;
    posts->slots = (Slot *)(posts->turnings + 3 * parts);
    for (size_t part = 0; part < parts; part++) {
        posts->slots[part].read = 1;
        posts->slots[part].between = 2;
    }
    return posts;
}

int proximity_post(proximity_scene *scene, int32_t part, const double *matrix, int64_t pose_ns, const double *velocity,
                   const double *angular_velocity, proximity_error *error)
{
    if (scene == NULL) {
        return proximity_refuse_scene(scene, error);
    }
    if (part < 0 || part >= scene->archive.part_count) {
        return proximity_no_such_part(scene, part, error);
    }
    if (matrix == NULL) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "the matrix is NULL, expected 16 numbers");
    }
    if (!(pose_ns >= -MAX_NS && pose_ns <= MAX_NS)) {
        return proximity_refuse(error, PROXIMITY_BAD_ARGUMENT, "pose_ns is beyond 2^62 ns");
    }
    if (proximity_first_unfit(scene, 1, matrix, velocity, angular_velocity) >= 0) {
        return proximity_refuse_pose(scene->names[part], matrix, velocity, angular_velocity, error);
    }
    struct Posts *posts = __atomic_load_n(&scene->posts, __ATOMIC_RELAXED); /* only this thread writes it */
    if (posts == NULL) {
        posts = create_posts((size_t)scene->archive.part_count);
        if (posts == NULL) {
            return proximity_no_memory(error, "for poses");
        }
        __atomic_store_n(&scene->posts, posts, __ATOMIC_RELEASE);
    }
    static const double at_rest[3] = {0.0, 0.0, 0.0};
    Slot *slot = &posts->slots[part];
    Pose *pose = &slot->poses[slot->written];
    pose->pose_ns = pose_ns;
    memcpy(pose->matrix, matrix, sizeof pose->matrix);
    memcpy(pose->velocity, velocity != NULL ? velocity : at_rest, sizeof pose->velocity);
    memcpy(pose->turning, angular_velocity != NULL ? angular_velocity : at_rest, sizeof pose->turning);
    slot->written = __atomic_exchange_n(&slot->between, slot->written | IS_NEW, __ATOMIC_ACQ_REL) & ~IS_NEW;
    __atomic_fetch_or(&posts->new_parts[part / PARTS_A_WORD], 1ull << part % PARTS_A_WORD, __ATOMIC_RELEASE);
    return PROXIMITY_OK;
}

static void read_newest(struct Posts *posts, int64_t part)
{
    Slot *slot = &posts->slots[part];
    if (__atomic_load_n(&slot->between, __ATOMIC_RELAXED) & IS_NEW) {
        slot->read = __atomic_exchange_n(&slot->between, slot->read, __ATOMIC_ACQ_REL) & ~IS_NEW;
        slot->is_carried = 1;
        if (!slot->is_listed) {
            slot->is_listed = 1;
            posts->listed[posts->listed_count++] = part;
        }
    }
}

static void read_all(struct Posts *posts, int64_t parts)
{
    for (int64_t word = 0; word <= parts / PARTS_A_WORD; word++) {
        uint64_t *bits = &posts->new_parts[word];
        uint64_t left = __atomic_load_n(bits, __ATOMIC_RELAXED) ? __atomic_exchange_n(bits, 0, __ATOMIC_ACQUIRE) : 0;
        for (; left != 0; left &= left - 1) {
            read_newest(posts, word * PARTS_A_WORD + __builtin_ctzll(left));
        }
    }
}

static int is_moving(const Pose *pose)
{
    const double *v = pose->velocity, *w = pose->turning;
    return v[0] != 0.0 || v[1] != 0.0 || v[2] != 0.0 || w[0] != 0.0 || w[1] != 0.0 || w[2] != 0.0;
}

/* Extrapolate a matrix by the velocities of a pose. */
static void carry(double *matrix, const Pose *pose, double seconds)
{
    const double *w = pose->turning, rate = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    for (int row = 0; row < 3; row++) {
        matrix[4 * row + 3] += pose->velocity[row] * seconds;
    }
    if (!(rate > 0.0)) {
        return;
    }
    double x = w[0] / rate, y = w[1] / rate, z = w[2] / rate, sine = sin(rate * seconds), rest = 1.0 - cos(rate * seconds);
    for (int column = 0; column < 3; column++) { /* Rodrigues' formula, on each axis of the part */
        double a = matrix[column], b = matrix[4 + column], c = matrix[8 + column];
        double across[3] = {y * c - z * b, z * a - x * c, x * b - y * a};
        double back[3] = {y * across[2] - z * across[1], z * across[0] - x * across[2], x * across[1] - y * across[0]};
        for (int row = 0; row < 3; row++) {
            matrix[4 * row + column] += sine * across[row] + rest * back[row];
        }
    }
}

/* Write the row of a part at an instant; return whether it moves on from there. */
static int add_row(proximity_scene *scene, int64_t part, int64_t at, int64_t instant_ns)
{
    struct Posts *posts = scene->posts;
    const Pose *pose = &posts->slots[part].poses[posts->slots[part].read];
    double *matrix = posts->matrices + 16 * at, *velocity = posts->velocities + 3 * at, *turning = posts->turnings + 3 * at;
    int64_t first_ns = pose->pose_ns - CARRIED_NS, last_ns = pose->pose_ns + CARRIED_NS;
    int64_t at_ns = instant_ns < first_ns ? first_ns : instant_ns > last_ns ? last_ns : instant_ns;
    int goes_on = is_moving(pose) && instant_ns < last_ns;
    proximity_note_post(scene, part, pose->pose_ns, instant_ns);
    posts->rows[at] = part;
    memcpy(matrix, pose->matrix, sizeof pose->matrix);
    for (int axis = 0; axis < 3; axis++) {
        velocity[axis] = goes_on ? pose->velocity[axis] : 0.0;
        turning[axis] = goes_on ? pose->turning[axis] : 0.0;
    }
    if (is_moving(pose)) {
        carry(matrix, pose, 1e-9 * (double)(at_ns - pose->pose_ns));
        if (proximity_first_unfit(scene, 1, matrix, velocity, turning) >= 0) { /* too far away: keep the posted pose */
            memcpy(matrix, pose->matrix, sizeof pose->matrix);
        }
    }
    return goes_on;
}

int64_t proximity_newest_instant(const double *positions, const int64_t *pose_ns, int64_t count, int64_t now_ns)
{
    int64_t newest_ns = INT64_MIN;
    for (int64_t k = 0; k < count; k++) {
        const double *p = positions + 3 * k;
        if (isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && pose_ns[k] > newest_ns) {
            newest_ns = pose_ns[k];
        }
    }
    return newest_ns == INT64_MIN ? now_ns : newest_ns;
}

int proximity_take(proximity_scene *scene, int64_t instant_ns, proximity_error *error)
{
    int unusable = proximity_refuse_scene(scene, error);
    struct Posts *posts = unusable ? NULL : __atomic_load_n(&scene->posts, __ATOMIC_ACQUIRE);
    if (posts == NULL) {
        return unusable;
    }
    int64_t count = 0, kept = 0;
    read_all(posts, scene->archive.part_count);
    for (int64_t k = 0; k < posts->listed_count; k++) {
        int64_t part = posts->listed[k];
        Slot *slot = &posts->slots[part];
        slot->is_carried = slot->is_listed = slot->is_carried && add_row(scene, part, count++, instant_ns);
        if (slot->is_listed) {
            posts->listed[kept++] = part;
        }
    }
    posts->listed_count = kept;
    if (count > 0) {
        proximity_put_parts(scene, posts->rows, count, posts->matrices, posts->velocities, posts->turnings);
        proximity_settle(scene);
    }
    return proximity_refuse_scene(scene, error);
}

void proximity_discard_posts(proximity_scene *scene, int32_t part)
{
    struct Posts *posts = __atomic_load_n(&scene->posts, __ATOMIC_ACQUIRE);
    if (posts != NULL) {
        read_newest(posts, part); /* discards earlier posts */
        posts->slots[part].is_carried = 0;
    }
}
