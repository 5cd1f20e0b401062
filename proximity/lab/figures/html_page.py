"""Pages of one HTML file that opens anywhere: a template filled in by Jinja, with figures and style in it."""

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from proximity.system.extras import needed


def render_page(
    template: Path,
    values: Mapping[str, Any],
    draw: Callable[[], Mapping[str, str]],
    filters: Iterable[Callable[..., Any]],
) -> str:
    """Return a page."""
    with needed("pages need", "sim"):
        import_module("jinja2")  # before anything is drawn
        markup = import_module("markupsafe").Markup
    style = markup(Path(__file__).with_name("page_style.css").read_text(encoding="utf-8"))
    pictures = {name: markup(picture) for name, picture in draw().items()}
    return filled_in(template, {**values, "style": style, "pictures": pictures}, filters)


def filled_in(
    template: Path,
    values: Mapping[str, Any],
    filters: Iterable[Callable[..., Any]] = (),
    *,
    is_html: bool = True,
) -> str:
    """Return a template with values filled in; in HTML, with what they have of its signs escaped."""
    with needed("pages need", "sim"):
        jinja = import_module("jinja2")
    environment = jinja.Environment(
        autoescape=is_html, trim_blocks=True, lstrip_blocks=True, undefined=jinja.StrictUndefined
    )
    environment.filters |= {each.__name__: each for each in filters}
    text: str = environment.from_string(template.read_text(encoding="utf-8")).render(values)
    return text.lstrip() + "\n"
