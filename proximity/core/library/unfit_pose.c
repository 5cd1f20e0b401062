/* Reasons for an invalid pose: kernels detect it, and this file finds the message. */
#include "scene.h"

#include <math.h>
#include <stdio.h>

static int are_finite(const double *numbers, int count)
{
    for (int k = 0; numbers != NULL && k < count; k++) {
        if (!isfinite(numbers[k])) {
            return 0;
        }
    }
    return 1;
}

static double length_of(const double *m, int first, int step)
{
    return sqrt(m[first] * m[first] + m[first + step] * m[first + step] + m[first + 2 * step] * m[first + 2 * step]);
}

/* Largest deviation of the axes of a matrix from length 1 and right angles. */
static double off_orthonormal(const double *m)
{
    double off = 0.0;
    for (int a = 0; a < 3; a++) {
        for (int b = a; b < 3; b++) {
            off = fmax(off, fabs(m[a] * m[b] + m[4 + a] * m[4 + b] + m[8 + a] * m[8 + b] - (a == b)));
        }
    }
    return off;
}

static double determinant(const double *m)
{
    return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
           m[2] * (m[4] * m[9] - m[5] * m[8]);
}

/* The defect of a matrix, in words that follow "the matrix"; an empty text if there is none. */
static void describe_matrix(const double *m, char *words, size_t size)
{
    double x = length_of(m, 0, 4), y = length_of(m, 1, 4), z = length_of(m, 2, 4), most = fmax(x, fmax(y, z));
    double far_m = fmax(fabs(m[3]), fmax(fabs(m[7]), fabs(m[11])));
    *words = '\0';
    if (!are_finite(m, 16)) {
        snprintf(words, size, "has numbers that are not finite");
    } else if (m[12] != 0.0 || m[13] != 0.0 || m[14] != 0.0 || m[15] != 1.0) {
        if (m[3] == 0.0 && m[7] == 0.0 && m[11] == 0.0 && m[15] == 1.0) {
            snprintf(words, size, "is column by column, expected row by row, with the translation at 3, 7, 11");
        } else {
            snprintf(words, size, "has the last row %g %g %g %g, expected 0 0 0 1", m[12], m[13], m[14], m[15]);
        }
    } else if (fabs(most - 1.0) > SINGLE_TOLERANCE && most - fmin(x, fmin(y, z)) <= SINGLE_TOLERANCE * most) {
        snprintf(words, size, "scales by %g, expected 1: a part keeps its size", most);
    } else if (off_orthonormal(m) > SINGLE_TOLERANCE) {
        snprintf(words, size, "scales or shears (its axes are %g, %g and %g long), expected a rotation", x, y, z);
    } else if (determinant(m) < 0.0) {
        snprintf(words, size, "mirrors (determinant -1), expected +1");
    } else if (far_m > FARTHEST_MOVE) {
        snprintf(words, size, "leads %g m away, expected at most %g m", far_m, FARTHEST_MOVE);
    }
}

int proximity_refuse_pose(const char *name, const double *matrix, const double *velocity,
                          const double *angular_velocity, proximity_error *error)
{
    char words[200];
    describe_matrix(matrix, words, sizeof words);
    if (*words != '\0') {
        return proximity_refuse(error, PROXIMITY_BAD_POSE, "part '%.80s': the matrix %s", name, words);
    }
    if (!are_finite(velocity, 3) || !are_finite(angular_velocity, 3)) {
        return proximity_refuse(error, PROXIMITY_BAD_POSE, "part '%.80s': a velocity is not finite", name);
    }
    return proximity_refuse(error, PROXIMITY_BAD_POSE,
                            "part '%.80s': the matrix is no rigid transform, or the velocity is above %g m/s or rad/s", name,
                            FASTEST_MOVE);
}
