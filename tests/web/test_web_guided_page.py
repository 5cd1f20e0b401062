"""Guided pages in a browser: steps are seen, filled in, answered by mouse and keys, watched and stopped."""

import threading

import pytest
from browsing import Page

from proximity.web.guided import Answer, Button, Field, GuidedPages, Step, StoppedError

pytestmark = [pytest.mark.slow, pytest.mark.browser]

PICTURE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 20"><circle cx="20" cy="10" r="9"/></svg>'
ASKED = Step(
    "Before we begin",
    "Please fill this in.\n\nNothing of it names you.",
    picture=PICTURE,
    picture_words="a disc",
    table=(("", "measured", "± 95 %"), ("mass [g]", "193.2", "1.4")),
    fields=(
        Field("age", "Age", least=18, most=99),
        Field("hand", "Hand", choices=("left", "right")),
    ),
    buttons=(Button("go", "Go on", "Enter", "main", takes_fields=True), Button("leave", "Leave")),
    progress=(3, 44),
)
CHOICE = Step(
    "Which was stiffer?",
    buttons=(Button("first", "The first", "ArrowLeft"), Button("second", "The second", "ArrowRight")),
    seconds=60.0,
)


def begin(pages, step):
    """Have a step asked beside; the list that its answer, or what ended it, comes into."""
    got: list[Answer | Exception] = []

    def ask():
        try:
            got.append(pages.ask(step))
        except StoppedError as stopped:
            got.append(stopped)

    thread = threading.Thread(target=ask)
    thread.start()
    return got, thread


def test_a_person_fills_in_a_step_and_answers_by_keys(chromium):
    with GuidedPages("Test of a wall") as pages, Page(chromium, pages.url) as person:
        got, thread = begin(pages, ASKED)
        person.until("document.getElementById('title').textContent === 'Before we begin'")
        assert person.ask("document.getElementById('done').textContent") == "3 of 44"
        person.until("document.getElementById('picture').naturalWidth > 0")
        form = person.page
        form.get_by_label("Age").fill("17")
        form.get_by_role("button", name="Go on").click()
        person.until(
            "document.getElementById('notice').textContent === 'Age: expected a number from 18 to 99'"
        )
        form.get_by_label("Age").fill("31")
        form.get_by_label("right").check()
        person.picture("guided-fields")
        form.get_by_label("Age").press("Enter")
        thread.join(10)
        assert dict(got[0].values) == {"age": 31.0, "hand": "right"}

        got, thread = begin(pages, CHOICE)
        person.until("document.getElementById('time-left').textContent.endsWith('s left')")
        person.picture("guided-choice")
        person.page.keyboard.press("ArrowRight")
        thread.join(10)
        assert got[0].button == "second" and 0.0 < got[0].seconds < 60.0
    # the page has been told that it is over


def test_a_watching_page_sees_the_same_and_stops(chromium):
    with (
        GuidedPages("Test of a wall", has_stop=True) as pages,
        Page(chromium, pages.url) as person,
        Page(chromium, pages.watch_url) as watching,
    ):
        pages.show({"force": "0.31 N"}, watched={"condition": "coupled, 3 ms"})
        got, thread = begin(pages, CHOICE)
        watching.until("document.getElementById('title').textContent === 'Which was stiffer?'")
        watching.until("document.getElementById('watched').textContent === 'conditioncoupled, 3 ms'")
        person.until("document.getElementById('live').textContent === 'force0.31 N'")
        assert person.ask("document.getElementById('watched').textContent") == ""
        assert watching.ask("document.querySelectorAll('#buttons button:disabled').length") == 2
        watching.picture("guided-watching")
        watching.page.keyboard.press("Escape")
        thread.join(10)

        assert isinstance(got[0], StoppedError)
        person.until("document.getElementById('cover-text').textContent === 'Stopped.'")
        person.picture("guided-stopped")
