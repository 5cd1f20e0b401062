"""Notes on poses that were probably meant otherwise: instants of another clock, positions in millimetres."""

import logging
from collections.abc import Iterator

import numpy as np

from proximity.kernels.tracking.motion import FUTURE, TOO_OLD
from proximity.kernels.tracking.tick import ALL_IN_MILLIMETRES, DONE, HAS_DEFECT
from proximity.message import ContactFlag
from proximity.message.instant_advice import FROM_FUTURE, OTHER_CLOCK_NS, on_future, on_too_old
from proximity.scene.model.assembly import Model
from proximity.scene.queries.checked_query import in_millimetres, size_of

LOGGER = logging.getLogger("proximity.tracker")
TWO_CLOCKS = "t_pose_ns and now_ns may be of two clocks: take both from time.monotonic_ns()"


class PoseNotes:
    """Sentences about the poses of a tracker; each kind is logged once."""

    sentences: list[str]

    def __init__(self) -> None:
        self.sentences = []
        self._known = DONE

    def add(self, answer: int, contacts: np.ndarray, model: Model) -> None:
        """Note what the *answer* of a tick says about its poses, unless that is known."""
        new, self._known = answer & ~self._known, answer | self._known
        for sentence in _sentences(new, contacts, model) if new else ():
            self.sentences.append(sentence)
            LOGGER.warning("%s", sentence)


def _sentences(bits: int, contacts: np.ndarray, model: Model) -> Iterator[str]:
    ages_ns = contacts["age_ns"][np.isfinite(contacts["position"]).all(axis=1)]
    if bits & HAS_DEFECT << FUTURE:
        ahead_ns = -int(ages_ns.min())
        effect = "not used" if ahead_ns > OTHER_CLOCK_NS else "predicted for their own instant"
        yield f"{FROM_FUTURE} are {effect} ({on_future(ahead_ns, TWO_CLOCKS)})"
    if bits & HAS_DEFECT << TOO_OLD:
        yield f"poses older than 1 s are not used ({on_too_old(int(ages_ns.max()), TWO_CLOCKS)})"
    if bits & ALL_IN_MILLIMETRES:
        nearest = contacts[(contacts["flags"] & np.uint32(ContactFlag.TRACKED)) != 0]
        row = int(np.argmin(nearest["signed_distance"]))
        what, distance = f"finger {nearest['finger'][row]}", float(nearest["signed_distance"][row])
        yield in_millimetres(what, distance, size_of(model), "positions")
