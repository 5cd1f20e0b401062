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
    uint8_t *mapped; /* the file, or NULL for bytes that are the caller's */
    size_t mapped_size;
    void *copies; /* what is changed of the caller's bytes */
    int is_broken;
    /* What follows from where parts are, see kernels.scene.dynamic_tree. */
    int64_t dynamic[6]; /* address and length of rows, order and keys */
    int64_t *versions, *rows, *order, *keys;
    float *boxes;
    int64_t changes, epoch, boxes_version, sort_steps; /* epoch: grows when parts are hidden or shown */
    int tree;
};

#endif
