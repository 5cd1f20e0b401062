/* What the parts of the extension share. */
#ifndef PROXIMITY_ENTRY_POINTS_H
#define PROXIMITY_ENTRY_POINTS_H

#include <stddef.h>
#include <stdint.h>

/* A compiled wrapper: words of arguments, behind which it writes words of results. Not 0: no memory was left. */
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
extern const char digest_in_c[];      /* of what is written in C beside them */

/* Owner of an array that a kernel made; the references and the address of the data are read by compiled code,
   whose numbers have 64 bits also where addresses have 32. */
typedef struct {
    uint64_t references;
    void *unused[2];
    void *data;
    uint64_t size;
} Owner;

void release_owner(Owner *owner);

/* Whether this processor has a set of instructions, by its name. */
int has_instructions(const char *name);

#endif
