/* Messages of poses: received and checked as `transport/message_reader.py` does, and kept where they are newer. */
#ifndef PROXIMITY_LOOP_POSES_H
#define PROXIMITY_LOOP_POSES_H

#include <math.h>

#include "loop_outputs.h"

enum { MOST_AT_ONCE = 256, MOST_FLAWED = 32 };
static const int64_t SILENCE_NS = 50000000;

static int64_t clock_now_ns(const Loop *loop)
{
    return loop->is_simulated ? loop->simulated_ns : system_now_ns();
}

static const InstructionSet *set_of(const Loop *loop)
{
    return POINTER(loop->set);
}

/* The flaw of bytes that claim to be poses, as proximity_check() has it. */
static int flaw_of(const uint8_t *message, int64_t size, int is_measured, int *kind)
{
    const proximity_input_header *header = (const proximity_input_header *)(const void *)message;
    int64_t stride;
    if (size < (int64_t)sizeof(proximity_prefix)) {
        return PROXIMITY_FLAW_SHORT;
    }
    *kind = is_measured ? 2 : header->magic == PROXIMITY_PATH_POSES_MAGIC;
    stride = (int64_t)(*kind == 2 ? sizeof(proximity_measurement) : *kind ? sizeof(proximity_path_pose) : sizeof(proximity_finger_pose));
    if (size < (int64_t)sizeof *header) {
        return PROXIMITY_FLAW_SHORT;
    }
    if (header->magic != (*kind == 2 ? PROXIMITY_MEASURED_MAGIC : *kind ? PROXIMITY_PATH_POSES_MAGIC : PROXIMITY_POSES_MAGIC)) {
        return PROXIMITY_FLAW_MAGIC;
    }
    if (header->version != PROXIMITY_VERSION) {
        return PROXIMITY_FLAW_VERSION;
    }
    int64_t body = size - (int64_t)sizeof *header;
    if (header->size != (uint64_t)size || header->header_size != sizeof *header || body % stride != 0 ||
        body / stride > PROXIMITY_MAX_RECORDS) {
        return PROXIMITY_FLAW_SIZE;
    }
    if (checksum(message + 8, size - 8) != header->checksum) {
        return PROXIMITY_FLAW_CHECKSUM;
    }
    return header->count == (uint64_t)(body / stride) ? PROXIMITY_FLAW_NONE : PROXIMITY_FLAW_SIZE;
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
static int is_old(LoopInput *input, int kind, const proximity_input_header *header, int64_t now_ns)
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
        return !(header->sequence > last->sequence && header->sequence - last->sequence <= PROXIMITY_MOST_SKIPPED);
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
static void accept_message(LoopInput *input, int kind, const proximity_input_header *header, int64_t now_ns)
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
    uint64_t missing = header->sequence - before - 1;
    input->lost += missing <= PROXIMITY_MOST_SKIPPED ? (int64_t)missing : 0; /* of a run that was joined late */
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
    const proximity_input_header *header = (const proximity_input_header *)(const void *)message;
    int kind = 0, flaw = size > input->longest ? PROXIMITY_FLAW_SIZE : flaw_of(message, size, input->is_measured != 0, &kind);
    if (flaw == PROXIMITY_FLAW_NONE && is_old(input, kind, header, now_ns)) {
        flaw = PROXIMITY_FLAW_CHECKSUM + 1;
    }
    if (flaw != PROXIMITY_FLAW_NONE) {
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

/* Keep numbers that come beside positions: of whoever has none in this message they are not known any more. */
static void keep_optional(Loop *loop, int64_t rows, const uint8_t *records, int64_t stride, int64_t at, int64_t width,
                          double *kept, int64_t *has)
{
    const uint8_t *defects = POINTER(loop->defects);
    const int64_t *fingers = POINTER(loop->fingers);
    for (int64_t row = 0; row < rows && !*has && at >= 0; row++) {
        const double *numbers = (const double *)(const void *)(records + row * stride + at);
        for (int64_t k = 0; k < width && !*has; k++) {
            *has = isfinite(numbers[k]) != 0;
        }
    }
    for (int64_t row = 0; row < rows && *has; row++) {
        if (defects[row] == USABLE && at >= 0) {
            memcpy(kept + width * fingers[row], records + row * stride + at, (size_t)width * sizeof(double));
        } else if (defects[row] == USABLE) {
            for (int64_t k = 0; k < width; k++) {
                kept[width * fingers[row] + k] = NAN;
            }
        }
    }
}

/* Take the poses that are in `given` where they are newer; whether that was done. */
static int take_given(Loop *loop, int64_t rows)
{
    int64_t now_ns = clock_now_ns(loop), count = loop->count;
    int64_t words[] = {loop->pose_ns, count, loop->positions, count, loop->width, loop->refused_ns, count, loop->row_of,
                       count, loop->fingers, rows, loop->given_ns, rows, loop->given, rows, loop->width, loop->defects, rows,
                       now_ns - loop->stale_after_ns, now_ns + PROXIMITY_AHEAD_NS, 0};
    if (!proximity_call(set_of(loop), UPDATE_NEWEST, words)) {
        return 0;
    }
    count_defects(loop, rows, now_ns);
    return 1;
}

/* Take the poses of a message that was checked: those of fingers that are served, where they are newer. */
static void take_poses(Loop *loop, uint8_t *message)
{
    proximity_input_header *header = (proximity_input_header *)(void *)message;
    int is_path = header->magic == PROXIMITY_PATH_POSES_MAGIC;
    int64_t stride = is_path ? (int64_t)sizeof(proximity_path_pose) : (int64_t)sizeof(proximity_finger_pose), rows = 0;
    uint8_t *records = (uint8_t *)(header + 1);
    int64_t *fingers = POINTER(loop->fingers), *given_ns = POINTER(loop->given_ns);
    double *given = POINTER(loop->given);
    for (uint32_t k = 0; k < header->count; k++) {
        const proximity_finger_pose *pose = (const proximity_finger_pose *)(const void *)(records + (int64_t)k * stride);
        if (pose->finger >= (uint64_t)loop->count) {
            loop->input.unserved++;
            continue;
        }
        fingers[rows] = pose->finger;
        given_ns[rows] = pose->pose_ns;
        memcpy(given + 3 * rows, pose->position, sizeof pose->position);
        memmove(records + rows * stride, pose, (size_t)stride);
        rows++;
    }
    if (!take_given(loop, rows)) {
        return;
    }
    keep_optional(loop, rows, records, stride, offsetof(proximity_finger_pose, velocity), 3, POINTER(loop->velocities),
                  &loop->has_velocities);
    keep_optional(loop, rows, records, stride, is_path ? (int64_t)offsetof(proximity_path_pose, corners) : -1,
                  3 * PROXIMITY_PATH_CORNERS, POINTER(loop->paths), &loop->has_paths);
    keep_optional(loop, rows, records, stride, offsetof(proximity_finger_pose, bend), 1, POINTER(loop->bends), &loop->has_bends);
}

/* Take the distances of a message that was checked, likewise, and all that the sensor knows beside them. */
static void take_measured(Loop *loop, uint8_t *message)
{
    const proximity_input_header *header = (const proximity_input_header *)(const void *)message;
    const proximity_measurement *records = (const proximity_measurement *)(const void *)(header + 1);
    proximity_measurement *kept = POINTER(loop->measured);
    const uint8_t *defects = POINTER(loop->defects);
    int64_t *fingers = POINTER(loop->fingers), *given_ns = POINTER(loop->given_ns), rows = 0;
    double *given = POINTER(loop->given);
    for (; rows < header->count; rows++) { /* of fingers that are served: Python sees to that */
        fingers[rows] = records[rows].finger;
        given_ns[rows] = records[rows].measured_ns;
        given[rows] = records[rows].signed_distance;
    }
    if (take_given(loop, rows)) {
        for (int64_t row = 0; row < rows; row++) {
            if (defects[row] == USABLE) {
                kept[fingers[row]] = records[row];
            }
        }
    }
}

/* Take the poses of a recording at the last of its times that is past, unless they were taken before. */
static void play_recording(Loop *loop, int64_t now_ns)
{
    LoopRecording *recording = &loop->recording;
    const int64_t *times_ns = POINTER(recording->times_ns);
    if (recording->rows == 0) {
        return;
    }
    if (!recording->has_begun) {
        recording->has_begun = 1;
        recording->row = -1;
        recording->start_ns = now_ns - recording->latency_ns;
    }
    int64_t elapsed_ns = now_ns - recording->latency_ns - recording->start_ns;
    if (recording->round_ns != 0 && elapsed_ns >= recording->round_ns) { /* all that are past at once */
        recording->start_ns += elapsed_ns / recording->round_ns * recording->round_ns;
        elapsed_ns %= recording->round_ns;
        recording->row = -1;
    }
    int64_t row = recording->row, *fingers = POINTER(loop->fingers), *given_ns = POINTER(loop->given_ns);
    while (row + 1 < recording->rows && times_ns[row + 1] <= elapsed_ns) {
        row++;
    }
    if (row == recording->row) {
        return;
    }
    recording->row = row;
    for (int64_t k = 0; k < loop->count; k++) {
        fingers[k] = k;
        given_ns[k] = recording->start_ns + times_ns[row];
    }
    const double *positions = POINTER(recording->positions);
    memcpy(POINTER(loop->given), positions + 3 * loop->count * row, (size_t)loop->count * 3 * sizeof(double));
    take_given(loop, loop->count);
    if (recording->round_ns == 0 && row == recording->rows - 1) {
        recording->is_over = 1;
        loop->ticks_wanted = loop->ticks + 1; /* this one */
    }
}

static void take_messages(Loop *loop)
{
    LoopInput *input = &loop->input;
    uint8_t *message = POINTER(input->message);
    int flawed = 0;
    for (int k = 0; k < MOST_AT_ONCE && flawed < MOST_FLAWED; k++) {
        int64_t size = receive_message(input);
        if (size == PROXIMITY_MAILBOX_NOTHING) {
            return;
        }
        if (is_usable(input, message, size, clock_now_ns(loop))) {
            (input->is_measured ? take_measured : take_poses)(loop, message);
        } else {
            flawed++;
        }
    }
}

#endif
