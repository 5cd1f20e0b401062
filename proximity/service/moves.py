"""Parts that move while they are served: where to, as messages tell."""

import time
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from proximity.errors import PoseError, SceneError
from proximity.message import MOVES
from proximity.scene import Scene
from proximity.service.clock import SECOND
from proximity.service.reception import Reception

HOLD_NS = SECOND // 10
"""How long a part is believed to have the velocity that was told, unless it is told again."""
NEVER = 2**63 - 1
SILENT = "velocities of parts of which nothing more was told for 100 ms"

EXACT = 1e-9
SINGLE = 1e-5
"""How far rotation times its transpose may be from the identity: senders that compute in single precision
are off by a millionth, and a scene refuses that. Up to here the nearest rotation is meant."""

Move = tuple[np.ndarray, np.ndarray, np.ndarray, int]
"""``world_from_part`` (4, 4), velocity and angular velocity (3,) of one part, until when, ns."""


class MovesInput:
    """Moves of parts, as `MOVES` messages at an address.

    A part that is not there, or a pose that is not rigid, is counted and left out; the others move.
    Velocities of nan are zero. A part that had a velocity and of which nothing more is told stands where it
    was put: `HOLD_NS` after its pose its velocity is zero, and that is counted.

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
        self._next_ns = NEVER  # no part loses its velocity before
        self._names: dict[bytes, str] = {}

    @property
    def notes(self) -> list[str]:
        """What was lost, refused or left out."""
        return self._reception.notes

    def apply(self, scene: Scene, now_ns: int) -> None:
        """Move the parts of a scene that are to move.

        Parameters
        ----------
        scene : Scene
            Another one than before, an edited one perhaps, gets all that was told until now.
        now_ns : int, ns
            The present instant.
        """
        if scene is not self._scene:
            self._scene = scene
            self._repeat(scene, self._latest)
        for _, records, ahead_ns in self._reception.messages():
            self._move(scene, records, np.minimum(records["pose_ns"] + ahead_ns, now_ns) + HOLD_NS)
        if now_ns >= self._next_ns:
            self._stop_silent(scene, now_ns)

    def close(self) -> None:
        """Give the address back."""
        self._reception.close()

    def _move(self, scene: Scene, records: np.ndarray, until_ns: np.ndarray) -> None:
        names = [self._name(raw) for raw in records["name"].tolist()]
        matrices = np.zeros((len(names), 4, 4))
        matrices[:, :3, :3] = _nearest_rotations(records["rotation"])
        matrices[:, :3, 3] = records["translation"]
        matrices[:, 3, 3] = 1.0
        velocities = np.nan_to_num(records["velocity"], posinf=np.inf, neginf=-np.inf)
        turning = np.nan_to_num(records["angular_velocity"], posinf=np.inf, neginf=-np.inf)
        until_ns[~(velocities.any(axis=1) | turning.any(axis=1))] = NEVER
        told = zip(matrices, velocities, turning, until_ns.tolist(), strict=True)
        moves: dict[str, Move] = dict(zip(names, told, strict=True))
        try:
            scene.move_many(names, matrices, velocities, turning)
        except (SceneError, PoseError):
            moves = dict(self._moved_each(scene, moves))
        self._latest.update(moves)
        self._next_ns = min(self._next_ns, until_ns.min(initial=NEVER))

    def _moved_each(self, scene: Scene, moves: dict[str, Move]) -> Iterator[tuple[str, Move]]:
        """Move one after the other, and leave out whoever cannot be; gives those that were moved."""
        for name, move in moves.items():
            try:
                scene.move(name, move[0], velocity=move[1], angular_velocity=move[2])
            except (SceneError, PoseError) as unfit:
                self._reception.leave_out("moves of parts that cannot be", 1, str(unfit))
            else:
                yield name, move

    def _repeat(self, scene: Scene, names: Iterable[str]) -> None:
        """Tell a scene once more what is known of some parts."""
        for name in names:
            matrix, velocity, turning, _ = self._latest[name]
            try:
                scene.move(name, matrix, velocity=velocity, angular_velocity=turning)
            except SceneError:
                continue  # the part is not there any more

    def _stop_silent(self, scene: Scene, now_ns: int) -> None:
        """Take the velocities of parts of which nothing more is told."""
        silent = [name for name, move in self._latest.items() if move[-1] <= now_ns]
        for name in silent:
            self._latest[name] = self._latest[name][0], np.zeros(3), np.zeros(3), NEVER
        self._repeat(scene, silent)
        if silent:
            self._reception.leave_out(SILENT, len(silent), f"first of {silent[0]!r}")
        self._next_ns = min((move[-1] for move in self._latest.values()), default=NEVER)

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
