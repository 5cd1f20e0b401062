"""Report of an experiment: one page, plots, tables as CSV, and the methods paragraph."""

import base64
import csv
import io
from collections.abc import Iterable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any

from proximity.lab.experiment.analysis.findings import Findings
from proximity.lab.experiment.analysis.plots import draw_plots
from proximity.lab.experiment.analysis.scores import MEANING, shown
from proximity.lab.experiment.design import CHOICES, Kind, Procedure
from proximity.lab.figures.pages import filled_in
from proximity.lab.figures.style import write_bytes

HERE = Path(__file__).parent
Rows = list[Sequence[Any]]
Tables = dict[str, tuple[tuple[str, ...], Rows]]
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
    tables, paragraph = tables_of(findings), _paragraph(findings)
    pictures = draw_plots(findings, "png")
    files = {f"{name}.csv": _as_csv(names, rows) for name, (names, rows) in tables.items()}
    files |= {f"{name}.png": content for name, content in pictures.items()}
    files |= {f"{name}.pdf": content for name, content in draw_plots(findings, "pdf").items()}
    files["methods.txt"] = (paragraph + "\n").encode()
    page = {"report.html": _page(findings, paragraph, pictures).encode()}
    for name, content in (page | files).items():
        write_bytes(folder / name, content)
    return [folder / name for name in page | files]


def tables_of(findings: Findings) -> Tables:
    """Return the tables of a report by name: their columns, and their rows."""
    kinds = {task.name: task.kind for task in findings.design.tasks}
    return {
        "thresholds": (
            ("participant", "task", "condition", "threshold", "lower", "upper", "width", "lapse", "trials"),
            [
                (*key, one.threshold, one.lower, one.upper, one.shape.width, one.shape.lapse, one.trials)
                for key, one in sorted(findings.functions.items())
            ],
        ),
        "scores": (
            ("participant", "task", "condition", "score", "shown", "trials"),
            [
                (one.participant, one.task, one.condition, one.value, shown(kinds[one.task], one.value),
                 one.trials)
                for one in findings.scores
            ],
        ),
        **_comparison_tables(findings, kinds),
        "exclusions": (
            ("participant", "trial", "why"),
            [
                (one.participant, "all" if one.trial is None else one.trial, one.why)
                for one in findings.exclusions
            ],
        ),
        "not_analysed": (
            ("task", "condition", "participants", "why"),
            [
                (one.task, one.condition, " ".join(one.participants) or "all", one.why)
                for one in findings.missing
            ],
        ),
    }  # fmt: skip


def _comparison_tables(findings: Findings, kinds: dict[str, Kind]) -> Tables:
    """Those of the comparisons between conditions."""
    found = [one for one in findings.comparisons.values() if one is not None]
    return {
        "means": (
            ("task", "condition", "mean", "lower", "upper", "p_chance", "participants"),
            [
                (
                    comparison.task,
                    one.condition,
                    *(shown(kinds[comparison.task], value) for value in (one.value, one.lower, one.upper)),
                    one.p_zero if kinds[comparison.task] is Kind.REAL else "",
                    one.participants,
                )
                for comparison in found
                for one in comparison.means
            ],
        ),
        "models": (("task", "F", "df1", "df2", "p"), [(one.task, one.f, *one.df, one.p) for one in found]),
        "differences": (
            ("task", "first", "second", "difference", "lower", "upper", "p_holm", "BF01", "participants"),
            [
                (comparison.task, one.first, one.second, one.value, one.lower, one.upper, one.p,
                 one.bayes_factor_none, one.participants)
                for comparison in found
                for one in comparison.differences
            ],
        ),
    }  # fmt: skip


def _paragraph(findings: Findings) -> str:
    """The methods in words, with the numbers filled in: a draft for a paper."""
    values = {
        "findings": findings,
        "asked": ASKED,
        "methods": METHODS,
        "choices": CHOICES,
        "version": version,
    }
    return " ".join(filled_in(HERE / "methods.txt.j2", values, is_html=False).split())


def _page(findings: Findings, paragraph: str, pictures: dict[str, bytes]) -> str:
    values = {
        "findings": findings,
        "kinds": {task.name: task.kind for task in findings.design.tasks},
        "meaning": MEANING,
        "shown": shown,
        "paragraph": paragraph,
        "pictures": {name: base64.b64encode(content).decode() for name, content in pictures.items()},
        "tables": list(tables_of(findings)),
    }
    return filled_in(HERE / "report.html.j2", values)


def _as_csv(names: Sequence[str], rows: Iterable[Sequence[Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(names)
    writer.writerows([f"{cell:.6g}" if isinstance(cell, float) else cell for cell in row] for row in rows)
    return text.getvalue().encode()
