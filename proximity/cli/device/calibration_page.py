"""Calibration on a page in the browser: the same steps, with a picture of each pose and live numbers."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import typer

from proximity.cli.device.guide import Prompt, RepeatError, SkipError, UnfinishedError
from proximity.decaff.glove.glove import Glove
from proximity.errors import MotorError, ProximityError
from proximity.web.guided import Answer, Button, Field, GuidedPages, PageLeftError, Step, StoppedError
from proximity.web.server.access import open_in_browser

LIVE_S = 0.1  # between two live readings
LEFT = -40.0  # mm, where a drawing begins
CHOICES = (
    Button("take", "Take", "Enter", "main", takes_fields=True),
    Button("repeat", "Repeat the last reading", "r"),
    Button("skip", "Skip this task", "s"),
    Button("stop", "Stop and keep the readings"),
)
KEPT = "All readings are kept, and the same command continues from there. You can close this page."


class Page:
    """A `Face` that asks on a page."""

    def __init__(self, pages: GuidedPages) -> None:
        self._pages = pages
        self._prompt: Prompt | None = None
        self._part = 0
        self._refusal = ""
        self._read: dict[str, str] = {}

    def begin(self, prompt: Prompt) -> None:
        """Show the step; where it goes on by itself there is nothing to press."""
        self._prompt, self._part = prompt, 0
        if prompt.goes_on:
            self._pages.present(self._step("The next readings follow by themselves."))
            self._wait(0.0)

    def ready(self, part: int) -> None:
        """Show what is to be done; where the prompt waits, return when it is."""
        self._part = part
        if self._prompt is not None and self._prompt.waits:
            self._ask()
        else:
            self._pages.present(self._step())
            self._wait(0.0)

    def numbers(self, questions: Sequence[str]) -> list[float]:
        """Return numbers that are filled in."""
        fields = [Field(str(i), question.capitalize()) for i, question in enumerate(questions)]
        values = self._ask(tuple(fields)).values
        return [float(values[field.key] or 0.0) for field in fields]

    def read(self, sentence: str) -> None:
        """Show what was read beside the next step."""
        self._read = {"last reading": sentence}
        self._refusal = ""

    def refuse(self, sentence: str) -> None:
        """Show it on the next step."""
        self._refusal = sentence

    def results(self, rows: Sequence[tuple[str, ...]], sentence: str, drawing: Path | None) -> None:
        """Show results until the person has seen them."""
        self._prompt, self._read = None, {}
        picture = "" if drawing is None else drawing.read_bytes()
        shown = Step(
            "Result", sentence, picture, "Measured against the model", tuple(rows),
            buttons=(Button("done", "Done", "Enter", "main"),),
        )  # fmt: skip
        self._pages.present(shown)
        try:
            self._wait(None)
        except (UnfinishedError, KeyboardInterrupt):
            return  # everything is written

    def _step(self, more: str = "", fields: tuple[Field, ...] = (), buttons: tuple[Button, ...] = ()) -> Step:
        prompt = self._prompt
        assert prompt is not None, "a prompt begins first"
        advice = f"If this happens again: {prompt.advice}." if prompt.advice else ""
        text = "\n\n".join(filter(None, [prompt.parts[self._part], advice, more]))
        picture = words = ""
        if prompt.bend is not None:
            picture, words = _pose_drawing(prompt.glove, prompt.bend), prompt.joint_angles()
            text += f"\n\nBend {prompt.bend:.3f}: {words}."
        progress = prompt.done, prompt.total
        return Step(prompt.title, text, picture, words, (), fields, buttons, None, progress)

    def _ask(self, fields: tuple[Field, ...] = ()) -> Answer:
        self._pages.present(self._step("", fields, CHOICES))
        if self._refusal:
            self._pages.say(self._refusal)
        self._refusal = ""
        answer = self._wait(None)
        assert answer is not None, "without a timeout there is an answer"
        if answer.button == "repeat":
            raise RepeatError
        if answer.button == "skip":
            raise SkipError
        if answer.button == "stop":
            raise UnfinishedError
        return answer

    def _wait(self, timeout: float | None) -> Answer | None:
        try:
            while (answer := self._pages.wait(LIVE_S if timeout is None else timeout)) is None:
                live = {} if self._prompt is None else self._prompt.live()
                self._pages.show({**live, **self._read})
                if timeout is not None:
                    return None
        except PageLeftError as left:
            raise UnfinishedError(str(left)) from left
        except StoppedError as stopped:
            raise MotorError("the emergency stop was pressed; the motor was switched off") from stopped
        return answer


@contextmanager
def opened_page(*, port: int, opens_browser: bool, on_stop: Callable[[], object] | None) -> Iterator[Page]:
    """Serve the page, and print where it is.

    *port*: where to listen on this machine; 0: any that is free. *on_stop*: is called at an emergency stop;
    None: there is nothing to stop.
    """
    with GuidedPages("Calibration", has_stop=on_stop is not None, on_stop=on_stop, port=port) as pages:
        typer.echo(pages.url)
        if on_stop is not None:
            typer.echo(f"{pages.watch_url} is a second page, to watch, with the emergency stop")
        if opens_browser:
            open_in_browser(pages.url)
        try:
            yield Page(pages)
        except (KeyboardInterrupt, UnfinishedError, ProximityError) as ended:
            pages.ending = f"{str(ended) or 'The calibration was stopped'}. {KEPT}"
            raise


def _pose_drawing(glove: Glove, bend: float) -> str:
    """An SVG from the side: back of the hand and finger, its joints, and the path of the fingertip."""
    joints = [np.zeros(2), *_joints(glove, bend)]
    path = [_joints(glove, each)[-1] for each in np.linspace(0.0, 1.0, 61)]
    lower = 1e3 * min(point[1] for point in path) - 14.0
    left, right = LEFT, 1e3 * max(point[0] for point in path) + 14.0
    wide = 2e3 * glove.finger.pad_radius
    dots = "".join(f'<circle cx="{x:.2f}" cy="{y:.2f}" r="1.6"/>' for x, y in _screen(joints[:-1]))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{6 * (right - left):.0f}" '
        f'height="{6 * (14.0 - lower):.0f}" viewBox="{left:.1f} -14 {right - left:.1f} {14.0 - lower:.1f}" '
        'fill="none" stroke-linecap="round" stroke-linejoin="round">'
        f'<polyline points="{_points(path)}" stroke="#9fb6cc" stroke-width="0.6" stroke-dasharray="1.5 2"/>'
        f'<polyline points="{left - 20:.1f},0 0,0" stroke="#d9a98c" stroke-width="{1.3 * wide:.2f}"/>'
        f'<polyline points="{_points(joints)}" stroke="#edc9b0" stroke-width="{wide:.2f}"/>'
        f'<polyline points="{_points(joints)}" stroke="#7a4f35" stroke-width="0.7"/>'
        f'<g fill="#7a4f35">{dots}</g></svg>'
    )


def _joints(glove: Glove, bend: float) -> list[np.ndarray]:
    angles = -bend * np.cumsum(glove.finger.flexions)
    steps = np.stack([np.cos(angles), np.sin(angles)], axis=-1) * np.array(glove.finger.phalanges)[:, None]
    return list(np.cumsum(steps, axis=0))


def _screen(points: Sequence[np.ndarray]) -> np.ndarray:
    """Millimetres, downwards."""
    return np.array([1e3, -1e3]) * np.array(points)


def _points(points: Sequence[np.ndarray]) -> str:
    return " ".join(f"{x:.2f},{y:.2f}" for x, y in _screen(points))
