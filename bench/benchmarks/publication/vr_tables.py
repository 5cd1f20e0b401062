"""Tables, sentence and picture of whole VR applications, from the JSON of ``vr.py``."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from benchmarks.growth.plots import COLOURS, save
from benchmarks.publication.wording import short_name, table
from benchmarks.service.vr_application import HEADINGS, PATHS, TICK_S, VrRow
from proximity.lab.figures.style import LOOK

Document = dict[str, Any]


def vr_table(document: Document) -> list[str]:
    """Return a row for each application."""
    return table(HEADINGS, [row.cells for row in _rows(document)])


def _rows(document):
    return [VrRow.of(row) for row in document["rows"]]


def libraries_table(document: Document) -> list[str]:
    """Return a row for each library and part."""
    others = [(each["library"], VrRow.of(each["row"])) for each in document["others"]]
    return table(HEADINGS, [[name, *row.cells[1:]] for name, row in others])


def vr_sentence(document: Document) -> str:
    """Return the answer to the paper's sentence on the cost of a complete VR application."""
    rows = [row for row in _rows(document) if not row.case.is_moving]
    largest = max(row.face_count for row in rows)
    native, page = (
        next(row for row in rows if (row.face_count, row.case.path) == (largest, path)) for path in PATHS
    )
    return (
        'The paper on the glove ends: "At the present time a complete VR application has not been '
        'implemented to verify the precise performance cost of these intersection checks." Here it is: with '
        f"{native.case.finger_count} fingers tracked at {native.case.pose_rate_hz:g} Hz over a part of "
        f"{largest / 1e6:.0f} M faces, a tick takes {1e6 * native.tick_p50:.0f} µs when a new pose has "
        f"come, {native.tick_p50 / TICK_S:.0%} of a haptic sample, otherwise "
        f"{1e6 * (native.idle_tick_p50 or 0.0):.0f} µs. "
        f"From a pose to its distances takes {1e3 * native.motion_to_distance_p50:.1f} ms, "
        f"and {1e3 * page.motion_to_distance_p50:.1f} ms over the web socket of a page (medians, "
        f"{short_name(document['machine'])}; `python bench/vr.py PART` measures your part)."
    )


def draw_vr(document: Document, path: Path) -> list[Path]:
    """Draw motion-to-distance of each application; bars are medians, whiskers lead to p99 and p99.9."""
    rows = _rows(document)
    with mpl.rc_context(LOOK):
        figure = Figure((7.4, 4.2), layout="constrained")
        axes = figure.subplots()
        for k, row in enumerate(rows):
            delays = (row.motion_to_distance_p50, row.motion_to_distance_p99, row.motion_to_distance_p999)
            p50, p99, p999 = (1e3 * each for each in delays)
            colour = COLOURS[PATHS.index(row.case.path)]
            axes.barh(k, p50, color=colour, height=0.6)
            axes.plot([p50, p99], [k, k], color=colour, lw=1.5)
            axes.plot([p99, p999], [k, k], color=colour, lw=0.8, ls=":")
            axes.plot(p99, k, "|", color=colour, ms=8)
            axes.plot(p999, k, ".", color=colour, ms=5)
            axes.plot(1e3 / row.case.pose_rate_hz, k, "k|", ms=12, mew=1.5)
        axes.set_yticks(range(len(rows)), [_label(row) for row in rows])
        axes.invert_yaxis()
        axes.set_xlim(0)
        axes.set_xlabel(
            "from a pose to its distances, ms: bar p50, tick p99, dot p99.9; black: the next pose"
        )
        figure.suptitle(
            f"{short_name(document['machine'])}, {document['machine']['date'][:10]}",
            fontsize=8,
            ha="right",
            x=0.99,
        )
        return save(figure, path)


def _label(row):
    application, faces, poses, fingers, *_ = row.cells
    return f"{application}, {faces} faces, {fingers} fingers, {poses} Hz"
