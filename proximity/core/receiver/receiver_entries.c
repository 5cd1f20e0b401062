/* The receiver of proximity_message.h as entry points of the extension: its state, messages and contacts lie in arrays
   of bytes, as `proximity.core.receiver_state` has them. */
#include "entry_points.h"
#include "proximity_message.h"

/* Words of an array are its address and its length; results lie behind all arguments. */
#define POINTER(word) ((void *)(intptr_t)(word))

/* The instant at which a message was sent, which is at that byte. */
static int64_t sent_at(const uint8_t *message, int64_t at)
{
    int64_t sent_ns;
    memcpy(&sent_ns, message + at, sizeof sent_ns);
    return sent_ns;
}

/* receiver, message: uint8[:]; kind, sent_at, now: int; returns whether it is old */
int receiver_is_old(void **unused, void **no_error, int64_t words)
{
    int64_t *word = POINTER(words), sent_ns = sent_at(POINTER(word[2]), word[5]);
    proximity_prefix prefix;
    (void)unused, (void)no_error;
    memcpy(&prefix, POINTER(word[2]), sizeof prefix);
    word[7] = proximity_is_old(POINTER(word[0]), (uint64_t)word[4], &prefix, sent_ns, word[6]);
    return 0;
}

/* receiver, message: uint8[:]; kind, sent_at, now: int */
int receiver_accept(void **unused, void **no_error, int64_t words)
{
    int64_t *word = POINTER(words), sent_ns = sent_at(POINTER(word[2]), word[5]);
    proximity_prefix prefix;
    (void)unused, (void)no_error;
    memcpy(&prefix, POINTER(word[2]), sizeof prefix);
    proximity_accept(POINTER(word[0]), (uint64_t)word[4], &prefix, sent_ns, word[6]);
    return 0;
}

/* frame: uint8[:]; base: int; returns the flaw of its content */
int receiver_content_flaw(void **unused, void **no_error, int64_t words)
{
    int64_t *word = POINTER(words);
    const uint8_t *frame = POINTER(word[0]);
    proximity_frame_header header;
    (void)unused, (void)no_error;
    memcpy(&header, frame, sizeof header);
    word[3] = (int64_t)proximity_content_flaw(&header, frame + sizeof header, word[2]);
    return 0;
}

/* contacts: uint8[:]; now: int; max_speed, max_acceleration: float */
int receiver_widen(void **unused, void **no_error, int64_t words)
{
    const int64_t *word = POINTER(words);
    proximity_contact *contacts = POINTER(word[0]);
    double limits[2];
    (void)unused, (void)no_error;
    memcpy(limits, &word[3], sizeof limits);
    for (int64_t k = 0; k < word[1] / (int64_t)sizeof *contacts; k++) {
        proximity_widen(&contacts[k], word[2], limits[0], limits[1]);
    }
    return 0;
}

/* contacts: uint8[:] */
int receiver_forget(void **unused, void **no_error, int64_t words)
{
    const int64_t *word = POINTER(words);
    proximity_contact *contacts = POINTER(word[0]);
    (void)unused, (void)no_error;
    for (int64_t k = 0; k < word[1] / (int64_t)sizeof *contacts; k++) {
        proximity_forget(&contacts[k]);
    }
    return 0;
}
