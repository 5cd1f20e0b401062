"""Bar charts of times beside other libraries, as SVG that is readable on light and dark pages.

The text is the same for the same figures, so that a test can compare it with the files of the documentation.
"""

import math
from html import escape
from itertools import pairwise
from typing import Any, NamedTuple

from benchmarks.publication.tables import CONTENDERS
from benchmarks.publication.wording import count_words, figure, instructions, share, short_name
from benchmarks.queries.results import BUILD, FIVE_SIGNED, OUR_TREE, OURS, RAYS, SIGNED

Document = dict[str, Any]
CASE = "plate"
PANELS = {
    SIGNED: "Time per signed distance",
    FIVE_SIGNED: "Time per call for five signed distances",
    RAYS: "Time per ray",
    BUILD: "Time to build the tree",
}
"""Titles of the kinds of work beside other libraries."""
PAIRS = {
    "bracket and gear": "CAD parts of 11 and 3.8 thousand faces",
    "84 x 84 k, gap 2 %": "Bent rings of 84 and 84 thousand faces",
}
"""Titles of the pairs in the chart of clearances."""

WIDTH, LEFT, RIGHT = 540.0, 104.0, 96.0  # of the drawing, of the names, of the numbers
ROW, BAR, TITLE, AXIS, HEAD, GAP = 24.0, 15.0, 26.0, 26.0, 46.0, 14.0
CUT, LONG = 20.0, 4.0
"""A bar that is this many times as long as the one before is cut."""
STYLE = (
    ".chart{color:#505a66;font:13px system-ui,-apple-system,'Segoe UI',sans-serif}"
    "@media(prefers-color-scheme:dark){.chart{color:#a3adba}}"
    ".chart text{fill:currentColor}.chart .grid{stroke:currentColor;stroke-opacity:.25}"
    ".chart rect{fill:currentColor;fill-opacity:.5}.chart .ours{fill:#2f80d8;fill-opacity:1}"
    ".chart .cut{stroke:currentColor;stroke-width:1.5;fill:none}"
)


class Bar(NamedTuple):
    """A time, and a remark on its answers."""

    name: str
    time: float
    remark: str = ""


class Panel(NamedTuple):
    """Bars with one axis."""

    title: str
    unit: str
    bars: list[Bar]


def charts(documents: dict[str, Document]) -> dict[str, str]:
    """Return the charts of the documentation by file name, as far as their figures are there."""
    found = {}
    if report := documents.get("report_v3"):
        machine = report["machine"]
        rows = report["rows"]
        faces = next(row["case"].split()[-2] for row in rows if row["case"].startswith(f"{CASE}, "))
        where = f"plate of {count_words(int(faces))} faces, one core, "
        where += f"{short_name(machine)}{instructions(machine)}"
        panels = [beside_others(rows, section) for section in PANELS]
        found["times_point.svg"] = drawing(panels[0].title, where, [panels[0]._replace(title="")])
        found["times.svg"] = drawing("Times beside other libraries", where, panels)
    if pairs := documents.get("pairs"):
        where = "gap of 2 % of their size, one core, called from Python"
        found["times_pairs.svg"] = drawing("Time for the clearance of two parts", where, pair_panels(pairs))
    return found


def beside_others(rows: list[Document], section: str) -> Panel:
    """Return our time for a kind of work at the plate, and each library's fastest with the same answers."""
    ours_name = OUR_TREE if section == BUILD else OURS
    at_plate = [row for row in rows if row["section"] == section and row["case"].startswith(CASE)]
    (ours,) = (row for row in at_plate if row["contender"] == ours_name)
    fastest: dict[str, Document] = {}
    for row in sorted(at_plate, key=lambda row: row["median"]):
        name = row["contender"].partition(" (")[0]
        if name != OURS and row.get("beside", ours_name) == ours_name:
            fastest.setdefault(name, row)
    bars = [Bar(name, row["median"], _remark(row)) for name, row in fastest.items()]
    return Panel(PANELS[section], ours["unit"].partition(" ")[0], [Bar(OURS, ours["median"]), *bars])


def _remark(row):
    wrong = row["agreement"]["wrong_sign_count"] if row["agreement"] else 0
    return f"{share(wrong, row['agreement']['checked_count'])} % of signs wrong" if wrong else ""


def pair_panels(document: Document) -> list[Panel]:
    """Return the times of a query of some pairs of parts."""
    panels = []
    for pair, title in PAIRS.items():
        (figures,) = (row["times"] for row in document["rows"] if row["pair"] == pair)
        times = {name: each[0] for name, each in figures.items()}
        rivals = sorted((times[key], name) for key, name in CONTENDERS.items() if key != OURS)
        bars = [Bar(OURS, times[OURS]), *(Bar(name, time) for time, name in rivals)]
        panels.append(Panel(title, "µs", bars))
    return panels


def drawing(headline: str, where: str, panels: list[Panel]) -> str:
    """Return panels below each other as SVG."""
    heights = [TITLE * bool(panel.title) + ROW * len(panel.bars) + AXIS for panel in panels]
    height = HEAD + sum(heights) + GAP * (len(panels) - 1)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" class="chart" viewBox="0 0 {WIDTH:g} {height:g}" '
        f'width="{WIDTH:g}" height="{height:g}" role="img">',
        f"<title>{escape(headline)}: {escape(_spoken(panels))}</title>",
        f"<style>{STYLE}</style>",
        _text(0, 16, headline, ' font-size="16" font-weight="600"'),
        _text(0, 35, where, ' font-size="12"'),
    ]
    top = HEAD
    for panel, size in zip(panels, heights, strict=True):
        lines += _panel(panel, top)
        top += size + GAP
    return "\n".join([*lines, "</svg>"]) + "\n"


def _spoken(panels):
    """Return the figures in words, for readers who do not see the drawing."""
    texts = (
        ", ".join(f"{bar.name} {figure(bar.time)} {panel.unit}" for bar in panel.bars) for panel in panels
    )
    return "; ".join(
        f"{panel.title}: {text}" if panel.title else text for panel, text in zip(panels, texts, strict=True)
    )


def _panel(panel, top):
    """Return the lines of one panel; bars much longer than the others are cut at the right end."""
    longest = _longest_whole(panel.bars)
    step = _step(longest)
    scale = (WIDTH - LEFT - RIGHT) / longest
    first = top + TITLE * bool(panel.title)
    bottom = first + ROW * len(panel.bars)
    lines = [_text(0, top + 14, panel.title, ' font-weight="600"')] if panel.title else []
    for k in range(math.floor(longest / step) + 1):
        x = LEFT + k * step * scale
        lines.append(f'<path class="grid" d="M{x:.1f} {first:g}V{bottom:g}"/>')
        unit = f" {panel.unit}" if k == 0 else ""
        lines.append(
            _text(x, bottom + 15, f"{figure(k * step)}{unit}", ' font-size="11" text-anchor="middle"')
        )
    for k, bar in enumerate(panel.bars):
        y = first + ROW * k + 0.5 * (ROW - BAR)
        width = scale * min(bar.time, longest)
        kind = ' class="ours"' if k == 0 else ""
        weight = ' font-weight="600"' if k == 0 else ""
        lines.append(_text(LEFT - 8, y + 12, bar.name, f' text-anchor="end"{weight}'))
        spans = [(LEFT, width)] if bar.time <= longest else [(LEFT, width - CUT), (LEFT + width - 8.0, 8.0)]
        lines += [
            f'<rect{kind} x="{x:.1f}" y="{y:g}" width="{w:.1f}" height="{BAR:g}" rx="2"/>' for x, w in spans
        ]
        if bar.time > longest:
            lines.append(f'<path class="cut" d="M{LEFT + width - CUT:.1f} {y + 17:g}l6 -19m6 0l-6 19"/>')
        unit = f" {panel.unit}" if k == 0 else ""
        words = f"{figure(bar.time)}{unit}{', ' + bar.remark if bar.remark else ''}"
        lines.append(_text(LEFT + width + 7, y + 12, words, weight))
    return lines


def _longest_whole(bars):
    """Return the time at the right end: the longest bar that is not cut."""
    rivals = sorted(bar.time for bar in bars[1:])
    shown = [time for before, time in pairwise([rivals[0], *rivals]) if time <= LONG * before]
    return max(bars[0].time, *shown)


def _step(longest):
    """Return the distance of ticks: 1, 2 or 5 times a power of ten, at most six of them."""
    power = 10.0 ** math.floor(math.log10(longest / 5.0))
    return next(power * k for k in (1.0, 2.0, 5.0, 10.0) if longest / (power * k) <= 6.0)


def _text(x, y, words, attributes=""):
    return f'<text x="{x:.1f}" y="{y:.1f}"{attributes}>{escape(words)}</text>'
