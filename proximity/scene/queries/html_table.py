"""Tables for notebooks, which show an object by its ``_repr_html_``."""

from collections.abc import Iterable, Sequence
from html import escape
from itertools import islice
from typing import Any

from proximity.checks import shown_number

MAX_ROWS = 20


def html_table(caption: str, head: Sequence[str], rows: Iterable[Iterable[Any]], row_count: int = 1) -> str:
    """Return a table of text and numbers in HTML, with at most `MAX_ROWS` rows."""
    lines = [f"<table><caption>{escape(caption)}</caption>", _row("th", head)]
    lines += [_row("td", row) for row in islice(rows, MAX_ROWS)]
    if row_count > MAX_ROWS:
        lines.append(f'<tr><td colspan="{len(head)}">… and {row_count - MAX_ROWS} more</td></tr>')
    return "\n".join([*lines, "</table>"])


def _row(tag: str, cells: Iterable[Any]) -> str:
    texts = (str(cell) if isinstance(cell, str) else shown_number(cell) for cell in cells)
    return "<tr>" + "".join(f"<{tag}>{escape(text)}</{tag}>" for text in texts) + "</tr>"
