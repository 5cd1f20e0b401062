/* The clock of `time.monotonic_ns`, that of a thread, and sleeping, for each system. */
#ifndef PROXIMITY_LOOP_SYSTEM_H
#define PROXIMITY_LOOP_SYSTEM_H

#include <stdint.h>
#include <time.h>
#ifdef _WIN32
#include <windows.h>
#endif

static int system_clock_is_coarse; /* Windows: the clock of Python before 3.13, with steps of 16 ms */

#ifdef _WIN32
static int64_t system_now_ns(void)
{
    LARGE_INTEGER now, rate;

    if (system_clock_is_coarse)
        return (int64_t)GetTickCount64() * 1000000;
    QueryPerformanceCounter(&now);
    QueryPerformanceFrequency(&rate);
    return now.QuadPart / rate.QuadPart * 1000000000 + now.QuadPart % rate.QuadPart * 1000000000 / rate.QuadPart;
}

/* Processor time of this thread. */
static int64_t system_thread_ns(void)
{
    FILETIME begun, ended, kernel, user;

    GetThreadTimes(GetCurrentThread(), &begun, &ended, &kernel, &user);
    return 100 * (((int64_t)kernel.dwHighDateTime << 32) + kernel.dwLowDateTime
                  + ((int64_t)user.dwHighDateTime << 32) + user.dwLowDateTime);
}

static void system_sleep(int64_t until_ns)
{
    static __thread HANDLE timer; /* one per thread, until the process ends */
    LARGE_INTEGER left;

    if (timer == NULL)
        timer = CreateWaitableTimerExW(NULL, NULL, 2 /* of high resolution */, TIMER_ALL_ACCESS);
    left.QuadPart = -((until_ns - system_now_ns() + 99) / 100);
    if (left.QuadPart < 0 && timer != NULL && SetWaitableTimer(timer, &left, 0, NULL, NULL, 0))
        WaitForSingleObject(timer, INFINITE);
    else if (left.QuadPart < 0)
        Sleep((DWORD)(-left.QuadPart / 10000 + 1));
}
#else
static int64_t read_clock(clockid_t clock)
{
    struct timespec now;

    clock_gettime(clock, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static int64_t system_now_ns(void)
{
#ifdef __APPLE__
    return read_clock(CLOCK_UPTIME_RAW);
#else
    return read_clock(CLOCK_MONOTONIC);
#endif
}

/* Processor time of this thread. */
static int64_t system_thread_ns(void)
{
    return read_clock(CLOCK_THREAD_CPUTIME_ID);
}

static void system_sleep(int64_t until_ns)
{
#ifdef __linux__
    struct timespec until = {until_ns / 1000000000, until_ns % 1000000000};

    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL);
#else
    int64_t left = until_ns - system_now_ns();
    struct timespec rest = {left / 1000000000, left % 1000000000};

    if (left > 0)
        nanosleep(&rest, NULL);
#endif
}
#endif

#endif
