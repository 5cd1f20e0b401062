/* The loop of a service: read poses, filter, tick, write, seal and send the frame, without an interpreter and
   without allocation. */
#ifndef __wasm__

#include "loop_parts.h"

PROXIMITY_API int proximity_loop_run(Loop *loop);
PROXIMITY_API proximity_scene *proximity_loop_scene(const int64_t *model);

enum { LOOK_NS = 50000000, APART_NS = 500000, STOPPING_FRAMES = 3 };

/* A scene for the loop alone; free it with proximity_close(). */
proximity_scene *proximity_loop_scene(const int64_t *model)
{
    return proximity_scene_over(model);
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

static int is_over(const Loop *loop)
{
    return __atomic_load_n(&loop->stop, __ATOMIC_ACQUIRE) != 0;
}

static int64_t stopwatch_ns(const Loop *loop)
{
    return loop->counts_processor ? system_thread_ns() : loop->is_ahead ? system_now_ns() : clock_now_ns(loop);
}

/* Lead of the frames' clock over that of their readers. */
static int64_t skipped_ns(const Loop *loop)
{
    return loop->is_ahead ? loop->simulated_ns - system_now_ns() : 0;
}

/* Wait for the next tick; return whether a pose triggers it before it is due. Ticks for poses are half a
   period, or half a millisecond, apart, which limits the cost of a flood of poses. */
static int wait_for_tick(Loop *loop)
{
    if (loop->is_simulated) {
        loop->simulated_ns = loop->due_ns > loop->simulated_ns ? loop->due_ns : loop->simulated_ns;
        return 0;
    }
    while (!is_over(loop)) {
        int64_t now_ns = system_now_ns(), until_ns = loop->due_ns, apart_ns = loop->period_ns / 2;
        int64_t free_ns = loop->posed_ns + (apart_ns < APART_NS ? apart_ns : APART_NS);
        if (now_ns >= until_ns) {
            return 0;
        }
        until_ns = until_ns < now_ns + LOOK_NS ? until_ns : now_ns + LOOK_NS;
        if (now_ns < free_ns || loop->is_polled) {
            system_sleep(free_ns < until_ns && !loop->is_polled ? free_ns : until_ns);
        } else if (wait_for_message(&loop->input, until_ns)) {
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

/* Write the bends, with estimated rates, of tracked fingers without a path. */
static void write_bends(Loop *loop, LoopSource *source, proximity_contact *contacts)
{
    const double *bends = POINTER(loop->bends);
    const int64_t *pose_ns = POINTER(loop->pose_ns);
    for (int64_t k = 0; k < loop->count && loop->has_bends; k++) {
        uint32_t flags = contacts[k].flags & (PROXIMITY_FLAG_TRACKED | PROXIMITY_FLAG_ON_PATH);
        if (flags != PROXIMITY_FLAG_TRACKED || !isfinite(bends[k])) {
            continue;
        }
        double reals[5] = {loop->metres_a_bend * bends[k], 0.0, 0.0, DEFAULT_MAX_SPEED, DEFAULT_MAX_ACCELERATION};
        int64_t words[12] = {source->bend_motions, loop->count, ESTIMATES, k, pose_ns[k]};
        memcpy(words + 5, reals, sizeof reals);
        proximity_call(set_of(loop), OBSERVE, words);
        contacts[k].bend = bends[k];
        if ((words[10] & PROXIMITY_FLAG_PREDICTED) != 0) {
            const Estimate *estimates = POINTER(source->bend_motions);
            contacts[k].bend_rate = estimates[ESTIMATES * k].velocity[0] / loop->metres_a_bend;
        }
    }
}

/* Mark all contacts as unknown: a tick failed, and the contacts are those of the one before. */
static void forget_all(const Loop *loop, proximity_contact *contacts)
{
    for (int64_t k = 0; k < loop->count; k++) {
        memcpy(&contacts[k], proximity_unknown_contact, sizeof *contacts);
        contacts[k].finger = (uint32_t)k;
    }
}

static void tick_tracker(Loop *loop, proximity_contact *contacts, int64_t now_ns)
{
    LoopSource *source = POINTER(loop->source);
    const int64_t *table = POINTER(source->tracker);
    Settings *settings = POINTER(table[AT_SETTINGS]);
    settings->has_velocities = loop->has_velocities != 0;
    settings->has_paths = loop->has_paths != 0;
    int64_t model = source->scene != 0 ? (int64_t)(intptr_t)scene_of(source)->model : source->model;
    int64_t words[] = {model, source->tracker, loop->positions, loop->count, 3, loop->pose_ns, loop->count,
                       now_ns, source->is_moved, 0};
    int is_broken = source->scene != 0 && scene_of(source)->is_broken;
    if (is_broken || !proximity_call(set_of(loop), TICK, words) || words[9] == 0) {
        forget_all(loop, contacts);
        return;
    }
    source->is_moved = 0;
    source->answers |= words[9];
    write_bends(loop, source, contacts);
}

/* Compute contacts from a sensor's measurements. */
static void sense_contacts(Loop *loop, proximity_contact *contacts, int64_t now_ns)
{
    const LoopSensor *sensor = POINTER(((LoopSource *)POINTER(loop->source))->sensor);
    int64_t n = loop->count;
    int64_t words[] = {sensor->motions, n, ESTIMATES, sensor->error_sums, n, 2, loop->pose_ns, n, loop->positions, n, 1,
                       loop->measured, n, (int64_t)(intptr_t)contacts, n, sensor->unknown, n, now_ns,
                       sensor->latency_ns, 0, 0, 0, 0};
    memcpy(words + 19, &sensor->horizon, 3 * sizeof(double));
    proximity_call(set_of(loop), SENSE_CONTACTS, words);
}

/* Read the newest message of contacts that were computed outside the loop. */
static void receive_contacts(Loop *loop)
{
    for (int k = 0; k < PROXIMITY_MAX_AT_ONCE && receive_message(&loop->input) != PROXIMITY_MAILBOX_NOTHING; k++) {
    }
}

static void copy_contacts(Loop *loop, proximity_contact *contacts)
{
    const LoopContacts *given = POINTER(loop->input.message);
    if (given->source != loop->source) { /* none has arrived yet */
        forget_all(loop, contacts);
        return;
    }
    memcpy(contacts, given + 1, (size_t)loop->count * sizeof *contacts);
    ((LoopSource *)POINTER(loop->source))->epoch = given->epoch;
    loop->is_late = given->is_late;
    if (loop->is_simulated) {
        loop->simulated_ns += given->spent_ns;
    }
}

/* Switch to the next source; if contacts arrive as messages, once a message of that source has arrived. */
static void exchange_source(Loop *loop)
{
    LoopSource *next = POINTER(__atomic_load_n(&loop->next, __ATOMIC_ACQUIRE)), *before = POINTER(loop->source);
    int64_t taken = (int64_t)(intptr_t)next;
    const LoopContacts *given = POINTER(loop->input.message);
    if (next != NULL && (!loop->is_given || given->source == taken)) {
        if (!next->is_edited) {
            loop->epoch_offset = before->epoch + loop->epoch_offset + 1 - next->epoch;
        }
        loop->source = taken; /* a thread that tests whether `next` was read finds this; a newer one stays there */
        __atomic_compare_exchange_n(&loop->next, &taken, 0, 0, __ATOMIC_RELEASE, __ATOMIC_RELAXED);
    }
}

/* Convert times to the readers' clock. */
static void write_times(Loop *loop, int64_t pose_ns, int64_t start_ns, int64_t publish_ns)
{
    proximity_frame_header *frame = POINTER(loop->frame);
    frame->pose_ns = pose_ns;
    frame->start_ns = start_ns;
    frame->publish_ns = publish_ns;
    frame->valid_until_ns = pose_ns + loop->valid_for_ns;
    frame->period_ns = loop->period_ns;
}

/* Finish the header of a frame, including its state. */
static int finish_frame(Loop *loop, int64_t start_ns, int64_t publish_ns)
{
    proximity_frame_header *frame = POINTER(loop->frame);
    proximity_contact *contacts = (proximity_contact *)(void *)(frame + 1);
    int64_t oldest_ns = INT64_MAX, tracked = 0, uncertain = 0, skipped = skipped_ns(loop);
    const uint32_t close_by = PROXIMITY_FLAG_BOUNDED | PROXIMITY_FLAG_IN_RANGE;
    for (int64_t k = 0; k < loop->count; k++) {
        if ((contacts[k].flags & PROXIMITY_FLAG_TRACKED) != 0) {
            tracked++;
            oldest_ns = contacts[k].pose_ns < oldest_ns ? contacts[k].pose_ns : oldest_ns;
            uncertain += (contacts[k].flags & close_by) == close_by;
        }
        contacts[k].pose_ns -= skipped;
        contacts[k].predicted_ns -= skipped;
    }
    int64_t pose_ns = tracked ? oldest_ns : start_ns;
    write_times(loop, pose_ns - skipped, start_ns - skipped, publish_ns - skipped);
    loop->has_started |= tracked > 0;
    if (!tracked) {
        frame->state = loop->has_started ? PROXIMITY_STATE_STALE : PROXIMITY_STATE_STARTING;
    } else if (loop->missed != loop->reported_missed || publish_ns > pose_ns + loop->valid_for_ns || loop->is_late) {
        frame->state = PROXIMITY_STATE_LATE;
    } else {
        frame->state = tracked < loop->count || uncertain ? PROXIMITY_STATE_DEGRADED : PROXIMITY_STATE_OK;
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
            proximity_mailbox_add(POINTER(loop->log), message, (uint32_t)size); /* its reader polls it */
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

static void fill_contacts(Loop *loop, proximity_contact *contacts, int64_t start_ns)
{
    if (loop->is_given) {
        copy_contacts(loop, contacts);
        return;
    }
    play_recording(loop, start_ns);
    take_messages(loop);
    int64_t words[] = {loop->pose_ns, loop->count, loop->positions, loop->count, loop->width,
                       start_ns - loop->stale_after_ns, 0};
    proximity_call(set_of(loop), DROP_STALE, words);
    if (((LoopSource *)POINTER(loop->source))->sensor != 0) {
        sense_contacts(loop, contacts, start_ns);
        return;
    }
    int64_t instant_ns = carry_parts(loop, start_ns);
    tick_tracker(loop, contacts, start_ns);
    widen_bounds(loop, contacts, start_ns, instant_ns);
}

/* Make one frame. */
static void tick(Loop *loop, int is_for_pose)
{
    proximity_frame_header *frame = POINTER(loop->frame);
    proximity_contact *contacts = (proximity_contact *)(void *)(frame + 1);
    int64_t start_ns = clock_now_ns(loop), begun_ns = stopwatch_ns(loop);
    if (is_for_pose) {
        loop->posed_ns = loop->due_ns = start_ns;
    }
    int64_t late_ns = start_ns - loop->due_ns;
    if (loop->is_given) {
        receive_contacts(loop);
    }
    exchange_source(loop);
    fill_contacts(loop, contacts, start_ns);
    loop->epoch = ((LoopSource *)POINTER(loop->source))->epoch + loop->epoch_offset;
    int64_t publish_ns = clock_now_ns(loop);
    skip_what_is_past(loop, publish_ns);
    int state = finish_frame(loop, start_ns, publish_ns);
    publish(loop, (uint8_t *)frame, frame->size, 0);
    record(&loop->compute, stopwatch_ns(loop) - begun_ns);
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
    proximity_mailbox *box = POINTER(loop->input.box);
    if (box != NULL && box->header != NULL && !loop->is_simulated) {
        proximity_mailbox_skip(box); /* messages that arrived while the scene was loaded are old */
    }
    for (int64_t k = 0; k < loop->count; k++) {
        pose_ns[k] = now_ns - loop->stale_after_ns;
        positions[loop->width * k] = NAN;
    }
    loop->due_ns = now_ns + loop->period_ns;
    loop->posed_ns = now_ns - loop->period_ns;
    loop->is_begun = 1;
}

/* Announce that no more frames will come. */
static void publish_stopping(Loop *loop)
{
    proximity_frame_header *frame = POINTER(loop->frame);
    for (int k = 0; k < STOPPING_FRAMES; k++) {
        int64_t now_ns = clock_now_ns(loop), told_ns = now_ns - skipped_ns(loop);
        frame->state = PROXIMITY_STATE_STOPPING;
        write_times(loop, frame->pose_ns != 0 ? frame->pose_ns : told_ns, told_ns, told_ns);
        publish(loop, (uint8_t *)frame, frame->size, 0);
        if (loop->is_simulated) {
            loop->simulated_ns += loop->period_ns;
        } else {
            system_sleep(now_ns + loop->period_ns);
        }
    }
}

/* Run until stopped, or for the given number of ticks; return 0, or the missing resource: 1 an instruction
   set, 2 a timer. The state STOPPING is sent only after a request to stop. */
int proximity_loop_run(Loop *loop)
{
    if (loop->set == 0) { /* detecting the processor is slow */
        loop->set = (int64_t)(intptr_t)proximity_best_set(POINTER(loop->instructions));
    }
    if (loop->set == 0) {
        return 1;
    }
    if (!open_timer(&loop->input)) {
        return 2;
    }
    system_clock_is_coarse = loop->is_coarse != 0;
    make_checksum_tables();
    if (!loop->is_begun) {
        begin(loop);
    }
    while (!is_over(loop) && loop->ticks != loop->ticks_wanted) {
        int is_for_pose = wait_for_tick(loop);
        if (!is_over(loop)) {
            tick(loop, is_for_pose);
            skip_what_is_past(loop, clock_now_ns(loop));
            loop->due_ns += loop->period_ns;
        }
    }
    publish_pending(loop);
    if (is_over(loop)) {
        publish_stopping(loop);
    }
    close_timer(&loop->input);
    return 0;
}
#endif
