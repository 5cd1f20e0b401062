"""Inputs of a service besides poses: paths of fingers, and motions of parts.

Both make a tick dearer. A scene file says whether they may come; then there are motions with them as well: a
path through each fingertip wherever it is, and all parts swaying a little, so that fingers stay at the worst
places.
"""

import copy
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from proximity.lab.certificate.subject import Subject
from proximity.message import MAX_RECORDS, MOVES, Message
from proximity.scene.scene import Scene
from proximity.service import FingerPoses, MovesInput, RecordingInput, TrackedContacts
from proximity.service.inputs.gloves import points_on
from proximity.service.inputs.part_prediction import Carried, ReportedMotion, VisibleParts
from proximity.transport import open_publisher

MOVES_PERIOD_NS = 16_666_667
"""Between two moves of a part: 60 Hz, as a simulation or a renderer tells them."""
SWAY, BEAT, TURN_RATE = 0.001, 10.0, 0.01
"""m, rad/s and rad/s: how far parts sway, how fast, and how fast they turn meanwhile."""
MOST_BENT = 0.5
"""Of fingers at the worst positions: most of their paths lies before them, and is looked along."""
NAME_SIZE = MOVES.record["name"].itemsize
MOVES_ADDRESS = "mailbox:proximity-certificate/moves"


class Paths:
    """A path for each finger, through wherever its tip is.

    *corners*: (M, K, 3) m; of fingers, in their frames; given to the fingers in turn. *rng*: decides how each
    finger is turned, and how far it is bent.
    """

    def __init__(self, corners: np.ndarray, fingers: int, rng: np.random.Generator) -> None:
        own = corners[np.arange(fingers) % len(corners)]
        turns, _ = np.linalg.qr(rng.normal(size=(fingers, 3, 3)))
        turns *= np.linalg.det(turns)[:, None, None]  # no mirrors
        self.bends = rng.uniform(0.0, MOST_BENT, fingers)
        paths = np.einsum("fij,fkj->fki", turns, own)
        self._around = paths - points_on(paths, self.bends)[:, None]

    def at(self, tips: np.ndarray) -> np.ndarray:
        """Return the paths through fingertips (N, 3), (N, K, 3), m."""
        return tips[:, None] + self._around


class SwayingParts:
    """All parts of a scene that moves can name, as they sway about where they are."""

    def __init__(self, scene: Scene, period_ns: int) -> None:
        fit = [part for part in scene.parts if len(part.name.encode()) <= NAME_SIZE][:MAX_RECORDS]
        self._scene, self._period_ns = scene, period_ns
        self._names = [part.name for part in fit]
        self._matrices = np.array([part.pose.matrix for part in fit]).reshape(-1, 4, 4)
        self._visible = VisibleParts(scene)
        self._carried: Carried | None = None
        self._shown = -1

    def report_due(self, tick: int) -> None:
        """Have moves reported where they are due; not what a tick takes."""
        number = tick * self._period_ns // MOVES_PERIOD_NS
        if number != self._shown or self._carried is None:
            self._shown = number
            self._carried = Carried(self.moves(number * MOVES_PERIOD_NS), set(), self._visible)

    def move(self, tick: int) -> None:
        """Put the parts where they are at a tick."""
        assert self._carried is not None
        positions = self._carried.at(tick * self._period_ns)
        assert positions is not None
        self._scene.move_many(self._carried.names, *positions)

    def moves(self, now_ns: int) -> dict[str, ReportedMotion]:
        """Return where the parts are at an instant, and how fast they go."""
        phase = BEAT * 1e-9 * now_ns
        shift, velocity = np.zeros(3), np.zeros(3)
        shift[2], velocity[2] = SWAY * math.sin(phase), SWAY * BEAT * math.cos(phase)
        turning = np.array([0.0, 0.0, TURN_RATE])
        matrices = self._matrices.copy()
        matrices[:, :3, 3] += shift
        return {
            name: ReportedMotion(matrix, velocity, turning, now_ns)
            for name, matrix in zip(self._names, matrices, strict=True)
        }


class FedInput:
    """A recording whose poses come with paths, and with moves of parts, as a service takes them."""

    def __init__(self, hand: RecordingInput, paths: Paths | None, parts: SwayingParts | None) -> None:
        self._hand, self._paths, self._parts = hand, paths, parts
        self._publisher = None if parts is None else open_publisher(MOVES_ADDRESS)
        self._message: Message | None = None
        self._sent_ns = -MOVES_PERIOD_NS
        self.address = hand.address
        self.is_over = False  # the recording begins anew

    @property
    def notes(self) -> list[str]:
        """Notes on the recording."""
        return self._hand.notes

    def poll(self, now_ns: int) -> Iterator[FingerPoses]:
        """Give the newest poses, where there are others than at the poll before."""
        if self._parts is not None and now_ns - self._sent_ns >= MOVES_PERIOD_NS:
            self._sent_ns = now_ns
            self._send(self._parts.moves(now_ns), now_ns)
        for poses in self._hand.poll(now_ns):
            if self._paths is not None:
                poses.paths, poses.bends = self._paths.at(poses.positions), self._paths.bends
            yield poses

    def close(self) -> None:
        """Close the recording and the address of moves."""
        self._hand.close()
        if self._publisher is not None:
            self._publisher.close()

    def _send(self, moves: dict[str, ReportedMotion], now_ns: int) -> None:
        assert self._publisher is not None
        if self._message is None:
            self._message = Message(MOVES, len(moves))
            self._message.records["name"] = [name.encode() for name in moves]
        header, records = self._message.header, self._message.records
        header["send_ns"] = records["pose_ns"] = now_ns
        matrices = np.array([motion.matrix for motion in moves.values()])
        records["rotation"], records["translation"] = matrices[:, :3, :3], matrices[:, :3, 3]
        records["velocity"] = [motion.velocity for motion in moves.values()]
        records["angular_velocity"] = [motion.turning for motion in moves.values()]
        self._publisher.publish(self._message)


def with_own_scene(subject: Subject) -> Subject:
    """Return the subject with parts that may be moved, and nobody else's are."""
    return replace(subject, scene=copy.copy(subject.scene)) if subject.moves else subject


def fed_service_input(
    subject: Subject, hand: RecordingInput, rng: np.random.Generator
) -> tuple[TrackedContacts, FedInput]:
    """Build the contact source and pose input of a service under test."""
    paths = None if subject.corners is None else Paths(subject.corners, subject.fingers, rng)
    parts, moves = None, None
    if subject.moves:
        parts = SwayingParts(subject.scene, round(1e9 * subject.period))
        moves = MovesInput(MOVES_ADDRESS)
    return TrackedContacts(subject.tracker(), moves), FedInput(hand, paths, parts)
