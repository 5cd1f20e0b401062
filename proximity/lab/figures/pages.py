"""HTML pages without external files, made from a Jinja template, figures and a style.

Figures are SVG in the colours of the page. Strokes in `INK` and `FAINT` take the colour of the surrounding
text, so that pictures are readable on a light and on a dark background.
"""

import re
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from proximity.lab.figures import style
from proximity.system.extras import needed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

INK, FAINT = "#010203", "#040506"
"""Placeholders for the page's text colour and a faint variant of it."""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", INK, INK)
DASHES = ("-", "-", "--", "-.", (0, (4, 1, 1, 1)), ":", "-", (0, (1, 1)))
WIDE, HIGH = 7.6, 3.4  # inches
LOOK = {
    "text.color": INK, "axes.labelcolor": INK, "axes.edgecolor": INK, "xtick.color": INK, "ytick.color": INK,
    "axes.facecolor": "none", "figure.facecolor": "none", "savefig.facecolor": "none", "grid.color": FAINT,
    "legend.labelcolor": INK,
}  # fmt: skip


def svg(draw: Callable[["Figure", Any], None], name: str, size: tuple[float, float] = (WIDE, HIGH)) -> str:
    """Return a figure as an SVG element of a page."""
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


def render_page(
    template: Path,
    values: Mapping[str, Any],
    draw: Callable[[], Mapping[str, str]],
    filters: Iterable[Callable[..., Any]],
) -> str:
    """Return the HTML text of a page."""
    with needed("pages need", "picture"):
        import_module("jinja2")  # before drawing
        markup = import_module("markupsafe").Markup
    sheet = markup(Path(__file__).with_name("page_style.css").read_text(encoding="utf-8"))
    pictures = {name: markup(picture) for name, picture in draw().items()}
    return filled_in(template, {**values, "style": sheet, "pictures": pictures}, filters)


def filled_in(
    template: Path,
    values: Mapping[str, Any],
    filters: Iterable[Callable[..., Any]] = (),
    *,
    is_html: bool = True,
) -> str:
    """Return the text of a template with values filled in, which are escaped in HTML."""
    with needed("pages need", "picture"):
        jinja = import_module("jinja2")
    environment = jinja.Environment(
        autoescape=is_html, trim_blocks=True, lstrip_blocks=True, undefined=jinja.StrictUndefined
    )
    environment.filters |= {each.__name__: each for each in filters}
    text: str = environment.from_string(template.read_text(encoding="utf-8")).render(values)
    return text.lstrip() + "\n"
