"""Figures as SVG that may stand in a page, in the page's own colours.

What is drawn in `INK` and `FAINT` takes the colour of the text around it, so that pictures can be read on
light and on dark.
"""

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from proximity.lab.figures import style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, FAINT = "#010203", "#040506"
"""Stand for the page's colour of text, and a faint one of it."""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", INK, INK)
DASHES = ("-", "-", "--", "-.", (0, (4, 1, 1, 1)), ":", "-", (0, (1, 1)))
WIDE, HIGH = 7.6, 3.4  # inches
LOOK = {
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.facecolor": "none", "figure.facecolor": "none", "savefig.facecolor": "none", "grid.color": FAINT,
    "legend.labelcolor": INK,
}  # fmt: skip


def svg(draw: Callable[["Figure", Any], None], name: str, size: tuple[float, float] = (WIDE, HIGH)) -> str:
    """Return a figure as an element of a page."""
    drawn = style.render(draw, None, size, "svg", look=LOOK).decode()
    text = drawn[drawn.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", text).replace("xlink:href", "href")
    text = re.sub(r'\bid="', f'id="{name}-', text)
    text = re.sub(r'href="#', f'href="#{name}-', text).replace("url(#", f"url(#{name}-")
    text = re.sub(
        r'<svg [^>]*?(viewBox="[^"]*")[^>]*>', rf'<svg \1 role="img" aria-label="{name}">', text, count=1
    )
    return text.replace(INK, "currentColor").replace(FAINT, "var(--faint)")
