/* Starts a simulated drum by decaff_start_step: see test_decaff_chip.py. Words: how the motor turns the drum (1, -1 or
 * 0: not at all), how the encoder counts (1, -1), the drum's angle, the stop's, and the index's (nan: none), rad. */
#include <stdio.h>
#include <stdlib.h>

#include "decaff_controller.h"

#define INERTIA 2.4e-5  /* kg m2, of motor and gear at the drum */
#define RATIO 4.0       /* turns of the motor to one of the drum */
#define FRICTION 1.8e-3 /* N m, likewise */

int main(int count, char **words)
{
    const decaff_path *path = &decaff_paths[0];
    const decaff_settings *set = path->settings;
    double turns, counts, angle, stop, index, speed = 0.0, most = 0.0, torque = 0.0, before;
    decaff_start start;
    int sample;

    if (count != 6)
        return 2;
    turns = atof(words[1]), counts = atof(words[2]), angle = atof(words[3]), stop = atof(words[4]);
    index = atof(words[5]);
    decaff_start_begin(&start, path, isnan(index) ? stop : index);
    for (sample = 0; sample < 90000 && start.state < DECAFF_START_DONE; sample++) {
        before = angle;
        speed += turns * RATIO * torque / INERTIA * set->period;
        speed -= fmax(-FRICTION / INERTIA * set->period, fmin(speed, FRICTION / INERTIA * set->period));
        angle += speed * set->period;
        if (angle >= stop) {
            angle = stop;
            speed = fmin(speed, 0.0);
        }
        torque = decaff_start_step(&start, counts * (angle - 5.0), (before < index) != (angle < index));
        most = fmax(most, fabs(torque));
    }
    printf("%d %.4f %.4f %.4f\n", (int)start.state, counts * (angle - 5.0) + start.offset - angle, most, torque);
    return 0;
}
