"""Receive messages of a page, which are poses of fingers and moves and changes of parts, for the service.

The messages are untrusted. They have the service's format, with instants on the page's clock. They are
validated, their instants converted to this machine's clock, and published again, so that a page never chooses
session or sequence.
"""

import contextlib
import time

import numpy as np

from proximity.errors import ProximityError
from proximity.message import CHANGES, MOVES, PATH_POSES, POSES, Kind, Message, PartAction, parts_of, validate
from proximity.pose import Pose
from proximity.scene.part import Part
from proximity.scene.scene import Scene
from proximity.service.inputs.changes_input import carry_out
from proximity.service.inputs.moves_input import names_repeat
from proximity.transport import Publisher, open_publisher
from proximity.transport.publisher_clock import ForeignClock
from proximity.web.server.access import UnfitError

KINDS = {kind.magic: kind for kind in (POSES, PATH_POSES, MOVES, CHANGES)}
FARTHEST = 1e4
"""Maximum distance from the origin, m. No hand or part is farther."""
OLDEST_NS = 1_000_000_000
"""Maximum delay of a message. A longer one is due to a blocked connection or a suspended machine."""
SPREAD_NS = 1_000_000_000
"""Maximum difference between the instant of a pose and that at which it was sent."""


class HeldUpError(UnfitError):
    """Raised for messages that are so late that the page must connect again to restart its clock."""


class PageClock:
    """Clock of a page, whose offset from this machine's clock is given by the fastest message."""

    def __init__(self) -> None:
        self._clock = ForeignClock()

    def ahead_ns(self, sent_ns: int, now_ns: int) -> int | None:
        """Return the offset to add to instants of the page, or None until its clock is seen to advance."""
        self._clock.arrived(sent_ns, now_ns)
        ahead = now_ns - self._clock.theirs(now_ns)
        if now_ns - (sent_ns + ahead) > OLDEST_NS:
            raise HeldUpError("messages of this page are delayed by more than a second")
        return ahead if self._clock.is_certain else None


class PageInbox:
    """Passes messages of pages to the addresses of a service that are not None.

    *scene*: changed like the service's scene, to which it is equal initially. The addresses are closed at the
    end.
    """

    def __init__(
        self,
        poses: str | None,
        moves: str | None,
        changes: str | None,
        scene: Scene | None,
        count: int,
    ) -> None:
        self.may_pose = poses is not None
        self.may_move, self.may_hide = (scene is not None and each is not None for each in (moves, changes))
        self.count = count
        self._scene = scene
        self._poses, self._moves, self._changes = (
            None if each is None else open_publisher(each) for each in (poses, moves, changes)
        )
        self._initial = {} if scene is None else {part.name: part for part in scene.parts}
        self._gone = Message(POSES, count)
        self._gone.records["finger"] = np.arange(count)

    def receive(self, data: bytes, clock: PageClock, now_ns: int | None = None) -> bytes | None:
        """Validate and publish a message of a page.

        Return the message for other pages if it contains moves or changes, else None.
        """
        now_ns = time.monotonic_ns() if now_ns is None else now_ns
        array = np.frombuffer(data, np.uint8)
        kind = KINDS.get(int.from_bytes(data[:4], "little"))
        if kind is None:
            raise UnfitError("a page may send only poses, moves and changes")
        defect = validate(array, kind)
        if defect is not None:
            raise UnfitError(f"a message of {kind.name} is {defect.value}")
        header, records = parts_of(array, kind)
        if kind is CHANGES:
            message = self._changes_of(records)
            message.header["send_ns"] = now_ns
            self._publish(self._changes, message)
            return bytes(message.data)
        ahead = clock.ahead_ns(int(header["send_ns"]), now_ns)
        if not len(records) or ahead is None:
            return None
        off = np.abs(records["pose_ns"].astype(np.float64) - float(header["send_ns"]))
        if off.max() > SPREAD_NS:
            raise UnfitError("instants of poses are far from when they were sent")
        message = self._moves_of(records) if kind is MOVES else self._poses_of(kind, records)
        message.records["pose_ns"] += ahead
        message.header["send_ns"] = now_ns
        self._publish(self._moves if kind is MOVES else self._poses, message)
        return bytes(message.data) if kind is MOVES else None

    def release(self) -> None:
        """Report that no finger is tracked, because the page that sent poses has disconnected."""
        if self._poses is not None:
            self._gone.records["pose_ns"] = self._gone.header["send_ns"] = time.monotonic_ns()
            self._publish(self._poses, self._gone)

    def state(self) -> list[bytes]:
        """Return messages with the moved, hidden and shown parts, for a new page."""
        return [bytes(message.seal(0, 0)) for message in (self._where(), self._hidden()) if message]

    def resend(self) -> None:
        """Send moved, hidden and shown parts to a service that has restarted with the initial scene."""
        for publisher, message in ((self._moves, self._where()), (self._changes, self._hidden())):
            if message is not None:
                self._publish(publisher, message)

    def close(self) -> None:
        """Close the addresses."""
        for publisher in (self._poses, self._moves, self._changes):
            if publisher is not None:
                publisher.close()

    def _poses_of(self, kind: Kind, records: np.ndarray) -> Message:
        if not self.may_pose:
            raise UnfitError("this page may not feed poses: the scene file does not let it")
        if len(records) > self.count or int(records["finger"].max()) >= self.count:
            raise UnfitError(
                f"a pose is for a finger that does not exist, expected fingers 0 to {self.count - 1}"
            )
        numbers = [records["position"], records["velocity"]]
        numbers += [records["corners"]] if kind is PATH_POSES else []
        if any(_most(each) > FARTHEST for each in numbers):
            raise UnfitError("a pose is farther than 10 km from the origin")
        message = Message(kind, len(records))
        message.records[...] = records
        return message

    def _moves_of(self, records: np.ndarray) -> Message:
        if not self.may_move or self._scene is None:
            raise UnfitError("this page may not move parts: the scene file does not let it")
        if names_repeat(records):
            raise UnfitError("moves name the same parts again and again")
        names = self._known_names(records)
        message = Message(MOVES, len(records))
        message.records[...] = records
        for name, record in zip(names, message.records, strict=True):
            if not max(_most(record["translation"]), _most(record["velocity"])) <= FARTHEST:
                raise UnfitError(f"part {name!r} is moved farther than 10 km")
            try:
                pose = Pose(record["rotation"], record["translation"])
                self._scene.move(name, pose)
            except ProximityError as unfit:
                raise UnfitError(str(unfit)) from unfit
            record["rotation"] = pose.rotation
        return message

    def _changes_of(self, records: np.ndarray) -> Message:
        if not self.may_hide or self._scene is None:
            raise UnfitError("this page may not hide parts: the scene file does not let it")
        if not set(records["action"].tolist()) <= {PartAction.HIDE, PartAction.SHOW}:
            raise UnfitError("a page may only hide and show parts")
        message = Message(CHANGES, len(records))
        message.records[...] = records
        actions = map(PartAction, records["action"].tolist())
        carry_out(self._scene, tuple(zip(self._known_names(records), actions, strict=True)))
        return message

    def _known_names(self, records: np.ndarray) -> list[str]:
        names = [raw.decode("utf-8", "replace") for raw in records["name"].tolist()]
        unknown = [name for name in names if name not in self._initial]
        if unknown:
            raise UnfitError(f"unknown part {unknown[0]!r}")
        return names

    def _hidden(self) -> Message | None:
        changed = [part for part in self._parts() if part.is_hidden != self._initial[part.name].is_hidden]
        if not changed:
            return None
        message = Message(CHANGES, len(changed))
        message.header["send_ns"] = time.monotonic_ns()
        for record, part in zip(message.records, changed, strict=True):
            record["name"] = part.name.encode()
            record["action"] = PartAction.HIDE if part.is_hidden else PartAction.SHOW
        return message

    def _where(self) -> Message | None:
        moved = [
            part
            for part in self._parts()
            if not np.array_equal(part.pose.matrix, self._initial[part.name].pose.matrix)
        ]
        if not moved:
            return None
        message = Message(MOVES, len(moved))
        message.header["send_ns"] = message.records["pose_ns"] = time.monotonic_ns()
        for record, part in zip(message.records, moved, strict=True):
            record["name"] = part.name.encode()
            record["rotation"], record["translation"] = part.pose.rotation, part.pose.translation
        return message

    def _parts(self) -> tuple[Part, ...]:
        return () if self._scene is None else self._scene.parts

    def _publish(self, publisher: Publisher | None, message: Message) -> None:
        if publisher is not None:
            with contextlib.suppress(ProximityError):  # the service detects missing poses by their age
                publisher.publish(message)


def _most(numbers: np.ndarray) -> float:
    """Return the largest absolute value. Nan counts as 0, infinity as infinity."""
    return float(np.nan_to_num(np.abs(numbers), nan=0.0, posinf=np.inf).max(initial=0.0))
