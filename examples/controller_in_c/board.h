/*
 * What your board has instead: a clock, the motor driver's enable, and a watchdog. A computer stands in here.
 *
 * There is no motor: power() says when it would be cut, which a fault does, and so does the watchdog, where no
 * sample comes in time. Your chip's own has 10 ms; and decaff_start_step() comes first: it tests the sign of
 * torque and angle with a small torque, and finds the stop.
 */
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

/* Your motor driver's enable; off also when the program ends. */
static void power(bool is_on)
{
    static bool was_on = true;
    if (was_on && !is_on)
        printf("power off\n");
    was_on = is_on;
}

/* Your chip's watchdog: unless it is started anew in time, it cuts the power. A PC that does other work needs a second. */
static void restart_watchdog(void)
{
    struct itimerval limit = {.it_value.tv_sec = 1};
    setitimer(ITIMER_REAL, &limit, NULL); /* SIGALRM ends the program */
}
