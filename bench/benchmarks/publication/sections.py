"""The page on speed and the README's small table, made from the JSON of published runs.

The text between the two marks of either is made from the files in ``bench/published`` alone; a test checks
that. ``publish.py`` measures new figures and writes it.
"""

import json
import textwrap
from pathlib import Path
from typing import Any

from benchmarks.publication.tables import (
    build_sentences,
    growth_table,
    others_table,
    pairs_table,
    period_table,
    served_table,
    summary_table,
    ticks_table,
)
from benchmarks.publication.vr_tables import libraries_table, vr_sentence, vr_table
from benchmarks.publication.wording import full_name, instructions, short_name, verdict_lines, when, whole
from benchmarks.support.project import BENCH, PROJECT

PUBLISHED = BENCH / "published"
README = PROJECT / "README.md"
PAGES = PROJECT / "docs"
PERFORMANCE = "performance"
"""The folder of the pictures, within that of the pages."""
BEGIN = "<!-- Figures: made by `python bench/publish.py` of bench/published. Edit neither by hand. -->"
END = "<!-- End of the figures. -->"
PICTURES = {
    "growth_faces": "Time, work, building and memory against the faces of a part",
    "growth_parts": "Time and work against the parts of a scene",
    "growth_centre": "Time, work and bracket in the centre of a hollow ball",
}
VR_PICTURE = ("vr", "From the pose of a hand to its distances, against the time between two poses")
SHOWN_THOUGH_MET = (
    "fingers/plate: a tick against",
    "cavity, anywhere",
    "warm/plate, outside: a track kept, against scene.closest",
    "prediction",
    "open",
    "deform",
)
WIDTH = 118
NAMES = ("report", "ticks", "service", "vr", "growth")
PAGES_OF = {
    "performance/results.md": NAMES[:-1],
    "performance/growth.md": NAMES[-1:],
    "guide/clearances.md": ("pairs",),
}
"""The runs of each page."""
KERNELS = ("_v3", "")
"""Suffixes of the names of runs made with several sets of instructions: the most common first."""
ALONE = ("memory", "proximity ")  # prefixes of requirements that concern this package only

Document = dict[str, Any]


def write(page: Path, text: str) -> None:
    """Write a text between the marks of a page.

    Raises
    ------
    ValueError
        If the page lacks the marks between which the text belongs.
    """
    page.write_text(replaced(page.read_text(encoding="utf-8"), text), encoding="utf-8")


def read(folder: Path) -> dict[str, Document]:
    """Return the documents of a folder by name: report, ticks, service, growth; those of AVX2 end in _v3."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))}


def replaced(page: str, text: str) -> str:
    """Return *page* with *text* between the marks.

    Raises
    ------
    ValueError
        Unless the marks are present, once each and in order.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end or BEGIN in rest or END in after:
        raise ValueError(f"expected one line {BEGIN!r} and below it one line {END!r}")
    return f"{before}{BEGIN}\n\n{text}\n{END}{after}"


def summary(documents: dict[str, Document]) -> str:
    """Return the README's table, and the line on its conditions."""
    reports, ticks = _runs("report", documents)[0], _runs("ticks", documents)[0]
    lines = summary_table(reports, ticks)
    machine = reports["machine"]
    how = (
        f"Medians on one core, {short_name(machine)}{instructions(machine)}, {machine['date']} (the tick: "
        f"{short_name(ticks['machine'])}, {ticks['machine']['date']}): points "
        "near a plate of 304 k faces, 87 k for the tick. proximity computes in double precision, the others "
        "in single. [All results](docs/performance/results.md), with the cases in which others are faster."
    )
    application = [_wrapped(vr_sentence(documents["vr"])), ""] if "vr" in documents else []
    ratio = "The last column is the median of paired rounds, not the quotient of the medians."
    return "\n".join([*lines, "", ratio, "", *application, _wrapped(how)]) + "\n"


def section(documents: dict[str, Document], names: tuple[str, ...]) -> str:
    """Return the text between the marks of a page with these runs; those without a document are left out."""
    if names == ("pairs",):
        return "\n".join(pairs_table(documents["pairs"])) + "\n" if "pairs" in documents else ""
    parts = {"report": _others, "ticks": _ticks, "service": _service, "vr": _vr, "growth": _growth}
    documents = {name: each for name, each in documents.items() if name.partition("_")[0] in names}
    here = [name for name in names if _runs(name, documents)]
    judged = [run for name in here for run in _runs(name, documents)[: 1 if name == "ticks" else None]]
    blocks = [_conditions(judged)] if here else []
    for name in here:
        blocks += parts[name](documents)
    texts = ("\n".join(block) if isinstance(block, list) else _wrapped(block) for block in blocks)
    return "\n\n".join(text for text in texts if text) + "\n"


def _runs(name, documents):
    """Return the runs of a command made with several sets of instructions, the most common first."""
    return [documents[name + end] for end in KERNELS if name + end in documents]


def _wrapped(paragraph):
    return textwrap.fill(paragraph, WIDTH, break_long_words=False, break_on_hyphens=False)


def _conditions(documents):
    """Return the machine, and the number of met requirements."""
    machine = documents[0]["machine"]
    asked = [each for document in documents for each in _verdicts(document)]
    met = sum(each["is_met"] for each in asked)
    judged = f" {met} of {len(asked)} requirements are met; the others are named below." if asked else ""
    return (
        f"Measured on {full_name(machine)}. One thread on one core, except for the service. Nothing is "
        f"subtracted. The machine is shared, so the tails contain what its neighbours did.{judged}"
    )


def _verdicts(document):
    """Yield all requirements judged in a document, at any depth."""
    of_rows = (verdict for row in document["rows"] for verdict in row.get("verdicts", ()))
    return [*document.get("requirements", ()), *document.get("verdicts", ()), *of_rows]


def _run(name, document, first):
    """Return the command of a run, its date and its machine."""
    machine = document["machine"]
    is_there = machine["processor"] == first["processor"]
    where = instructions(machine) if is_there else f" on {full_name(machine)}"
    return f"Made by `python bench/{name}.py`{where} ({when(machine)})."


def _first(documents):
    return next(run for name in NAMES for run in _runs(name, documents))["machine"]


def _others(documents):
    read = (
        "*Asked for* is how many times as fast proximity should be. If the fastest other library has wrong "
        "signs, a second row has the fastest whose signs are right. embreex by itself answers distances, as "
        "`cast_distance` does; *all outputs* stands beside `cast`. Points lie near the surface, at a "
        "normally distributed distance with a standard deviation of 2 % of the diagonal. Other libraries "
        "take the instructions that they find."
    )
    found = [["## Beside other libraries"], read]
    for document in _runs("report", documents):
        found += _compared(document, documents)
    return found


def _compared(document, documents):
    """Return one comparison with other libraries."""
    versions = dict.fromkeys(
        f"{row['contender'].partition(' (')[0]} {row['version']}" for row in document["rows"]
    )
    rounds = f"{document['rounds']} interleaved rounds, " if "rounds" in document else "all contenders, "
    missing = document["missing"]
    absent = f" Not there: {', '.join(missing)}." if missing else ""
    how = (
        f"{_run('report', document, _first(documents))} Medians of {rounds}whose answers were compared "
        f"before they were timed: {', '.join(versions)}.{absent}"
    )
    verdicts = [each for each in document["requirements"] if each["requirement"].startswith(ALONE)]
    rest = verdict_lines("on memory and on starting", verdicts)
    made = " ".join(build_sentences(document))
    return [how, others_table(document), made, rest]


def _ticks(documents):
    document, *others = _runs("ticks", documents)
    others += [each for name, each in documents.items() if name.startswith("ticks_") and name != "ticks_v3"]
    beside = [
        f"Beside it: {full_name(each['machine'])}, {each['machine']['date']}"
        + (f", transcribed {each['machine']['transcribed']}." if "transcribed" in each["machine"] else ".")
        for each in others
    ]
    how = (
        f"{_run('ticks', document, _first(documents))} Each tick is timed by itself, from call to answer: "
        f"{_ticks_of(document)}. {' '.join(beside)}"
    )
    read = (
        "Each case runs three times. *Shortest of 3 runs* takes the shortest time of each tick: that is what "
        "the work itself takes. *A bare loop* only counts, for as long as the median tick takes: its tail is "
        "the machine's."
    )
    period = (
        f"The same ticks in wall time on the {short_name(document['machine'])}"
        f"{instructions(document['machine'])}, as shares of 40 ms (the "
        "paper's 25 Hz), 5 ms (200 Hz), 3 ms (Kazerooni's bound), 1 ms and 0.2 ms. A tick above 100 does not "
        "fit."
    )
    return [
        ["## Ticks"],
        how.strip(),
        read,
        ticks_table([document, *others]),
        verdict_lines("on ticks", _verdicts(document)),
        _met(document),
        ["## Ticks against haptic periods"],
        period,
        period_table(document),
    ]


def _met(document):
    """Return met requirements to list; the table has those on times."""
    found = [
        each
        for each in _verdicts(document)
        if each["is_met"] and each["requirement"].startswith(SHOWN_THOUGH_MET)
    ]
    lines = [f"- {each['requirement']}: {each['measured']}" for each in found]
    return ["Met, besides those on times:", "", *lines] if lines else []


def _ticks_of(document):
    counts = [row["tick_count"] for row in document["rows"] if row["case"].startswith("fingers/")]
    return f"{whole(min(counts))} or more a case" if counts else "as many as asked for"


def _service(documents):
    document = documents["service"]
    how = f"{_run('service', document, _first(documents))} A recorded hand at 1 kHz, with the log on."
    return [
        ["## The service"],
        how,
        served_table(document),
        verdict_lines("on the service", _verdicts(document)),
    ]


def _vr(documents):
    document = documents["vr"]
    how = (
        f"{_run('vr', document, _first(documents))} Time from the pose of a hand to the frame that answers "
        "it, in front of tori, with ticks at 1 kHz. *native* publishes poses and subscribes to frames in "
        "shared memory. *page* is a page beside a service, without drawing. *moving* has one moving part."
    )
    read = (
        "On average a pose waits for half a tick. Service and bridge are shares of a core. p99.9 of about "
        "1000 poses is almost the largest. Few ticks without a new pose are sent to the page."
    )
    others = (
        "The native application with another library's signed distances instead of our tick, computed only "
        "when a pose is new. Our ticks also answer velocities, predictions and times to contact."
    )
    picture = [f"![{VR_PICTURE[1]}]({VR_PICTURE[0]}.png)"]
    heading = ["## A complete VR application"]
    return [heading, how, read, vr_table(document), others, libraries_table(document), picture]


def _growth(documents):
    document = documents["growth"]
    how = (
        f"{_run('growth', document, _first(documents))} A part is a bumpy ring of even triangles. *Near* is "
        "a normally distributed distance with a standard deviation of 2 % of its diagonal."
    )
    read = (
        "A slope is that of a straight line through the logarithms of both, fitted to the upper two decades, "
        "with its standard error. 0 is no growth, 0.5 grows as the square root, 1 in proportion. Nodes and "
        "leaves visited are the same on every machine. Where faces are much smaller than their distance, "
        "many are nearly equally far: about their square root has to be looked at."
    )
    pictures = [f"![{words}]({name}.png)" for name, words in PICTURES.items()]
    return [how, read, growth_table(document), " ".join(document["left_out"]), pictures]
