"""``proximity calibrate --page``: the same steps on a page, from the first pose to the result."""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time

import browsing
import pytest
from guided_client import Client
from project import IMPORT_PATHS

from proximity.cli.device.calibration_page import Page
from proximity.cli.device.guide import guide
from proximity.decaff.calibrating.readings import Readings
from proximity.decaff.calibrating.results import Session
from proximity.decaff.calibrating.simulated_glove import SimulatedGlove
from proximity.decaff.calibrating.tasks import Bench
from proximity.decaff.glove.calibration import read_calibration
from proximity.decaff.glove.glove import Glove
from proximity.errors import MotorError
from proximity.web.guided import GuidedPages

SHORT = ("--simulate", "--skip", "held drum", "--skip", "free drum")


class Calibrating:
    """`proximity calibrate` in a process of its own."""

    def __init__(self, path, *words):
        command = [
            sys.executable,
            "-m",
            "proximity",
            "calibrate",
            str(path),
            *words,
            "--page",
            "--no-browser",
        ]
        self.process = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(IMPORT_PATHS), "PYTHONUNBUFFERED": "1"},
        )
        self.url = self.process.stdout.readline().strip()
        assert self.url, self.process.stderr.read()

    def ended(self):
        """Exit code, and what it printed, when it has ended."""
        out, err = self.process.communicate(timeout=60)
        return self.process.returncode, out, err

    def __enter__(self):
        return self

    def __exit__(self, *unused):
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()


def test_a_glove_is_calibrated_on_the_page(tmp_path):
    path = tmp_path / "glove.json"
    with Calibrating(path, *SHORT) as running, Client(running.url) as page:
        titles = []
        while (step := page.get("step"))["title"] != "Result":
            if step["buttons"]:
                titles.append(step["title"])
                page.answer(step)
        assert titles[:8] == [*(f"pose {i}, 1 of 3" for i in range(1, 8)), "pose 1, 2 of 3"]
        assert titles[-1] == "step, 1 of 3"  # the others follow by themselves
        assert step["picture"].startswith("data:image/png") and "written; drawn in" in step["text"]
        assert step["table"][0] == ["", "measured", "± 95 %", "model", "true", "readings", ""]
        assert step["table"][-1][0] == "glove latency [ms]"
        page.answer(step, "done")
        code, out, _ = running.ended()

    assert code == 0 and "glove latency [ms]" in out
    assert len(read_calibration(path).counts) == 7


def test_readings_are_repeated_left_out_and_kept(tmp_path):
    """What is left out is missing at the end; the same command asks for it."""
    path = tmp_path / "glove.json"
    readings = tmp_path / "glove.readings.json"
    with Calibrating(path, *SHORT) as running, Client(running.url) as page:
        page.answer(page.step("pose 1, 1 of 3"), "repeat")
        step = page.step("pose 1, 1 of 3")
        assert page.get("notice") == "There is no reading yet."
        page.answer(step)
        page.answer(page.step("pose 2, 1 of 3"), "repeat")
        page.answer(page.step("pose 1, 1 of 3"))
        for title in (
            "pose 2",
            "pose 3",
            "pose 4",
            "pose 5",
            "pose 6",
            "pose 7",
            "pose 1",
            "both directions",
        ):
            page.answer(page.step(f"{title}, {2 if title == 'pose 1' else 1} of 3"), "skip")
        for title in ("cable pull, 1 of 3", "touches, 1 of 9", "step, 1 of 3"):
            page.answer(page.step(title), "skip")
        assert page.get("end").startswith("pose 1, pose 2, ")
        code, _, err = running.ended()
    assert code == 1 and "step: not measured, but a calibration needs it; 1 readings are kept in" in err
    assert len(json.loads(readings.read_text())["readings"]) == 1


@pytest.mark.parametrize("how", ["stop", "close"])
def test_a_page_that_stops_or_closes_keeps_what_was_measured(tmp_path, how):
    with Calibrating(tmp_path / "glove.json", *SHORT) as running:
        with Client(running.url) as page:
            page.answer(page.step("pose 1, 1 of 3"))
            if how == "stop":
                page.answer(page.step("pose 2, 1 of 3"), "stop")
                assert "All readings are kept" in page.get("end")
            else:
                page.step("pose 2, 1 of 3")
        code, _, err = running.ended()

    assert code == 1 and "1 readings are kept in" in err
    assert ("the page was closed" in err) is (how == "close")


def test_numbers_are_filled_in_beside_the_pose(tmp_path):
    with Calibrating(tmp_path / "glove.json") as running, Client(running.url) as page:
        step = page.step("pose 1, 1 of 3")
        while not step["fields"]:
            step = page.get("step")
        assert step["fields"][0]["label"] == "Counts of the potentiometer"
        assert step["picture"].startswith("data:image/svg+xml")
        page.answer(step, **{"0": "flat"})
        assert page.get("refused") == "Counts of the potentiometer: expected a number"
        page.answer(step, **{"0": "21845"})
        page.step("pose 2, 1 of 3")
        live = page.get("live")
        assert live == {"last reading": "21845 counts"}


def test_emergency_stop_ends_the_calibration_at_once(tmp_path):
    stopped = threading.Event()
    glove = SimulatedGlove(0, Glove())
    session = Session(Bench(glove.instruments, Glove()), Readings(tmp_path / "r.json", "test"))

    def press(url):
        with Client(url) as page:
            page.answer(page.step("pose 1, 1 of 3"))
            page.step("pose 2, 1 of 3")
            page.socket.send(json.dumps({"stop": True}))
            page.get("stopped")

    with GuidedPages("Test", has_stop=True, on_stop=stopped.set) as pages:
        pressing = threading.Thread(target=press, args=(pages.url,))
        pressing.start()
        with pytest.raises(MotorError, match=r"^the emergency stop was pressed; the motor was switched off$"):
            guide(session, Page(pages), glove, waits=True)
        pressing.join()
    assert stopped.is_set() and len(session.readings.all) == 1


@pytest.mark.slow
@pytest.mark.browser
def test_a_person_calibrates_a_simulated_glove_in_a_browser(tmp_path):
    path = tmp_path / "glove.json"
    with (
        Calibrating(path, "--simulate", "--skip", "held drum") as running,
        browsing.browser() as chromium,
        browsing.Page(chromium, running.url) as page,
    ):
        page.until("document.getElementById('live').textContent.includes('potentiometer')")
        page.picture("calibrate-pose-1")
        ends = time.monotonic() + browsing.PATIENCE
        title = "document.getElementById('title').textContent"
        while (shown := page.ask(title)) != "Result":
            assert time.monotonic() < ends, shown
            if shown.startswith(("pose 5, 2", "cable pull", "free drum, 3")):
                page.picture(f"calibrate-{shown.split(',')[0].replace(' ', '-')}")
            with contextlib.suppress(Exception):
                page.page.get_by_role("button", name="Take").click(timeout=300)
        page.until("document.getElementById('picture').naturalWidth > 0")
        page.page.set_viewport_size({"width": 960, "height": 1500})
        page.picture("calibrate-result")
        assert page.ask("document.querySelectorAll('#table tr').length") == 16
        page.page.get_by_role("button", name="Done").click()
        page.until("document.getElementById('cover-text').textContent.startsWith('This is over')")
        assert running.ended()[0] == 0
    assert len(read_calibration(path).counts) == 7
