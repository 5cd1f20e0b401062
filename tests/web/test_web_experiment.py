"""Pages of an experiment: what a participant is asked, and what the experimenter sees and stops."""

import json
import threading

import pytest
from experiments import SMALL, write_design
from test_web_guided import Client

from proximity.cli.lab.participant_session import PageRespondent
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.observers import Observer
from proximity.lab.experiment.session import Monitor, StoppedError, run_visit
from proximity.web.guided import GuidedPages

RATING = SMALL.replace(
    'name = "which"\nkind = "real"\ntrials = 4', 'name = "rate"\nkind = "rating"\ntrials = 1'
)


@pytest.fixture
def visit(tmp_path):
    """A session at pages, in a thread; what ended it, and the data."""
    dataset = Dataset(tmp_path / "data", read_design(write_design(tmp_path, RATING)))
    monitor, ended = Monitor(), []
    with GuidedPages("Small", has_stop=True, on_stop=monitor.stop.set) as pages:
        observer = Observer(dataset.design, dataset.register("p01", Observer.name))
        respondent = PageRespondent(pages, monitor, "Small")

        def run():
            try:
                run_visit(dataset, "p01", observer, respondent, monitor)
            except StoppedError as stopped:
                ended.append(stopped)

        thread = threading.Thread(target=run)
        with Client(pages.url) as person:
            thread.start()
            yield person, pages.watch_url, dataset, thread, ended
            monitor.stop.set()
        thread.join()


def answered(step):
    """The button and the values by which a step is answered."""
    buttons = [button["key"] for button in step["buttons"]]
    values = {field["key"]: "right" if field["choices"] else "3" for field in step["fields"]}
    return ("agree" if "agree" in buttons else buttons[0]), values


def go_through(person, until=lambda step: False):
    """Answer steps; the titles that were shown."""
    titles = []
    while True:
        step = person.get("step")
        titles.append(step["title"])
        if until(step):
            return titles
        if step["buttons"]:
            button, values = answered(step)
            person.answer(step, button, **values)
        if step["text"] == "Thanks.":
            return titles


def test_participant_goes_through_a_session(visit):
    person, watch_url, dataset, thread, ended = visit
    titles = go_through(person)

    assert titles[0] in ("Consent", "Small") and "Consent" in titles
    assert titles.count("Question") == 2
    assert titles.count("First surface") >= 19 and titles.count("Which?") == 19
    assert titles.count("Rating") == 2
    with Client(watch_url) as watcher:
        shown = watcher.get("watched")
    assert set(shown) == {"step", "surface", "trial", "left", "largest force", "force limit"}
    thread.join(20.0)
    assert not ended and not thread.is_alive()
    trials = dataset.trials()
    assert {one["answer"] for one in trials} == {1, 3.0}


def test_experimenter_stops_and_the_trial_at_hand_is_not_answered(visit):
    person, watch_url, dataset, thread, ended = visit
    go_through(person, until=lambda step: step["title"] == "Which?")
    with Client(watch_url) as watcher:
        watcher.socket.send(json.dumps({"stop": True}))
        thread.join(20.0)

    assert not thread.is_alive() and len(ended) == 1
    assert [one["event"] for one in dataset.entries("p01")] == ["begin", "text", "question"]
