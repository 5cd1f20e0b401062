"""A guided page without a browser: a websocket that says what a page says."""

import contextlib
import json
import time

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

PATIENCE = 30.0


class Client:
    """A page as a socket sees it."""

    def __init__(self, url, token=None):
        address, _, given = url.partition("/#token=")
        self.opened = contextlib.ExitStack()
        self.socket = self.opened.enter_context(
            connect(address.replace("http", "ws") + "/live", origin=address)
        )
        self.socket.send(json.dumps({"hello": given if token is None else token}))

    def get(self, topic):
        """The next of a topic, whatever comes before it."""
        ends = time.monotonic() + PATIENCE
        while time.monotonic() < ends:
            found = json.loads(self.socket.recv(PATIENCE))
            if topic in found:
                return found[topic]
        raise AssertionError(f"no {topic} came for {PATIENCE:g} s")

    def step(self, title):
        while (step := self.get("step"))["title"] != title:
            pass
        return step

    def answer(self, step, button="take", seconds=0.5, **values):
        given = {"number": step["number"], "button": button, "values": values, "seconds": seconds}
        self.socket.send(json.dumps({"answer": given}))

    def closed(self):
        """Code and reason with which the connection is closed."""
        try:
            while True:
                self.socket.recv(PATIENCE)
        except ConnectionClosed as ended:
            return ended.rcvd.code, ended.rcvd.reason

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.opened.close()
