/* Assembly of parts into one scene. */
#ifndef PROXIMITY_ASSEMBLED_H
#define PROXIMITY_ASSEMBLED_H

#include "scene.h"

/* A part of a new scene: a row of a model, its pose, name, and the reason for its sign method. */
typedef struct {
    const int64_t *model;
    int64_t row;
    double matrix[16];
    const char *name, *reason;
} Source;

/* Allocate zeroed rows for the parts and the scene, outside of the block; free the result; NULL: out of memory. */
void *proximity_take_rows(Archive *made, int64_t part_count);

/* Allocate one block for all arrays, and copy the rows there; free the result; NULL: out of memory. */
void *proximity_take_block(Archive *made, int64_t real_count, int64_t word_count);

/* Make a scene of copies of parts; NULL if out of memory, or if they are too far apart (`is_far`). */
proximity_scene *proximity_assemble(const InstructionSet *set, const Source *sources, int64_t count, int *is_far);

#endif
