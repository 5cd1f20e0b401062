"""Show one finger of a frame as cells of a table, in words or as JSON values.

The cells include a bar, whose length is the clearance of the finger on a scale from 0 to `SCALE_MM`. If the
finger touches, the whole bar is a red field.
"""

import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from rich.text import Text

from proximity.cli.output import MM_PER_M
from proximity.cli.tables import Drawn
from proximity.message import ContactFlag, Mode, Source, State, Surface
from proximity.system.time_units import MS_PER_S

HEADER_FIELDS = (
    "session", "sequence", "pose_ns", "start_ns", "publish_ns", "valid_until_ns", "period_ns", "epoch",
    "missed",
)  # fmt: skip
NAMED: dict[str, type[IntEnum]] = {"mode": Mode, "surface": Surface, "source": Source}
SCALE_MM = 120.0
"""Largest distance on the scale, which is the default working range of the tracker."""
MARKS_MM = (0, 30, 60, 90, 120)
MIN_BAR, MAX_BAR = 25, 60
EIGHTHS = " ▏▎▍▌▋▊▉"
BETWEEN = "▒"
PREDICTED = "◆"
BEYOND = "»"
TOUCH_STYLE = "bold white on red"
MAY_TOUCH_STYLE = "red"
FEW_DIGITS_FROM = 1000.0  # mm
UNKNOWN = "?"
NONE = "-"

FLAG_LETTERS = {
    ContactFlag.TRACKED: ("T", "tracked"),
    ContactFlag.PREDICTED: ("P", "predicted"),
    ContactFlag.EXACT: ("E", "exact"),
    ContactFlag.BOUNDED: ("B", "bounded"),
    ContactFlag.SKIPPED: ("K", "skipped"),
    ContactFlag.SIGNED: ("S", "side known"),
    ContactFlag.INSIDE: ("I", "inside"),
    ContactFlag.IN_RANGE: ("R", "in range"),
    ContactFlag.PART_CHANGED: ("N", "new part"),
    ContactFlag.JUMPED: ("J", "jumped"),
    ContactFlag.ON_PATH: ("W", "on its path"),
    ContactFlag.CONTACT_FOUND: ("C", "contact found"),
}
"""Letter and meaning of each flag. A letter is always in the same position."""
MODE_STYLES: dict[int, str] = {
    Mode.RETRACT: "green",
    Mode.POSITION: "yellow",
    Mode.FORCE: "magenta",
    Mode.HOLD: "red",
}
FREE_STYLE = "green"
CLOSING_STYLE = "yellow"


def is_tracked(contacts: np.ndarray) -> np.ndarray:
    """Return which *contacts*, (N,) CONTACT, belong to tracked fingers."""
    return (contacts["flags"] & ContactFlag.TRACKED) != 0


def finger_cells(contact: Any, part_names: Sequence[str] = ()) -> dict[str, Text | Drawn]:
    """Return the cells of a finger by the names of their columns.

    *part_names*: names in the order of the parts' numbers. A part without a name is shown by its number.
    """
    cells: dict[str, Text | Drawn] = {
        "finger": Text(str(contact["finger"]), "bold"),
        "mode": _mode(contact),
        "flags": _flags(contact),
    }
    if not is_tracked(contact):
        unknown = dict.fromkeys(("part", "distance mm", "touch in", "closing"), Text(UNKNOWN, "red"))
        return {**cells, **unknown, "bar": _bar_cell(lambda width: Text("not tracked"[:width], "red"))}
    lower, upper = MM_PER_M * float(contact["lower"]), MM_PER_M * float(contact["upper"])
    predicted = float(contact["predicted_distance"]) if contact["flags"] & ContactFlag.PREDICTED else math.nan
    style = CLOSING_STYLE if math.isfinite(contact["time_to_contact"]) else FREE_STYLE
    return {
        **cells,
        "part": Text(_part(int(contact["part"]), part_names)),
        "distance mm": Text(_distance(lower, upper)),
        "bar": _bar_cell(lambda width: bar(lower, upper, MM_PER_M * predicted, width, style)),
        "touch in": Text(_time(contact)),
        "closing": Text(_speed(float(contact["approach_speed"]))),
    }


def _bar_cell(draw: Callable[[int], Text]) -> Drawn:
    return Drawn(draw, MIN_BAR, MAX_BAR)


def finger_words(contact: Any, part_names: Sequence[str] = ()) -> str:
    """Return the contact of a finger, or of a connection of a held part, in words."""
    if not is_tracked(contact):
        return f"{contact['finger']}: not tracked"
    lower, upper = MM_PER_M * float(contact["lower"]), MM_PER_M * float(contact["upper"])
    soon = _time(contact)
    touch = f", touch in {soon}" if soon not in (NONE, UNKNOWN, "now") else ""
    if contact["source"] == Source.HELD:
        to = f"to {_part(int(contact['part']), part_names)}: " if contact["part"] >= 0 else ""
        return f"{to}{_distance(lower, upper)} mm{touch}"
    return f"{contact['finger']}: {_distance(lower, upper)} mm{touch}, {_mode(contact)}"


def frame_document(frame: Any, part_names: Sequence[str]) -> dict[str, Any]:
    """Return a frame as values for JSON, with the fields of its header and of each contact.

    *part_names*: names in the order of the parts' numbers. If they are empty, ``part_name`` is null.
    """
    header = frame["header"]
    return {
        "state": _name(State, header["state"]),
        **{field: header[field].item() for field in HEADER_FIELDS},
        "fingers": [_finger(contact, part_names) for contact in frame["contacts"]],
    }


def _finger(contact: Any, part_names: Sequence[str]) -> dict[str, Any]:
    fields = {field: contact[field].tolist() for field in contact.dtype.names}
    part, flags = fields["part"], fields["flags"]
    return fields | {
        **{field: _name(kind, fields[field]) for field, kind in NAMED.items()},
        "flags": [str(flag.name).lower() for flag in ContactFlag if flags & flag],
        "force_is_valid": bool(fields["force_is_valid"]),
        "part_name": part_names[part] if 0 <= part < len(part_names) else None,
    }


def _name(kind: type[IntEnum], number: Any) -> str:
    """Return the name of a member of an enumeration, or its number if it is not known here."""
    return kind(number).name.lower() if number in set(kind) else str(number)


def _part(number: int, names: Sequence[str]) -> str:
    if number < 0:
        return NONE
    # A name is untrusted text, and must not move the cursor.
    name = "".join(letter for letter in names[number] if letter.isprintable()) if number < len(names) else ""
    return name or str(number)


def _distance(lower: float, upper: float) -> str:
    """Return a distance as text, mm, or its bounds if they differ."""
    if math.isclose(lower, upper, rel_tol=1e-12):
        return f"{lower + 0.0:.2f}"
    digits = 1 if max(abs(lower), abs(upper)) < FEW_DIGITS_FROM else 0
    at_least = f"{lower + 0.0:.{digits}f}"
    return f"{at_least}…{upper + 0.0:.{digits}f}" if math.isfinite(upper) else f"≥ {at_least}"


def _time(contact: Any) -> str:
    """Return the time to contact as text, or its lower bound if the distance is not exact."""
    seconds, at_least = float(contact["time_to_contact"]), float(contact["time_to_contact_lower"])
    if math.isnan(seconds):
        return UNKNOWN
    if contact["upper"] <= 0.0:
        return "now"
    if math.isinf(seconds):
        return NONE
    is_exact = bool(contact["flags"] & ContactFlag.EXACT)
    return f"{MS_PER_S * seconds:.0f} ms" if is_exact else f"≥ {MS_PER_S * at_least:.0f} ms"


def _speed(speed: float) -> str:
    return UNKNOWN if math.isnan(speed) else f"{MM_PER_M * speed + 0.0:.0f} mm/s"


def _mode(contact: Any) -> Text:
    number = int(contact["mode"])
    return Text(_name(Mode, number), MODE_STYLES.get(number, ""))


def _flags(contact: Any) -> Text:
    return Text(
        "".join(letter if contact["flags"] & flag else "·" for flag, (letter, _) in FLAG_LETTERS.items())
    )


def ruler(width: int) -> str:
    """Return the scale that is shown above the bars."""
    cells = [" "] * width
    for mark in MARKS_MM[:: 1 if width >= 24 else 2 if width >= 12 else 4]:
        text = str(mark)
        first = min(round(mark / SCALE_MM * width), width - len(text))
        cells[first : first + len(text)] = text
    return "".join(cells)


def bar(lower_mm: float, upper_mm: float, predicted_mm: float, width: int, style: str) -> Text:
    """Return a bar that shows a distance.

    *lower_mm*: lower bound, which is the full part of the bar. *upper_mm*: upper bound, up to which the bar
    is shaded. *predicted_mm*: predicted distance, shown as a mark if it is on the scale.
    """
    if upper_mm <= 0.0:
        return touch(-lower_mm, width)
    cells = list(filled(_cells(lower_mm, width)))
    cells += [BETWEEN] * (math.ceil(_cells(upper_mm, width)) - len(cells))
    cells += [" "] * (width - len(cells))
    if lower_mm > SCALE_MM:
        cells[-1] = BEYOND
    drawn = Text("".join(cells), MAY_TOUCH_STYLE if lower_mm <= 0.0 else style)
    if 0.0 <= predicted_mm < SCALE_MM:
        cell = int(_cells(predicted_mm, width))
        drawn = drawn[:cell] + Text(PREDICTED, "bold") + drawn[cell + 1 :]
    return drawn


def filled(cells: float) -> str:
    """Return the full part of a bar that is *cells* cells long, to an eighth of a cell."""
    full, eighths = divmod(math.floor(8.0 * cells), 8)
    return "█" * full + (EIGHTHS[eighths] if eighths else "")


def touch(depth_mm: float, width: int) -> Text:
    """Return the red field that is shown for a touching finger."""
    reported = f"{depth_mm + 0.0:.2f} mm inside"
    if width > len(reported) + len("touches, "):
        reported = f"touches, {reported}"
    return Text(reported[:width].center(width), TOUCH_STYLE)


def _cells(distance_mm: float, width: int) -> float:
    """Return the number of cells for a distance, at most that of the whole scale."""
    return min(max(distance_mm, 0.0), SCALE_MM) / SCALE_MM * width
