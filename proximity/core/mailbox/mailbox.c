/* Mailboxes in shared memory, for Python; programs in C include proximity_mailbox.h themselves. */
#include "proximity.h"

#include <stdint.h>

#ifndef __wasm__
#include "proximity_mailbox.h"

PROXIMITY_API int64_t proximity_box_size(void);
PROXIMITY_API int proximity_box_write(proximity_mailbox *box, const void *message, uint32_t size);
PROXIMITY_API int64_t proximity_box_read(proximity_mailbox *box, void *to, uint64_t room);
PROXIMITY_API int proximity_box_has(const proximity_mailbox *box);
PROXIMITY_API void proximity_box_within(proximity_mailbox *box, void *memory, uint64_t ring);

int64_t proximity_box_size(void)
{
    return sizeof(proximity_mailbox);
}

int proximity_box_write(proximity_mailbox *box, const void *message, uint32_t size)
{
    return proximity_mailbox_write(box, message, size);
}

int64_t proximity_box_read(proximity_mailbox *box, void *to, uint64_t room)
{
    return proximity_mailbox_read(box, to, room);
}

int proximity_box_has(const proximity_mailbox *box)
{
    return proximity_mailbox_has(box);
}

/* A mailbox without a file, in zeroed memory of this process: either end. The ring is a power of two of bytes. */
void proximity_box_within(proximity_mailbox *box, void *memory, uint64_t ring)
{
    memset(box, 0, sizeof *box);
    box->header = memory;
    box->ring = ring;
    box->file = -1;
    box->header->writer = 1;
}

#ifdef __linux__
PROXIMITY_API int proximity_box_create(proximity_mailbox *box, const char *name, uint64_t largest);
PROXIMITY_API int proximity_box_enlarge(proximity_mailbox *box, uint64_t largest);
PROXIMITY_API int proximity_box_open(proximity_mailbox *box, const char *name, int is_next);
PROXIMITY_API int proximity_box_wait(proximity_mailbox *box, int64_t until_ns);
PROXIMITY_API int proximity_box_is_over(const proximity_mailbox *box, int looks_at_name);
PROXIMITY_API int proximity_box_is_written(const proximity_mailbox *box);
PROXIMITY_API void proximity_box_close(proximity_mailbox *box);
PROXIMITY_API const char *proximity_box_reason(int outcome);

int proximity_box_create(proximity_mailbox *box, const char *name, uint64_t largest)
{
    return proximity_mailbox_create(box, name, largest);
}

int proximity_box_enlarge(proximity_mailbox *box, uint64_t largest)
{
    return proximity_mailbox_enlarge(box, largest);
}

/* Open a mailbox that follows a closed one, at its first message. */
int proximity_box_open(proximity_mailbox *box, const char *name, int is_next)
{
    int outcome = proximity_mailbox_open(box, name);
    if (outcome == PROXIMITY_MAILBOX_OK && is_next) {
        box->position = __atomic_load_n(&box->header->floor, __ATOMIC_ACQUIRE);
    }
    return outcome;
}

int proximity_box_wait(proximity_mailbox *box, int64_t until_ns)
{
    return proximity_mailbox_wait(box, until_ns);
}

int proximity_box_is_over(const proximity_mailbox *box, int looks_at_name)
{
    return looks_at_name ? proximity_mailbox_is_over(box) : proximity_mailbox_is_closed(box);
}

int proximity_box_is_written(const proximity_mailbox *box)
{
    return proximity_mailbox_is_written(box);
}

void proximity_box_close(proximity_mailbox *box)
{
    proximity_mailbox_close(box);
}

const char *proximity_box_reason(int outcome)
{
    return proximity_mailbox_reason(outcome);
}
#endif
#endif
