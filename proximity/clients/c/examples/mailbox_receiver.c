/* Frames of a service in shared memory: mailbox_receiver NAME SECONDS, for shm://NAME. Linux.

   A service that is started anew has another mailbox, which is opened here; of one that was killed the last frame
   ages, until it is STALE. Names of parts come between frames. */
#define _GNU_SOURCE
#include <decaff_mailbox.h>
#include <decaff_message.h>
#include <stdio.h>
#include <stdlib.h>

enum { MOST_FINGERS = 64, MOST_PARTS = 1000, MOST_LABELS = 64 };
#define MS INT64_C(1000000)      /* ns */
#define MAX_SPEED 3.0            /* m/s, and */
#define MAX_ACCELERATION 120.0   /* m/s2, of a finger */

static const char *const STATE[] = {"STARTING", "OK", "DEGRADED", "LATE", "STALE", "STOPPING"};
static struct frame {
    decaff_frame_header header;
    decaff_contact contacts[MOST_FINGERS];
} held;
static union {
    struct frame frame;
    struct {
        decaff_description_header header;
        decaff_label labels[MOST_LABELS];
    } described;
} arrived;
static decaff_description_header named; /* of the names: whose they are */
static char names[MOST_PARTS][65];
static int has_frame;

/* Hold what arrived if it is a frame, or names, and whole. */
static void take(size_t size, int64_t now_ns)
{
    const decaff_description_header *header = &arrived.described.header;

    if (size > sizeof arrived)
        return;
    if (decaff_check_frame(&arrived, size) == DECAFF_FLAW_NONE) {
        if (decaff_makes_sense(&arrived.frame.header, now_ns + DECAFF_AHEAD_NS)) {
            memcpy(&held, &arrived, size);
            has_frame = 1;
        }
    } else if (decaff_check(&arrived, size, DECAFF_DESCRIPTION_MAGIC, sizeof *header, sizeof(decaff_label),
                            offsetof(decaff_description_header, count)) == DECAFF_FLAW_NONE) {
        named = *header;
        for (uint32_t k = 0; k < header->count; k++) {
            uint64_t part = (uint64_t)header->first + k;
            if (part < header->part_count && part < MOST_PARTS)
                memcpy(names[part], arrived.described.labels[k].name, 64);
        }
    }
}

static const char *name_of(int32_t part)
{
    int is_known = named.session == held.header.session && named.epoch == held.header.epoch;
    return is_known && part >= 0 && part < MOST_PARTS ? names[part] : "?";
}

/* Print what is known now; here a program would act. */
static void show(int64_t now_ns)
{
    enum decaff_state state = decaff_state_at(&held.header, now_ns);
    int is_late = state == DECAFF_STATE_LATE, is_valid = state == DECAFF_STATE_OK || state == DECAFF_STATE_DEGRADED;

    printf("%s", has_frame ? STATE[state] : "no frame yet");
    for (uint32_t i = 0; has_frame && (is_valid || is_late) && i < held.header.count; i++) {
        const decaff_contact *c = &held.contacts[i];
        if ((c->flags & DECAFF_FLAG_TRACKED) != 0)
            printf("; finger %u: %s %.3f mm to %s", (unsigned)c->finger, is_late ? "at least" : "at",
                   1e3 * (is_late ? decaff_lower_at(c, now_ns, MAX_SPEED, MAX_ACCELERATION) : c->signed_distance),
                   name_of(c->part));
    }
    printf("\n");
    fflush(stdout);
}

int main(int count, char **words)
{
    decaff_mailbox box;
    int64_t size, now_ns = decaff_mailbox_now_ns(), shown_ns = 0;
    int64_t ends_ns = now_ns + (count == 3 ? (int64_t)(1e9 * atof(words[2])) : 0);
    int outcome = DECAFF_MAILBOX_NOBODY;

    for (; (now_ns = decaff_mailbox_now_ns()) < ends_ns;) {
        if (outcome != DECAFF_MAILBOX_OK)
            outcome = decaff_mailbox_open(&box, words[1]);
        if (outcome == DECAFF_MAILBOX_NOBODY) { /* yet, or not any more: look again */
            struct timespec pause = {0, 5 * MS};
            nanosleep(&pause, NULL);
        } else if (outcome != DECAFF_MAILBOX_OK) {
            break;
        } else if (decaff_mailbox_wait(&box, now_ns + 5 * MS)) {
            while ((size = decaff_mailbox_read(&box, &arrived, sizeof arrived)) != DECAFF_MAILBOX_NOTHING)
                take((size_t)size, decaff_mailbox_now_ns());
        } else if (decaff_mailbox_is_over(&box)) {
            decaff_mailbox_close(&box);
            outcome = DECAFF_MAILBOX_NOBODY;
        }
        if (now_ns - shown_ns >= 100 * MS) {
            shown_ns = now_ns;
            show(now_ns);
        }
    }
    if (count != 3 || (outcome != DECAFF_MAILBOX_OK && outcome != DECAFF_MAILBOX_NOBODY)) {
        fprintf(stderr, "%s\n", count != 3 ? "expected NAME SECONDS" : decaff_mailbox_reason(outcome));
        return 1;
    }
    if (outcome == DECAFF_MAILBOX_OK)
        decaff_mailbox_close(&box);
    return 0;
}
