"""Guided pages: steps go to pages and answers come back, checked; pages leave, watch and stop."""

import contextlib
import json
import socket
import sys
import threading
import time

import pytest
from guided_client import PATIENCE, Client
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from proximity.errors import MissingLibraryError, ServiceError
from proximity.web.guided import Button, Field, GuidedPages, PageLeftError, Step, StoppedError, guided_pages

TAKE = Button("take", "Take", "Enter", "main", takes_fields=True)
SKIP = Button("skip", "Leave out")
STEP = Step("Pose 1", "Lay the hand flat.", buttons=(TAKE, SKIP))


@pytest.fixture
def pages():
    with GuidedPages("Test") as running:
        yield running


@pytest.fixture
def person(pages):
    with Client(pages.url) as client:
        yield client


@pytest.fixture
def watcher(pages):
    with Client(pages.watch_url) as client:
        yield client


def test_a_step_is_shown_and_its_answer_comes_back(pages, person):
    assert person.get("welcome") == {"title": "Test", "has_stop": False, "is_watching": False}
    pages.present(
        Step("A", picture="<svg/>", table=(("", "mm"), ("mass", "3")), progress=(1, 4), buttons=(TAKE,))
    )
    shown = person.step("A")
    assert shown["picture"] == "data:image/svg+xml;base64,PHN2Zy8+" and shown["progress"] == [1, 4]
    assert pages.wait(0.05) is None

    person.answer(shown, seconds=1.25)

    answer = pages.wait(PATIENCE)
    assert (answer.button, answer.seconds, dict(answer.values)) == ("take", 1.25, {})


def test_an_answer_to_an_earlier_step_does_not_count(pages, person):
    pages.present(STEP)
    first = person.step("Pose 1")
    pages.present(Step("B", buttons=(SKIP,)))
    person.answer(first)
    person.answer(person.step("B"), "skip")

    assert pages.wait(PATIENCE).button == "skip"


@pytest.mark.parametrize(
    ("field", "given", "expected"),
    [
        (Field("x", "Bend", least=0, most=1), "0,5", 0.5),
        (Field("x", "Bend", least=0, most=1), "2", "Bend: expected a number from 0 to 1"),
        (Field("x", "Bend"), "flat", "Bend: expected a number"),
        (Field("x", "Bend"), None, "Bend: expected a number"),
        (Field("x", "Hand", choices=("left", "right")), "left", "left"),
        (Field("x", "Hand", choices=("left", "right")), "both", "Hand: expected a choice"),
    ],
)
def test_fields_are_read_or_a_sentence_says_what_was_expected(pages, person, field, given, expected):
    pages.present(Step("A", fields=(field,), buttons=(TAKE, SKIP)))
    shown = person.step("A")
    person.answer(shown, x=given)

    if isinstance(expected, str) and "expected" in expected:
        assert person.get("refused") == expected
        person.answer(shown, "skip", x=given)  # leaves the fields out
        assert dict(pages.wait(PATIENCE).values) == {}
    else:
        assert dict(pages.wait(PATIENCE).values) == {"x": expected}


def test_a_step_ends_by_itself(pages):
    started = time.monotonic()
    answer = pages.ask(Step("Now", seconds=0.2))

    assert (answer.button, answer.seconds) == ("", 0.2)
    assert time.monotonic() - started >= 0.2


def test_live_numbers_come_and_some_only_to_those_who_watch(pages, person, watcher):
    pages.show({"counts": "31072"}, watched={"force": "0.3 N"})

    assert watcher.get("welcome")["is_watching"] is True
    assert watcher.get("live") == {"counts": "31072"} and watcher.get("watched") == {"force": "0.3 N"}
    person.get("live")
    pages.say("not kept")
    said = json.loads(person.socket.recv(PATIENCE))
    assert said == {"notice": "not kept"}  # and no numbers before it


def test_a_watching_page_stops_at_once_and_the_program_can_go_on():
    done = threading.Event()
    with GuidedPages("Test", on_stop=done.set) as pages, Client(pages.watch_url) as watcher:
        pages.present(STEP)
        watcher.socket.send(json.dumps({"stop": True}))
        with pytest.raises(StoppedError, match="the emergency stop was pressed"):
            pages.wait()
        assert done.is_set()
        assert watcher.get("stopped") is True
        with pytest.raises(StoppedError):
            pages.ask(STEP)

        pages.stopped.clear()
        pages.present(STEP)
        assert watcher.get("stopped") is False and pages.wait(0.0) is None


def test_a_stop_that_fails_is_reported():
    with GuidedPages("Test", on_stop=lambda: 1 / 0) as pages, Client(pages.url) as person:
        person.socket.send(json.dumps({"stop": True}))
        with pytest.raises(StoppedError) as stopped:
            pages.ask(STEP)
    assert isinstance(stopped.value.__cause__, ZeroDivisionError)


def test_a_page_that_is_closed_ends_the_program_unless_it_comes_back(pages, monkeypatch):
    monkeypatch.setattr(guided_pages, "GONE_S", 0.3)
    pages.present(STEP)
    for _ in range(2):
        with Client(pages.url) as person:
            person.answer(person.step("Pose 1"))
            assert pages.wait(PATIENCE).button == "take"

    with pytest.raises(PageLeftError, match="the page was closed"):
        pages.wait()


def test_a_second_page_takes_the_place_of_the_first(pages, person):
    person.step("Test")
    with Client(pages.url) as second:
        second.step("Test")

        assert person.closed() == (4409, "the page was opened elsewhere")
        pages.present(STEP)
        second.answer(second.step("Pose 1"))
        assert pages.wait(PATIENCE).button == "take"


def test_pages_are_told_that_it_is_over():
    opened = contextlib.ExitStack()
    with GuidedPages("Test") as pages:
        person = opened.enter_context(Client(pages.url))
        person.step("Test")
        pages.ending = "Thank you."
    assert person.get("end") == "Thank you."
    assert person.closed()[0] == 1000
    opened.close()


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        ({"answer": {"number": 1, "button": "other", "values": {}, "seconds": 1}},
         "that is no answer to this step"),
        ({"answer": {"number": 1, "button": "take", "values": {}, "seconds": -1}},
         "an answer takes no such time"),
        ({"answer": 1}, "an answer is no object"),
        ({"run": "rm"}, "a page may answer and stop, and no more than a person can"),
    ],
)  # fmt: skip
def test_what_no_page_sends_ends_the_connection(pages, person, said, reason):
    pages.present(STEP)
    person.step("Pose 1")
    person.socket.send(json.dumps(said))

    assert person.closed() == (4400, reason)


def test_a_watching_page_cannot_answer(pages, watcher):
    pages.present(STEP)
    watcher.answer(watcher.step("Pose 1"))

    assert watcher.closed()[0] == 4400 and pages.wait(0.0) is None


def test_who_has_no_token_or_comes_from_elsewhere_is_refused(pages):
    with Client(pages.url, token="guessed") as page:
        assert page.closed()[0] == 4403
    address = pages.url.partition("/#")[0].replace("http", "ws") + "/live"
    with pytest.raises(InvalidStatus), connect(address, origin="http://elsewhere"):
        pass
    assert pages.url.rpartition("=")[2] != pages.watch_url.rpartition("=")[2]


def test_a_port_that_is_taken_and_a_package_that_is_missing_are_said(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(ServiceError, match=f"^no page can be served at port {port} "),
            GuidedPages("T", port=port),
        ):
            pass
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    monkeypatch.delitem(sys.modules, "proximity.web.server.page_server", raising=False)
    with (
        pytest.raises(MissingLibraryError, match=r"^the page needs websockets.*: pip install .cad-proximity"),
        GuidedPages("T"),
    ):
        pass
