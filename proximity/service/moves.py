"""Parts that move while they are served: where to, as messages tell."""

import time
from collections.abc import Callable

import numpy as np

from proximity.errors import PoseError, SceneError
from proximity.message import MOVES
from proximity.scene import Scene
from proximity.service.reception import Reception

EXACT = 1e-9
SINGLE = 1e-5
"""How far rotation times its transpose may be from the identity: senders that compute in single precision
are off by a millionth, and a scene refuses that. Up to here the nearest rotation is meant."""

Move = tuple[np.ndarray, np.ndarray, np.ndarray]
"""``world_from_part`` (4, 4), velocity and angular velocity (3,) of one part."""


class MovesInput:
    """Moves of parts, as `MOVES` messages at an address.

    A part that is not there, or a pose that is not rigid, is counted and left out; the others move.
    Velocities of nan are zero.

    Parameters
    ----------
    address : str
        As of `open_subscriber`.
    clock : callable
        Gives now, ns, monotonic.

    Raises
    ------
    PublishError
        If the address cannot be opened.
    """

    def __init__(self, address: str, *, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self._reception = Reception(address, [MOVES], clock)
        self._scene: Scene | None = None
        self._latest: dict[str, Move] = {}  # by name of a part that there is or was
        self._names: dict[bytes, str] = {}

    @property
    def notes(self) -> list[str]:
        """What was lost, refused or left out."""
        return self._reception.notes

    def apply(self, scene: Scene) -> None:
        """Move the parts of a scene that are to move.

        Parameters
        ----------
        scene : Scene
            Another one than before, an edited one perhaps, gets all that was told until now.
        """
        if scene is not self._scene:
            self._scene = scene
            self._repeat(scene)
        for _, records, _ in self._reception.messages():
            self._move(scene, records)

    def close(self) -> None:
        """Give the address back."""
        self._reception.close()

    def _move(self, scene: Scene, records: np.ndarray) -> None:
        names = [self._name(raw) for raw in records["name"].tolist()]
        matrices = np.zeros((len(names), 4, 4))
        matrices[:, :3, :3] = _nearest_rotations(records["rotation"])
        matrices[:, :3, 3] = records["translation"]
        matrices[:, 3, 3] = 1.0
        velocities = np.nan_to_num(records["velocity"], posinf=np.inf, neginf=-np.inf)
        turning = np.nan_to_num(records["angular_velocity"], posinf=np.inf, neginf=-np.inf)
        try:
            scene.move_many(names, matrices, velocities, turning)
        except (SceneError, PoseError):
            self._move_each(scene, names, matrices, velocities, turning)
            return
        self._latest.update(zip(names, zip(matrices, velocities, turning, strict=True), strict=True))

    def _move_each(
        self,
        scene: Scene,
        names: list[str],
        matrices: np.ndarray,
        velocities: np.ndarray,
        turning: np.ndarray,
    ) -> None:
        """Move one after the other, and leave out whoever cannot be."""
        for name, *move in zip(names, matrices, velocities, turning, strict=True):
            try:
                scene.move(name, move[0], velocity=move[1], angular_velocity=move[2])
            except (SceneError, PoseError) as unfit:
                self._reception.leave_out("moves of parts that cannot be", 1, str(unfit))
            else:
                self._latest[name] = move[0], move[1], move[2]

    def _repeat(self, scene: Scene) -> None:
        """Tell a new scene where its parts are."""
        for name, (matrix, velocity, turning) in self._latest.items():
            try:
                scene.move(name, matrix, velocity=velocity, angular_velocity=turning)
            except SceneError:
                continue  # the part is not there any more

    def _name(self, raw: bytes) -> str:
        name = self._names.get(raw)
        if name is None:
            name = raw.decode("utf-8", "replace")
            if self._scene is not None and name in self._latest:
                self._names[raw] = name
        return name


def _nearest_rotations(rotations: np.ndarray) -> np.ndarray:
    """Rotations (K, 3, 3) of which those that are off by single precision are made exact."""
    with np.errstate(over="ignore", invalid="ignore"):  # whatever a sender tells
        off = np.abs(rotations @ rotations.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    rows = (off > EXACT) & (off <= SINGLE)
    if rows.any():
        left, _, right = np.linalg.svd(rotations[rows])
        rotations = rotations.copy()
        rotations[rows] = left @ right
    return rotations
