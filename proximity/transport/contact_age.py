"""Ageing of contacts: bounds widen with time until nothing is known.

Both functions change records in place and leave every field with the meaning it has when it is published.
"""

import numpy as np

from proximity.core.library_in_c import receiver_in_c


def widen(contacts: np.ndarray, now_ns: int, max_speed: float, max_acceleration: float) -> None:
    """Widen the bounds of contacts by as much as finger and parts may have moved until a later instant.

    Bounds, and those of predictions, hold at *now_ns*; the distances stay those of the pose. Nothing is exact
    or predicted any more, no force is valid, and the place of contact is kept without a promise. Times to
    contact go on counting from the pose. A finger that is not tracked stays so.

    *contacts*: (N,) CONTACT, in C order. *now_ns*: the instant, on the clock of the poses, not before them.

    Notes
    -----
    The bounds hold as long as the finger keeps to both limits and every part to the velocity, of translation
    and rotation, that the scene had for it at the tick.
    ``part_velocity`` is that of one point. How much faster other parts and other points are, and how far off
    the finger's velocity may be, is in the published predictions: their bounds are apart by what both may
    have done until ``predicted_ns``. Where a publisher predicts for the pose's own instant that is not
    reported: then no part is thought to be faster than the nearest point of the nearest one.
    """
    receiver_in_c("widen")(_bytes_of(contacts), int(now_ns), float(max_speed), float(max_acceleration))


def forget(contacts: np.ndarray) -> None:
    """Leave nothing of contacts but whose they are, where they come from and when that was.

    *contacts*: (N,) CONTACT, in C order; changed in place: as of fingers that are not tracked.
    """
    receiver_in_c("forget")(_bytes_of(contacts))


def _bytes_of(contacts: np.ndarray) -> np.ndarray:
    return contacts.reshape(-1).view(np.uint8)
