/* What the parts of the extension share. */
#ifndef PROXIMITY_DOOR_H
#define PROXIMITY_DOOR_H

#include <stddef.h>
#include <stdint.h>

/* A compiled door: words of arguments, behind which it writes words of results. Not 0: no memory was left. */
typedef int (*Door)(void **unused_result, void **unused_error, int64_t words);

/* The doors of one set of instructions, made by the build. */
typedef struct {
    const char *instructions;
    const char *name;
    Door door;
} NamedDoor;

extern const NamedDoor named_doors[]; /* the last one has no name */
extern const char sources_digest[];   /* of the sources that the doors were compiled from */

/* Owner of an array that a kernel made; the first and the fourth word are read by compiled code. */
typedef struct {
    size_t references;
    void *unused[2];
    void *data;
    size_t size;
} Owner;

void release_owner(Owner *owner);

/* Whether this processor has a set of instructions, by its name. */
int has_instructions(const char *name);

#endif
