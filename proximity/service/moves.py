"""Parts that move while they are served: where to, as messages tell."""

import logging

from proximity.scene import Scene

LOGGER = logging.getLogger("proximity.service")


class MovesInput:
    """Moves of parts, as `MOVES` messages at an address.

    Parameters
    ----------
    address : str
        As of `open_subscriber`.

    Raises
    ------
    PublishError
        If the address cannot be opened.
    """

    def __init__(self, address: str) -> None:
        raise NotImplementedError

    @property
    def notes(self) -> list[str]:
        """What was left out, and why."""
        return []

    def apply(self, scene: Scene) -> None:
        """Move the parts of a scene that are to move.

        Parameters
        ----------
        scene : Scene
            Another one than before gets all that was told until now.
        """

    def close(self) -> None:
        """Give the address back."""
