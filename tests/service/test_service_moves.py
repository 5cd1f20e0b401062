"""Parts moved by messages while they are served."""

import numpy as np
import pytest
import shapes
from fake_service import SteppedLoop, hands_at

from proximity.message import MOVES, Message
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.service import MovesInput, TrackedContacts
from proximity.tracker.tracker import Tracker

NOW = 5_000_000_000  # ns
MS = 1_000_000


def scene(*names):
    return Scene([Solid(*shapes.cube(1.0, (3.0 * k, 0, 0)), name=name) for k, name in enumerate(names)])


def moves(**translations):
    """A message that translates parts; tests change its other fields."""
    message = Message(MOVES, len(translations))
    message.records["pose_ns"] = NOW
    message.records["name"] = [name.encode() for name in translations]
    message.records["rotation"] = np.eye(3)
    message.records["translation"] = list(translations.values())
    return message


def stepped(parts, source):
    """A loop with one finger and parts moved by the source."""
    return SteppedLoop(TrackedContacts(Tracker(parts, fingers=1, radius=0.0), source), NOW)


def places(scene):
    return {part.name: part.pose.translation.tolist() for part in scene.parts}


def test_parts_are_moved_and_told_how_fast(inlet):
    parts, source = scene("a", "b"), MovesInput("queue:")
    message = moves(b=(0, 0, 1), a=(0, 2, 0))
    message.records["rotation"][0] = shapes.rotation(3)
    message.records["velocity"] = [(1, 2, 3), (np.nan, 0, 0)]
    message.records["angular_velocity"] = [(4, 5, 6), (0, np.nan, 0)]
    inlet.put(message)

    source.take(parts, NOW)

    assert places(parts) == {"a": [0, 2, 0], "b": [0, 0, 1]}
    np.testing.assert_allclose(parts.part("b").pose.rotation, shapes.rotation(3), atol=1e-15)
    assert parts.part("b").velocity.tolist() == [1, 2, 3]
    assert parts.part("b").angular_velocity.tolist() == [4, 5, 6]
    assert parts.part("a").velocity.tolist() == [0, 0, 0]  # unknown: at rest
    assert source.notes == []


def test_messages_are_applied_in_order(inlet):
    parts, source = scene("a", "b"), MovesInput("queue:")
    inlet.put(moves(a=(1, 0, 0), b=(2, 0, 0)))
    inlet.put(moves(a=(3, 0, 0)))

    source.take(parts, NOW)

    assert places(parts) == {"a": [3, 0, 0], "b": [2, 0, 0]}


BROKEN = {  # invalid field and value of the middle part, and the reason
    "unknown": ("name", b"nobody", "no part is named 'nobody'; the scene has 'a', 'b', 'c'"),
    "no text": ("name", b"\xff\xfe", "no part is named"),
    "scaled": ("rotation", 2.0 * np.eye(3), "part 'b': a pose's rotation is not orthonormal"),
    "nan rotation": ("rotation", np.nan, "part 'b': a pose's rotation is not finite"),
    "velocity": ("velocity", np.inf, "velocity of part 'b' is"),
}


def broken(what):
    """A message whose middle part cannot be moved."""
    message = moves(a=(1, 0, 0), b=(2, 0, 0), c=(3, 0, 0))
    field, value, _ = BROKEN[what]
    message.records[field][1] = value
    return message


@pytest.mark.parametrize("what", BROKEN)
def test_part_that_cannot_be_moved_is_counted_and_the_others_move(inlet, caplog, what):
    parts, source = scene("a", "b", "c"), MovesInput("queue:")
    inlet.put(broken(what))
    inlet.put(broken(what))

    source.take(parts, NOW)

    assert places(parts) == {"a": [1, 0, 0], "b": [0, 0, 0], "c": [3, 0, 0]}
    assert source.notes == ["queue:: 2 moves of parts that are invalid"]
    (said,) = [record.message for record in caplog.records]
    assert said.startswith(f"queue:: moves of parts that are invalid are not used ({BROKEN[what][2]}")


def test_part_that_is_named_twice_goes_where_it_is_told_last(inlet):
    parts, source = scene("a", "b", "c"), MovesInput("queue:")
    message = moves(a=(9, 0, 0), b=(1, 0, 0), c=(3, 0, 0))
    message.records["name"][1] = b"a"
    inlet.put(message)

    source.take(parts, NOW)

    assert places(parts) == {"a": [1, 0, 0], "b": [0, 0, 0], "c": [3, 0, 0]}
    assert source.notes == []


def test_moves_that_are_refused_are_reported_with_the_reason(inlet):
    refused = []
    parts, source = scene("a"), MovesInput("queue:", refuse=lambda *words: refused.append(words))
    inlet.put(moves(a=(1, 0, 0), nobody=(1, 0, 0)))

    source.take(parts, NOW)

    assert refused == [("moves", "no part is named 'nobody'; the scene has 'a'", 1)]


def test_message_that_names_one_part_300_times_is_refused_at_once(inlet, caplog):
    parts, source = scene("a", "b"), MovesInput("queue:")
    for _ in range(2):
        flood = Message(MOVES, 300)
        flood.records["name"], flood.records["translation"] = b"a", (1, 0, 0)
        flood.records["pose_ns"] = NOW
        inlet.put(flood)
    inlet.put(moves(b=(2, 0, 0)))

    source.take(parts, NOW)

    assert places(parts) == {"a": [0, 0, 0], "b": [2, 0, 0]}
    assert source.notes == ["queue:: 2 messages of moves that repeat parts"]
    (said,) = caplog.messages
    assert said.endswith("that repeat parts are not used (300 moves, expected one for each part)")


def test_move_without_a_translation_is_refused_and_one_without_the_rest_only_shifts(inlet):
    """Records once began as zeros: a part without a translation moved to the origin."""
    parts, source = scene("a", "b"), MovesInput("queue:")
    inlet.put(moves(a=(1, 0, 0), b=(2, 0, 0)))
    source.take(parts, NOW)
    message = Message(MOVES, 2)
    message.records["name"], message.records["pose_ns"] = [b"a", b"b"], NOW
    message.records["translation"][1] = (3, 0, 0)
    inlet.put(message)

    source.take(parts, NOW)

    assert places(parts) == {"a": [1, 0, 0], "b": [3, 0, 0]}
    assert parts.part("b").pose.rotation.tolist() == np.eye(3).tolist() and not parts.part("b").velocity.any()
    assert source.notes == ["queue:: 1 moves of parts that are invalid"]


def test_rotations_in_single_precision_are_made_exact(inlet):
    """Rotations of game engines are off by 1e-7; scenes accept 1e-9."""
    parts, source = scene("a"), MovesInput("queue:")
    message = moves(a=(0, 0, 0))
    message.records["rotation"] = shapes.rotation(5).astype(np.float32)
    inlet.put(message)

    source.take(parts, NOW)

    assert source.notes == []
    rotation = parts.part("a").pose.rotation
    np.testing.assert_allclose(rotation, shapes.rotation(5), atol=1e-6)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


def test_edited_scene_gets_all_that_was_told_before(inlet):
    source, before, after = MovesInput("queue:"), scene("a", "b", "c"), scene("c", "d", "a")
    inlet.put(moves(a=(1, 0, 0), b=(2, 0, 0)))
    inlet.put(broken("unknown"))
    source.take(before, NOW)

    source.take(after, NOW)
    assert places(after) == {"a": [1, 0, 0], "c": [3, 0, 0], "d": [0, 0, 0]}

    inlet.put(moves(d=(4, 0, 0)))
    source.take(after, NOW)
    assert places(after)["d"] == [4, 0, 0]


def test_tick_sees_the_moves_that_have_arrived(inlet):
    loop = stepped(scene("a"), MovesInput("queue:"))  # a cube about the origin
    answers = loop.service.contact_source

    first = loop.tick(NOW, hands_at([(0, 0, 2)], NOW))["signed_distance"][0]
    inlet.put(moves(a=(0, 0, 1)))
    second = loop.tick(NOW, hands_at([(0, 0, 2)], NOW))["signed_distance"][0]

    assert first - second == pytest.approx(1.0, abs=1e-12)
    answers.close()
    assert inlet.is_closed and answers.notes == []


def moving(pose_ns=NOW, speed=0.5):
    """A message of a moving part *a* and a part *b* at rest."""
    message = moves(a=(1, 0, 0), b=(2, 0, 0))
    message.records["pose_ns"] = pose_ns
    message.records["velocity"][0] = (speed, 0, 0)
    return message


def test_part_of_which_nothing_more_is_told_is_not_believed_to_go_on(inlet):
    source = MovesInput("queue:")
    loop = stepped(scene("a", "b"), source)
    inlet.put(moving())

    loop.tick(NOW)
    loop.tick(NOW + 100 * MS - 1)
    assert loop.part("a")["velocity"].tolist() == [0.5, 0, 0] and source.notes == [] and not loop.is_late

    loop.tick(NOW + 100 * MS)
    assert loop.part("a")["velocity"].tolist() == [0, 0, 0]
    where = [loop.part(name)["translation"].tolist() for name in "ab"]
    assert where == [[1.05, 0, 0], [2, 0, 0]]  # its last pose within the time limit
    assert source.notes == ["queue:: 1 parts stood still: no move for 100 ms"]
    assert loop.is_late

    loop.tick(NOW + 300 * MS)
    assert [loop.part(name)["translation"].tolist() for name in "ab"] == where
    assert len(source.notes) == 1 and ": 1 " in source.notes[0]  # reported once

    inlet.put(moving(pose_ns=NOW + 310 * MS, speed=0.0))
    loop.tick(NOW + 310 * MS)
    assert not loop.is_late and loop.part("a")["translation"].tolist() == [1, 0, 0]


def test_velocity_lasts_from_the_pose_on_and_not_from_when_it_came(inlet):
    loop = stepped(scene("a", "b"), MovesInput("queue:"))
    inlet.put(moving(pose_ns=NOW - 90 * MS))
    loop.tick(NOW)
    loop.tick(NOW + 10 * MS - 1)
    assert loop.part("a")["velocity"].any()

    loop.tick(NOW + 10 * MS)
    assert not loop.part("a")["velocity"].any() and loop.is_late


@pytest.mark.parametrize(
    ("pose_ns", "refused", "note"),
    [
        (NOW + 5 * MS + 1, (1, 0, 0), "moves from the future"),
        (NOW - 1, (0, 1, 0), "moves older than the one before"),
    ],
)
def test_move_of_an_instant_that_cannot_be_is_left_out_and_counted(inlet, pose_ns, refused, note):
    parts, source = scene("a", "b"), MovesInput("queue:", clock=lambda: NOW)
    answers = TrackedContacts(Tracker(parts, fingers=1), source)
    inlet.put(moves(a=(0, 0, 1), b=(0, 0, 2)))
    source.take(parts, NOW)
    message = moves(b=(0, 0, 9), a=(0, 0, 3))
    message.records["pose_ns"] = [pose_ns, NOW]
    message.records["velocity"] = [(1, 0, 0), (0, 0, 0)]
    inlet.put(message)

    source.take(parts, NOW)

    assert places(parts) == {"a": [0, 0, 3], "b": [0, 0, 2]} and not parts.part("b").velocity.any()
    assert answers.refused == refused and answers.notes == [f"queue:: 1 {note}"]


def test_part_with_a_name_of_64_bytes_is_moved(inlet):
    """The guide stated 63."""
    name = "x" * 64
    parts, source = scene(name), MovesInput("queue:")
    inlet.put(moves(**{name: (0, 0, 1)}))

    source.take(parts, NOW)

    assert places(parts) == {name: [0, 0, 1]}


def test_first_move_of_a_part_is_worth_nothing_when_it_is_old(inlet):
    parts, source = scene("a", "b"), MovesInput("queue:", stale_after=0.05)
    inlet.put(moving(pose_ns=NOW - 50 * MS - 1))
    source.take(parts, NOW)
    assert places(parts) == {"a": [0, 0, 0], "b": [0, 0, 0]}
    assert not (parts.part("a").velocity.any() or source.reported())
    assert source.notes == ["queue:: 2 moves older than 50 ms"]

    inlet.put(moving(pose_ns=NOW - 50 * MS, speed=0.0))
    source.take(parts, NOW)
    assert places(parts) == {"a": [1, 0, 0], "b": [2, 0, 0]}


def test_move_that_came_while_the_system_kept_the_tick_from_running_is_not_from_the_future(inlet):
    parts, source = scene("a", "b"), MovesInput("queue:", clock=lambda: NOW + 30 * MS)
    inlet.put(moving(pose_ns=NOW + 30 * MS))

    source.take(parts, NOW)

    assert source.future == 0 and parts.part("a").velocity.any()


def test_instants_of_ticks_that_skip_ahead_are_those_of_moves_as_well(inlet):
    hour = 3_600_000 * MS
    source = MovesInput("queue:", clock=lambda: NOW, skipped=lambda: hour)
    loop = stepped(scene("a", "b"), source)
    inlet.put(moving())

    loop.tick(NOW + hour + 20 * MS)

    assert loop.part("a")["translation"].tolist() == [1.01, 0, 0] and source.notes == []


def test_edited_scene_is_not_told_a_velocity_that_has_ended(inlet):
    source = MovesInput("queue:")
    loop = stepped(scene("a", "b"), source)
    inlet.put(moving())
    loop.tick(NOW)
    loop.service.replace(TrackedContacts(Tracker(scene("b"), fingers=1), source))
    loop.tick(NOW + 200 * MS)  # a has been removed
    assert not loop.is_late

    loop.service.replace(TrackedContacts(Tracker(scene("a", "b"), fingers=1), source))
    loop.tick(NOW + 300 * MS)

    assert not loop.part("a")["velocity"].any()
    assert [loop.part(name)["translation"].tolist() for name in "ab"] == [[1.05, 0, 0], [2, 0, 0]]
    assert loop.is_late and len(source.notes) == 1
