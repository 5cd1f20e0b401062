"""Tables of published figures, each made from the JSON of the command that measured it."""

import itertools
from typing import Any

from benchmarks.growth.fit import Fit
from benchmarks.growth.samples import MIN_FOR_P99, TIME, WORK
from benchmarks.publication.wording import (
    amount,
    count_words,
    figure,
    instructions,
    power,
    share,
    short_name,
    table,
    whole,
)
from benchmarks.queries.results import (
    BUILD,
    FIVE_RAYS,
    OUR_TREE,
    OURS,
    POINTS,
    PROCESS,
    RAYS,
    REQUIREMENTS,
)

Document = dict[str, Any]
US_PER_MS = 1000.0
PERIODS = {"40 ms": 40.0, "5 ms": 5.0, "3 ms": 3.0, "1 ms": 1.0, "0.2 ms": 0.2}
"""Periods of the paper's 25 Hz and 200 Hz, of Kazerooni's bound, of a tick, and of 5 kHz."""
SHARES = ("p50", "p99", "p999")
TICKS = {
    "fingers/plate": "{fingers} recorded fingers, plate of {faces} faces",
    "fingers/freeform": "{fingers} recorded fingers, even triangles, {faces} faces",
    "moving: move_many and tick": "{fingers} fingers, {parts} parts, {faces} faces, a tenth of parts moving",
    "skin/freeform: tolerance 5 %, working range 20 mm": "{fingers} points of a skin, {faces} faces, "
    "tolerance 5 %, range 20 mm",
    "cavity: at rest in the centre": "{fingers} fingers in the centre of a hollow ball of {faces} faces",
    "deform: scene.deform": "a part of {faces} faces takes another shape (`deform`)",
}
NO_TICKS = ("deform: scene.deform",)
SERVED = {
    ("a tick", "compute"): "a tick of the service, from waking to having published",
    ("a tick", "lateness"): "woken later than asked",
    ("shm", "publish, one after another"): "`publish` of a frame, shared memory, one after another",
    ("shm", "publish, reader waits"): "`publish` of a frame, shared memory, at 1 kHz",
    ("shm", "seen by a reader that spins"): "from `publish` to a reader that spins",
    ("shm", "seen by a reader that waits"): "from `publish` to a reader that waits",
    ("udp", "seen by a reader that waits"): "from `publish` to a reader that waits, by UDP",
    ("zenoh", "seen by a reader that waits"): "the same by zenoh",
    ("no service", "a loop that counts: compute"): "for comparison: a bare loop that counts to 2000",
    ("no service", "a loop that counts: lateness"): "for comparison: that loop, woken later than asked",
}
GROWTH = {
    ("faces", "tick of five fingers", TIME): "a tick of five fingers of a recorded hand",
    ("faces", "five signed points, near", TIME): "five signed points near the surface",
    ("faces", "five signed points, on the surface", TIME): "five signed points on the surface",
    ("faces", "five rays", TIME): "five rays",
    ("faces", "solid and scene", "building"): "making the scene",
    ("faces", "scene", "memory"): "its memory",
    ("parts", "tick, all at rest", TIME): "a tick of five fingers, all parts at rest",
    ("parts", "tick, 10 % moving", TIME): "a tick of five fingers, 10 % of the parts moved before",
    ("points", "signed_distance", TIME): "one call of `signed_distance`",
    ("distance", "five signed points, outside", TIME): "five signed points outside",
    ("centre", "exact signed_distance", TIME): "the worst position: an exact signed distance",
    ("centre", "finger, default budget", TIME): "the worst position: a finger with the default budget",
    ("centre", "finger, default budget", "bracket"): "the worst position: how far its bounds are apart",
    ("centre", "finger inside a full ball", "bracket"): "inside a full ball: how far they are apart",
}
CONTENDERS = {OURS: "`clearance`", "coal": "Coal", "fcl": "python-fcl", "meshlib": "MeshLib"}
FOLLOWED = ("followed at 20 mm/s", "at 200 mm/s")
PAIRS = {
    "featuretype and cycloidal": "CAD: featuretype 3.5 and cycloidal 5.8, 2 %",
    "bracket and gear": "CAD: bracket 11 and gear 3.8, 2 %",
    "two gears": "CAD: gears in mesh, 3.8 each",
    "screw in plate": "screw of 12 in a plate of 33, 0.1 mm",
    "3.5 x 3.5 k, gap 2 %": "bent rings of 3.5 and 3.5, 2 %",
    "3.5 x 84 k, gap 2 %": "3.5 and 84, 2 %",
    "84 x 84 k, gap 2 %": "84 and 84, 2 %",
    "84 x 84 k, gap 20 %": "84 and 84, 20 %",
    "peg in hole": "peg of 16 in a hole of 33, 1 % of its radius",
}
"""Pairs of parts, with thousands of faces and the gap in per cent of the size."""
AXES = {
    "faces": "faces",
    "parts": "parts",
    "points": "points",
    "distance": "diagonals away",
    "centre": "faces of a hollow ball",
}


def others_table(document: Document) -> list[str]:
    """Return each requirement on a comparison: ours, the fastest of the named ones, and whether it is met.

    Each part has a table, which a page shows folded. For rays the second fastest follows: embreex answers
    distances alone, or all fields of ours, and is compared with the same answers of ours. If signs of the
    fastest are wrong, the fastest with right signs follows.
    """
    rows, met = document["rows"], {True: "yes", False: "no"}
    parts: dict[str, list[list[str]]] = {}
    for wanted in REQUIREMENTS:
        name = OUR_TREE if wanted.section == BUILD else OURS
        for ours in (row for row in rows if (row["section"], row["contender"]) == (wanted.section, name)):
            for best in _shown(rows, ours, wanted):
                part = ours["case"].partition("/")[0].partition(",")[0]
                ratio = best["times_ours"]
                works = f"{wanted.section}, {ours['unit'].replace('a query', 'each')}"
                cells = [works, _time(_beside(rows, ours, best)), _other(best), figure(ratio)]
                parts.setdefault(part, []).append([*cells, f"{wanted.least:.2g}", met[ratio >= wanted.least]])
    return [line for part, lines in parts.items() for line in _folded(part, lines, _faces(rows, part))]


def _folded(part, lines, faces):
    """Return the table of a part, folded under its name."""
    count = sum(line[-1] == "yes" for line in lines)
    for earlier, later in reversed(list(itertools.pairwise(lines))):
        if earlier[0] == later[0]:
            later[:2] = "", "" if earlier[1] == later[1] else later[1]
    headings = ("work", "proximity", "best other", "times as fast", "asked for", "met")
    summary = f"<summary>{part}{faces}: {count} of {len(lines)} met</summary>"
    return ['<details markdown="1">', summary, "", *table(headings, lines), "", "</details>", ""]


def _faces(rows, part):
    """Return the number of faces of a part in words, as far as its building was measured."""
    built = (row["case"].split() for row in rows if row["section"] == BUILD)
    return next((f", {count_words(int(words[-2]))} faces" for words in built if words[0] == f"{part},"), "")


def pairs_table(document: Document) -> list[str]:
    """Return medians and 99th percentiles of the times of pairs of parts, of all contenders."""
    rows = {row["pair"]: row for row in document["rows"]}
    lines = [
        [
            words,
            *(_with_tail(rows[pair]["times"][name]) for name in (*CONTENDERS, *FOLLOWED)),
            *(whole(rows[pair]["cold"][name][0]) for name in (OURS, "coal")),
        ]
        for pair, words in PAIRS.items()
        if pair in rows
    ]
    cold = ("`clearance` after other work", "Coal after other work")
    return table(("pair, gap in per cent of the size", *CONTENDERS.values(), *FOLLOWED, *cold), lines)


def _with_tail(times):
    return f"{whole(times[0])} ({whole(times[1])})"


def summary_table(report: Document, ticks: Document) -> list[str]:
    """Return each kind of work at the plate, with the fastest other with right signs; and a tick.

    Points without signs are on the page of all results only.
    """
    rows = report["rows"]
    lines = []
    for wanted in (each for each in REQUIREMENTS if each.section != POINTS):
        name = OUR_TREE if wanted.section == BUILD else OURS
        for ours in (row for row in rows if (row["section"], row["contender"]) == (wanted.section, name)):
            shown = _shown(rows, ours, wanted) if ours["case"].startswith("plate") else []
            rivals = [row for row in shown if not _wrong(row)][:1]
            work = f"{wanted.section}, {ours['unit'].replace('a query', 'each')}"
            lines += [
                [work, _time(_beside(rows, ours, best)), _other(best), figure(best["times_ours"])]
                for best in rivals
            ]
    (tick,) = (row for row in ticks["rows"] if row["case"] == "fingers/plate")
    times = f"{figure(tick['thread']['p50'])} (p99 {figure(tick['thread']['p99'])})"
    lines.append([f"a tick of {tick['finger_count']} fingers, µs", times, "", ""])
    return table(("work", "proximity", "fastest other with right signs", "times as fast"), lines)


def _shown(rows, ours, wanted):
    found = [
        row
        for row in rows
        if (row["section"], row["case"]) == (ours["section"], ours["case"])
        and row["contender"].startswith(wanted.rivals)
        and row["times_ours"] is not None
    ]
    if not found:
        return []
    first, *others = sorted(found, key=lambda row: row["median"])
    if _wrong(first):
        others = [row for row in others if not _wrong(row)]
    return [first, *others[: 1 if _wrong(first) or wanted.section in (RAYS, FIVE_RAYS) else 0]]


def _beside(rows, ours, other):
    """Return the row of ours by which the other's time was divided."""
    same = ours | {"contender": other.get("beside", ours["contender"])}
    keys = ("section", "case", "contender")
    return next((row for row in rows if all(row[key] == same[key] for key in keys)), ours)


def _wrong(row):
    return row["agreement"]["wrong_sign_count"] if row["agreement"] else 0


def _time(row):
    tail = f" (p99 {figure(row['p99'])})" if "call" in row["unit"] else ""
    return f"{figure(row['median'])}{tail}"


def _other(row):
    wrong = _wrong(row)
    remark = f", {share(wrong, row['agreement']['checked_count'])} % of its signs wrong" if wrong else ""
    return f"{_time(row)} {row['contender']}{remark}"


def build_sentences(document: Document) -> list[str]:
    """Return sentences on the cost of a whole scene and of the program."""
    built = [row for row in document["rows"] if (row["section"], row["contender"]) == (BUILD, OURS)]
    lines = [
        f"A whole scene, sign and all, of {count_words(int(row['case'].split()[-2]))} faces is made in "
        f"{amount(row['median'], row['unit'])} and takes {row['bytes_per_face']:.0f} bytes a face."
        for row in built[-1:]
    ]
    processes = [row for row in document["rows"] if row["section"] == PROCESS]
    commands = ", ".join(f"`{row['case'].partition(',')[0]}` {row['median']:.2g} s" for row in processes)
    return [*lines, f"From start to end: {commands} (of a file of 50 000 faces)."] if commands else lines


def ticks_table(documents: list[Document]) -> list[str]:
    """Return thread times of ticks, a column for each machine, and which of them is faster."""
    speeds = [_row(document, "fingers/plate") for document in documents]
    named = []
    for document, row in zip(documents, speeds, strict=True):
        machine = document["machine"]
        order = _rank(row, speeds)
        named.append(
            ", ".join([f"{short_name(machine)}{instructions(machine)}", *order, machine["date"][:10]])
        )
    lines = []
    for case, words in TICKS.items():
        rows = [_row(document, case) for document in documents]
        if rows[0] is not None:
            cells = [_percentiles(row, "thread") for row in rows]
            alike = [_percentiles(rows[0], kind) for kind in ("best", "bare")]
            lines.append([_worded(words, rows[0]), cells[0], *alike, *cells[1:]])
    beside = "shortest of 3 runs there", "a bare loop there"
    headings = ("µs of thread time: p50, p99, p99.9", named[0], *beside, *named[1:])
    return table(headings, lines)


def _rank(row, rows):
    if row is None or len(rows) < 2 or None in rows:
        return []
    medians = sorted(each["thread"]["p50"] for each in rows)
    words = {medians[0]: ["the faster"], medians[-1]: ["the slower"]}
    return words.get(row["thread"]["p50"], []) if medians[0] < medians[-1] else []


def _row(document, case):
    return next((row for row in document["rows"] if row["case"] == case), None)


def _worded(words, row):
    return words.format(
        fingers=whole(row["finger_count"]),
        parts=row["part_count"],
        faces=count_words(row["face_count"]),
    )


def _percentiles(row, kind):
    figures = row and row.get(kind)
    if not figures:
        return ""
    names = SHARES if row.get("tick_count", MIN_FOR_P99) >= MIN_FOR_P99 else SHARES[:1]
    return ", ".join(figure(figures[name]) for name in names if figures[name] is not None)


def period_table(document: Document) -> list[str]:
    """Return the wall time of ticks as shares of haptic periods."""
    lines = []
    for case, words in TICKS.items():
        row = _row(document, case)
        if row is not None and row["wall"] and case not in NO_TICKS:
            wall = [row["wall"][name] for name in SHARES]
            periods = [US_PER_MS * ms for ms in PERIODS.values()]
            shares = [" / ".join(share(us, period) for us in wall) for period in periods]
            lines.append([_worded(words, row), *shares])
    return table(("% of the period: p50 / p99 / p99.9", *PERIODS), lines)


def served_table(document: Document) -> list[str]:
    """Return the times and lateness of the service."""
    rows = {(row["address"], row["what"]): row for row in document["rows"]}
    lines = []
    for key, words in SERVED.items():
        if key in rows:
            row = rows[key]
            figures = [figure(row["figures"][name]) for name in (*SHARES, "maximum")]
            lines.append([words, whole(row["count"]), *figures])
    return table(("µs", "samples", "p50", "p99", "p99.9", "longest"), lines)


def growth_table(document: Document) -> list[str]:
    """Return the range of a cost, and its slope at the upper end."""
    fits = [Fit(**fit) for fit in document["fits"]]
    slopes = {(fit.axis, fit.series, fit.quantity): fit.words for fit in fits}
    lines = []
    for (axis, series, quantity), words in GROWTH.items():
        key = (axis, series, quantity)
        own = [row for row in document["rows"] if (row["axis"], row["series"], row["quantity"]) == key]
        if own:
            first, last = own[0], own[-1]
            reach = f"{power(first['x'])} to {power(last['x'])} {AXES[axis]}"
            ends = [amount(row["median"], row["unit"].partition(" of")[0]) for row in (first, last)]
            work = slopes.get((axis, series, WORK), "") if quantity == TIME else ""
            lines.append([words, reach, " to ".join(ends), slopes.get(key, ""), work])
    headings = ("cost of", "from, to", "median there", "slope", "slope of nodes and leaves")
    return table(headings, lines, right=2)
