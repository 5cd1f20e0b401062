/*
 * What your board has instead: a clock, the motor driver's enable, and a watchdog. A computer stands in here.
 *
 * There is no motor: set_motor_mode() says when it would be braked, which a fault does, and so does the watchdog, where
 * no sample comes in time. Your chip's own brakes after 1 ms; and decaff_start_step() comes first: it compares encoder
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

/* Your motor driver: both low sides on where it is braked, both open where it is free; braked also when the program
 * ends. */
static void set_motor_mode(enum decaff_drive_mode mode)
{
    static enum decaff_drive_mode before = DECAFF_DRIVE_MODE_POSITION;
    if (mode != before && mode == DECAFF_DRIVE_MODE_BRAKED)
        printf("motor braked\n");
    before = mode;
}

/* Your chip's watchdog: unless it is started anew in time, it brakes the motor. A PC that does other work needs a second. */
static void restart_watchdog(void)
{
    struct itimerval limit = {.it_value.tv_sec = 1};
    setitimer(ITIMER_REAL, &limit, NULL); /* SIGALRM ends the program */
}
