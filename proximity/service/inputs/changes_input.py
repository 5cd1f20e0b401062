"""Changes of parts, received as messages while the scene is served.

Hiding, showing and deforming are applied when messages are read. Slow changes, adding and removing, are
passed to another thread, and messages wait until they are done: they take effect in order.
"""

import logging
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import numpy as np

from proximity.errors import PoseError, ProximityError, SceneError
from proximity.message import ADDITIONS, BLOCK_VERTICES, CHANGES, DEFORMATIONS, Kind, PartAction
from proximity.pose import Pose
from proximity.scene.scene import Scene
from proximity.service.inputs.inbox import Inbox

LOGGER = logging.getLogger("proximity.service")
DEFAULT_UNITS = "mm"
PENDING_INTERVAL = 0.005
"""s between two checks whether a slow change is done."""
_ACTIONS = frozenset(PartAction)


@dataclass(frozen=True, slots=True, eq=False)
class Addition:
    """A file of parts to add."""

    name: str  # of its part, or prefix of those of its parts
    file: str  # as in the message
    units: str
    pose: Pose  # world_from_file


@dataclass(slots=True, eq=False)
class Request:
    """One message for the other thread to execute, completely or not at all."""

    actions: tuple[tuple[str, PartAction], ...] = ()  # by names of parts, in this order
    additions: tuple[Addition, ...] = ()
    refusal: str = ""  # reason of a failure
    is_over: bool = False  # written last


class ChangesInput:
    """Changes of parts, as `CHANGES`, `ADDITIONS` and `DEFORMATIONS` messages at an address.

    A message is applied completely or, if that fails, not at all: then it is refused and counted, with the
    reason of the first of each kind.

    *requests*: queue of slow changes; the thread that executes them writes ``refusal`` and ``is_over``.
    *describe*: called when a message requests the description; *refuse*: with kind and reason of a refused
    message. *deforming*: entered while a shape changes.
    """

    requests: SimpleQueue[Request | None]

    def __init__(
        self,
        address: str,
        requests: SimpleQueue[Request | None],
        describe: Callable[[], None] = lambda: None,
        deforming: AbstractContextManager[Any] | None = None,
        refuse: Callable[[str, str], None] = lambda kind, reason: None,
    ) -> None:
        # A change holds for any clock of the sender.
        self._inbox = Inbox(address, [CHANGES, ADDITIONS, DEFORMATIONS], is_timed=False)
        self.requests, self._describe, self._report_refusal = requests, describe, refuse
        self._deforming = nullcontext() if deforming is None else deforming
        self._pending: tuple[Kind, Request] | None = None
        self._refused: dict[str, tuple[int, str]] = {}  # by kind: number of messages, reason of the first

    @property
    def notes(self) -> list[str]:
        """Sentences on messages that were lost or refused."""
        refused = [
            f"{self._inbox.address}: {count} messages of {kind} were refused, first: {reason}"
            for kind, (count, reason) in list(self._refused.items())
        ]
        return refused + self._inbox.notes

    def apply(self, scene: Scene) -> None:
        """Apply arrived messages, up to the first slow one."""
        if self._pending is not None and not self._is_carried_out(*self._pending):
            return
        for kind, records, _ in self._inbox.messages():
            try:
                self._apply_message(scene, kind, records)
            except ProximityError as unfit:
                self._refuse(kind, str(unfit))
            if self._pending is not None:
                return  # later messages wait

    def wait(self, timeout: float) -> None:
        """Wait until a message may have arrived, or for *timeout* seconds."""
        if self._pending is None:
            self._inbox.wait(timeout)
        else:  # arrived messages wait as well
            time.sleep(min(timeout, PENDING_INTERVAL))

    def close(self) -> None:
        """Close the address."""
        self._inbox.close()

    def _is_carried_out(self, kind: Kind, request: Request) -> bool:
        if request.is_over:
            self._pending = None
            if request.refusal:
                self._refuse(kind, request.refusal)
        return request.is_over

    def _apply_message(self, scene: Scene, kind: Kind, records: np.ndarray) -> None:
        if kind is CHANGES:
            self._change(scene, records)
        elif kind is DEFORMATIONS:
            name, vertices = _deformation(records)
            with self._deforming:
                scene.deform(name, vertices)
        else:
            self._request(kind, Request(additions=tuple(map(_addition, records.copy()))))

    def _change(self, scene: Scene, records: np.ndarray) -> None:
        numbers = records["action"].tolist()
        unknown = [number for number in numbers if number not in _ACTIONS]
        if unknown:
            raise SceneError(f"action {unknown[0]} is none, expected 0 to {max(_ACTIONS)}")
        named = zip(map(_text, records["name"].tolist()), map(PartAction, numbers), strict=True)
        actions = tuple((name, action) for name, action in named if action is not PartAction.DESCRIBE)
        for name, _ in actions:
            scene.part(name)  # before any change
        if len(actions) < len(numbers):
            self._describe()
        if any(action is PartAction.REMOVE for _, action in actions):
            self._request(CHANGES, Request(actions))
        else:
            carry_out(scene, actions)

    def _request(self, kind: Kind, request: Request) -> None:
        self._pending = kind, request
        self.requests.put(request)

    def _refuse(self, kind: Kind, reason: str) -> None:
        count, first = self._refused.get(kind.name, (0, reason))
        if not count:
            LOGGER.warning("%s: a message of %s is refused (%s)", self._inbox.address, kind.name, reason)
        self._refused[kind.name] = count + 1, first
        self._report_refusal(kind.name, reason)


def carry_out(scene: Scene, actions: tuple[tuple[str, PartAction], ...]) -> None:
    """Hide, show and remove parts.

    *actions*: names of parts, and an action for each.
    """
    do = {PartAction.HIDE: scene.hide, PartAction.SHOW: scene.show, PartAction.REMOVE: scene.remove}
    for name, action in actions:
        do[action](name)


def _addition(record: Any) -> Addition:
    name = _text(record["name"])
    if not name:
        raise SceneError("a part to add has no name, expected one")
    try:
        pose = Pose(record["rotation"], record["translation"])
    except PoseError as unfit:
        raise PoseError(f"part {name!r}: {unfit}") from unfit
    return Addition(name, _text(record["file"]), _text(record["units"]) or DEFAULT_UNITS, pose)


def _deformation(records: np.ndarray) -> tuple[str, np.ndarray]:
    """Return the part that a message deforms, and its vertices (V, 3)."""
    if not len(records):
        raise SceneError("the message has no records, expected one for each 64 vertices of a part")
    raw, count = records["name"][0], int(records["vertex_count"][0])
    expected = BLOCK_VERTICES * np.arange(len(records))
    if (
        (records["name"] != raw).any()
        or (records["vertex_count"] != count).any()
        or (records["first"] != expected).any()
        or not 0 < count - expected[-1] <= BLOCK_VERTICES
    ):
        raise SceneError(
            f"the records are not those of one part in order: expected the name and vertex_count of part "
            f"{_text(raw)!r} in all, first to be 0, 64, 128, …, and all {count} vertices"
        )
    return _text(raw), records["vertices"].reshape(-1, 3)[:count]


def _text(raw: bytes) -> str:
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as unfit:
        raise SceneError(f"{raw!r} is not UTF-8, expected a name in UTF-8") from unfit
