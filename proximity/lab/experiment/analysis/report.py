"""Report of an experiment: one page, plots, tables as CSV, and the methods paragraph."""

import base64
import csv
import io
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from proximity.lab.experiment.analysis.findings import MEANING, Findings, shown
from proximity.lab.experiment.analysis.plots import draw_plots
from proximity.lab.experiment.design import CHOICES, Kind, Procedure
from proximity.lab.figures.pages import filled_in
from proximity.lab.figures.style import write_bytes

HERE = Path(__file__).parent
METHODS = {
    Procedure.CONSTANT: "the method of constant stimuli",
    Procedure.STAIRCASE: "a 3-down-1-up staircase",
    Procedure.QUEST: "QUEST+ (Watson 2017)",
}
ASKED = {
    Kind.STIFFER: "say which of two surfaces is stiffer",
    Kind.REAL: "say which of two walls is the real one",
    Kind.RATING: "rate the stiffness of a surface",
    Kind.CONTACT: "touch a surface once",
    Kind.FREE: "explore a surface",
}


def write_report(findings: Findings, folder: Path) -> list[Path]:
    """Write a report, and return its files, the page first."""
    folder.mkdir(parents=True, exist_ok=True)
    tables, pictures = _tables(findings), draw_plots(findings, "png")
    # Blanks and line ends of the template are joined: a draft for a paper.
    values = {
        "findings": findings,
        "asked": ASKED,
        "methods": METHODS,
        "choices": CHOICES,
        "version": version,
    }
    paragraph = " ".join(filled_in(HERE / "methods.txt.j2", values, is_html=False).split())
    encoded = {name: base64.b64encode(content).decode() for name, content in pictures.items()}
    values |= {"kinds": _kinds(findings), "meaning": MEANING, "shown": shown, "paragraph": paragraph}
    page = filled_in(HERE / "report.html.j2", values | {"pictures": encoded, "tables": list(tables)})
    files = {"report.html": page.encode(), "methods.txt": (paragraph + "\n").encode()}
    files |= {f"{name}.csv": _as_csv(columns, rows) for name, (columns, rows) in tables.items()}
    files |= {f"{name}.png": content for name, content in pictures.items()}
    files |= {f"{name}.pdf": content for name, content in draw_plots(findings, "pdf").items()}
    for name, content in files.items():
        write_bytes(folder / name, content)
    return [folder / name for name in files]


def _kinds(findings: Findings) -> dict[str, Kind]:
    return {task.name: task.kind for task in findings.design.tasks}


def _tables(findings: Findings) -> dict[str, tuple[str, list[tuple[Any, ...]]]]:
    """Tables of a report by name: their columns, and their rows."""
    kinds = _kinds(findings)
    found = [one for one in findings.comparisons.values() if one is not None]
    means = [(one.task, kinds[one.task], mean) for one in found for mean in one.means]
    differences = [(one.task, pair) for one in found for pair in one.differences]
    return {
        "thresholds": ("participant task condition threshold lower upper width lapse trials", [
            (*key, one.threshold, one.lower, one.upper, one.shape.width, one.shape.lapse, one.trials)
            for key, one in sorted(findings.functions.items())
        ]),
        "scores": ("participant task condition score shown trials", [
            (one.participant, one.task, one.condition, one.value, shown(kinds[one.task], one.value),
             one.trials)
            for one in findings.scores
        ]),
        "means": ("task condition mean lower upper p_chance participants", [
            (task, one.condition, *(shown(kind, value) for value in (one.value, one.lower, one.upper)),
             one.p if kind is Kind.REAL else "", one.participants)
            for task, kind, one in means
        ]),
        "models": ("task F df1 df2 p", [(one.task, one.f, *one.df, one.p) for one in found]),
        "differences": ("task first second difference lower upper p_holm BF01 participants", [
            (task, one.less, one.condition, one.value, one.lower, one.upper, one.p, one.bayes_factor_none,
             one.participants)
            for task, one in differences
        ]),
        "exclusions": ("participant trial why", [
            (one.participant, "all" if one.trial is None else one.trial, one.why)
            for one in findings.exclusions
        ]),
        "not_analysed": ("task condition participants why", [
            (one.task, one.condition, " ".join(one.participants) or "all", one.why)
            for one in findings.missing
        ]),
    }  # fmt: skip


def _as_csv(columns: str, rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns.split())
    writer.writerows([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows)
    return text.getvalue().encode()
