"""Pages of `proximity view` in headless Chromium, with an optional emulated headset."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from project import IMPORT_PATHS, TESTS

BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
FLAGS = (
    "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
    "--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync",
)  # fmt: skip
EMULATOR = TESTS / "web" / "vendor" / "iwer.min.js"
HEADSET = (
    "window.headset = new IWER.XRDevice(IWER.metaQuest3); headset.installRuntime({ forceInstall: true });"
)
PATIENCE = float(os.environ.get("PROXIMITY_PATIENCE", "90"))  # s: software rendering on a loaded machine
SIZE = {"width": 960, "height": 600}


def browser_path():
    """Find a browser; without one skip the test, or fail it in continuous integration."""
    for name in BROWSERS:
        found = shutil.which(name)
        if found:
            return found
    sentence = f"there is no browser here: install {BROWSERS[0]}, a package of Debian, to test the page"
    if os.environ.get("CI"):
        pytest.fail(sentence)
    pytest.skip(sentence)


@contextlib.contextmanager
def browser():
    """Chromium with software rendering; Playwright's own browsers are never downloaded."""
    path = browser_path()
    driver = pytest.importorskip("playwright.sync_api", reason="playwright drives the tests of the page")
    with driver.sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        yield running
        running.close()


class Viewing:
    """`proximity view` in a separate process."""

    def __init__(self, *words):
        command = [sys.executable, "-m", "proximity", "view", *map(str, words)]
        self.process = subprocess.Popen(
            [*command, "--no-browser", "--json", "--until-stdin"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(IMPORT_PATHS)},
        )
        line = self.process.stdout.readline()
        assert line, "proximity view has ended"
        self.url = json.loads(line)["url"]

    def stop(self):
        """End the process and wait for it."""
        self.process.stdin.close()
        assert self.process.wait(30) == 0
        self.process.stdout.close()

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        self.stop()


class Page:
    """An open page and the errors it reported."""

    def __init__(self, running, url, *, has_headset=False):
        self.context = running.new_context(viewport=SIZE, device_scale_factor=1, accept_downloads=True)
        self.page = self.context.new_page()
        self.page.set_default_timeout(1e3 * PATIENCE)
        self.complaints = []
        self.page.on(
            "console", lambda said: self.complaints.append(said.text) if said.type == "error" else None
        )
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        if has_headset:
            self.page.add_init_script(path=str(EMULATOR))
            self.page.add_init_script(HEADSET)
        self.page.goto(url, wait_until="commit", timeout=1e3 * PATIENCE)

    def ask(self, script, given=None):
        """Evaluate a JavaScript expression."""
        return self.page.evaluate(script, given)

    def until(self, script, given=None, patience=PATIENCE):
        """Poll until an expression is true and return its value.

        Polls from Python: the page's policy forbids eval.
        """
        ends = time.monotonic() + patience
        while True:
            found = self.page.evaluate(script, given)
            if found:
                return found
            if time.monotonic() > ends:
                self.picture("failure")
                state = self.page.evaluate("document.body.innerText")
                raise AssertionError(f"never: {script}\n{state}\n{self.complaints}")
            time.sleep(0.03)

    def ready(self):
        """Wait until the parts are shown and frames arrive."""
        self.until("!!(window.page && page.parts.isLoaded && page.reading.header)")
        return self

    def picture(self, name):
        """Save a screenshot to the folder PROXIMITY_PICTURES, if set."""
        folder = os.environ.get("PROXIMITY_PICTURES")
        if folder:
            Path(folder).mkdir(parents=True, exist_ok=True)
            self.page.screenshot(path=str(Path(folder) / f"{name}.png"), timeout=60_000)

    def contacts(self):
        """Known fingers: number, position, distance and whether it is exact."""
        return self.ask(
            "((reading) => reading.contacts.filter((each) => each.isKnown && reading.state !== 'LATE')"
            ".map(({ finger, position, distance, isExact: exact }) =>"
            " ({ finger, position, distance, exact }))"
            ")(page.reading)"
        )

    def exact(self, count=1):
        """Wait for exact distances of at least *count* fingers; return these fingers."""
        ends = time.monotonic() + PATIENCE
        while len(found := [each for each in self.contacts() if each["exact"]]) < count:
            assert time.monotonic() < ends, f"never {count} exact distances: {self.contacts()}"
            time.sleep(0.03)
        return found

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        """Close the page and check that it reported no error."""
        self.context.close()
        assert error is not None or self.complaints == []
