/* Starts controller_driver.c on a simulated Cortex-M7 and counts the instructions of calls, see controller_in_c.py.
 * The simulator's clock advances by 1024 ns per instruction, SysTick by one per 40 ns. */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "decaff_controller.h"

#define TICKS_AN_INSTRUCTION 25.6
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)

static void boot(void);
__attribute__((section(".vectors"), used)) static void *const vectors[2] = {(void *)0x20300000, (void *)boot};

/* Enable the double-precision FPU. */
__attribute__((naked)) static void boot(void)
{
    __asm volatile("ldr r0, =0xE000ED88\n ldr r1, [r0]\n orr r1, r1, #(0xF << 20)\n str r1, [r0]\n"
                   "dsb\n isb\n b _start\n");
}

static uint64_t total[4];
static uint32_t most[4], calls[4];

static void report(void)
{
    int i;

    for (i = 0; i < 4; i++)
        printf("%u %.1f %.1f\n", (unsigned)calls[i],
               calls[i] > 0 ? (double)total[i] / calls[i] / TICKS_AN_INSTRUCTION : 0.0,
               most[i] / TICKS_AN_INSTRUCTION);
}

static uint32_t now(void)
{
    if (SYSTICK_CONTROL == 0) {
        SYSTICK_RELOAD = 0xffffff;
        SYSTICK_VALUE = 0;
        SYSTICK_CONTROL = 5;
        atexit(report);
    }
    return SYSTICK_VALUE;
}

static void note(int which, uint32_t before)
{
    uint32_t ticks = (before - SYSTICK_VALUE) & 0xffffff;

    total[which] += ticks;
    most[which] = ticks > most[which] ? ticks : most[which];
    calls[which]++;
}

void __real_decaff_controller_step(decaff_controller *, const decaff_observation *, decaff_action *);
enum decaff_reason __real_decaff_subscriber_take(decaff_subscriber *, const void *, size_t, int64_t);
void __real_decaff_subscriber_look(const decaff_subscriber *, size_t, int64_t, decaff_observation *);
decaff_real __real_decaff_servo_step(decaff_servo *, const decaff_action *, decaff_real, decaff_real);

void __wrap_decaff_controller_step(decaff_controller *finger, const decaff_observation *seen,
                                   decaff_action *action)
{
    uint32_t before = now();

    __real_decaff_controller_step(finger, seen, action);
    note(0, before);
}

enum decaff_reason __wrap_decaff_subscriber_take(decaff_subscriber *frames, const void *datagram, size_t size,
                                                 int64_t now_ns)
{
    uint32_t before = now();
    enum decaff_reason reason = __real_decaff_subscriber_take(frames, datagram, size, now_ns);

    note(1, before);
    return reason;
}

void __wrap_decaff_subscriber_look(const decaff_subscriber *frames, size_t finger, int64_t sample_ns,
                                   decaff_observation *seen)
{
    uint32_t before = now();

    __real_decaff_subscriber_look(frames, finger, sample_ns, seen);
    note(2, before);
}

decaff_real __wrap_decaff_servo_step(decaff_servo *servo, const decaff_action *action, decaff_real position,
                                     decaff_real force)
{
    uint32_t before = now();
    decaff_real applied = __real_decaff_servo_step(servo, action, position, force);

    note(3, before);
    return applied;
}
