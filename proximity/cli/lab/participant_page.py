"""A participant at a guided page, and the experimenter's second page with state, limits and stop."""

from typing import Any

from proximity.lab.experiment.design import CHOICES, Kind, Question
from proximity.lab.experiment.display import Presentation
from proximity.lab.experiment.drum_display import DrumDisplay
from proximity.lab.experiment.plan import Text
from proximity.lab.experiment.session import Trial
from proximity.lab.experiment.visit import EMERGENCY, Monitor, StoppedError
from proximity.lab.simulation.simulated_press import Wall
from proximity.web import guided
from proximity.web.guided import Answer, Button, Field, GuidedPages, PageLeftError, Step

GO_ON = Button("go", "Go on", "Enter", look="main")
CHOICE_BUTTONS = (Button("1", "The first", "ArrowLeft"), Button("2", "The second", "ArrowRight"))


class PageRespondent:
    """Asks a person at a page; both pages stop everything."""

    def __init__(self, pages: GuidedPages, monitor: Monitor, title: str) -> None:
        self._pages, self._monitor, self._title = pages, monitor, title
        self._surface = ""
        monitor.changed = self._show

    def read(self, text: Text) -> bool:
        """Show a text; whether the participant goes on."""
        if text.seconds:
            self._ask(Step("Break", _paragraphs(text.text), seconds=text.seconds))
        buttons: tuple[Button, ...] = (GO_ON,)
        if text.name == "consent":
            buttons = (Button("agree", "I agree", look="main"), Button("refuse", "I do not agree"))
        title = {"consent": "Consent", "instructions": "What to do", "break": "After the break"}
        answer = self._ask(Step(title.get(text.name, self._title), _paragraphs(text.text), buttons=buttons))
        return answer.button != "refuse"

    def choose(self, question: Question) -> Any:
        """Ask a question."""
        field = Field("answer", question.text, least=question.lowest, most=question.highest)
        if question.choices:
            field = Field("answer", question.text, "choice", choices=question.choices)
        button = Button("go", "Go on", "Enter", look="main", takes_fields=True)
        return self._ask(Step("Question", fields=(field,), buttons=(button,))).values["answer"]

    def begin(self, trial: Trial, interval: int) -> None:
        """Wait until the participant is ready, then say to press."""
        name = ("First surface", "Second surface")[interval] if len(trial.intervals) > 1 else "Surface"
        where = self._progress()
        is_real = trial.intervals[interval].wall is Wall.REAL
        self._surface = "put the real surface in place" if is_real else "by the drum"
        self._show()
        self._ask(Step(name, "Take the finger back, then go on.", buttons=(GO_ON,), progress=where))
        self._pages.present(Step(name, "Press now.", progress=where))

    def answer(self, trial: Trial, felt: list[Presentation]) -> Any:
        """Ask for the answer to a trial."""
        if trial.kind in CHOICES:
            shown = Step(trial.question or "Which?", buttons=CHOICE_BUTTONS, progress=self._progress())
            return int(self._ask(shown).button)
        if trial.kind is not Kind.RATING:
            return None
        button = Button("go", "Go on", "Enter", look="main", takes_fields=True)
        field = Field("answer", trial.question or "How stiff?", least=0.001)
        return self._ask(Step("Rating", fields=(field,), buttons=(button,))).values["answer"]

    def explain(self, why: str) -> None:
        """Say that a trial ended early, until the participant goes on."""
        if not self._monitor.stop.is_set():
            self._ask(Step("This trial ended early", f"{why[0].upper()}{why[1:]}.", buttons=(GO_ON,)))

    def _ask(self, step: Step) -> Answer:
        try:
            return self._pages.ask(step)
        except (guided.StoppedError, PageLeftError):
            self._monitor.stop.set()
            raise StoppedError from None

    def _progress(self) -> tuple[int, int]:
        return self._monitor.trial, self._monitor.trials

    def _show(self) -> None:
        """Show the experimenter where the session is; a participant is not shown the condition."""
        monitor = self._monitor
        self._pages.show(
            {},
            watched={
                "step": monitor.doing,
                "surface": self._surface,
                "trial": f"{monitor.trial} of {monitor.trials}",
                "left": f"{monitor.minutes_left:.0f} min",
                "largest force": f"{monitor.force:.2f} N",
                "force limit": f"{monitor.force_limit:g} N",
            },
        )


def _paragraphs(text: str) -> str:
    """A text whose lines end where the page's do."""
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in text.split("\n\n"))


def stop_everything(monitor: Monitor, display: DrumDisplay) -> None:
    """Retract the drums and end the visit: what the emergency stop of a page calls."""
    monitor.stop.set()
    display.stop(EMERGENCY)
