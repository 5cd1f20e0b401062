/* The loop of a service: newest poses in, filter, tick, frame, seal, out, without an interpreter and without
   allocation. What it does with a message, a pose and a frame is what `service/loop.py` does, bit for bit. */
#ifdef __linux__
#include "loop.h"

#include <math.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/timerfd.h>

#include "core.h"
#include "decaff_mailbox.h"
#include "decaff_message.h"
#include "loop_messages.h"

PROXIMITY_API int64_t proximity_loop_size(void);
PROXIMITY_API int proximity_loop_run(Loop *loop);

enum { LOOK_NS = 50000000, OPEN_NS = 5000000, APART_NS = 500000, STOPPING_FRAMES = 3, MOST_AT_ONCE = 256, MOST_FLAWED = 32 };

int64_t proximity_loop_size(void)
{
    return sizeof(Loop);
}

static int64_t clock_now_ns(const Loop *loop)
{
    return loop->is_simulated ? loop->simulated_ns : decaff_mailbox_now_ns();
}

static void record(LoopTimes *times, int64_t duration_ns)
{
    int64_t bin = duration_ns < 0 ? 0 : duration_ns;
    int shift = duration_ns > 0 ? 58 - __builtin_clzll((unsigned long long)duration_ns) : 0;
    times->count++;
    times->max_ns = duration_ns > times->max_ns ? duration_ns : times->max_ns;
    if (duration_ns >= (INT64_C(1) << 42)) {
        bin = LOOP_BINS - 1;
    } else if (shift > 0) {
        bin = ((int64_t)shift << 5) + (duration_ns >> shift);
    }
    times->bins[bin]++;
}

static void sleep_until(int64_t instant_ns)
{
    struct timespec until = {instant_ns / 1000000000, instant_ns % 1000000000};
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
}

/* Wait for a message until that instant; whether one may be there. */
static int wait_for_message(Loop *loop, int64_t until_ns)
{
    LoopInput *input = &loop->input;
    decaff_mailbox *box = POINTER(input->box);
    if (box != NULL) {
        int is_gone = box->header == NULL || (decaff_mailbox_is_closed(box) && !decaff_mailbox_has(box));
        if (is_gone && !follow_mailbox(input)) {
            int64_t again_ns = decaff_mailbox_now_ns() + OPEN_NS;
            sleep_until(again_ns < until_ns ? again_ns : until_ns);
            return 0;
        }
        return decaff_mailbox_wait(box, until_ns);
    }
    struct itimerspec due = {{0, 0}, {until_ns / 1000000000, until_ns % 1000000000}};
    struct pollfd ends[2] = {{(int)input->socket, POLLIN, 0}, {(int)loop->timer, POLLIN, 0}};
    timerfd_settime((int)loop->timer, TFD_TIMER_ABSTIME, &due, NULL);
    poll(ends, 2, -1);
    return (ends[0].revents & POLLIN) != 0;
}

/* Wait for the next tick; whether a pose is why it comes before it is due. Ticks for poses are half a period, or
   half a millisecond, apart: a flood of poses takes no more than that. */
static int wait_for_tick(Loop *loop)
{
    if (loop->is_simulated) {
        loop->simulated_ns = loop->due_ns > loop->simulated_ns ? loop->due_ns : loop->simulated_ns;
        return 0;
    }
    while (!__atomic_load_n(&loop->stop, __ATOMIC_ACQUIRE)) {
        int64_t now_ns = decaff_mailbox_now_ns(), until_ns = loop->due_ns, apart_ns = loop->period_ns / 2;
        int64_t free_ns = loop->posed_ns + (apart_ns < APART_NS ? apart_ns : APART_NS);
        if (now_ns >= until_ns) {
            return 0;
        }
        until_ns = until_ns < now_ns + LOOK_NS ? until_ns : now_ns + LOOK_NS;
        if (now_ns < free_ns) {
            sleep_until(free_ns < until_ns ? free_ns : until_ns);
        } else if (wait_for_message(loop, until_ns)) {
            return 1;
        }
    }
    return 0;
}

static void skip_what_is_past(Loop *loop, int64_t now_ns)
{
    int64_t past = now_ns > loop->due_ns ? (now_ns - loop->due_ns) / loop->period_ns : 0;
    loop->missed += past;
    loop->due_ns += past * loop->period_ns;
}

static const InstructionSet *set_of(const Loop *loop)
{
    return POINTER(loop->set);
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

/* Take the poses of a message that was checked: those of fingers that are served, where they are newer. */
static void take_poses(Loop *loop, uint8_t *message)
{
    decaff_input_header *header = (decaff_input_header *)(void *)message;
    int is_path = header->magic == DECAFF_PATH_POSES_MAGIC;
    int64_t stride = is_path ? (int64_t)sizeof(decaff_path_pose) : (int64_t)sizeof(decaff_pose), rows = 0;
    uint8_t *records = (uint8_t *)(header + 1);
    int64_t *fingers = POINTER(loop->fingers), *given_ns = POINTER(loop->given_ns);
    double *given = POINTER(loop->given);
    for (uint32_t k = 0; k < header->count; k++) {
        const decaff_pose *pose = (const decaff_pose *)(const void *)(records + (int64_t)k * stride);
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
    int64_t now_ns = clock_now_ns(loop), count = loop->count;
    int64_t words[] = {loop->pose_ns, count, loop->positions, count, 3, loop->refused_ns, count, loop->row_of, count,
                       loop->fingers, rows, loop->given_ns, rows, loop->given, rows, 3, loop->defects, rows,
                       now_ns - loop->stale_after_ns, now_ns + DECAFF_AHEAD_NS, 0};
    if (!proximity_call(set_of(loop), UPDATE_NEWEST, words)) {
        return;
    }
    count_defects(loop, rows, now_ns);
    keep_optional(loop, rows, records, stride, offsetof(decaff_pose, velocity), 3, POINTER(loop->velocities),
                  &loop->has_velocities);
    keep_optional(loop, rows, records, stride, is_path ? (int64_t)offsetof(decaff_path_pose, corners) : -1,
                  3 * DECAFF_PATH_CORNERS, POINTER(loop->paths), &loop->has_paths);
    keep_optional(loop, rows, records, stride, offsetof(decaff_pose, bend), 1, POINTER(loop->bends), &loop->has_bends);
}

static void take_messages(Loop *loop)
{
    LoopInput *input = &loop->input;
    uint8_t *message = POINTER(input->message);
    int flawed = 0;
    for (int k = 0; k < MOST_AT_ONCE && flawed < MOST_FLAWED; k++) {
        int64_t size = receive_message(input);
        if (size == DECAFF_MAILBOX_NOTHING) {
            return;
        }
        if (is_usable(input, message, size, clock_now_ns(loop))) {
            take_poses(loop, message);
        } else {
            flawed++;
        }
    }
}

/* What is known of the bends of fingers that are tracked and are on no path. */
static void write_bends(Loop *loop, LoopSource *source, decaff_contact *contacts)
{
    const double *bends = POINTER(loop->bends);
    const int64_t *pose_ns = POINTER(loop->pose_ns);
    for (int64_t k = 0; k < loop->count && loop->has_bends; k++) {
        uint32_t flags = contacts[k].flags & (DECAFF_FLAG_TRACKED | DECAFF_FLAG_ON_PATH);
        if (flags != DECAFF_FLAG_TRACKED || !isfinite(bends[k])) {
            continue;
        }
        double reals[5] = {loop->metres_a_bend * bends[k], 0.0, 0.0, DEFAULT_MAX_SPEED, DEFAULT_MAX_ACCELERATION};
        int64_t words[12] = {source->bend_motions, loop->count, ESTIMATES, k, pose_ns[k]};
        memcpy(words + 5, reals, sizeof reals);
        proximity_call(set_of(loop), OBSERVE, words);
        contacts[k].bend = bends[k];
        if ((words[10] & DECAFF_FLAG_PREDICTED) != 0) {
            const Estimate *estimates = POINTER(source->bend_motions);
            contacts[k].bend_rate = estimates[ESTIMATES * k].velocity[0] / loop->metres_a_bend;
        }
    }
}

/* Let nothing be known: a tick was not done, and what is there is of the one before. */
static void forget_all(const Loop *loop, decaff_contact *contacts)
{
    for (int64_t k = 0; k < loop->count; k++) {
        memcpy(&contacts[k], proximity_unknown_contact, sizeof *contacts);
        contacts[k].finger = (uint32_t)k;
    }
}

static void tick_tracker(Loop *loop, decaff_contact *contacts, int64_t now_ns)
{
    LoopSource *source = POINTER(loop->source);
    const int64_t *table = POINTER(source->tracker);
    Settings *settings = POINTER(table[AT_SETTINGS]);
    settings->has_velocities = loop->has_velocities != 0;
    settings->has_paths = loop->has_paths != 0;
    int64_t words[] = {source->model, source->tracker, loop->positions, loop->count, 3, loop->pose_ns, loop->count,
                       now_ns, source->is_moved, 0};
    if (!proximity_call(set_of(loop), TICK, words) || words[9] == 0) {
        forget_all(loop, contacts);
        return;
    }
    source->is_moved = 0;
    source->answers |= words[9];
    write_bends(loop, source, contacts);
}

static void exchange_source(Loop *loop)
{
    LoopSource *next = POINTER(__atomic_load_n(&loop->next, __ATOMIC_ACQUIRE)), *before = POINTER(loop->source);
    if (next != NULL) {
        loop->epoch_offset = before->epoch + loop->epoch_offset + 1 - next->epoch;
        loop->source = (int64_t)(intptr_t)next;
        __atomic_store_n(&loop->next, 0, __ATOMIC_RELEASE);
    }
}

/* Finish the header of a frame: see `service/frame_builder.py`. */
static int finish_frame(Loop *loop, int64_t start_ns, int64_t publish_ns)
{
    decaff_frame_header *frame = POINTER(loop->frame);
    const decaff_contact *contacts = (const decaff_contact *)(const void *)(frame + 1);
    int64_t oldest_ns = INT64_MAX, tracked = 0, uncertain = 0;
    const uint32_t near = DECAFF_FLAG_BOUNDED | DECAFF_FLAG_IN_RANGE;
    for (int64_t k = 0; k < loop->count; k++) {
        if ((contacts[k].flags & DECAFF_FLAG_TRACKED) != 0) {
            tracked++;
            oldest_ns = contacts[k].pose_ns < oldest_ns ? contacts[k].pose_ns : oldest_ns;
            uncertain += (contacts[k].flags & near) == near;
        }
    }
    frame->pose_ns = tracked ? oldest_ns : start_ns;
    frame->start_ns = start_ns;
    frame->publish_ns = publish_ns;
    frame->valid_until_ns = frame->pose_ns + loop->valid_for_ns;
    frame->period_ns = loop->period_ns;
    loop->has_started |= tracked > 0;
    if (!tracked) {
        frame->state = loop->has_started ? DECAFF_STATE_STALE : DECAFF_STATE_STARTING;
    } else if (loop->missed != loop->reported_missed || publish_ns > frame->valid_until_ns) {
        frame->state = DECAFF_STATE_LATE;
    } else {
        frame->state = tracked < loop->count || uncertain ? DECAFF_STATE_DEGRADED : DECAFF_STATE_OK;
    }
    loop->reported_missed = loop->missed;
    frame->epoch = (uint64_t)loop->epoch;
    frame->missed = (uint64_t)loop->missed;
    return frame->state;
}

static void publish(Loop *loop, uint8_t *message, int64_t size, int kind)
{
    for (int64_t k = 0; k < loop->output_count; k++) {
        send_message(&loop->outputs[k], message, size, kind, POINTER(loop->datagram));
        if (k == 0 && kind == 0 && loop->log != 0) {
            decaff_mailbox_add(POINTER(loop->log), message, (uint32_t)size); /* its reader looks now and then */
        }
    }
}

static void publish_pending(Loop *loop)
{
    uint8_t *message = POINTER(__atomic_load_n(&loop->pending, __ATOMIC_ACQUIRE));
    if (message != NULL) {
        publish(loop, message, loop->pending_size, 1);
        __atomic_store_n(&loop->pending, 0, __ATOMIC_RELEASE);
    }
}

/* Make one frame. */
static void tick(Loop *loop, int is_for_pose)
{
    decaff_frame_header *frame = POINTER(loop->frame);
    decaff_contact *contacts = (decaff_contact *)(void *)(frame + 1);
    int64_t start_ns = clock_now_ns(loop), begun_ns = decaff_mailbox_now_ns();
    if (is_for_pose) {
        loop->posed_ns = loop->due_ns = start_ns;
    }
    int64_t late_ns = start_ns - loop->due_ns;
    exchange_source(loop);
    take_messages(loop);
    int64_t words[] = {loop->pose_ns, loop->count, loop->positions, loop->count, 3, start_ns - loop->stale_after_ns, 0};
    proximity_call(set_of(loop), DROP_STALE, words);
    tick_tracker(loop, contacts, start_ns);
    loop->epoch = ((LoopSource *)POINTER(loop->source))->epoch + loop->epoch_offset;
    int64_t publish_ns = clock_now_ns(loop);
    skip_what_is_past(loop, publish_ns);
    int state = finish_frame(loop, start_ns, publish_ns);
    publish(loop, (uint8_t *)frame, frame->size, 0);
    record(&loop->compute, decaff_mailbox_now_ns() - begun_ns);
    if (!is_for_pose) {
        record(&loop->lateness, late_ns);
    }
    loop->states[state]++;
    __atomic_store_n(&loop->ticks, loop->ticks + 1, __ATOMIC_RELEASE);
    publish_pending(loop);
}

static void begin(Loop *loop)
{
    int64_t now_ns = clock_now_ns(loop), *pose_ns = POINTER(loop->pose_ns);
    double *positions = POINTER(loop->positions);
    decaff_mailbox *box = POINTER(loop->input.box);
    if (box != NULL && box->header != NULL && !loop->is_simulated) {
        decaff_mailbox_skip(box); /* what has come while the scene was loaded is old */
    }
    for (int64_t k = 0; k < loop->count; k++) {
        pose_ns[k] = now_ns - loop->stale_after_ns;
        positions[3 * k] = NAN;
    }
    loop->due_ns = now_ns + loop->period_ns;
    loop->posed_ns = now_ns - loop->period_ns;
    loop->is_begun = 1;
}

/* Say that no frames will come any more. */
static void publish_stopping(Loop *loop)
{
    decaff_frame_header *frame = POINTER(loop->frame);
    for (int k = 0; k < STOPPING_FRAMES; k++) {
        int64_t now_ns = clock_now_ns(loop);
        frame->state = DECAFF_STATE_STOPPING;
        frame->pose_ns = frame->pose_ns != 0 ? frame->pose_ns : now_ns;
        frame->start_ns = frame->publish_ns = now_ns;
        frame->valid_until_ns = frame->pose_ns + loop->valid_for_ns;
        frame->period_ns = loop->period_ns;
        publish(loop, (uint8_t *)frame, frame->size, 0);
        if (!loop->is_simulated) {
            sleep_until(now_ns + loop->period_ns);
        }
    }
}

/* Run until asked to stop, or for as many ticks as wanted; 0, or what is missing: 1 a set of instructions, 2 a timer.
   It says STOPPING only where it was asked to stop. */
int proximity_loop_run(Loop *loop)
{
    loop->set = (int64_t)(intptr_t)proximity_best_set(POINTER(loop->instructions));
    if (loop->set == 0) {
        return 1;
    }
    loop->timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    if (loop->timer < 0) {
        return 2;
    }
    make_checksum_tables();
    if (!loop->is_begun) {
        begin(loop);
    }
    while (!__atomic_load_n(&loop->stop, __ATOMIC_ACQUIRE) && loop->ticks != loop->ticks_wanted) {
        int is_for_pose = wait_for_tick(loop);
        if (!__atomic_load_n(&loop->stop, __ATOMIC_ACQUIRE)) {
            tick(loop, is_for_pose);
            skip_what_is_past(loop, clock_now_ns(loop));
            loop->due_ns += loop->period_ns;
        }
    }
    if (__atomic_load_n(&loop->stop, __ATOMIC_ACQUIRE)) {
        publish_stopping(loop);
    }
    close((int)loop->timer);
    return 0;
}
#endif
