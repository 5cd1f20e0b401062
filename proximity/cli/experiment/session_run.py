"""Session of an experiment with a person: the drums in a thread, and who asks in front of them."""

from dataclasses import dataclass
from pathlib import Path

import typer

from proximity.cli.drum_loop import DrumsBeside
from proximity.cli.drum_motors import armable_motors
from proximity.cli.experiment.participant_page import PageRespondent, stop_everything
from proximity.cli.experiment.participant_terminal import TerminalRespondent
from proximity.decaff.glove.glove_set import read_any_glove
from proximity.decaff.motors.motor_set import home_all
from proximity.lab.experiment.conduct import Monitor, RefusedError, StoppedError
from proximity.lab.experiment.dataset import Dataset
from proximity.lab.experiment.drum_display import DrumDisplay
from proximity.lab.experiment.sitting import sit
from proximity.transport import open_subscriber
from proximity.web.guided import GuidedPages
from proximity.web.server.browser import open_in_browser


@dataclass(frozen=True, slots=True)
class Drums:
    """The drums that a session needs."""

    address: str  # of the service
    rate: float  # Hz
    finger: int
    gloves: list[Path]
    max_age: float | None  # days
    motors: list[str]  # addresses; they are armed


def run_session(
    dataset: Dataset, participant: str, drums: Drums, *, at_terminal: bool, opens_browser: bool = False
) -> str:
    """Do what is left of a session.

    *opens_browser*: whether the page is opened in a browser of this machine.
    """
    gloves, monitor = [read_any_glove(path, drums.max_age) for path in drums.gloves], Monitor()
    with (
        armable_motors(drums.motors, gloves) as motors,
        open_subscriber(drums.address) as subscriber,
    ):
        display = DrumDisplay(drums.rate, drums.finger, gloves, motors)
        display.check(dataset.design)
        display.warm_up()
        home_all(motors, monitor.stop.wait, lambda sentence: typer.echo(f"proximity: {sentence}", err=True))
        try:
            with DrumsBeside(display, subscriber, drums.rate):
                if at_terminal:
                    sit(dataset, participant, display, TerminalRespondent(), monitor)
                else:
                    _sit_at_page(dataset, participant, display, monitor, opens_browser)
        except RefusedError:
            return f"{participant} does not agree: nothing was kept"
        except StoppedError:
            return "stopped; the same command goes on there"
        finally:
            display.stop("the session is over")
    return ""


def _sit_at_page(
    dataset: Dataset, participant: str, display: DrumDisplay, monitor: Monitor, opens_browser: bool
) -> None:
    title = dataset.design.title
    with GuidedPages(title, has_stop=True, on_stop=lambda: stop_everything(monitor, display)) as pages:
        typer.echo(f"participant:  {pages.url}")
        typer.echo(f"experimenter: {pages.watch_url}")
        if opens_browser:
            open_in_browser(pages.url)
        sit(dataset, participant, display, PageRespondent(pages, monitor, title), monitor)
