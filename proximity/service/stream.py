"""Poses that come as messages, from another process or machine."""

import time
from collections.abc import Callable

import numpy as np

from proximity.message import PATH_CORNERS, PATH_POSES, POSES, Kind
from proximity.service.reception import Reception, rows_of
from proximity.service.samples import Hands


class StreamInput:
    """Poses of fingers, as `POSES` and `PATH_POSES` messages at an address.

    A message need not tell all fingers: of the others, what was told last is still true. Where several have
    come since the last poll, the newest counts.

    Parameters
    ----------
    address : str
        As of `open_subscriber`.
    count : int
        Of fingers.
    clock : callable
        Gives now, ns, monotonic.

    Raises
    ------
    PublishError
        If the address cannot be opened.
    """

    is_over = False

    def __init__(self, address: str, count: int, *, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._reception = Reception(address, [POSES, PATH_POSES], clock)
        self._count = count
        self._hands = Hands(count)

    @property
    def notes(self) -> list[str]:
        """What was lost, refused or left out."""
        return self._reception.notes

    def poll(self, now_ns: int) -> Hands | None:
        """Return the newest pose of each finger; None where no message came.

        Parameters
        ----------
        now_ns : int, ns
            The present instant.
        """
        has_come = False
        for kind, records, ahead_ns in self._reception.messages():
            has_come = True
            self._take(kind, records, ahead_ns)
        return self._hands if has_come else None

    def close(self) -> None:
        """Give the address back."""
        self._reception.close()

    def _take(self, kind: Kind, records: np.ndarray, ahead_ns: int) -> None:
        hands = self._hands
        rows, chosen = rows_of(records["finger"], self._count)
        if chosen is not None:
            self._reception.leave_out("poses of fingers that are not served", int((~chosen).sum()))
            records = records[chosen]
        hands.positions[rows] = records["position"]
        hands.pose_ns[rows] = records["pose_ns"] + ahead_ns
        if hands.velocities is not None or np.isfinite(records["velocity"]).any():
            if hands.velocities is None:
                hands.velocities = np.full((self._count, 3), np.nan)
            hands.velocities[rows] = records["velocity"]
        if hands.bends is not None or np.isfinite(records["bend"]).any():
            if hands.bends is None:
                hands.bends = np.full(self._count, np.nan)
            hands.bends[rows] = records["bend"]
        if hands.paths is not None or kind is PATH_POSES:
            if hands.paths is None:
                hands.paths = np.full((self._count, PATH_CORNERS, 3), np.nan)
            # A pose without a path says that the one before does not hold any more.
            hands.paths[rows] = records["corners"] if kind is PATH_POSES else np.nan
