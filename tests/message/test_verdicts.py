"""Receivers in all languages accept the same messages, by one table."""

import numpy as np
import pytest
from client_programs import DEFECTS, LANGUAGES, Events, build_driver
from controller_in_c import Events as ChipEvents
from controller_in_c import build as build_controller
from verdicts import CASES, ROWS, datagrams
from wire import Clock, Wire

from proximity.transport import Subscriber


@pytest.fixture(scope="module", params=LANGUAGES)
def driver(request, tmp_path_factory):
    """A program for each language."""
    return build_driver(request.param, tmp_path_factory.mktemp(request.param))


@pytest.fixture(scope="module")
def chip(tmp_path_factory):
    """The controller in C."""
    return build_controller(tmp_path_factory.mktemp("chip"))


def expected_of(name):
    return [verdict for *_, verdict in datagrams(ROWS[name])]


@pytest.mark.parametrize(("name", "shares_clock", "is_keyed"), CASES)
def test_subscriber(name, shares_clock, is_keyed):
    clock, wire, found = Clock(), Wire(shares_clock), []
    wire.is_keyed = is_keyed
    subscriber = Subscriber(wire, "wire:", clock=clock)
    for data, clock.now, _ in datagrams(ROWS[name]):
        before = subscriber.counts.flawed.copy()
        wire.put(data)
        used = len(list(subscriber.frames()))
        (verdict,) = (subscriber.counts.flawed - before) or [None]
        assert used == (verdict is None)
        found.append(verdict)

    counts = subscriber.counts
    assert found == expected_of(name)
    assert (counts.received, counts.lost, counts.sessions) == ROWS[name].counts()


@pytest.mark.processes
def test_clients(driver, tmp_path):
    for name, shares_clock, is_keyed in CASES:
        events = Events(shares_clock, is_keyed)
        for data, now, _ in datagrams(ROWS[name]):
            events.offer(data, now)
        found, counts, _ = events.answers(driver, tmp_path)

        assert found == expected_of(name), (name, shares_clock, is_keyed)
        assert counts == ROWS[name].counts(), (name, shares_clock, is_keyed)


@pytest.mark.processes
def test_controller(chip, tmp_path):
    for name, shares_clock, is_keyed in CASES:
        if is_keyed:
            continue
        events = ChipEvents(shares_clock)
        for data, now, _ in datagrams(ROWS[name]):
            events.datagram(data, now)
        found = np.frombuffer(events.answers([chip], tmp_path), "<i4")

        assert [DEFECTS[number] for number in found] == expected_of(name), (name, shares_clock)
