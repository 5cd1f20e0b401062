"""Tables, the sentence and the picture of whole VR applications, from the JSON of ``vr.py``."""

from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.figure import Figure

from benchmarks.growth.plots import COLOURS, save
from benchmarks.publication.wording import short_name, table
from proximity.studies.figures.style import LOOK

Document = dict[str, Any]
HEADINGS = (
    "application", "faces", "poses, Hz", "fingers", "p50, ms", "p99", "p99.9", "of a frame",
    "a tick, µs", "of 1 ms", "service", "bridge",
)  # fmt: skip
LIBRARIES = ("library", "3 k faces, µs", "100 k", "1 M", "of 1 ms at 1 M")


def vr_table(document: Document) -> list[str]:
    """A row for each application."""
    return table(HEADINGS, [_row(row) for row in document["rows"]])


def _row(row):
    case = row["case"]
    delays = [row[f"motion_to_distance_{name}"] for name in ("p50", "p99", "p999")]
    shares = (row["service_share"], row["bridge_share"])
    return [
        case["path"] + (", moving" if case["is_moving"] else ""),
        f"{row['face_count']:,}",
        f"{case['pose_rate_hz']:g}",
        str(case["finger_count"]),
        *(f"{1e3 * each:.2f}" for each in delays),
        f"{delays[0] * case['pose_rate_hz']:.0%}",
        f"{1e6 * row['tick_p50']:.0f}",
        f"{1e3 * row['tick_p50']:.1%}",
        *("" if each is None or each != each else f"{each:.2f}" for each in shares),
    ]


def libraries_table(document: Document) -> list[str]:
    """A row for each library: medians by the number of faces."""
    found: dict[str, dict[int, Document]] = {}
    for each in document["others"]:
        title = each["library"] + ("" if each["question"] == "signed_distance" else ", unsigned")
        found.setdefault(title, {})[each["faces"]] = each
    rows = []
    for title, by_faces in found.items():
        medians = [by_faces[faces]["p50"] for faces in sorted(by_faces)]
        rows.append([title, *(f"{each:,.1f}" for each in medians), f"{medians[-1] / 1e3:.0%}"])
    return table(LIBRARIES, rows)


def vr_sentence(document: Document) -> str:
    """What answers the paper's sentence on the cost of a complete VR application."""
    rows = [row for row in document["rows"] if not row["case"]["is_moving"]]
    largest = max(row["face_count"] for row in rows)
    native, page = (
        next(row for row in rows if row["face_count"] == largest and row["case"]["path"] == path)
        for path in ("native", "page")
    )
    return (
        '"At the present time a complete VR application has not been implemented to verify the precise '
        'performance cost of these intersection checks", the paper ends. It has been now: with ten fingers '
        f"at {native['case']['pose_rate_hz']:g} Hz over a part of {largest / 1e6:.0f} M faces a tick takes "
        f"{1e6 * native['tick_p50']:.0f} µs, {1e3 * native['tick_p50']:.0%} of a haptic sample, and "
        f"{1e6 * page['tick_p50']:.0f} µs with a new pose; from a pose to its distances it is "
        f"{1e3 * native['motion_to_distance_p50']:.1f} ms in the middle, and "
        f"{1e3 * page['motion_to_distance_p50']:.1f} ms through the page of a browser "
        f"({short_name(document['machine'])}, `proximity bench --vr` for your part)."
    )


def draw_vr(document: Document, path: Path) -> list[Path]:
    """Draw motion-to-distance of each application; bars are medians, whiskers lead to p99 and p99.9."""
    rows = document["rows"]
    with mpl.rc_context(LOOK):
        figure = Figure((7.4, 4.2), layout="constrained")
        axes = figure.subplots()
        for k, row in enumerate(rows):
            case = row["case"]
            p50, p99, p999 = (1e3 * row[f"motion_to_distance_{name}"] for name in ("p50", "p99", "p999"))
            colour = COLOURS[0] if case["path"] == "native" else COLOURS[1]
            axes.barh(k, p50, color=colour, height=0.6)
            axes.plot([p50, p99], [k, k], color=colour, lw=1.5)
            axes.plot([p99, p999], [k, k], color=colour, lw=0.8, ls=":")
            axes.plot(p99, k, "|", color=colour, ms=8)
            axes.plot(p999, k, ".", color=colour, ms=5)
            axes.plot(1e3 / case["pose_rate_hz"], k, "k|", ms=12, mew=1.5)
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
    case = row["case"]
    words = [
        case["path"],
        f"{row['face_count'] / 1e3:.0f} k",
        f"{case['finger_count']} fingers",
        f"{case['pose_rate_hz']:g} Hz",
    ]
    return ", ".join([*words, *(["moving"] if case["is_moving"] else [])])
