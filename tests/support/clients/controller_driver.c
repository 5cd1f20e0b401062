/* Driver of decaff_controller.h, see controller_in_c.py: reads events from a file, writes answers to another. */
#include <stdio.h>
#include <stdlib.h>

#include "decaff_controller.h"

static FILE *events, *answers;

static void get(void *into, size_t size)
{
    if (fread(into, 1, size, events) != size)
        abort();
}

#define GET(variable) get(&(variable), sizeof(variable))
#define PUT(variable) fwrite(&(variable), sizeof(variable), 1, answers)

static void step(decaff_controller *finger, const decaff_observation *seen, decaff_action *action)
{
    int32_t words[8];
    double numbers[10];

    decaff_controller_step(finger, seen, action);
    words[0] = (int32_t)action->state;
    words[1] = (int32_t)action->mode;
    words[2] = (int32_t)finger->trust;
    words[3] = (int32_t)finger->fault;
    words[4] = (int32_t)seen->state;
    words[5] = (int32_t)finger->frames.dropped;
    words[6] = (int32_t)finger->frames.awaited;
    words[7] = 0;
    numbers[0] = action->position;
    numbers[1] = action->angle;
    numbers[2] = action->force;
    numbers[3] = action->speed_cap;
    numbers[4] = action->force_cap;
    numbers[5] = action->start_force;
    numbers[6] = action->torque;
    numbers[7] = action->torque_cap;
    numbers[8] = action->motor_speed_cap;
    numbers[9] = action->force_slew;
    PUT(words);
    PUT(numbers);
}

static void get_measured(decaff_observation *seen)
{
    double numbers[4];
    uint8_t fault;

    GET(numbers);
    GET(fault);
    seen->bend = numbers[0];
    seen->drum_angle = numbers[1];
    seen->force = numbers[2];
    seen->motor_force = numbers[3];
    seen->has_fault = fault != 0;
}

static void take(decaff_subscriber *frames)
{
    static uint8_t bytes[70000];
    int64_t now_ns;
    uint32_t size;
    int32_t reason;

    GET(now_ns);
    GET(size);
    get(bytes + 1, size); /* unaligned, as data may arrive */
    reason = (int32_t)decaff_subscriber_take(frames, bytes + 1, size, now_ns);
    PUT(reason);
}

static void look(const decaff_subscriber *frames, decaff_controller *finger, decaff_action *action)
{
    decaff_observation seen;
    int64_t sample_ns;

    GET(sample_ns);
    decaff_subscriber_look(frames, 0u, sample_ns, &seen);
    get_measured(&seen);
    step(finger, &seen, action);
}

static void serve(decaff_servo *servo)
{
    decaff_action action = {0};
    double numbers[8], force;
    uint8_t mode;

    GET(mode);
    GET(numbers);
    action.mode = (enum decaff_drive_mode)mode;
    action.position = action.force = numbers[0];
    action.speed_cap = numbers[1];
    action.force_cap = numbers[2];
    action.start_force = numbers[3];
    action.force_slew = numbers[4];
    force = decaff_servo_step(servo, &action, numbers[5], numbers[6]);
    PUT(force);
}

int main(int count, char **words)
{
    static decaff_subscriber frames;
    static decaff_controller finger;
    static decaff_servo servo;
    decaff_action action = {0};
    uint8_t shares_clock, has_key, key[PROXIMITY_KEY_BYTES];
    double position;
    int kind;

    events = count == 3 ? fopen(words[1], "rb") : NULL;
    answers = count == 3 ? fopen(words[2], "wb") : NULL;
    if (events == NULL || answers == NULL)
        return 2;
    while ((kind = fgetc(events)) != EOF) {
        switch (kind) {
        case 'B':
            GET(shares_clock);
            GET(has_key);
            GET(key);
            GET(position);
            decaff_subscriber_begin(&frames, shares_clock != 0, has_key != 0 ? key : NULL);
            decaff_controller_begin(&finger, &decaff_paths[0]);
            decaff_servo_begin(&servo, &decaff_paths[0], position);
            break;
        case 'D':
            take(&frames);
            break;
        case 'L':
            look(&frames, &finger, &action);
            break;
        case 'V':
            serve(&servo);
            break;
        default:
            return 3;
        }
    }
    return fclose(answers) != 0;
}
