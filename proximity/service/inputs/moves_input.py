"""Receive poses of moving parts as messages while the scene is served."""

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from proximity.core.receiver_state import AHEAD_NS
from proximity.errors import ArgumentError, SceneError
from proximity.message import MOVES
from proximity.message.instant_advice import on_backwards, on_future, on_too_old
from proximity.pose import nearest_rotations
from proximity.scene.scene import Scene
from proximity.service.inputs.inbox import Inbox
from proximity.service.inputs.part_prediction import HOLD_NS, ReportedMotion
from proximity.system.time_units import NS_PER_MS, NS_PER_S

SILENT_PARTS = "parts stood still: no move for 100 ms"
UNFIT = "moves of parts that are invalid"
FUTURE, BACKWARDS = "moves from the future", "moves older than the one before"
REPEATED = "messages of moves that repeat parts"


class MovesInput:
    """Receives `MOVES` messages at an address and moves the parts of a scene.

    A move is counted and not used if its part is missing or its pose is not rigid, if its instant is more
    than 5 ms in the future or before the part's previous one, or if it is too old. The other moves of the
    message are used. A message whose moves name each part more than twice on average is not used at all.
    Velocities of nan are zero.

    The loop extrapolates a part with a velocity from the instant of its pose, for `HOLD_NS` at most. Then the
    part stops, which is counted, and frames are late until it is reported again. So a part that comes to rest
    must be reported once without a velocity.
    """

    future: int  # number of unused moves from the future
    backwards: int  # … older than the previous one
    too_old: int  # … too old on arrival

    def __init__(
        self,
        address: str,
        *,
        stale_after: float = 0.100,
        clock: Callable[[], int] = time.monotonic_ns,
        skipped: Callable[[], int] = lambda: 0,
        refuse: Callable[[str, str, int], None] = lambda kind, reason, count: None,
    ) -> None:
        self._inbox = Inbox(address, [MOVES], clock)
        self._clock, self._skipped, self._refuse = clock, skipped, refuse
        self._stale_after_ns = round(NS_PER_S * stale_after)
        self.future = self.backwards = self.too_old = 0
        self._scene: Scene | None = None
        self._latest: dict[str, ReportedMotion] = {}  # last motion by part, present or removed
        self._silent: set[str] = set()  # names of parts that are no longer reported
        self._names: dict[bytes, str] = {}
        self._followers: dict[str, dict[str, np.ndarray]] = {}  # relative poses
        self._listeners: list[Callable[[], None]] = []

    @property
    def address(self) -> str:
        """Address at which the messages arrive."""
        return self._inbox.address

    def follow(self, scene: Scene, names: Sequence[str], listener: Callable[[], None]) -> None:
        """Move the other parts of a rigid group whenever its first part moves.

        Their poses relative to the first part stay as they are now. *listener* is called after each message.
        """
        first, *others = (scene.part(name).pose for name in names)
        offsets = [(first.inverse @ pose).matrix for pose in others]
        self._followers[names[0]] = dict(zip(names[1:], offsets, strict=True))
        self._listeners.append(listener)

    def reported(self) -> dict[str, ReportedMotion]:
        """Return a copy of the last motion of each part. Any thread may call it."""
        return self._latest.copy()

    @property
    def notes(self) -> list[str]:
        """Sentences on messages that were lost, refused or not used."""
        return self._inbox.notes

    def take(self, scene: Scene, now_ns: int) -> dict[str, ReportedMotion]:
        """Move parts as reported by the arrived messages. Return the new motions.

        A new scene also gets all earlier motions.
        """
        moved: dict[str, ReportedMotion] = {}
        if scene is not self._scene:
            self._scene = scene
            moved |= self._moved_each(scene, self._latest)
        for _, records, offset_ns in self._inbox.messages():
            moved |= self._apply_message(scene, records, offset_ns + self._skipped(), now_ns)
            for listener in self._listeners:
                listener()
        return moved

    def wait(self, timeout: float) -> None:
        """Wait until a message may have arrived, or for *timeout* seconds."""
        self._inbox.wait(timeout)

    def note_silence(self, names: Collection[str], now_ns: int) -> None:
        """Count those of the named parts that were moving and are no longer reported."""
        silent = [
            name
            for name, reported in self._latest.items()
            if reported.is_moving
            and reported.pose_ns + HOLD_NS <= now_ns
            and name not in self._silent
            and name in names
        ]
        if silent:
            self._silent.update(silent)
            self._inbox.leave_out(
                SILENT_PARTS, len(silent), says=f"{silent[0]!r} stands still: no move for 100 ms"
            )

    def close(self) -> None:
        """Close the address."""
        self._inbox.close()

    def _apply_message(
        self, scene: Scene, records: np.ndarray, offset_ns: int, now_ns: int
    ) -> dict[str, ReportedMotion]:
        """Move parts as reported in a message. Store and return the moves that were used."""
        if names_repeat(records):
            self._leave_out(REPEATED, 1, f"{len(records)} moves, expected one for each part")
            return {}
        names = [self._name(raw) for raw in records["name"].tolist()]
        pose_ns = records["pose_ns"] + offset_ns
        rows = self._usable_rows(names, pose_ns, now_ns)
        if len(rows) < len(names):
            names, records, pose_ns = [names[row] for row in rows], records[rows], pose_ns[rows]
        matrices = np.zeros((len(names), 4, 4))
        matrices[:, :3, :3] = nearest_rotations(records["rotation"])
        matrices[:, :3, 3] = records["translation"]
        matrices[:, 3, 3] = 1.0
        velocities = np.nan_to_num(records["velocity"], posinf=np.inf, neginf=-np.inf)
        turning = np.nan_to_num(records["angular_velocity"], posinf=np.inf, neginf=-np.inf)
        is_moving = velocities.any(axis=1) | turning.any(axis=1)
        is_known = np.isfinite(records["velocity"]).any(axis=1)
        each = zip(
            matrices,
            velocities,
            turning,
            pose_ns.tolist(),
            is_moving.tolist(),
            is_known.tolist(),
            strict=True,
        )
        moves = {name: ReportedMotion(*reported) for name, reported in zip(names, each, strict=True)}
        if self._followers.keys() & moves.keys():
            names, matrices, velocities, turning = self._with_followers(moves)
        try:
            scene.move_many(names, matrices, velocities, turning)
        except (ArgumentError, SceneError):
            moves = dict(self._moved_each(scene, moves, UNFIT))
        self._latest.update(moves)
        self._silent -= moves.keys()
        return moves

    def _with_followers(self, moves: dict[str, ReportedMotion]) -> Any:
        """Add the parts that follow others to *moves*.

        Return the names, matrices, velocities and angular velocities of all moved parts.
        """
        for name in self._followers.keys() & moves.keys():
            first = moves[name]
            for follower, offset in self._followers[name].items():
                matrix = first.matrix @ offset
                arm = matrix[:3, 3] - first.matrix[:3, 3]
                velocity = first.velocity + np.cross(first.turning, arm)
                moves[follower] = first._replace(matrix=matrix, velocity=velocity)
        columns = zip(*((each.matrix, each.velocity, each.turning) for each in moves.values()), strict=True)
        return list(moves), *map(np.array, columns)

    def _usable_rows(self, names: list[str], pose_ns: np.ndarray, now_ns: int) -> list[int]:
        """Return the rows of the moves whose instants are usable.

        An instant must not be in the future, before the previous one of its part, or too old.
        """
        usable, latest = [], self._latest
        ahead_ns, back_ns, ages_ns = [], [], []
        # Not the start of the tick: if the system suspended this thread since, new moves are later.
        newest_ns = max(now_ns, self._clock() + self._skipped())
        for row, (name, instant) in enumerate(zip(names, pose_ns.tolist(), strict=True)):
            if instant > newest_ns + AHEAD_NS:
                ahead_ns.append(instant - newest_ns)
            elif name in latest and instant < latest[name].pose_ns:
                back_ns.append(latest[name].pose_ns - instant)
            elif instant < now_ns - self._stale_after_ns:
                ages_ns.append(now_ns - instant)
            else:
                usable.append(row)
        if len(usable) < len(names):
            self.future += len(ahead_ns)
            self.backwards += len(back_ns)
            self.too_old += len(ages_ns)
            too_old = f"moves older than {self._stale_after_ns / NS_PER_MS:g} ms"
            reasons = (
                (FUTURE, ahead_ns, on_future),
                (BACKWARDS, back_ns, on_backwards),
                (too_old, ages_ns, on_too_old),
            )
            for what, off_ns, advice in reasons:
                if off_ns:
                    self._leave_out(what, len(off_ns), advice(off_ns[0]))
        return usable

    def _moved_each(
        self, scene: Scene, moves: Mapping[str, ReportedMotion], unfit_are: str = ""
    ) -> Iterator[tuple[str, ReportedMotion]]:
        """Move parts one by one without using invalid moves. Yield the moves that were used."""
        for name, reported in moves.items():
            try:
                scene.move(
                    name, reported.matrix, velocity=reported.velocity, angular_velocity=reported.turning
                )
            except (ArgumentError, SceneError) as unfit:
                if unfit_are:
                    self._leave_out(unfit_are, 1, str(unfit))
            else:
                yield name, reported

    def _leave_out(self, what: str, count: int, why: str) -> None:
        self._inbox.leave_out(what, count, why)
        self._refuse(MOVES.name, why, count)

    def _name(self, raw: bytes) -> str:
        name = self._names.get(raw)
        if name is None:
            name = raw.decode("utf-8", "replace")
            if self._scene is not None and name in self._latest:
                self._names[raw] = name
        return name


def names_repeat(records: np.ndarray) -> bool:
    """Return whether the moves name each part more than twice on average."""
    return len(records) > 2 * len(set(records["name"].tolist()))
