/* Entry points of the drum's controller in the extension: fingers, samples and actions are arrays of bytes,
   whose layouts are those of `proximity.decaff.controller.records`. */
#include "entry_points.h"

#include <string.h>

#include "decaff_controller.h"

/* An array of one axis takes two words, its address and length; one of two axes takes three, address and lengths. */
#define ARGUMENTS(words) ((const int64_t *)(intptr_t)(words))
#define POINTER(word) ((void *)(intptr_t)(word))

static double real_of(int64_t word)
{
    double real;
    memcpy(&real, &word, sizeof real);
    return real;
}

/* sizes: int64[9] */
int controller_sizes(void **unused, void **no_error, int64_t words)
{
    int64_t *sizes = POINTER(ARGUMENTS(words)[0]);
    const size_t known[] = {sizeof(decaff_settings), sizeof(decaff_path), sizeof(decaff_controller),
                            sizeof(decaff_observation), sizeof(decaff_action), sizeof(decaff_steady),
                            sizeof(proximity_contact), PROXIMITY_VERSION, sizeof(decaff_servo)};
    (void)unused, (void)no_error;
    for (size_t k = 0; k < sizeof known / sizeof known[0]; k++) {
        sizes[k] = (int64_t)known[k];
    }
    return 0;
}

/* finger, path: uint8[:] */
int controller_begin(void **unused, void **no_error, int64_t words)
{
    const int64_t *word = ARGUMENTS(words);
    (void)unused, (void)no_error;
    decaff_controller_begin(POINTER(word[0]), POINTER(word[2]));
    return 0;
}

/* finger: uint8[:] */
int controller_reset(void **unused, void **no_error, int64_t words)
{
    (void)unused, (void)no_error;
    decaff_controller_reset(POINTER(ARGUMENTS(words)[0]));
    return 0;
}

/* fingers, samples, actions: uint8[:, :], a row for each finger */
int controller_step(void **unused, void **no_error, int64_t words)
{
    const int64_t *word = ARGUMENTS(words);
    decaff_controller *fingers = POINTER(word[0]);
    const decaff_observation *seen = POINTER(word[3]);
    decaff_action *actions = POINTER(word[6]);
    (void)unused, (void)no_error;
    for (int64_t k = 0; k < word[1] && k < word[4] && k < word[7]; k++) {
        decaff_controller_step(&fingers[k], &seen[k], &actions[k]);
    }
    return 0;
}

/* servo, path: uint8[:]; position: float */
int controller_servo_begin(void **unused, void **no_error, int64_t words)
{
    const int64_t *word = ARGUMENTS(words);
    (void)unused, (void)no_error;
    decaff_servo_begin(POINTER(word[0]), POINTER(word[2]), real_of(word[4]));
    return 0;
}

/* servo, action: uint8[:]; position, force: float; returns the motor's force until the next sample */
int controller_servo_step(void **unused, void **no_error, int64_t words)
{
    int64_t *word = POINTER(words);
    (void)unused, (void)no_error;
    double applied = decaff_servo_step(POINTER(word[0]), POINTER(word[2]), real_of(word[4]), real_of(word[5]));
    memcpy(&word[6], &applied, sizeof applied);
    return 0;
}

/* watch, settings: uint8[:]; force, speed: float; returns whether it is steady */
int controller_is_steady(void **unused, void **no_error, int64_t words)
{
    int64_t *word = POINTER(words);
    (void)unused, (void)no_error;
    word[6] = decaff_is_steady(POINTER(word[0]), POINTER(word[2]), real_of(word[4]), real_of(word[5]));
    return 0;
}

/* settings: uint8[:]; stiffness, damping: float; returns the displayed stiffness and damping */
int controller_displayed(void **unused, void **no_error, int64_t words)
{
    int64_t *word = POINTER(words);
    double k, b;
    (void)unused, (void)no_error;
    decaff_displayed(POINTER(word[0]), real_of(word[2]), real_of(word[3]), &k, &b);
    memcpy(&word[4], &k, sizeof k);
    memcpy(&word[5], &b, sizeof b);
    return 0;
}
