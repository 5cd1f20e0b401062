/* Outgoing messages of the loop: numbered, given a checksum and a tag, and sent as publishers do. */
#ifndef PROXIMITY_LOOP_OUTPUTS_H
#define PROXIMITY_LOOP_OUTPUTS_H

#include "loop_ends.h"

enum { MAX_DATAGRAM_BYTES = 65507 };
static const int64_t ASLEEP_NS = 1000000000;

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

/* The CRC-32 of bytes whose number is a multiple of eight, as that of every message. */
static uint32_t checksum(const void *data, size_t size)
{
    const uint8_t *bytes = data;
    const uint32_t(*t)[256] = checksum_tables;
    uint32_t crc = 0xffffffffu;
    for (size_t at = 0; at < size; at += 8) {
        uint32_t a, b;
        memcpy(&a, bytes + at, 4);
        memcpy(&b, bytes + at + 4, 4);
        a ^= crc;
        crc = t[7][a & 255] ^ t[6][a >> 8 & 255] ^ t[5][a >> 16 & 255] ^ t[4][a >> 24] ^ t[3][b & 255] ^
              t[2][b >> 8 & 255] ^ t[1][b >> 16 & 255] ^ t[0][b >> 24];
    }
    return crc ^ 0xffffffffu;
}

static int64_t calendar_ns(void)
{
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Number a message of that kind: 0 for frames, 1 for the description. After the machine slept the session is new. */
static void seal(LoopOutput *output, uint8_t *message, int64_t size, int kind)
{
    proximity_prefix *prefix = (proximity_prefix *)(void *)message;
    int64_t calendar = calendar_ns(), before_ns = output->awake_ns;
    output->awake_ns = calendar - system_now_ns();
    if (output->awake_ns > before_ns + ASLEEP_NS) {
        output->session = calendar > output->session ? calendar : output->session + 1;
        output->sequences[0] = output->sequences[1] = 0;
    }
    prefix->session = (uint64_t)output->session;
    prefix->sequence = (uint64_t)output->sequences[kind]++;
    prefix->checksum = checksum(message + 8, (size_t)size - 8);
}

static void send_message(LoopOutput *output, uint8_t *message, int64_t size, int kind, uint8_t *datagram)
{
    proximity_mailbox *box = POINTER(output->box);
    int error;
    seal(output, message, size, kind);
    if (box != NULL) {
        error = proximity_mailbox_write(box, message, (uint32_t)size) ? 0 : EMSGSIZE;
    } else if (output->socket < 0) {
        error = 0; /* frames are logged only */
    } else if (size > MAX_DATAGRAM_BYTES - (output->key != 0 ? PROXIMITY_TAG_BYTES : 0)) {
        error = EMSGSIZE;
    } else if (output->key == 0) {
        error = send_datagram(output, message, (size_t)size);
    } else {
        memcpy(datagram, message, (size_t)size);
        proximity_tag(POINTER(output->key), message, (size_t)size, datagram + size);
        error = send_datagram(output, datagram, (size_t)size + PROXIMITY_TAG_BYTES);
    }
    if (error != 0 && kind == 0) {
        output->first_failure = output->failures++ == 0 ? error : output->first_failure;
    }
}

#endif
