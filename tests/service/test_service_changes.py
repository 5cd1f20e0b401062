"""Parts that messages hide, show, remove, add and deform while they are served."""

import os
import shutil
from queue import SimpleQueue
from types import SimpleNamespace

import numpy as np
import pytest
import shapes
from project import MESHES

from proximity.errors import SceneError
from proximity.message import ADDITIONS, CHANGES, DEFORMATIONS, Message, PartAction
from proximity.scene.scene import Scene
from proximity.scene.solid import Solid
from proximity.service import ChangesInput
from proximity.service.hosting import scene_changes
from proximity.service.hosting.scene_changes import NOT_ALLOWED, PartChanger, allowed_file


def scene(*names):
    return Scene([Solid(*shapes.cube(1.0, (3.0 * k, 0, 0)), name=name) for k, name in enumerate(names)])


def source():
    return ChangesInput("queue:", SimpleQueue())


def changes(*actions):
    message = Message(CHANGES, len(actions))
    for record, (name, action) in zip(message.records, actions, strict=True):
        record["name"], record["action"] = name.encode(), action
    return message


def named(name):
    """A message that hides the part with a name in bytes."""
    message = changes(("", PartAction.HIDE))
    message.records["name"] = name
    return message


def addition(name="lid", file="box.stl", **fields):
    message = Message(ADDITIONS, 1)
    message.records["name"], message.records["file"] = name.encode(), file.encode()
    message.records["rotation"] = np.eye(3)
    for field, value in fields.items():
        message.records[field] = value
    return message


def deformation(name, vertices):
    """A message that replaces all vertices of a part."""
    message = Message(DEFORMATIONS, -(-len(vertices) // 64))
    records = message.records
    records["name"], records["vertex_count"] = name.encode(), len(vertices)
    records["first"] = 64 * np.arange(len(records))
    for record in records:
        rows = vertices[record["first"] : record["first"] + 64]
        record["vertices"][: len(rows)] = rows
    return message


def hidden(scene):
    return [part.name for part in scene.parts if part.is_hidden]


def test_parts_are_hidden_and_shown(inlet):
    parts, changing = scene("a", "b"), source()
    inlet.put(changes(("a", PartAction.HIDE), ("b", PartAction.HIDE)))
    changing.apply(parts)
    assert hidden(parts) == ["a", "b"]

    inlet.put(changes(("b", PartAction.SHOW)))
    changing.apply(parts)

    assert hidden(parts) == ["a"]
    assert changing.notes == []


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (changes(("a", PartAction.HIDE), ("nobody", PartAction.HIDE)),
         "no part is named 'nobody'; the scene has 'a', 'b'"),
        (changes(("a", PartAction.HIDE), ("b", 7)), "action 7 is none, expected 0 to 3"),
        (named(b"\xff\xfe"), "b'\\xff\\xfe' is not UTF-8, expected a name in UTF-8"),
        (changes(("nobody", PartAction.REMOVE)), "no part is named 'nobody'; the scene has 'a', 'b'"),
        (deformation("nobody", np.zeros((8, 3))), "no part is named 'nobody'; the scene has 'a', 'b'"),
        (deformation("a", np.zeros((7, 3))), "vertices of part 'a' have shape (7, 3), expected (8, 3)"),
        (deformation("a", np.full((8, 3), np.nan)),
         "vertex 0 of part 'a' would be at (nan, nan, nan), expected finite coordinates"),
        (Message(DEFORMATIONS, 0), "the message has no records, expected one for each 64 vertices of a part"),
        (addition(name=""), "a part to add has no name, expected one"),
        (addition(rotation=2.0 * np.eye(3)), "part 'lid': a pose's rotation is not orthonormal"),
    ],
)  # fmt: skip
def test_message_that_cannot_be_used_is_refused_with_its_reason_and_changes_nothing(
    inlet, caplog, message, reason
):
    refused = []
    parts = scene("a", "b")
    changing = ChangesInput("queue:", SimpleQueue(), refuse=lambda *words: refused.append(words))
    epoch = parts.epoch
    inlet.put(message)
    inlet.put(message)

    changing.apply(parts)

    assert (hidden(parts), parts.epoch, changing.requests.empty()) == ([], epoch, True)
    (note,) = changing.notes
    assert note.startswith(f"queue:: 2 messages of {message.kind.name} were refused, first: {reason}")
    assert [(kind, words.startswith(reason)) for kind, words in refused] == [(message.kind.name, True)] * 2
    (said,) = [record.message for record in caplog.records]
    assert said.startswith(f"queue:: a message of {message.kind.name} is refused ({reason}")


@pytest.mark.parametrize("field", ["name", "first", "vertex_count"])
def test_deformation_whose_records_do_not_fit_together_is_refused(inlet, field):
    parts, changing = (
        Scene([Solid(*shapes.sphere(1.0, 2), name="a"), Solid(*shapes.cube(1.0), name="b")]),
        source(),
    )
    vertices = parts.part("a").solid.mesh.vertices
    message = deformation("a", vertices)
    assert len(message.records) > 1
    message.records[field][1] = b"b" if field == "name" else 65
    inlet.put(message)

    changing.apply(parts)

    (note,) = changing.notes
    assert (
        "the records are not those of one part in order: expected the name and vertex_count of part 'a' in"
        in note
    )
    np.testing.assert_array_equal(parts.part("a").solid.mesh.vertices, vertices)


def test_part_is_deformed_as_a_whole(inlet):
    parts, changing = Scene([Solid(*shapes.sphere(1.0, 2), name="ball")]), source()
    before = parts.part("ball").solid.mesh.vertices
    inlet.put(deformation("ball", 2.0 * before))

    changing.apply(parts)

    np.testing.assert_array_equal(parts.part("ball").solid.mesh.vertices, 2.0 * before)
    assert changing.notes == []


def test_description_is_asked_for(inlet):
    asked = []
    changing = ChangesInput("queue:", SimpleQueue(), lambda: asked.append(True))
    inlet.put(changes(("", PartAction.DESCRIBE)))

    changing.apply(scene("a"))

    assert (asked, changing.notes) == ([True], [])


def test_messages_behind_one_that_takes_long_wait_for_it(inlet):
    parts, changing = scene("a", "b"), source()
    inlet.put(changes(("a", PartAction.REMOVE)))
    inlet.put(changes(("b", PartAction.HIDE)))
    changing.apply(parts)
    changing.apply(parts)
    assert hidden(parts) == []

    request = changing.requests.get_nowait()
    assert request.actions == (("a", PartAction.REMOVE),)
    request.refusal, request.is_over = "it is needed", True
    changing.apply(parts)

    assert hidden(parts) == ["b"]
    assert changing.notes == ["queue:: 1 messages of changes were refused, first: it is needed"]


class FakeAnswers:
    """Contacts of a scene, passed on without delay."""

    def __init__(self, tracker, moves=None, changes=None):
        self.tracker, self.moves, self.changes, self.count = tracker, moves, changes, 1


@pytest.fixture
def changer(monkeypatch, tmp_path):
    """Apply requests to a scene of two parts; *served* is the published scene."""
    monkeypatch.setattr(scene_changes, "TrackedContacts", FakeAnswers)
    monkeypatch.setattr(
        scene_changes, "make_tracker", lambda settings, scene, count: SimpleNamespace(scene=scene)
    )
    service = SimpleNamespace(contact_source=FakeAnswers(SimpleNamespace(scene=scene("a", "b"))))
    service.replace = lambda source: setattr(service, "contact_source", source)
    folder = tmp_path / "parts"
    folder.mkdir()
    shutil.copy(MESHES / "box.stl", folder)
    shutil.copy(MESHES / "box.stl", tmp_path / "secret.stl")
    settings = SimpleNamespace(input=SimpleNamespace(parts_from=(str(folder),)))
    changer = PartChanger(service, lambda: settings)
    return SimpleNamespace(
        carry_out=changer.carry_out,
        folder=folder,
        settings=settings,
        served=lambda: service.contact_source.tracker.scene,
    )


def asked(inlet, message):
    """The request parsed from a message."""
    changing = source()
    inlet.put(message)
    changing.apply(scene("a", "b"))
    return changing.requests.get_nowait()


def names(scene):
    return [part.name for part in scene.parts]


def test_part_is_removed_from_a_copy(changer, inlet):
    before = changer.served()
    request = asked(inlet, changes(("b", PartAction.HIDE), ("a", PartAction.REMOVE)))
    changer.carry_out(request)

    assert (request.is_over, request.refusal) == (True, "")
    assert (names(before), names(changer.served())) == (["a", "b"], ["b"])
    assert (hidden(before), hidden(changer.served())) == ([], ["b"])


def test_last_part_stays_and_nothing_of_its_message_is_done(changer, inlet):
    before = changer.served()
    request = asked(inlet, changes(("a", PartAction.REMOVE), ("b", PartAction.REMOVE)))
    changer.carry_out(request)

    assert request.refusal == "part 'b' is the only one and cannot be removed: hide it instead"
    assert changer.served() is before
    assert names(before) == ["a", "b"]


def test_part_is_added_where_the_message_puts_it(changer, inlet):
    request = asked(inlet, addition(translation=(1.0, 2.0, 3.0), units=b"m"))
    changer.carry_out(request)

    assert (request.refusal, names(changer.served())) == ("", ["a", "b", "lid"])
    assert changer.served().part("lid").pose.translation.tolist() == [1.0, 2.0, 3.0]


@pytest.mark.parametrize(
    ("file", "reason"),
    [
        ("../secret.stl", "the file to add, '../secret.stl', is outside of input.parts_from"),
        ("link.stl", "the file to add, 'link.stl', is outside of input.parts_from"),
        ("none.stl", "the file to add, 'none.stl', is not in input.parts_from"),
        (".", "the file to add, '.', is outside of input.parts_from"),
        ("", "the file to add is '', expected a name relative to input.parts_from"),
        ("/etc/passwd", "the file to add is '/etc/passwd', expected a name relative to input.parts_from"),
    ],
)
def test_file_elsewhere_is_not_read(changer, inlet, file, reason):
    os.symlink(changer.folder.parent / "secret.stl", changer.folder / "link.stl")
    request = asked(inlet, addition(file=file))
    changer.carry_out(request)

    assert (request.is_over, request.refusal) == (True, reason)
    assert names(changer.served()) == ["a", "b"]


def test_second_folder_is_looked_into(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
    (tmp_path / "two" / "x.stl").write_bytes(b"")

    path = allowed_file("x.stl", [str(tmp_path / "one"), str(tmp_path / "two")])

    assert path == str((tmp_path / "two" / "x.stl").resolve())


def test_nothing_is_added_unless_the_scene_file_allows_it():
    with pytest.raises(SceneError) as refused:
        allowed_file("box.stl", ())
    assert str(refused.value) == NOT_ALLOWED


def test_name_that_is_taken_and_file_that_is_none_are_refused(changer, inlet):
    (changer.folder / "bad.stl").write_bytes(b"no mesh")
    taken, broken = asked(inlet, addition(name="a")), asked(inlet, addition(file="bad.stl"))
    changer.carry_out(taken)
    changer.carry_out(broken)

    assert taken.refusal == "a part is named 'a' already, expected another name"
    assert "bad.stl" in broken.refusal
    assert names(changer.served()) == ["a", "b"]
