/* Parts that are put together as one scene. */
#ifndef PROXIMITY_ASSEMBLED_H
#define PROXIMITY_ASSEMBLED_H

#include "scene.h"

/* A part of a new scene: a row of some model, its pose, name, and why its distances have a sign or have none. */
typedef struct {
    const int64_t *model;
    int64_t row;
    double matrix[16];
    const char *name, *reason;
} Source;

/* Take rows of zeros for so many parts and the scene, outside of the block; free what is returned, NULL for no memory. */
void *proximity_take_rows(Archive *made, int64_t part_count);

/* Take one block for all arrays, and copy the rows there; free what is returned, NULL for no memory. */
void *proximity_take_block(Archive *made, int64_t real_count, int64_t word_count);

/* Make a scene of copies of parts; NULL where there is no memory, or where they are too far apart (`is_far`). */
proximity_scene *proximity_assemble(const InstructionSet *set, const Source *sources, int64_t count, int *is_far);

#endif
