"""Samples of the surface of a part, for checking its sign.

A sample is a point and the unit normal of its face.
"""

from math import sqrt

import numpy as np

from proximity.kernels.mesh.faces import double_area
from proximity.kernels.mesh.positions import fetch_corners, rows_where
from proximity.native import allocating_kernel, kernel

POINT_SAMPLE_COUNT = 64
"""Number of points on the surface. They are distributed by area."""
# fmt: off
RANDOM_SAMPLES = np.array([
    .62509547, .58643884, .20784613, .89721380, .01212614, .49927093, .77568569, .35512946, .18982131,
    .22520719, .61117356, .25245219, .30016628, .54427015, .21534694, .87355345, .04635854, .10194971,
    .00526530, .35003997, .01192242, .82122842, .11468742, .68871840, .79706943, .68294467, .30350302,
    .46793495, .67953022, .05923394, .30303243, .05069792, .94434425, .27842561, .75561114, .08078266,
    .25486959, .32349356, .53860590, .44507631, .48261520, .35919251, .50454826, .50578804, .41680634,
    .55349735, .23997024, .38012097, .99550028, .01536501, .98382339, .79266192, .47249219, .43178883,
    .62217923, .63587594, .34885150, .98896015, .25582865, .38011579, .21530870, .92546551, .03496126,
    .16021203, .43289307, .15768493, .61253960, .59002858, .28355680, .04394201, .10470653, .81879774,
    .03568028, .26545989, .44161699, .51488882, .38931572, .53053868, .46620603, .22827549, .51641388,
    .91716777, .77049249, .03854633, .62922625, .18184147, .56628734, .51411765, .50238219, .12506610,
    .49687344, .41707958, .28384525, .24751492, .50270401, .27458409, .01179403, .03718300, .75548563,
    .19240214, .13913708, .60880648, .69203212, .25496021, .68184857, .20060672, .63383535, .07116811,
    .36953631, .68829584, .29887615, .00373424, .10117040, .51706867, .83004773, .18595951, .07074285,
    .15446108, .23603918, .68254104, .26759930, .95776350, .02346433, .88033215, .05204033, .10240238,
    .50979081, .03704973, .94346601, .84715025, .32097504, .13641822, .63971717, .00814576, .15877477,
    .74177095, .36254203, .11996941, .09149561, .26962054, .06561252, .54114382, .02026210, .43700174,
    .50777224, .29784063, .10543583, .87133938, .06096644, .23107846, .36126406, .14225186, .12141794,
    .59818407, .46987186, .14306834, .05925164, .47450231, .04792660, .38763180, .75193819, .22556069,
    .32303635, .19640078, .30069165, .15019973, .15402965, .56143941, .81633810, .46708838, .05403206,
    .37944617, .12749049, .69572835, .97874788, .53875283, .20455918, .58999169, .62679635, .00747794,
    .60505625, .05278709, .34064346, .63799658, .24236333, .14561151, .67645024, .45360580, .18520018,
    .15078802, .37440928, .06064413,
]).reshape(64, 3)
# fmt: on
"""Random numbers, which are the same for every part.

A row has a share of the area, and the weights of two corners, distributed uniformly over a face.
"""
FACE_SAMPLE_COUNT = 128
"""Maximum number of points above faces for which the sign grid has no side.

In parts with at most this number of faces, any face may be sampled.
"""
FACE_SAMPLE_WEIGHTS = np.array([[100, 100, 100], [298, 1, 1], [1, 298, 1], [1, 1, 298]]) / 300.0
"""Weights of the corners of a face at its samples.

One sample is in the middle, and one is near each corner, because corners enter other regions first.
"""


@allocating_kernel
def surface_samples(corners, faces):
    """Return samples distributed by area, (N, 6), or none if no face has an area.

    A sample is a point and a unit normal.
    """
    sums, total = np.empty(len(faces)), 0.0
    for face in range(len(faces)):
        fetch_corners(corners, faces, face)
        total += double_area(corners, faces, face)
        sums[face] = total
    samples, count = np.empty((POINT_SAMPLE_COUNT, 6)), 0
    if total > 0.0:
        for sample in range(POINT_SAMPLE_COUNT):
            share, u, v = RANDOM_SAMPLES[sample]
            face = min(_first_above(sums, share * total), len(faces) - 1)
            count = _add_sample(corners, faces, face, u, v, 1.0 - u - v, samples, count)
    return samples[:count]


@kernel
def _first_above(sums, value):
    """Return the index of the first number above *value* in ascending *sums*, or their length without one."""
    low, high = 0, len(sums)
    while low < high:
        middle = (low + high) // 2
        if sums[middle] > value:
            high = middle
        else:
            low = middle + 1
    return low


@allocating_kernel
def face_samples(corners, faces, is_left_out):
    """Return samples distributed evenly over faces, independent of their area, (N, 6).

    A sample is a point and a unit normal. *is_left_out*: (F,), True for faces to skip.
    """
    among = rows_where(is_left_out, False)
    sample_count = len(FACE_SAMPLE_WEIGHTS) * len(among)
    wanted = min(FACE_SAMPLE_COUNT, sample_count)
    samples, count = np.empty((wanted, 6)), 0
    for k in range(wanted):
        sample = k * sample_count // wanted
        u, v, w = FACE_SAMPLE_WEIGHTS[sample % len(FACE_SAMPLE_WEIGHTS)]
        face = among[sample // len(FACE_SAMPLE_WEIGHTS)]
        count = _add_sample(corners, faces, face, u, v, w, samples, count)
    return samples[:count]


@kernel
def _add_sample(corners, faces, face, u, v, w, samples, count):
    """Add the point of a face with the given weights, unless the face has no area. Return the new count."""
    a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        samples[count, axis] = corners[a, axis] * u + corners[b, axis] * v + corners[c, axis] * w
        samples[count, 3 + axis] = (corners[b, j] - corners[a, j]) * (corners[c, k] - corners[a, k]) - (
            corners[b, k] - corners[a, k]
        ) * (corners[c, j] - corners[a, j])
    x, y, z = samples[count, 3], samples[count, 4], samples[count, 5]
    area = sqrt(x * x + y * y + z * z)
    if not area > 0.0:
        return count
    for axis in range(3):
        samples[count, 3 + axis] /= area
    return count + 1
