"""Calls that the gate compares with the yardstick; their answers are compared first."""

import threading
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import proximity
from benchmarks.gate import yardstick
from benchmarks.queries import cases
from benchmarks.ticks import motions, scenes

RING = (160, 70)  # 22,400 faces fit the second-level cache, so that other programs matter little
POINTS, RAYS, SEGMENTS, HANDS, TICKS, FRAMES = 1000, 1000, 250, 50, 100, 200
SEGMENT_LENGTH = 0.05  # of the diagonal
TOLERANCE = 1e-12  # of the diagonal: both compute in float64


class AnswerError(Exception):
    """Answers of this package and of the yardstick differ, so that times are meaningless."""


@dataclass(frozen=True, slots=True, eq=False)
class GateCase:
    """One call of this package, and the yardstick's; each does the same work every time."""

    name: str
    ours: Callable[[], Any]
    theirs: Callable[[], Any]


def make_cases() -> list[GateCase]:
    """Make all cases, and compare their answers.

    Raises
    ------
    AnswerError
        If this package and the yardstick differ; the message names the case and the difference.
    """
    vertices, faces = scenes.freeform(RING)
    scene, plain = proximity.Scene.from_mesh(vertices, faces), yardstick.build(vertices, faces)
    near, rays = (_case(pattern, vertices, faces) for pattern in ("near", "rays"))
    return [
        *_point_cases(scene, plain, near),
        _ray_case(scene, plain, rays),
        _segment_case(scene, plain, near),
        _build_case(vertices, faces),
        *_hand_cases(scene, plain, near),
        _publish_case(),
    ]


def _case(pattern, vertices, faces):
    points, directions = cases.PATTERNS[pattern](vertices, faces, POINTS, np.random.default_rng(6))
    return cases.Case(f"ring/{pattern}", vertices, faces, points, directions)


def _point_cases(scene, plain, case):
    points, distances = case.points, plain.distance(case.points)
    _compare("points-unsigned", case, scene.distance(points), distances)
    _compare("points-signed", case, np.abs(scene.signed_distance(points)), distances)
    theirs = partial(plain.distance, points)
    return (
        GateCase("points-unsigned", partial(scene.distance, points), theirs),
        GateCase("points-signed", partial(scene.signed_distance, points), theirs),
    )


def _ray_case(scene, plain, case):
    origins, directions = case.points[:RAYS], case.directions[:RAYS]
    _compare("rays", case, scene.cast(origins, directions).distance, plain.cast(origins, directions))
    return GateCase(
        "rays", partial(scene.cast, origins, directions), partial(plain.cast, origins, directions)
    )


def _segment_case(scene, plain, case):
    """The yardstick answers for both ends of each segment; segments of length zero are compared as points."""
    starts = case.points[:SEGMENTS]
    directions = np.random.default_rng(7).normal(size=starts.shape)
    ends = starts + SEGMENT_LENGTH * case.diagonal * directions / np.linalg.norm(directions, axis=1)[:, None]
    _compare("segments", case, scene.closest_to_segments(starts, starts).distance, plain.distance(starts))
    both = np.concatenate([starts, ends])
    return GateCase(
        "segments", partial(scene.closest_to_segments, starts, ends), partial(plain.distance, both)
    )


def _build_case(vertices, faces):
    return GateCase(
        "build",
        partial(proximity.Scene.from_mesh, vertices, faces),
        partial(yardstick.build, vertices, faces),
    )


def _hand_cases(scene, plain, case):
    """Five points in one call, and the five fingers of the generated hand, tick by tick."""
    fives = [case.points[5 * k : 5 * k + 5].copy() for k in range(HANDS)]
    positions = motions.ticks_of(next(motions.hands()), scene)
    positions = positions[~np.isnan(positions).any(axis=(1, 2))][:TICKS]
    hand = _Hand(scene, positions)
    found = [hand.tick(tips)["signed_distance"] + scenes.RADIUS for tips in positions]
    _compare("tick", case, np.abs(found), [plain.distance(tips) for tips in positions])
    return (
        GateCase("call-of-five", _each(scene.signed_distance, fives), _each(plain.distance, fives)),
        GateCase("tick", _each(hand.tick, hand.there_and_back), _each(plain.distance, hand.there_and_back)),
    )


class _Hand:
    """A tracker with a clock that counts ticks."""

    def __init__(self, scene, positions):
        self._tracker, self._now_ns = proximity.Tracker(scene, radius=scenes.RADIUS), 0
        self._pose_ns = np.zeros(len(self._tracker.contacts), np.int64)
        self.there_and_back = [*positions, *positions[::-1]]

    def tick(self, tips):
        self._now_ns += scenes.PERIOD_NS
        self._pose_ns.fill(self._now_ns)
        return self._tracker.advance(tips, self._pose_ns, self._now_ns + scenes.PERIOD_NS)


def _publish_case():
    """A frame of five fingers into a mailbox, against its checksum and its copy done by hand."""
    message = proximity.Message(proximity.FRAME, 5)
    publisher = proximity.open_publisher("mailbox:gate")
    data, mailbox = message.data.copy(), np.zeros_like(message.data)
    number, checked, changed = data[16:32].view("<u8"), data[8:], threading.Condition()

    def by_hand(k):
        number[1] = k
        data[4:8].view("<u4")[0] = zlib.crc32(checked.data)
        with changed:
            mailbox[: len(data)] = data
            changed.notify_all()

    return GateCase(
        "publish-mailbox", _each(publisher.publish, [message] * FRAMES), _each(by_hand, range(FRAMES))
    )


def _each(call, arguments):
    """Return a call that makes each query in turn."""

    def run():
        for argument in arguments:
            call(argument)

    return run


def _compare(name, case, ours, theirs):
    ours, theirs = np.asarray(ours), np.asarray(theirs)
    is_off = ~(ours == theirs)
    is_off[is_off] = ~(np.abs(ours[is_off] - theirs[is_off]) <= TOLERANCE * case.diagonal)
    if is_off.any():
        k = int(np.argmax(is_off))
        raise AnswerError(
            f"{name}: {is_off.sum()} of {is_off.size} answers differ from the yardstick's; "
            f"the first is {ours.flat[k]!r}, expected {theirs.flat[k]!r}"
        )
