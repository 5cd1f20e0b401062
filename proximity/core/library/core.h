/* Declarations shared by the files of the library; `core_tables.h` is generated when the kernels are compiled. */
#ifndef PROXIMITY_CORE_H
#define PROXIMITY_CORE_H

#include "core_tables.h"
#include "proximity.h"

/* A compiled wrapper: words of arguments, followed by words of results. Not 0: out of memory. */
typedef int (*Wrapper)(void **unused_result, void **unused_error, int64_t words);

typedef struct {
    const char *name; /* of the set of instructions; the last set has none */
    Wrapper wrappers[ENTRY_COUNT];
} InstructionSet;

PROXIMITY_API extern const InstructionSet proximity_sets[]; /* in ascending order */

typedef struct {
    int64_t kind;
    const char *sentence;
} Sentence;

extern const Sentence proximity_sentences[]; /* the last one is NULL */
extern const Sentence proximity_reasons[];   /* why a sign was chosen; the last one is NULL */
extern const char *const proximity_exceptions[]; /* near which faces the winding number gives the sign; two */
extern const char proximity_flipped[];
extern const char proximity_layout[];        /* as required in a file */
extern const int64_t proximity_unknown_contact[CONTACT_SIZE / 8];

/* The arrays of a file, in place; and the names of its parts. */
typedef struct {
    double *reals;
    float *words;
    Frame *frames;
    Part *parts;
    int64_t real_count, word_count, frame_count, part_rows, part_count;
    char *names; /* each terminated by a zero; the scene frees them */
} Archive;

int proximity_call(const InstructionSet *set, int entry, int64_t *words);
int proximity_refuse(proximity_error *error, int code, const char *sentence, ...);
int proximity_no_memory(proximity_error *error, const char *for_what);
int proximity_refuse_kind(proximity_error *error, int64_t kind, const int64_t *numbers, const char *name,
                          const char *where);
/* Write the reason for the sign method of a part; *found*: the results of `choose_sign` before the share. */
void proximity_write_reason(char *text, size_t size, const int64_t *found, double share, int is_flipped);
int proximity_read_archive(const InstructionSet *set, uint8_t *bytes, size_t size, Archive *archive,
                           proximity_error *error);
int proximity_map_file(const char *path, uint8_t **bytes, size_t *size, proximity_error *error);
void proximity_unmap(uint8_t *bytes, size_t size);
const InstructionSet *proximity_best_set(const char *name);

#endif
