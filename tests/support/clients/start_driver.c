/* Starts a simulated drum by decaff_start_step: see test_decaff_chip.py. Words: how the motor turns the drum (1, -1 or
 * 0: not at all), how the encoder counts (1, -1), the drum's angle, the stop's, and the index's (nan: none), rad; whether
 * there is a link before the drum (1, 0). By hand the link is pushed against the drum. */
#include <stdio.h>
#include <stdlib.h>

#include "decaff_controller.h"

#define INERTIA 1.15e-6  /* kg m2, of motor and gear at the shaft */
#define FRICTION 8.63e-4 /* N m, likewise */
#define SHORTED 2.43e-4  /* N m s, of the motor with its windings shorted */
#define LINK 0.3         /* rad, from the drum to the link */

static double turns, counts, angle, stop, speed, link; /* rad and rad/s of the drum */

/* A sample of the drum, which may push the link. */
static void move(const decaff_settings *set, enum decaff_drive_mode mode, double torque)
{
    double ratio = set->drum_ratio, rub = FRICTION / INERTIA / ratio * set->period;

    if (mode == DECAFF_DRIVE_MODE_FORCE)
        speed += turns * torque / INERTIA / ratio * set->period;
    if (mode == DECAFF_DRIVE_MODE_BRAKED)
        speed *= fmax(0.0, 1.0 - SHORTED / INERTIA * set->period);
    speed -= fmax(-rub, fmin(speed, rub));
    angle += speed * set->period;
    if (angle >= stop) {
        angle = stop;
        speed = fmin(speed, 0.0);
    }
    link = fmin(link, angle);
}

static double bend_of(const decaff_path *path)
{
    size_t row = 1;

    while (row + 1 < path->count && path->angles[row] < link)
        row++;
    return path->bends[row - 1]
           + (link - path->angles[row - 1]) / (path->angles[row] - path->angles[row - 1])
                 * (path->bends[row] - path->bends[row - 1]);
}

int main(int count, char **words)
{
    const decaff_path *path = &decaff_paths[0];
    const decaff_settings *set = path->settings;
    double index, most = 0.0, torque = 0.0, before, nearest, began;
    decaff_start start;
    int sample;

    if (count != 7)
        return 2;
    turns = atof(words[1]), counts = atof(words[2]), angle = atof(words[3]), stop = atof(words[4]);
    index = atof(words[5]);
    link = atof(words[6]) > 0.0 ? angle - LINK : path->angles[0];
    decaff_start_begin(&start, path, isnan(index) ? stop : index, !isnan(index));
    for (sample = 0; sample < 4000 && start.state == DECAFF_START_BY_HAND; sample++) {
        if (sample > 1000) { /* a hand turns the drum to the link, and pushes both on */
            angle -= 0.5 * set->period;
            link = fmin(link, angle);
        }
        decaff_start_step(&start, counts * (angle - 5.0), bend_of(path), false);
    }
    nearest = began = angle;
    for (sample = 0; sample < 90000 && (start.state < DECAFF_START_DONE || speed != 0.0); sample++) {
        before = angle;
        move(set, start.mode, torque);
        nearest = fmin(nearest, angle);
        torque = decaff_start_step(&start, counts * (angle - 5.0), bend_of(path),
                                   (before < index) != (angle < index));
        most = fmax(most, fabs(torque));
    }
    printf("%d %.4f %.4f %.4f %.5f %d\n", (int)start.state, counts * (angle - 5.0) + start.offset - angle, most, torque,
           began - nearest, (int)start.mode);
    return 0;
}
