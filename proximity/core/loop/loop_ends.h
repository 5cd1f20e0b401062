/* Inputs and outputs of the loop on Linux without Python threads: mailboxes and datagrams. */
#ifndef PROXIMITY_LOOP_ENDS_H
#define PROXIMITY_LOOP_ENDS_H

#include <errno.h>
#include <stddef.h>
#include <stdint.h>

static uint32_t checksum(const void *data, size_t size); /* of loop_outputs.h: eight bytes at a time */
#define PROXIMITY_CRC32 checksum
#include "core.h"
#include "proximity_mailbox.h"
#include "proximity_message.h"
#include "loop_system.h"

enum { NAP_NS = 200000 };
#define POINTER(word) ((void *)(intptr_t)(word))

#ifdef __linux__
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/timerfd.h>

enum { MAX_STRANGERS = 64, MAX_FORGED_BYTES = 1 << 17, NAME_NS = 100000000, OPEN_NS = 5000000 };

/* Open the present mailbox of that name; return whether there is one. All messages of a later mailbox are new. */
static int follow_mailbox(LoopInput *input)
{
    proximity_mailbox *box = POINTER(input->box);
    int is_next = input->looked_ns != 0, outcome;
    proximity_mailbox_close(box);
    outcome = proximity_mailbox_open(box, POINTER(input->name));
    input->looked_ns = system_now_ns();
    if (outcome == PROXIMITY_MAILBOX_OK && is_next) {
        box->position = __atomic_load_n(&box->header->floor, __ATOMIC_ACQUIRE);
    }
    if (outcome != PROXIMITY_MAILBOX_OK && outcome != PROXIMITY_MAILBOX_NOBODY) {
        input->first_failure = input->failures++ == 0 ? -outcome : input->first_failure;
    }
    return outcome == PROXIMITY_MAILBOX_OK;
}

static int64_t receive_from_mailbox(LoopInput *input)
{
    proximity_mailbox *box = POINTER(input->box);
    if (box->header == NULL && !follow_mailbox(input)) {
        return PROXIMITY_MAILBOX_NOTHING;
    }
    int64_t size = proximity_mailbox_read(box, POINTER(input->message), (uint64_t)input->longest), now_ns;
    if (size != PROXIMITY_MAILBOX_NOTHING) {
        return size;
    }
    now_ns = system_now_ns();
    int looks = now_ns - input->looked_ns > NAME_NS;
    input->looked_ns = looks ? now_ns : input->looked_ns;
    if (!(looks ? proximity_mailbox_is_over(box) : proximity_mailbox_is_closed(box)) || !follow_mailbox(input)) {
        return PROXIMITY_MAILBOX_NOTHING;
    }
    return proximity_mailbox_read(box, POINTER(input->message), (uint64_t)input->longest);
}

static int is_expected(const LoopInput *input, const struct sockaddr_in *from)
{
    for (int64_t k = 0; k < input->host_count; k++) {
        if (from->sin_family == AF_INET && from->sin_addr.s_addr == (uint32_t)input->hosts[k]) {
            return input->port == 0 || ntohs(from->sin_port) == input->port;
        }
    }
    return 0;
}

static int64_t receive_datagram(LoopInput *input)
{
    int64_t forged = 0;
    for (int k = 0; k < MAX_STRANGERS && forged <= MAX_FORGED_BYTES; k++) {
        struct sockaddr_in from = {0};
        socklen_t from_size = sizeof from;
        int64_t size = recvfrom((int)input->socket, POINTER(input->message), (size_t)input->longest, MSG_TRUNC,
                                (struct sockaddr *)&from, &from_size);
        if (size < 0) {
            if (errno != EAGAIN && errno != EWOULDBLOCK) {
                input->first_failure = input->failures++ == 0 ? errno : input->first_failure;
            }
            return PROXIMITY_MAILBOX_NOTHING;
        }
        if (!is_expected(input, &from)) {
            input->refused++;
        } else if (input->key == 0) {
            return size;
        } else if (size <= input->longest) {
            size_t verified = proximity_verified(POINTER(input->key), POINTER(input->message), (size_t)size);
            if (verified != 0) {
                return (int64_t)verified;
            }
            input->unverified++;
            forged += size;
        }
    }
    return PROXIMITY_MAILBOX_NOTHING;
}

/* Wait at the mailbox of that name, after opening it if needed; return whether a message may be waiting. */
static int wait_at_mailbox(LoopInput *input, int64_t until_ns)
{
    proximity_mailbox *box = POINTER(input->box);
    int is_gone = box->header == NULL || (proximity_mailbox_is_closed(box) && !proximity_mailbox_has(box));
    if (is_gone && !follow_mailbox(input)) {
        int64_t again_ns = system_now_ns() + OPEN_NS;
        system_sleep(again_ns < until_ns ? again_ns : until_ns);
        return 0;
    }
    return proximity_mailbox_wait(box, until_ns);
}

static int wait_at_socket(LoopInput *input, int64_t until_ns)
{
    struct itimerspec due = {{0, 0}, {until_ns / 1000000000, until_ns % 1000000000}};
    struct pollfd ends[2] = {{(int)input->socket, POLLIN, 0}, {(int)input->timer, POLLIN, 0}};
    timerfd_settime((int)input->timer, TFD_TIMER_ABSTIME, &due, NULL);
    poll(ends, 2, -1);
    return (ends[0].revents & POLLIN) != 0;
}

/* Open the timer for waiting at a socket; return whether it is available. */
static int open_timer(LoopInput *input)
{
    input->timer = input->socket < 0 ? -1 : timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    return input->socket < 0 || input->timer >= 0;
}

static void close_timer(LoopInput *input)
{
    if (input->timer >= 0) {
        close((int)input->timer);
    }
}

/* Send a datagram; return errno if that failed. A missing receiver is not an error. */
static int send_datagram(LoopOutput *output, const uint8_t *datagram, size_t size)
{
    for (int tries = 0; tries < 2; tries++) {
        if (send((int)output->socket, datagram, size, MSG_NOSIGNAL) >= 0) {
            return 0;
        }
        /* The error may be of an earlier datagram; this one was not sent. */
        if (errno != ECONNREFUSED && errno != ECONNRESET && errno != EHOSTUNREACH && errno != EHOSTDOWN) {
            break;
        }
    }
    if (errno == EAGAIN || errno == EWOULDBLOCK || errno == ENOBUFS || errno == ENOMEM) {
        output->lost++;
        return 0;
    }
    return errno == ECONNREFUSED || errno == ECONNRESET || errno == EHOSTUNREACH || errno == EHOSTDOWN ? 0 : errno;
}

#else
static int send_datagram(LoopOutput *output, const uint8_t *datagram, size_t size)
{
    (void)output, (void)datagram, (void)size;
    return EIO;
}

static int open_timer(LoopInput *input)
{
    return input->socket < 0;
}

static void close_timer(LoopInput *input)
{
    (void)input;
}
#endif

/* Read the next message; return its size, or PROXIMITY_MAILBOX_NOTHING. */
static int64_t receive_message(LoopInput *input)
{
#ifdef __linux__
    if (input->socket >= 0) {
        return receive_datagram(input);
    }
    if (input->name != 0) {
        return receive_from_mailbox(input);
    }
#endif
    return proximity_mailbox_read(POINTER(input->box), POINTER(input->message), (uint64_t)input->longest);
}

/* Wait for a message until that instant; return whether one may be waiting. */
static int wait_for_message(LoopInput *input, int64_t until_ns)
{
#ifdef __linux__
    if (input->socket >= 0) {
        return wait_at_socket(input, until_ns);
    }
    if (input->name != 0) {
        return wait_at_mailbox(input, until_ns);
    }
    return proximity_mailbox_wait(POINTER(input->box), until_ns);
#else
    int64_t now_ns = system_now_ns();
    while (!proximity_mailbox_has(POINTER(input->box)) && now_ns < until_ns) {
        system_sleep(until_ns < now_ns + NAP_NS ? until_ns : now_ns + NAP_NS); /* no signal can wake it there */
        now_ns = system_now_ns();
    }
    return proximity_mailbox_has(POINTER(input->box));
#endif
}

#endif
