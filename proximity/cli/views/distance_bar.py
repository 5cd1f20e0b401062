"""A distance drawn as a bar of characters: its lower bound, upper bound and predicted value.

The scale is from 0 to `SCALE_MM`. The bar is as long as the room that a finger has: it shrinks as the finger
comes near. Of a touch the whole bar is a red field that says so.
"""

import math

from rich.text import Text

SCALE_MM = 120.0
"""As far as the tracker searches by default."""
MARKS_MM = (0, 30, 60, 90, 120)
FEW_MARKS_MM = (0, 60, 120)
MARKS_WIDTH = 24  # cells
EIGHTHS = " ▏▎▍▌▋▊▉"
BETWEEN = "▒"
PREDICTED = "◆"
BEYOND = "»"
TOUCH_STYLE = "bold white on red"
MAY_TOUCH_STYLE = "red"


def ruler(width: int) -> str:
    """Return the scale that stands above the bars."""
    cells = [" "] * width
    for mark in MARKS_MM if width >= MARKS_WIDTH else FEW_MARKS_MM:
        text = str(mark)
        first = min(round(mark / SCALE_MM * width), width - len(text))
        cells[first : first + len(text)] = text
    return "".join(cells)


def bar(lower_mm: float, upper_mm: float, predicted_mm: float, width: int, style: str) -> Text:
    """Return the bar of a distance.

    *lower_mm*: it is no less: the full part of the bar. *upper_mm*: it is no more: up to there the bar is
    shaded. *predicted_mm*: where it will be soon: a mark; none where that is not on the scale.
    """
    if upper_mm <= 0.0:
        return touch(-lower_mm, width)
    full, eighths = divmod(math.floor(8.0 * _cells(lower_mm, width)), 8)
    cells = ["█"] * full + ([EIGHTHS[eighths]] if eighths else [])
    cells += [BETWEEN] * (math.ceil(_cells(upper_mm, width)) - len(cells))
    cells += [" "] * (width - len(cells))
    if lower_mm > SCALE_MM:
        cells[-1] = BEYOND
    drawn = Text("".join(cells), MAY_TOUCH_STYLE if lower_mm <= 0.0 else style)
    if 0.0 <= predicted_mm < SCALE_MM:
        cell = int(_cells(predicted_mm, width))
        drawn = drawn[:cell] + Text(PREDICTED, "bold") + drawn[cell + 1 :]
    return drawn


def touch(depth_mm: float, width: int) -> Text:
    """Return the red field of a finger that touches."""
    reported = f"{depth_mm + 0.0:.2f} mm inside"
    if width > len(reported) + len("touches, "):
        reported = f"touches, {reported}"
    return Text(reported[:width].center(width), TOUCH_STYLE)


def _cells(distance_mm: float, width: int) -> float:
    """Number of cells for a distance, within the scale."""
    return min(max(distance_mm, 0.0), SCALE_MM) / SCALE_MM * width
