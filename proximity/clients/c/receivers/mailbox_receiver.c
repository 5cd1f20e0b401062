/* Frames of a service in shared memory: mailbox_receiver NAME SECONDS, for shm://NAME. Linux.

   A restarted service has another mailbox, which is opened here; if it was killed, the last frame
   ages until it is STALE. Names of parts come between frames. */
#define _GNU_SOURCE
#include <stdio.h>
#include <stdlib.h>

#include "proximity_mailbox.h"
#include "proximity_message.h"

enum { MAX_FINGERS = 64, MAX_PARTS = 1000, MAX_LABELS = 64 };
#define MS INT64_C(1000000)      /* ns */
#define MAX_SPEED 3.0            /* m/s, and */
#define MAX_ACCELERATION 120.0   /* m/s2, of a finger */

static const char *const STATE[] = {"STARTING", "OK", "DEGRADED", "LATE", "STALE", "STOPPING"};
static struct frame {
    proximity_frame_header header;
    proximity_contact contacts[MAX_FINGERS];
} held;
static union {
    struct frame frame;
    struct {
        proximity_description_header header;
        proximity_label labels[MAX_LABELS];
    } described;
} arrived;
static proximity_description_header named; /* of the names: their service and epoch */
static char names[MAX_PARTS][65];
static proximity_receiver receiver = {.shares_clock = 1};

/* Store a received frame, or names, if valid. */
static void take(size_t size, int64_t now_ns)
{
    const proximity_description_header *header = &arrived.described.header;

    if (size > sizeof arrived)
        return;
    if (proximity_take_frame(&receiver, &arrived, size, MAX_FINGERS, now_ns) == PROXIMITY_FLAW_NONE) {
        memcpy(&held, &arrived, size);
    } else if (proximity_check(&arrived, size, PROXIMITY_DESCRIPTION_MAGIC, sizeof *header, sizeof(proximity_label),
                               offsetof(proximity_description_header, count)) == PROXIMITY_FLAW_NONE) {
        named = *header;
        for (uint32_t k = 0; k < header->count; k++) {
            uint64_t part = (uint64_t)header->first + k;
            if (part < header->part_count && part < MAX_PARTS)
                memcpy(names[part], arrived.described.labels[k].name, 64);
        }
    }
}

static const char *name_of(int32_t part)
{
    int is_known = named.session == held.header.session && named.epoch == held.header.epoch;
    return is_known && part >= 0 && part < MAX_PARTS ? names[part] : "?";
}

/* Print the present state; a program would act here. */
static void show(int64_t now_ns)
{
    enum proximity_state state = proximity_trust(&receiver, &held.header, now_ns, PROXIMITY_STALE_AFTER_NS);
    int is_late = state == PROXIMITY_STATE_LATE, is_valid = state == PROXIMITY_STATE_OK || state == PROXIMITY_STATE_DEGRADED;

    printf("%s", receiver.received ? STATE[state] : "no frame yet");
    for (uint32_t i = 0; receiver.received && (is_valid || is_late) && i < held.header.count; i++) {
        const proximity_contact *c = &held.contacts[i];
        if ((c->flags & PROXIMITY_FLAG_TRACKED) != 0)
            printf("; finger %u: %s %.3f mm to %s", (unsigned)c->finger, is_late ? "at least" : "at",
                   1e3 * (is_late ? proximity_lower_at(c, now_ns, MAX_SPEED, MAX_ACCELERATION) : c->signed_distance),
                   name_of(c->part));
    }
    printf("\n");
    fflush(stdout);
}

int main(int count, char **words)
{
    proximity_mailbox box;
    int64_t size, now_ns = proximity_mailbox_now_ns(), shown_ns = 0;
    int64_t ends_ns = now_ns + (count == 3 ? (int64_t)(1e9 * atof(words[2])) : 0);
    int outcome = PROXIMITY_MAILBOX_NOBODY;

    for (; (now_ns = proximity_mailbox_now_ns()) < ends_ns;) {
        if (outcome != PROXIMITY_MAILBOX_OK)
            outcome = proximity_mailbox_open(&box, words[1]);
        if (outcome == PROXIMITY_MAILBOX_NOBODY) { /* not yet, or no longer: poll again */
            struct timespec pause = {0, 5 * MS};
            nanosleep(&pause, NULL);
        } else if (outcome != PROXIMITY_MAILBOX_OK) {
            break;
        } else if (proximity_mailbox_wait(&box, now_ns + 5 * MS)) {
            while ((size = proximity_mailbox_read(&box, &arrived, sizeof arrived)) != PROXIMITY_MAILBOX_NOTHING)
                take((size_t)size, proximity_mailbox_now_ns());
        } else if (proximity_mailbox_is_over(&box)) {
            proximity_mailbox_close(&box);
            outcome = PROXIMITY_MAILBOX_NOBODY;
        }
        if (now_ns - shown_ns >= 100 * MS) {
            shown_ns = now_ns;
            show(now_ns);
        }
    }
    if (count != 3 || (outcome != PROXIMITY_MAILBOX_OK && outcome != PROXIMITY_MAILBOX_NOBODY)) {
        fprintf(stderr, "%s\n", count != 3 ? "expected NAME SECONDS" : proximity_mailbox_reason(outcome));
        return 1;
    }
    if (outcome == PROXIMITY_MAILBOX_OK)
        proximity_mailbox_close(&box);
    return 0;
}
