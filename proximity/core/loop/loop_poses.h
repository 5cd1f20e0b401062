/* Messages of poses: received and validated as in `transport/message_reader.py`, and used if newer. */
#ifndef PROXIMITY_LOOP_POSES_H
#define PROXIMITY_LOOP_POSES_H

#include <math.h>

#include "loop_outputs.h"

static int64_t clock_now_ns(const Loop *loop)
{
    return loop->is_simulated ? loop->simulated_ns : system_now_ns();
}

static const InstructionSet *set_of(const Loop *loop)
{
    return POINTER(loop->set);
}

/* Test whether the received bytes are a message to be used; counted either way, an unused one by its flaw. */
static int is_usable(LoopInput *input, const uint8_t *message, int64_t size, int64_t now_ns)
{
    static const uint32_t magics[] = {PROXIMITY_POSES_MAGIC, PROXIMITY_PATH_POSES_MAGIC, PROXIMITY_MEASURED_MAGIC};
    static const size_t sizes[] = {sizeof(proximity_finger_pose), sizeof(proximity_path_pose), sizeof(proximity_measurement)};
    const proximity_prefix *prefix = (const proximity_prefix *)(const void *)message;
    const proximity_input_header *header = (const proximity_input_header *)(const void *)message;
    proximity_receiver *receiver = &input->receiver;
    int is_path = size >= (int64_t)sizeof *prefix && prefix->magic == PROXIMITY_PATH_POSES_MAGIC;
    uint64_t kind = input->is_measured ? 2 : (uint64_t)is_path;
    enum proximity_flaw flaw = PROXIMITY_FLAW_SIZE;
    if (size <= input->longest) {
        flaw = proximity_check(message, (size_t)size, magics[kind], sizeof *header, sizes[kind],
                               offsetof(proximity_input_header, count));
    }
    receiver->shares_clock = 1; /* the same machine has one clock */
    receiver->is_keyed = input->key != 0;
    if (flaw == PROXIMITY_FLAW_NONE && proximity_is_old(receiver, kind, prefix, header->send_ns, now_ns)) {
        flaw = PROXIMITY_FLAW_OLD;
    }
    receiver->flawed[flaw]++;
    if (flaw == PROXIMITY_FLAW_NONE) {
        proximity_accept(receiver, kind, prefix, header->send_ns, now_ns);
    }
    return flaw == PROXIMITY_FLAW_NONE;
}

/* Count poses that are dropped, and store the error of the first ones. */
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

/* Store values that accompany positions; they become unknown for fingers without any in this message. */
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

/* Use the poses in `given` that are newer; return whether there are any. */
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

/* Use the poses of a valid message: those of served fingers, if newer. */
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

/* Use the distances of a valid message, likewise, and the other values of the sensor. */
static void take_measured(Loop *loop, uint8_t *message)
{
    const proximity_input_header *header = (const proximity_input_header *)(const void *)message;
    const proximity_measurement *records = (const proximity_measurement *)(const void *)(header + 1);
    proximity_measurement *kept = POINTER(loop->measured);
    const uint8_t *defects = POINTER(loop->defects);
    int64_t *fingers = POINTER(loop->fingers), *given_ns = POINTER(loop->given_ns), rows = 0;
    double *given = POINTER(loop->given);
    for (; rows < header->count; rows++) { /* of served fingers only: Python ensures that */
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

/* Use the poses of a recording at the last of its times that has passed, once. */
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
    if (recording->round_ns != 0 && elapsed_ns >= recording->round_ns) { /* several rounds may have passed */
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
        loop->ticks_wanted = loop->ticks + 1; /* the present one */
    }
}

static void take_messages(Loop *loop)
{
    LoopInput *input = &loop->input;
    uint8_t *message = POINTER(input->message);
    int flawed = 0;
    for (int k = 0; k < PROXIMITY_MAX_AT_ONCE && flawed < PROXIMITY_MAX_FLAWED; k++) {
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
