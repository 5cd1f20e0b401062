/* Declarations shared by the files of the extension. */
#ifndef PROXIMITY_ENTRY_POINTS_H
#define PROXIMITY_ENTRY_POINTS_H

#include <stddef.h>
#include <stdint.h>

/* A compiled wrapper: words of arguments, followed by words of results. Not 0: out of memory. */
typedef int (*Wrapper)(void **unused_result, void **unused_error, int64_t words);

/* The wrappers of one set of instructions, made by the build. */
typedef struct {
    const char *instructions;
    const char *name;
    Wrapper wrapper;
} NamedEntry;

extern const NamedEntry named_entries[]; /* the last one has no name */
extern const char sources_digest[];   /* of the sources that the wrappers were compiled from */
extern const char entry_signatures[]; /* a line each: name|rows with the interpreter locked|signature */
extern const char digest_in_c[];      /* of the C sources */

/* Owner of an array that a kernel made; compiled code reads the reference count and the address of the data,
   as 64-bit numbers even if addresses have 32 bits. */
typedef struct {
    uint64_t references;
    void *unused[2];
    void *data;
    uint64_t size;
} Owner;

void release_owner(Owner *owner);

/* Test whether this processor has a set of instructions, by its name. */
int has_instructions(const char *name);

#endif
