/*
 * Replacement of your board by a computer: a clock, the motor driver's enable, and a watchdog.
 *
 * Without a motor, set_motor_mode() prints when it would be braked, by a fault or by the watchdog if no sample arrives
 * in time. The watchdog of your chip brakes after 1 ms. Call decaff_start_step() first: it compares encoder
 * and potentiometer, tests the sign of the motor with a small torque, and finds the stop.
 */
#include "decaff_controller.h"

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <sys/time.h>
#include <time.h>

static int64_t clock_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* Your motor driver: both low sides on if braked, both open if free; braked also when the program ends. */
static void set_motor_mode(enum decaff_drive_mode mode)
{
    static enum decaff_drive_mode before = DECAFF_DRIVE_MODE_POSITION;
    if (mode != before && mode == DECAFF_DRIVE_MODE_BRAKED)
        printf("motor braked\n");
    before = mode;
}

/* Your chip's watchdog: brakes the motor unless it is restarted in time. A busy PC needs a second. */
static void restart_watchdog(void)
{
    struct itimerval limit = {.it_value.tv_sec = 1};
    setitimer(ITIMER_REAL, &limit, NULL); /* SIGALRM ends the program */
}
