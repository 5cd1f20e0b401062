"""The description of a service: when its messages are sent, and the subscriber's result."""

import numpy as np
import pytest
from fake_service import (
    FakeAnswers,
    KeepingOutlet,
    ManualClock,
    ScriptedInput,
    publisher,
    serve,
    steady,
)
from wire import Reader, frame

from proximity.message import DESCRIPTION, FRAME, Defect, Message, parts_of
from proximity.message.description import encoded_name
from proximity.service import Describer, Service


def labels(count, hidden=()):
    names = tuple(f"part {row}" for row in range(count))
    return lambda: (names, np.isin(np.arange(count), hidden))


def read_by(reader, describer, count, *, epoch=0, hidden=(), now=0):
    """Deliver all due messages; return their number."""
    number = 0
    while (message := describer.message(epoch, now, labels(count, hidden))) is not None:
        reader.send(message)
        reader.read()
        number += 1
    return number


@pytest.mark.parametrize(("count", "messages"), [(0, 1), (3, 1), (62, 1), (63, 2), (64, 2), (200, 4)])
def test_names_come_over_several_messages(count, messages):
    reader, describer = Reader(), Describer(["thumb", "index"], [0.007, 0.008])
    reader.send(frame())
    reader.read()

    assert read_by(reader, describer, count, hidden=(1,)) == messages

    subscriber = reader.subscriber
    assert subscriber.part_names == tuple(f"part {row}" for row in range(count))
    assert subscriber.finger_names == ("thumb", "index")
    assert subscriber.description.hidden_parts == (("part 1",) if count else ())
    assert subscriber.description.finger_radii == (0.007, 0.008)
    assert (subscriber.counts.received, subscriber.counts.unused) == (1, 0)


def test_names_are_empty_until_known_and_when_the_epoch_changes():
    reader, describer = Reader(), Describer(["thumb"], [0.007])
    assert (reader.subscriber.part_names, reader.subscriber.finger_names) == ((), ())
    reader.send(frame())
    reader.read()
    read_by(reader, describer, 2)
    assert reader.subscriber.part_names == ("part 0", "part 1")

    changed = frame()
    changed.header["epoch"] = 1
    reader.send(changed)
    reader.read()
    assert (reader.subscriber.part_names, reader.subscriber.finger_names) == ((), ("thumb",))

    read_by(reader, describer, 3, epoch=1)
    assert reader.subscriber.part_names == ("part 0", "part 1", "part 2")


@pytest.mark.parametrize(("part_count", "apart_ns"), [(1, 100_000_000), (100, 200_000_000), (2000, 10**9)])
def test_description_comes_again_for_readers_that_begin_later(part_count, apart_ns):
    describer = Describer(["thumb"], [0.007])
    tick_ns, epoch, begins = 20_000_000, 1, []
    for now in range(0, 2 * apart_ns + 1, tick_ns):
        message = describer.message(epoch, now, labels(part_count))
        if message is not None and message.header["first"] == 0:
            begins.append(now)
    assert begins == [0, apart_ns, 2 * apart_ns]


def test_description_comes_every_tenth_of_a_tenth_and_when_it_is_asked_for():
    describer, tenth = Describer(["thumb"], [0.007]), 100_000_000
    is_due = [describer.message(0, now, labels(1)) is not None for now in (0, 1, tenth - 1, tenth, tenth + 1)]
    assert is_due == [True, False, False, True, False]

    describer.ask()

    assert describer.message(0, tenth + 2, labels(1)) is not None
    assert describer.message(0, tenth + 3, labels(1)) is None


@pytest.mark.parametrize(("first", "part_count"), [(1, 0), (0, 2**31), (2**32 - 1, 0)])
def test_description_that_contradicts_itself_is_dropped(first, part_count):
    reader, message = Reader(), Message(DESCRIPTION, 1)
    message.header["first"], message.header["part_count"], message.header["finger_count"] = (
        first,
        part_count,
        1,
    )
    reader.send(message)
    reader.read()

    assert reader.subscriber.description is None
    assert reader.flawed == {Defect.CONTENT: 1}


def test_refusals_come_with_the_description():
    reader, describer = Reader(), Describer(["thumb"], [0.007])
    read_by(reader, describer, 1, epoch=0)
    assert (reader.subscriber.description.refused, reader.subscriber.description.refusal) == (0, "")

    describer.refuse("additions", "there is no file 'lid.stl'")
    describer.refuse("moves", "é" * 200, 3)
    describer.ask()
    read_by(reader, describer, 1, epoch=0)

    assert reader.subscriber.description.refused == 4
    assert reader.subscriber.description.refusal == "moves: " + "é" * 92


def test_long_name_is_cut_between_two_characters():
    assert encoded_name("lid") == b"lid"
    assert encoded_name("é" * 40) == ("é" * 32).encode()
    assert encoded_name("x" + "é" * 40) == ("x" + "é" * 31).encode()


def test_service_publishes_it_behind_the_first_frame():
    answers = FakeAnswers()
    answers.labels = labels(2)
    _, outlet, _, _ = serve(answers=answers, describer=Describer(["thumb", "index"], [0.007] * 2), ticks=3)

    kinds = [int(data[:4].view("<u4")[0]) for data in outlet.sent]
    assert kinds[:4] == [FRAME.magic, DESCRIPTION.magic, FRAME.magic, FRAME.magic]
    header, records = parts_of(outlet.sent[1], DESCRIPTION)
    assert (int(header["part_count"]), int(header["finger_count"])) == (2, 2)
    assert records["name"].tolist() == [b"part 0", b"part 1", b"thumb", b"index"]


def test_description_that_is_not_published_is_noted():
    answers = FakeAnswers()
    answers.labels = labels(2)
    outlet = KeepingOutlet(refused={1})
    service = Service(
        answers,
        ScriptedInput(steady),
        [publisher(outlet)],
        period=0.001,
        clock=ManualClock(),
        describer=Describer(["thumb", "index"], [0.007] * 2),
    )

    report = service.run(tick_count=3)

    assert report.publish_failures == {"keeping:": 0}
    assert report.notes == [
        "keeping:: names of parts and fingers were not published, first: keeping: no room"
    ]
