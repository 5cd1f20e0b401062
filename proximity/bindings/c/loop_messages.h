/* Messages of the loop: received and checked as `transport/message_reader.py` does, sealed and sent as publishers do. */
#ifndef PROXIMITY_LOOP_MESSAGES_H
#define PROXIMITY_LOOP_MESSAGES_H

#include <errno.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include "core.h"
#include "decaff_mailbox.h"
#include "decaff_message.h"
#include "loop.h"

#define POINTER(word) ((void *)(intptr_t)(word))

enum { MOST_STRANGERS = 64, MOST_FORGED_BYTES = 1 << 17, MOST_DATAGRAM_BYTES = 65507, NAME_NS = 100000000 };
static const int64_t ASLEEP_NS = 1000000000, SILENCE_NS = 50000000;

/* --- the checksum, eight bytes at a time ---------------------------------------------------------------- */

static uint32_t checksum_tables[8][256];

static void make_checksum_tables(void)
{
    for (uint32_t k = 0; k < 256; k++) {
        uint32_t crc = k;
        for (int bit = 0; bit < 8; bit++) {
            crc = (crc >> 1) ^ ((crc & 1u) != 0 ? 0xedb88320u : 0u);
        }
        checksum_tables[0][k] = crc;
    }
    for (uint32_t k = 0; k < 256; k++) {
        for (int table = 1; table < 8; table++) {
            uint32_t before = checksum_tables[table - 1][k];
            checksum_tables[table][k] = (before >> 8) ^ checksum_tables[0][before & 255u];
        }
    }
}

/* The CRC-32 of bytes whose number is a multiple of eight, as those of messages are. */
static uint32_t checksum(const uint8_t *bytes, int64_t size)
{
    const uint32_t(*t)[256] = checksum_tables;
    uint32_t crc = 0xffffffffu;
    for (int64_t at = 0; at < size; at += 8) {
        uint32_t a, b;
        memcpy(&a, bytes + at, 4);
        memcpy(&b, bytes + at + 4, 4);
        a ^= crc;
        crc = t[7][a & 255] ^ t[6][a >> 8 & 255] ^ t[5][a >> 16 & 255] ^ t[4][a >> 24] ^ t[3][b & 255] ^
              t[2][b >> 8 & 255] ^ t[1][b >> 16 & 255] ^ t[0][b >> 24];
    }
    return crc ^ 0xffffffffu;
}

/* --- in ------------------------------------------------------------------------------------------------- */

/* Open the mailbox that has the name now; whether there is one. Of the next one everything is news. */
static int follow_mailbox(LoopInput *input)
{
    decaff_mailbox *box = POINTER(input->box);
    int is_next = input->looked_ns != 0, outcome;
    decaff_mailbox_close(box);
    outcome = decaff_mailbox_open(box, POINTER(input->name));
    input->looked_ns = decaff_mailbox_now_ns();
    if (outcome == DECAFF_MAILBOX_OK && is_next) {
        box->position = __atomic_load_n(&box->header->floor, __ATOMIC_ACQUIRE);
    }
    if (outcome != DECAFF_MAILBOX_OK && outcome != DECAFF_MAILBOX_NOBODY) {
        input->first_failure = input->failures++ == 0 ? -outcome : input->first_failure;
    }
    return outcome == DECAFF_MAILBOX_OK;
}

static int64_t receive_from_mailbox(LoopInput *input)
{
    decaff_mailbox *box = POINTER(input->box);
    if (box->header == NULL && !follow_mailbox(input)) {
        return DECAFF_MAILBOX_NOTHING;
    }
    int64_t size = decaff_mailbox_read(box, POINTER(input->message), (uint64_t)input->longest), now_ns;
    if (size != DECAFF_MAILBOX_NOTHING) {
        return size;
    }
    now_ns = decaff_mailbox_now_ns();
    int looks = now_ns - input->looked_ns > NAME_NS;
    input->looked_ns = looks ? now_ns : input->looked_ns;
    if (!(looks ? decaff_mailbox_is_over(box) : decaff_mailbox_is_closed(box)) || !follow_mailbox(input)) {
        return DECAFF_MAILBOX_NOTHING;
    }
    return decaff_mailbox_read(box, POINTER(input->message), (uint64_t)input->longest);
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
    for (int k = 0; k < MOST_STRANGERS && forged <= MOST_FORGED_BYTES; k++) {
        struct sockaddr_in from = {0};
        socklen_t from_size = sizeof from;
        int64_t size = recvfrom((int)input->socket, POINTER(input->message), (size_t)input->longest, MSG_TRUNC,
                                (struct sockaddr *)&from, &from_size);
        if (size < 0) {
            if (errno != EAGAIN && errno != EWOULDBLOCK) {
                input->first_failure = input->failures++ == 0 ? errno : input->first_failure;
            }
            return DECAFF_MAILBOX_NOTHING;
        }
        if (!is_expected(input, &from)) {
            input->refused++;
        } else if (input->key == 0) {
            return size;
        } else if (size <= input->longest) {
            size_t verified = decaff_verified(POINTER(input->key), POINTER(input->message), (size_t)size);
            if (verified != 0) {
                return (int64_t)verified;
            }
            input->unverified++;
            forged += size;
        }
    }
    return DECAFF_MAILBOX_NOTHING;
}

/* Read the next message; its size, or DECAFF_MAILBOX_NOTHING. */
static int64_t receive_message(LoopInput *input)
{
    return input->box != 0 ? receive_from_mailbox(input) : receive_datagram(input);
}

/* The flaw of bytes that claim to be poses, as decaff_check() has it. */
static int flaw_of(const uint8_t *message, int64_t size, int *kind)
{
    const decaff_input_header *header = (const decaff_input_header *)(const void *)message;
    int64_t stride;
    if (size < (int64_t)sizeof(decaff_prefix)) {
        return DECAFF_FLAW_SHORT;
    }
    *kind = header->magic == DECAFF_PATH_POSES_MAGIC;
    stride = *kind ? (int64_t)sizeof(decaff_path_pose) : (int64_t)sizeof(decaff_pose);
    if (size < (int64_t)sizeof *header) {
        return DECAFF_FLAW_SHORT;
    }
    if (header->magic != DECAFF_POSES_MAGIC && header->magic != DECAFF_PATH_POSES_MAGIC) {
        return DECAFF_FLAW_MAGIC;
    }
    if (header->version != DECAFF_VERSION) {
        return DECAFF_FLAW_VERSION;
    }
    int64_t body = size - (int64_t)sizeof *header;
    if (header->size != (uint64_t)size || header->header_size != sizeof *header || body % stride != 0 ||
        body / stride > DECAFF_MAX_RECORDS) {
        return DECAFF_FLAW_SIZE;
    }
    if (checksum(message + 8, size - 8) != header->checksum) {
        return DECAFF_FLAW_CHECKSUM;
    }
    return header->count == (uint64_t)(body / stride) ? DECAFF_FLAW_NONE : DECAFF_FLAW_SIZE;
}

static LoopRun *ended_run(LoopInput *input, int kind, uint64_t session)
{
    for (int64_t k = 0; k < input->ended_count; k++) {
        if (input->ended[k].kind == kind && input->ended[k].session == session) {
            return &input->ended[k];
        }
    }
    return NULL;
}

/* Whether a message was overtaken or is repeated; see `MessageReader`. */
static int is_old(LoopInput *input, int kind, const decaff_input_header *header, int64_t now_ns)
{
    const LoopSeen *last = &input->seen[kind];
    const LoopRun *run = ended_run(input, kind, header->session);
    if (header->session < input->newest_session && input->key != 0) {
        return 1;
    }
    if (!last->is_any) {
        return 0;
    }
    if (header->session == last->session) {
        return !(header->sequence > last->sequence && header->sequence - last->sequence <= DECAFF_MOST_SKIPPED);
    }
    if (header->session > last->session && run == NULL) {
        return 0;
    }
    if (run != NULL) {
        return !(now_ns - last->taken_ns > SILENCE_NS && header->sequence > run->sequence);
    }
    return !(header->send_ns > last->sent_ns); /* on one machine clocks are one */
}

static void forget_run(LoopInput *input, LoopRun *run)
{
    LoopRun *end = input->ended + input->ended_count--;
    memmove(run, run + 1, (size_t)(end - run - 1) * sizeof *run);
}

/* Count a message that is used, and those before it that are missing. */
static void accept_message(LoopInput *input, int kind, const decaff_input_header *header, int64_t now_ns)
{
    LoopSeen *last = &input->seen[kind];
    uint64_t before = header->sequence - 1;
    if (!last->is_any) {
        input->sessions++;
    } else if (last->session == header->session) {
        before = last->sequence;
    } else {
        LoopRun ended = {kind, last->session, last->sequence}, *run = ended_run(input, kind, header->session);
        input->sessions++;
        before = run != NULL ? run->sequence : UINT64_MAX;
        if (run != NULL) {
            forget_run(input, run);
        } else if (input->ended_count == LOOP_RUNS) {
            forget_run(input, input->ended);
        }
        input->ended[input->ended_count++] = ended;
    }
    input->lost += (int64_t)(header->sequence - before - 1);
    input->received++;
    last->is_any = 1;
    last->session = header->session;
    last->sequence = header->sequence;
    last->sent_ns = header->send_ns;
    last->taken_ns = now_ns;
    input->newest_session = header->session > input->newest_session ? header->session : input->newest_session;
}

/* Whether what was received is a message to be used; counted if it is, and if it is not, by its defect. */
static int is_usable(LoopInput *input, const uint8_t *message, int64_t size, int64_t now_ns)
{
    const decaff_input_header *header = (const decaff_input_header *)(const void *)message;
    int kind = 0, flaw = size > input->longest ? DECAFF_FLAW_SIZE : flaw_of(message, size, &kind);
    if (flaw == DECAFF_FLAW_NONE && is_old(input, kind, header, now_ns)) {
        flaw = DECAFF_FLAW_CHECKSUM + 1;
    }
    if (flaw != DECAFF_FLAW_NONE) {
        input->flawed[flaw]++;
        return 0;
    }
    accept_message(input, kind, header, now_ns);
    return 1;
}

/* Count poses that are left out, and remember how far off the first ones were. */
static void count_defects(Loop *loop, int64_t rows, int64_t now_ns)
{
    const uint8_t *defects = POINTER(loop->defects);
    const int64_t *given_ns = POINTER(loop->given_ns), *fingers = POINTER(loop->fingers), *newest = POINTER(loop->pose_ns);
    int64_t *counts[4] = {&loop->future, &loop->too_old, &loop->backwards, &loop->lost_hands};
    const int kinds[4] = {FUTURE, TOO_OLD, BACKWARDS, (int)loop->lost_hand};
    for (int kind = 0; kind < 4; kind++) {
        int64_t found = 0, off_ns = INT64_MIN;
        for (int64_t row = 0; row < rows; row++) {
            if (defects[row] == kinds[kind]) {
                int64_t each_ns = kind == 1   ? now_ns - given_ns[row]
                                  : kind == 2 ? newest[fingers[row]] - given_ns[row]
                                              : given_ns[row] - now_ns;
                off_ns = each_ns > off_ns ? each_ns : off_ns;
                found++;
            }
        }
        if (found > 0 && *counts[kind] == 0) {
            loop->first_off_ns[kind] = off_ns;
        }
        *counts[kind] += found;
    }
}

/* --- out ------------------------------------------------------------------------------------------------ */

static int64_t calendar_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Number a message of that kind, 0 of frames, 1 of the description; after the machine slept in another session. */
static void seal(LoopOutput *output, uint8_t *message, int64_t size, int kind)
{
    decaff_prefix *prefix = (decaff_prefix *)(void *)message;
    int64_t calendar = calendar_ns(), before_ns = output->awake_ns;
    output->awake_ns = calendar - decaff_mailbox_now_ns();
    if (output->awake_ns > before_ns + ASLEEP_NS) {
        output->session = calendar > output->session ? calendar : output->session + 1;
        output->sequences[0] = output->sequences[1] = 0;
    }
    prefix->session = (uint64_t)output->session;
    prefix->sequence = (uint64_t)output->sequences[kind]++;
    prefix->checksum = checksum(message + 8, size - 8);
}

/* Send a datagram; errno where that failed. That nobody listens is no failure. */
static int send_datagram(LoopOutput *output, const uint8_t *datagram, size_t size)
{
    for (int tries = 0; tries < 2; tries++) {
        if (send((int)output->socket, datagram, size, MSG_NOSIGNAL) >= 0) {
            return 0;
        }
        /* The system may tell here of an earlier datagram, and has not sent this one. */
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

static void send_message(LoopOutput *output, uint8_t *message, int64_t size, int kind, uint8_t *datagram)
{
    decaff_mailbox *box = POINTER(output->box);
    int error;
    seal(output, message, size, kind);
    if (box != NULL) {
        error = decaff_mailbox_write(box, message, (uint32_t)size) ? 0 : EMSGSIZE;
    } else if (size > MOST_DATAGRAM_BYTES - (output->key != 0 ? DECAFF_TAG_BYTES : 0)) {
        error = EMSGSIZE;
    } else if (output->key == 0) {
        error = send_datagram(output, message, (size_t)size);
    } else {
        memcpy(datagram, message, (size_t)size);
        decaff_tag(POINTER(output->key), message, (size_t)size, datagram + size);
        error = send_datagram(output, datagram, (size_t)size + DECAFF_TAG_BYTES);
    }
    if (error != 0 && kind == 0) {
        output->first_failure = output->failures++ == 0 ? error : output->first_failure;
    }
}

#endif
