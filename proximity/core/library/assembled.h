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

/* Make a scene of copies of parts; NULL where there is no memory, or where they are too far apart (`is_far`). */
proximity_scene *proximity_assemble(const InstructionSet *set, const Source *sources, int64_t count, int *is_far);

#endif
