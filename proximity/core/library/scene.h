/* A scene, internal to the library. */
#ifndef PROXIMITY_SCENE_H
#define PROXIMITY_SCENE_H

#include "core.h"

/* Pending work on the tree over static parts. */
enum { RIGHT, THINNER, NEW };

struct proximity_scene {
    const InstructionSet *set;
    int64_t model[8]; /* address and length of each array, as kernels take a model */
    Archive archive;
    const char **names;
    const char **reasons; /* reasons for the sign methods; NULL for a file, and "" for its parts */
    uint8_t *mapped; /* the file, or NULL for the caller's bytes */
    size_t mapped_size;
    void *copies; /* changed copies of the caller's bytes, or all arrays of a scene from meshes */
    int is_broken;
    proximity_log *log;
    void *log_user;
    int64_t noted;  /* kinds of notes (atomic) */
    int references; /* one of the opener, and one of each tracker */
    /* Derived from the poses, see kernels.scene.parts.dynamic_tree. */
    int64_t dynamic[6]; /* address and length of rows, order and keys */
    int64_t *versions, *rows, *order, *keys;
    float *boxes;
    int64_t changes, epoch, boxes_version, sort_steps; /* epoch: grows when parts are hidden or shown */
    int tree;
    int64_t *identities;   /* of the parts: numbers unique in the history of this scene */
    int64_t next_identity;
    struct Posts *posts; /* poses posted by another thread (posted.c); NULL before the first */
};

/* Kinds of notes of a scene; those of a tracker are bits of a tick's answer. */
enum { NOTED_POINTS = 1, NOTED_POSTS = 2 };
void proximity_note_points(const proximity_scene *scene, const double *answers, size_t count, int64_t width);
void proximity_note_post(proximity_scene *scene, int64_t part, int64_t pose_ns, int64_t instant_ns);
void proximity_note_tick(const proximity_scene *scene, int64_t *noted, int64_t answer, const proximity_contact *contacts,
                         size_t count);

/* Make a scene that owns the arrays of a model; NULL: out of memory. */
proximity_scene *proximity_scene_over(const int64_t *model);

/* Write the words of a kernel for one face of each surface of two parts; return the memory to free, or NULL. */
int32_t *proximity_surfaces_of(const proximity_scene *scene, const int32_t *parts, int64_t *words);

/* Return PROXIMITY_OK if both are parts of the scene and differ; otherwise write the error. */
int proximity_refuse_pair(const proximity_scene *scene, int32_t first, int32_t second, proximity_error *error);

/* Add or remove a reference: the scene is freed with the last one. */
void proximity_keep(const proximity_scene *scene);
void proximity_release(const proximity_scene *scene);

/* Report the error of a scene that cannot be queried; PROXIMITY_OK if it can. */
int proximity_refuse_scene(const proximity_scene *scene, proximity_error *error);

/* First invalid row of a move, or -1; velocities may be NULL. */
int64_t proximity_first_unfit(const proximity_scene *scene, int64_t n, const double *matrices, const double *velocities,
                              const double *angular_velocities);

/* Report that a part does not exist. */
int proximity_no_such_part(const proximity_scene *scene, int32_t part, proximity_error *error);

/* Report why a pose of a part is invalid. */
int proximity_refuse_pose(const char *name, const double *matrix, const double *velocity,
                          const double *angular_velocity, proximity_error *error);

/* Write the addresses and lengths of a model's arrays, as kernels take them. */
void proximity_write_model(int64_t *model, const Archive *archive);

int proximity_refuse_processor(proximity_error *error);

/* Choose the best instruction set of the processor. */
int proximity_choose_set(proximity_scene *scene, proximity_error *error);

/* Allocate the arrays of a scene outside of its archive; return 0 if out of memory. */
int proximity_begin_changes(proximity_scene *scene);

/* Newest instant of all tracked fingers, whose positions are finite; now_ns if there are none. */
int64_t proximity_newest_instant(const double *positions, const int64_t *pose_ns, int64_t count, int64_t now_ns);

/* Discard poses posted for a part, after proximity_move has moved it. */
void proximity_discard_posts(proximity_scene *scene, int32_t part);

/* Move parts, and update all that depends on their poses; if that fails the scene is broken. */
void proximity_put_parts(proximity_scene *scene, const int64_t *rows, int64_t count, const double *matrices,
                         const double *velocities, const double *angular_velocities);
void proximity_settle(proximity_scene *scene);

#endif
