/*
 * The controller of a contact drum in C: it reads the frames of a service and sets the position of the drum.
 *
 * Start it in this folder. `proximity controller` writes the sources of the controller itself:
 *
 *   proximity controller --out controller
 *   cc -std=c99 -O2 -Icontroller main.c controller/decaff_controller.c controller/decaff_glove.c -lm -o main
 *   python hand.py & ./main 9100
 *
 * It prints a line when the state of the drum changes: the state, the distance of the finger from the box,
 * the bend of the finger, and the target angle of the drum. It ends after the service, with the drum
 * retracted. In your firmware a timer starts each sample, the bend comes from the potentiometer, and the angle
 * from the encoder. Here the service reports the bend, and the drum reaches its target immediately.
 *
 * Signs: angles grow away from the finger, from the flat hand to the fist; a positive torque turns to greater angles.
 */
#define _XOPEN_SOURCE 700
#include <arpa/inet.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/socket.h>

#include "board.h"
#include "decaff_controller.h"

#define PERIOD_NS 333333 /* `proximity controller` writes a controller for 3 kHz */

static const char *const STATES[] = {
    "RETRACTED", "APPROACH", "CONTACT_POSITION", "CONTACT_FORCE", "HOLD", "FREEZE", "FAULT"};

int main(int count, char **words)
{
    static decaff_subscriber frames;
    static decaff_controller finger; /* one for each finger */
    static uint8_t datagram[65536];
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int receiver = socket(AF_INET, SOCK_DGRAM, 0), shown = DECAFF_DRUM_STATE_RETRACTED;
    int64_t due_ns = clock_ns();
    ssize_t size;
    double bend = 0.0; /* the flat hand, until a bend is reported */
    decaff_observation seen;
    decaff_action action = {.angle = decaff_paths[0].angles[decaff_paths[0].count - 1]};

    here.sin_port = htons((uint16_t)(count > 1 ? atoi(words[1]) : 9100));
    if (fcntl(receiver, F_SETFL, O_NONBLOCK) != 0
        || bind(receiver, (struct sockaddr *)&here, sizeof here) != 0) {
        perror("main");
        return EXIT_FAILURE;
    }
    decaff_subscriber_begin(&frames, true, NULL); /* the service has the same clock; no key */
    decaff_controller_begin(&finger, &decaff_paths[0]);

    do {
        int64_t wait_ns = (due_ns += PERIOD_NS) - clock_ns(); /* below 0: the computer has paused; catch up */
        struct timespec pause = {.tv_nsec = (long)wait_ns};
        if (wait_ns > 0) {
            nanosleep(&pause, NULL);
            while ((size = recv(receiver, datagram, sizeof datagram, 0)) > 0)
                decaff_subscriber_take(&frames, datagram, (size_t)size, clock_ns());
        }
        decaff_subscriber_look(&frames, 0, due_ns, &seen);
        if (seen.contact != NULL && !isnan(seen.contact->bend))
            bend = seen.contact->bend;
        seen.bend = bend;               /* your potentiometer */
        seen.drum_angle = action.angle; /* your encoder */
        decaff_controller_step(&finger, &seen, &action);
        set_motor_mode(action.mode);
        restart_watchdog();
        if (shown != (int)action.state && seen.contact != NULL)
            printf("%-16s %6.2f mm away, bend %.3f, drum to %.3f rad\n", STATES[action.state],
                   1e3 * seen.contact->signed_distance, bend, action.angle);
        shown = (int)action.state;
    } while (seen.state != PROXIMITY_STATE_STOPPING || shown != DECAFF_DRUM_STATE_RETRACTED);
    printf("%u frames used\n", (unsigned)frames.counts[DECAFF_REASON_USED]);
}
