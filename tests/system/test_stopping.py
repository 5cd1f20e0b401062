"""Signals as requests to stop."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from proximity.system.stop_signals import SIGNALS, stopped_by_signals

ON_POSIX = os.name == "posix"


@pytest.mark.skipif(not ON_POSIX, reason="sends itself signals")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_first_signal_sets_the_event_and_leaves_all_as_it_was(number):
    before = {each: signal.getsignal(each) for each in SIGNALS}

    with stopped_by_signals() as stop:
        assert not stop.is_set()
        os.kill(os.getpid(), number)
        assert stop.wait(20.0)
        assert {each: signal.getsignal(each) for each in SIGNALS} == before

    assert {each: signal.getsignal(each) for each in SIGNALS} == before


@pytest.mark.skipif(not ON_POSIX, reason="sends itself signals")
def test_second_signal_acts_as_usual():
    with stopped_by_signals() as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.wait(20.0)
        with pytest.raises(KeyboardInterrupt):
            for _ in range(2000):  # signals are handled between two steps of the interpreter
                os.kill(os.getpid(), signal.SIGINT)
                time.sleep(0.01)


def test_block_in_another_thread_changes_nothing():
    before = {each: signal.getsignal(each) for each in SIGNALS}
    seen, given = [], threading.Event()

    def run():
        with stopped_by_signals(given) as stop:
            seen.append((stop is given, {each: signal.getsignal(each) for each in SIGNALS}))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(20.0)

    assert seen == [(True, before)]


@pytest.mark.skipif(not ON_POSIX, reason="sends itself signals")
def test_another_signal_while_the_event_is_being_set_does_not_wait_for_ever():
    """As when a terminal is closed right after Ctrl-C; the event's lock is not reentrant."""
    code = """
import os, signal, threading
from proximity.system.stop_signals import stopped_by_signals

class Slow(threading.Event):
    def set(self):
        with self._cond:
            if not told:
                told.append(1)
                os.kill(os.getpid(), signal.SIGHUP)
                for _ in range(1000): pass
        super().set()

told = []
signal.signal(signal.SIGHUP, lambda number, frame: print("as usual", flush=True))
with stopped_by_signals(Slow()) as stop:
    os.kill(os.getpid(), signal.SIGTERM)
    print(stop.is_set())
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)

    assert result.stdout == "as usual\nTrue\n", result.stderr
