/* Calls of compiled kernels, and error messages. */
#include "core.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "entry_points.h"

int proximity_interface(void)
{
    return PROXIMITY_INTERFACE;
}

const char *proximity_version(void)
{
    return PACKAGE_VERSION;
}

/* The set of that name, or the best one for NULL; NULL if this processor does not have it. */
const InstructionSet *proximity_best_set(const char *name)
{
    const InstructionSet *best = NULL;
    for (const InstructionSet *set = proximity_sets; set->name != NULL; set++) {
        if ((name == NULL || strcmp(set->name, name) == 0) && has_instructions(set->name)) {
            best = set;
        }
    }
    return best;
}

/* Test whether an entry point succeeded: otherwise it was out of memory. */
int proximity_call(const InstructionSet *set, int entry, int64_t *words)
{
    void *unused[2] = {NULL, NULL};
    return set->wrappers[entry](&unused[0], &unused[1], (int64_t)(intptr_t)words) == 0;
}

int proximity_refuse(proximity_error *error, int code, const char *sentence, ...)
{
    if (error != NULL) {
        va_list values;
        va_start(values, sentence);
        error->code = code;
        vsnprintf(error->sentence, sizeof error->sentence, sentence, values);
        va_end(values);
    }
    return code;
}

int proximity_no_memory(proximity_error *error, const char *for_what)
{
    return proximity_refuse(error, PROXIMITY_NO_MEMORY, "there is no memory %s", for_what);
}

static const char *sentence_of(int64_t kind)
{
    const Sentence *each = proximity_sentences;
    while (each->sentence != NULL && each->kind != kind) {
        each++;
    }
    return each->sentence != NULL ? each->sentence : "it is not as it should be";
}

/* Report a fault of a file: {0} to {4} in its message are numbers, {name} is a name. */
int proximity_refuse_kind(proximity_error *error, int64_t kind, const int64_t *numbers, const char *name,
                          const char *where)
{
    char told[256];
    size_t at = 0;
    for (const char *from = sentence_of(kind); *from != '\0' && at < sizeof told - 1;) {
        size_t room = sizeof told - at;
        int written;
        if (from[0] == '{' && from[1] >= '0' && from[1] <= '4') {
            written = snprintf(told + at, room, "%lld", (long long)numbers[from[1] - '0']);
            from += 3;
        } else if (strncmp(from, "{name}", 6) == 0) {
            written = snprintf(told + at, room, "'%s'", name);
            from += 6;
        } else {
            written = snprintf(told + at, room, "%c", *from++);
        }
        at += written < 0 ? 0 : (size_t)written;
    }
    told[at < sizeof told ? at : sizeof told - 1] = '\0';
    if (kind == NO_MAGIC) {
        return proximity_refuse(error, PROXIMITY_BAD_FILE, "%s", told);
    }
    if (where == NULL) {
        int code = kind == OTHER_VERSION ? PROXIMITY_BAD_VERSION : PROXIMITY_BAD_FILE;
        return proximity_refuse(error, code, "%s; save the scene again with this version", told);
    }
    return proximity_refuse(error, PROXIMITY_BAD_FILE,
                            "its contents are inconsistent (%s%s); save the scene again with this version", where,
                            told);
}

/* Append a message in which {asked}, {against}, {count} and {share:.0%} are numbers; return its end. */
static size_t append(char *text, size_t size, size_t at, const char *from, const int64_t *numbers, double share)
{
    static const char *const names[] = {"{asked}", "{against}", "{count}"};
    while (*from != '\0' && at < size - 1) {
        int written = 0, known = 0;
        while (known < 3 && strncmp(from, names[known], strlen(names[known])) != 0) {
            known++;
        }
        if (known < 3) {
            written = snprintf(text + at, size - at, "%lld", (long long)numbers[known]);
            from += strlen(names[known]);
        } else if (strncmp(from, "{share:.0%}", 11) == 0) {
            written = snprintf(text + at, size - at, "%.0f%%", 100.0 * share);
            from += 11;
        } else {
            written = snprintf(text + at, size - at, "%c", *from++);
        }
        at += (size_t)written;
    }
    return at < size ? at : size - 1;
}

void proximity_write_reason(char *text, size_t size, const int64_t *found, double share, int is_flipped)
{
    const Sentence *reason = proximity_reasons;
    while (reason->sentence != NULL && reason->kind != found[0]) {
        reason++;
    }
    int64_t numbers[] = {found[1], found[2], 0};
    size_t at = append(text, size, 0, reason->sentence != NULL ? reason->sentence : "", numbers, share);
    for (int k = 0; k < 2; k++) {
        numbers[2] = found[3 + k];
        at = numbers[2] > 0 ? append(text, size, at, proximity_exceptions[k], numbers, share) : at;
    }
    append(text, size, at, is_flipped ? proximity_flipped : "", numbers, share);
}
