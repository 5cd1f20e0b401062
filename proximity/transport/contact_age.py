"""Widen the bounds of contacts as they age, and clear contacts that are too old."""

import numpy as np

from proximity.core.library_in_c import receiver_in_c


def widen(contacts: np.ndarray, now_ns: int, max_speed: float, max_acceleration: float) -> None:
    """Widen the bounds of contacts by the possible motion of the finger and the parts until *now_ns*.

    The bounds, and those of predictions, then hold at *now_ns*, while the distances stay those of the pose.
    Contacts are no longer marked as exact or predicted, no force is valid, and the place of contact is not
    guaranteed. Times to contact still count from the pose. Fingers that are not tracked are unchanged.

    *contacts*: (N,) CONTACT, in C order. *now_ns*: an instant on the clock of the poses, not before them.

    Notes
    -----
    The bounds hold if the finger exceeds neither limit and every part keeps the linear and angular velocity
    that the scene had for it at the tick.
    ``part_velocity`` is that of one point. The excess speed of other parts and points, and the error of the
    finger's velocity, are in the published predictions: their bounds differ by the possible motion until
    ``predicted_ns``. A publisher that predicts for the pose's own instant does not report it: then no part is
    assumed to be faster than the nearest point of the nearest one.
    """
    receiver_in_c("widen")(_bytes_of(contacts), int(now_ns), float(max_speed), float(max_acceleration))


def forget(contacts: np.ndarray) -> None:
    """Clear contacts except for finger, source and times.

    *contacts*: (N,) CONTACT, in C order; overwritten with contacts of fingers that are not tracked.
    """
    receiver_in_c("forget")(_bytes_of(contacts))


def _bytes_of(contacts: np.ndarray) -> np.ndarray:
    return contacts.reshape(-1).view(np.uint8)
