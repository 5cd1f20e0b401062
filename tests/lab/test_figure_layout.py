"""Figures at the widths of journals: texts are within the page and do not overlap."""

from itertools import combinations

import matplotlib.text
import numpy as np
import pytest

from proximity.lab.figures import (
    catalogue,
    error_plots,
    style,
)

WIDTHS = (0.086, 0.120, 0.178)  # m: one column, one and a half, and a page
OVERLAP = 0.5  # pixels at 300 per inch, for rounding


@pytest.fixture(scope="module")
def tables():
    """Return the tables of all figures, with few points if they need simulated presses."""
    with pytest.MonkeyPatch.context() as few:
        few.setattr(error_plots, "SPEEDS", (0.1, 1.0))
        few.setattr(error_plots, "LATENCIES", (1e-4, 0.040))
        few.setattr(error_plots, "STAIRS", 1)
        yield {name: plate.numbers() for name, plate in catalogue.PLATES.items()}


def drawn_texts(monkeypatch, draw, table, size, sheet):
    """Return the drawn texts with their boxes and the box of the page, in pixels."""
    texts, draw_text = {}, matplotlib.text.Text.draw

    def watch(text, renderer):
        if text.get_visible() and text.get_text().strip():
            texts[text] = text.get_text(), text.get_window_extent(renderer), text.figure.bbox.frozen()
        draw_text(text, renderer)

    with monkeypatch.context() as watched:
        watched.setattr(matplotlib.text.Text, "draw", watch)
        style.render(draw, table, size, "png", sheet=sheet)
    return list(texts.values())


def check_texts(texts):
    """Assert that texts are within the page and do not overlap."""
    assert len(texts) > 5
    for words, box, page in texts:
        assert min(box.x0 - page.x0, page.x1 - box.x1, box.y0 - page.y0, page.y1 - box.y1) > -OVERLAP, words
    for (words, box, _), (others, other, _) in combinations(texts, 2):
        shared = np.minimum(box.max, other.max) - np.maximum(box.min, other.min)
        assert shared.min() < OVERLAP, (words, others)


@pytest.mark.parametrize("has_caption", [True, False])
@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", catalogue.PLATES)
def test_texts_of_a_figure_stay_on_the_page_and_apart(name, width, has_caption, tables, monkeypatch):
    plate, sheet = catalogue.PLATES[name], style.Sheet(width, has_caption=has_caption)
    check_texts(drawn_texts(monkeypatch, plate.draw, tables[name], plate.size, sheet))


def test_panels_stand_below_one_another_in_a_column(tables, monkeypatch):
    plate = catalogue.PLATES["stability"]
    columns = {}
    for width in (0.086, 0.178):
        texts = drawn_texts(monkeypatch, plate.draw, tables["stability"], plate.size, style.Sheet(width))
        titles = [box for words, box, _ in texts if words.startswith(("(a)", "(b)"))]
        columns[width] = titles[0].y0 == pytest.approx(titles[1].y0)
    assert columns == {0.086: False, 0.178: True}
