"""Poses that come as messages, from another process or machine."""

from proximity.service.samples import Hands


class StreamInput:
    """Poses of fingers, as `POSES` and `PATH_POSES` messages at an address.

    Parameters
    ----------
    address : str
        As of `open_subscriber`.
    count : int
        Of fingers.

    Raises
    ------
    PublishError
        If the address cannot be opened.
    """

    is_over = False

    def __init__(self, address: str, count: int) -> None:
        raise NotImplementedError

    @property
    def notes(self) -> list[str]:
        """What was left out, and why."""
        return []

    def poll(self, now_ns: int) -> Hands | None:
        """Return the newest pose of each finger; None where no message came.

        Parameters
        ----------
        now_ns : int, ns
            The present instant.
        """
        return None

    def close(self) -> None:
        """Give the address back."""
