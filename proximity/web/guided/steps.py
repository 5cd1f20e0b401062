"""What a page shows a person, and what it answers; answers are distrusted until `Step.answer` read them."""

import base64
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal

from proximity.web.server.access import UnfitError

LONGEST_S = 1e6  # that a person may take


class FieldError(Exception):
    """A field is not filled in as expected; the text is a sentence for the person."""


@dataclass(frozen=True, slots=True)
class Field:
    """Something to fill in."""

    key: str
    label: str
    choices: tuple[str, ...] = ()  # none: a number is asked for
    least: float = -math.inf  # of a number
    most: float = math.inf

    def value(self, given: object) -> float | str:
        """Return what a page gave for this field: a number, or one of the choices."""
        text = given.strip() if isinstance(given, str) else ""
        if self.choices:
            if text not in self.choices:
                raise FieldError(f"{self.label}: expected a choice")
            return text
        try:
            value = float(text.replace(",", "."))
        except ValueError:
            value = math.nan
        if math.isfinite(value) and self.least <= value <= self.most:
            return value
        ends = f" from {self.least:g}" * (self.least > -math.inf) + f" to {self.most:g}" * (
            self.most < math.inf
        )
        raise FieldError(f"{self.label}: expected a number{ends}")


@dataclass(frozen=True, slots=True)
class Button:
    """One of the answers of a step."""

    key: str
    label: str
    shortcut: str = ""  # as browsers name keys: "Enter", "ArrowLeft", "1", " "
    look: Literal["main", "plain"] = "plain"
    takes_fields: bool = False  # whether the fields must be filled in; else they are left out


@dataclass(frozen=True, slots=True, eq=False)
class Step:
    """What a person is shown until the next step."""

    title: str
    text: str = ""  # paragraphs with an empty line between
    picture: str | bytes = ""  # an SVG's text, or a PNG
    picture_words: str = ""  # for those who do not see it
    table: tuple[tuple[str, ...], ...] = ()  # the first row is the heading
    fields: tuple[Field, ...] = ()
    buttons: tuple[Button, ...] = ()  # none: the program goes on by itself
    seconds: float | None = None  # until it is over by itself; the page shows what is left
    progress: tuple[int, int] | None = None  # done, of so many

    def document(self, number: int) -> dict[str, Any]:
        """Return it as a page takes it."""
        shown = asdict(self)
        for field in shown["fields"]:
            del field["least"], field["most"]  # JSON has no infinity, and a page checks no number
        if self.picture:
            is_svg = isinstance(self.picture, str)
            content = self.picture.encode() if isinstance(self.picture, str) else self.picture
            kind = "svg+xml" if is_svg else "png"
            shown["picture"] = f"data:image/{kind};base64,{base64.b64encode(content).decode()}"
        return {"number": number, **shown}

    def answer(self, given: Mapping[str, Any]) -> "Answer":
        """Return what a page answered."""
        pressed = [button for button in self.buttons if button.key == given.get("button")]
        values, seconds = given.get("values"), given.get("seconds")
        if not pressed or not isinstance(values, dict):
            raise UnfitError("that is no answer to this step")
        if not isinstance(seconds, int | float) or not 0.0 <= seconds <= LONGEST_S:
            raise UnfitError("an answer takes no such time")
        fields = self.fields if pressed[0].takes_fields else ()
        read = {field.key: field.value(values.get(field.key)) for field in fields}
        return Answer(pressed[0].key, read, float(seconds))


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What a person answered."""

    button: str  # its key; "": the step's time was over
    values: Mapping[str, float | str]  # by the keys of the fields
    seconds: float  # from when the step was seen until the answer, by the page's clock
