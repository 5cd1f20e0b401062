"""Ageing of contacts: widening of their bounds with time, and clearing.

Both functions change records in place and keep the meaning of every field as published.
"""

import numpy as np

from proximity.core.library_in_c import receiver_in_c


def widen(contacts: np.ndarray, now_ns: int, max_speed: float, max_acceleration: float) -> None:
    """Widen the bounds of contacts by the possible motion of finger and parts until a later instant.

    Bounds, and those of predictions, hold at *now_ns*; the distances stay those of the pose. Contacts are no
    longer exact or predicted, no force is valid, and the place of contact is not guaranteed. Times to contact
    still count from the pose. A finger that is not tracked stays so.

    *contacts*: (N,) CONTACT, in C order. *now_ns*: the instant, on the clock of the poses, not before them.

    Notes
    -----
    The bounds hold while the finger keeps to both limits and every part to the velocity, of translation and
    rotation, that the scene had for it at the tick.
    ``part_velocity`` is that of one point. The excess speed of other parts and points, and the error of the
    finger's velocity, are in the published predictions: their bounds differ by the possible motion until
    ``predicted_ns``. A publisher that predicts for the pose's own instant does not report it: then no part is
    assumed to be faster than the nearest point of the nearest one.
    """
    receiver_in_c("widen")(_bytes_of(contacts), int(now_ns), float(max_speed), float(max_acceleration))


def forget(contacts: np.ndarray) -> None:
    """Clear contacts except for finger, source and times.

    *contacts*: (N,) CONTACT, in C order; changed in place, to those of fingers that are not tracked.
    """
    receiver_in_c("forget")(_bytes_of(contacts))


def _bytes_of(contacts: np.ndarray) -> np.ndarray:
    return contacts.reshape(-1).view(np.uint8)
