/*
 * receiver.c: the controller's end of a udp:// address, as an example to copy. It never acts on outdated data:
 *
 *   - A datagram counts if it comes from the accepted sender, is complete, valid, and newer than the last.
 *     With a key, its tag must also be right; other datagrams are not read.
 *   - A valid frame holds unchanged, for the instant of its poses. Then a lower bound of each distance holds,
 *     which decreases with time. After that no value holds: retract.
 *   - It never waits for a frame: it evaluates the present state at intervals.
 *
 *   cc -std=c99 -O2 receiver.c -lm -o receiver
 *   ./receiver 127.0.0.1 9100 127.0.0.1 frames.key    # listen at, port, sender, and the key if there is one
 */
#define _POSIX_C_SOURCE 200809L
#include <arpa/inet.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "proximity_message.h"

#define MAX_FINGERS 64
#define LOOK_MS 10             /* maximum time between two evaluations */
#define MAX_SPEED 3.0          /* m/s, and */
#define MAX_ACCELERATION 120.0 /* m/s2, of a finger */

struct frame {
    proximity_frame_header header;
    proximity_contact contacts[MAX_FINGERS];
    char beyond[PROXIMITY_TAG_BYTES + 8]; /* a message that extends in here is too large */
};

enum { STRANGER = PROXIMITY_FLAW_CONTENT + 1, UNVERIFIED, REASONS };
static const char *const REASON[REASONS] = {"received", "short",  "magic",   "version",  "size",      "checksum",
                                            "old",      "future", "content", "stranger", "unverified"};
static const char *const STATE[] = {"STARTING", "OK", "DEGRADED", "LATE", "STALE", "STOPPING"};

static struct frame held, arrived;
static proximity_receiver receiver; /* of frames: selection, and the clock of their sender */
static uint8_t key[PROXIMITY_KEY_BYTES];
static unsigned long counts[REASONS];
static volatile sig_atomic_t is_told_to_stop;

static int64_t clock_ns(void)
{
    struct timespec now;

    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Store a message if it is valid; return whether it is. */
static int take(size_t size, int is_from_sender)
{
    int reason = is_from_sender ? (int)UNVERIFIED : (int)STRANGER;

    if (is_from_sender && (!receiver.is_keyed || (size = proximity_verified(key, &arrived, size)) > 0))
        reason = (int)proximity_take_frame(&receiver, &arrived, size, MAX_FINGERS, clock_ns());
    if (reason == (int)PROXIMITY_FLAW_MAGIC && arrived.header.magic == PROXIMITY_DESCRIPTION_MAGIC)
        return 0; /* names of parts and fingers, not needed here */
    counts[reason]++;
    if (reason == 0)
        memcpy(&held, &arrived, size);
    return reason == 0;
}

/* Print the present state; a controller would set its drum here. */
static void look(int is_new)
{
    static int told = -1;
    int64_t now_ns = proximity_theirs(&receiver, clock_ns());
    int state = (int)proximity_trust(&receiver, &held.header, now_ns, PROXIMITY_STALE_AFTER_NS);
    uint32_t i;

    if (!is_new && state == told && state != PROXIMITY_STATE_LATE)
        return;
    told = state;
    if (receiver.received == 0) {
        printf("no frame yet\n");
        return;
    }
    printf("%llu %s age %.3f ms", (unsigned long long)held.header.sequence, STATE[state],
           1e-6 * (double)(now_ns - held.header.pose_ns));
    for (i = 0; i < held.header.count; i++) {
        const proximity_contact *c = &held.contacts[i];
        if ((c->flags & PROXIMITY_FLAG_TRACKED) == 0)
            continue;
        if (state == PROXIMITY_STATE_OK || state == PROXIMITY_STATE_DEGRADED)
            printf("; finger %u: %.3f mm, contact in %.1f ms, not before %.1f", (unsigned)c->finger,
                   1e3 * c->signed_distance, 1e3 * c->time_to_contact, 1e3 * c->time_to_contact_lower);
        else if (state == PROXIMITY_STATE_LATE)
            printf("; finger %u: at least %.3f mm", (unsigned)c->finger,
                   1e3 * proximity_lower_at(c, now_ns, MAX_SPEED, MAX_ACCELERATION));
    }
    printf("\n");
}

/* Read the key; return the error of its file, or NULL. */
static const char *read_key(const char *path)
{
    char text[2 * PROXIMITY_KEY_BYTES + 2] = {0};
    struct stat status;
    int file = open(path, O_RDONLY | O_NONBLOCK);
    const char *wrong = NULL;

    if (file < 0)
        return "cannot be opened";
    if (fstat(file, &status) != 0 || !S_ISREG(status.st_mode))
        wrong = "is not a regular file";
    else if ((status.st_mode & 077) != 0)
        wrong = "may be used by others (expected permissions 0600)";
    else if (read(file, text, sizeof text - 1) < 0 || !proximity_key_of_text(text, key))
        wrong = "is not a key (expected 64 hexadecimal digits)";
    close(file);
    return wrong;
}

static void stop(int number)
{
    (void)number;
    is_told_to_stop = 1;
}

int main(int count, char **words)
{
    struct sockaddr_in here = {0}, sender = {0}, from;
    socklen_t from_size;
    struct pollfd waiting = {0};
    int reason, is_new, port = count == 4 || count == 5 ? atoi(words[2]) : 0;
    const char *wrong = count == 5 ? read_key(words[4]) : NULL;
    ssize_t size;

    if (port < 1 || port > 65535 || inet_pton(AF_INET, words[1], &here.sin_addr) != 1
        || inet_pton(AF_INET, words[3], &sender.sin_addr) != 1) {
        fprintf(stderr, "receiver: expected ADDRESS PORT SENDER [KEY], such as 127.0.0.1 9100 127.0.0.1\n");
        return 2;
    }
    if (wrong != NULL) {
        fprintf(stderr, "receiver: %s %s\n", words[4], wrong);
        return 2;
    }
    receiver.is_keyed = count == 5;
    receiver.shares_clock = ntohl(sender.sin_addr.s_addr) >> 24 == 127;
    here.sin_family = AF_INET;
    here.sin_port = htons((uint16_t)port);
    waiting.fd = socket(AF_INET, SOCK_DGRAM, 0);
    waiting.events = POLLIN;
    if (waiting.fd < 0 || fcntl(waiting.fd, F_SETFL, O_NONBLOCK) != 0
        || bind(waiting.fd, (struct sockaddr *)&here, sizeof here) != 0) {
        perror("receiver");
        return 1;
    }
    setvbuf(stdout, NULL, _IOLBF, 0);
    signal(SIGINT, stop);
    signal(SIGTERM, stop);
    printf("listening\n");
    while (!is_told_to_stop) {
        is_new = 0;
        if (poll(&waiting, 1, LOOK_MS) > 0) {
            from_size = sizeof from;
            size = recvfrom(waiting.fd, &arrived, sizeof arrived, 0, (struct sockaddr *)&from, &from_size);
            is_new = size >= 0 && take((size_t)size, from.sin_addr.s_addr == sender.sin_addr.s_addr);
        }
        look(is_new);
    }
    printf("lost %lu", (unsigned long)receiver.lost);
    for (reason = 0; reason < REASONS; reason++)
        printf(", %s %lu", REASON[reason], counts[reason]);
    printf("\n");
    close(waiting.fd);
    return 0;
}
