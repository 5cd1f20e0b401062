/* A scene, as its files see it. */
#ifndef PROXIMITY_SCENE_H
#define PROXIMITY_SCENE_H

#include "core.h"

/* What is to be done about the tree over parts that stand still. */
enum { RIGHT, THINNER, NEW };

struct proximity_scene {
    const InstructionSet *set;
    int64_t model[8]; /* address and length of each array, as kernels take a model */
    Archive archive;
    const char **names;
    const char **reasons; /* why parts have a sign or none; NULL for a file, and "" for its parts */
    uint8_t *mapped; /* the file, or NULL for bytes that are the caller's */
    size_t mapped_size;
    void *copies; /* what is changed of the caller's bytes, or all arrays of a scene from meshes */
    int is_broken;
    proximity_log *log;
    void *log_user;
    int64_t noted;  /* kinds of notes (atomic) */
    int references; /* that of who opened it, and one of each tracker */
    /* What follows from where parts are, see kernels.scene.parts.dynamic_tree. */
    int64_t dynamic[6]; /* address and length of rows, order and keys */
    int64_t *versions, *rows, *order, *keys;
    float *boxes;
    int64_t changes, epoch, boxes_version, sort_steps; /* epoch: grows when parts are hidden or shown */
    int tree;
    int64_t *identities;   /* of the parts: numbers that no other part of this scene has or had */
    int64_t next_identity;
    struct Posts *posts; /* poses posted by another thread (posted.c); NULL before the first */
};

/* Kinds of notes of a scene; a tracker has those of the answer of a tick. */
enum { NOTED_POINTS = 1, NOTED_POSTS = 2 };
void proximity_note_points(const proximity_scene *scene, const double *answers, size_t count, int64_t width);
void proximity_note_post(proximity_scene *scene, int64_t part, int64_t pose_ns, int64_t instant_ns);
void proximity_note_tick(const proximity_scene *scene, int64_t *noted, int64_t answer, const proximity_contact *contacts,
                         size_t count);

/* A scene over the arrays of a model, which are its own from now on; NULL: there is no memory. */
proximity_scene *proximity_scene_over(const int64_t *model);

/* One face of each surface of two parts: their words for a kernel, and the memory to free; NULL: there is none. */
int32_t *proximity_surfaces_of(const proximity_scene *scene, const int32_t *parts, int64_t *words);

/* The sentence about two parts that are not two different ones of the scene, as an error; PROXIMITY_OK where they are. */
int proximity_refuse_pair(const proximity_scene *scene, int32_t first, int32_t second, proximity_error *error);

/* Count another reference, or one less: with the last one the scene is freed. */
void proximity_keep(const proximity_scene *scene);
void proximity_release(const proximity_scene *scene);

/* The sentence about a scene that cannot be asked, as an error; PROXIMITY_OK where it can. */
int proximity_refuse_scene(const proximity_scene *scene, proximity_error *error);

/* The first row of a move that cannot be used, or -1; velocities may be NULL. */
int64_t proximity_first_unfit(const proximity_scene *scene, int64_t n, const double *matrices, const double *velocities,
                              const double *angular_velocities);

/* The sentence about a number that no part has, as an error. */
int proximity_no_such_part(const proximity_scene *scene, int32_t part, proximity_error *error);

/* The sentence why a pose of a part cannot be used, as an error. */
int proximity_refuse_pose(const char *name, const double *matrix, const double *velocity,
                          const double *angular_velocity, proximity_error *error);

/* Write the addresses and lengths of a model's arrays, as kernels take them. */
void proximity_write_model(int64_t *model, const Archive *archive);

int proximity_refuse_processor(proximity_error *error);

/* Choose the best instructions that the processor has. */
int proximity_choose_set(proximity_scene *scene, proximity_error *error);

/* Allocate what a scene keeps beside its archive; returns 0 where there is no memory. */
int proximity_begin_changes(proximity_scene *scene);

/* The newest instant of all tracked fingers, whose positions are finite; now_ns if there are none. */
int64_t proximity_newest_instant(const double *positions, const int64_t *pose_ns, int64_t count, int64_t now_ns);

/* Discard poses posted for a part, after proximity_move has moved it. */
void proximity_discard_posts(proximity_scene *scene, int32_t part);

/* Put parts elsewhere, and find what follows from it; where that cannot be done the scene is broken. */
void proximity_put_parts(proximity_scene *scene, const int64_t *rows, int64_t count, const double *matrices,
                         const double *velocities, const double *angular_velocities);
void proximity_settle(proximity_scene *scene);

#endif
