"""Commands ``proximity figures`` and ``claims``, for the figures of the paper and of this project."""

import re
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from proximity.cli import progress
from proximity.cli.options import (
    GLOVE,
    JSON_SUMMARY,
    Printing,
    argument,
    designed,
    flag,
    option,
    with_option_groups,
)
from proximity.cli.output import report

WIDEST = 120  # width of a table of sentences in columns
LINK = re.compile(r"\[(.*?)\]\(.*?\)")
SENTENCE = re.compile(r"(?<=[.]) (?=[A-Z])")  # between two sentences


@with_option_groups
def figures(
    names: Annotated[
        list[str] | None,
        argument(
            "NAME",
            "5a to 5h, 5, stability, error-speed, error-latency, drum-motion. Default: all.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[Path, option("DIR", "Output folder; created if missing.")] = Path("figures"),
    form: Annotated[str, option("FORMAT", "File format: png, svg or pdf.", "--format")] = "png",
    glove: GLOVE = None,
    as_json: JSON_SUMMARY = False,
    *,
    printing: Printing,
) -> None:
    """Draw the named figures, or all of them, each with its numbers as CSV in SI units.

    5a to 5h are those of the paper; 5 has all eight on one page. stability shows the stable springs and
    dampers of a sampled wall. error-speed and error-latency compare coupled walls and drums with the
    real wall. drum-motion shows when a drum is in position. With --glove the drums are on your glove.
    Existing files are replaced. All figures take less than a minute. Requires matplotlib.

    Examples:
      proximity figures
      proximity figures 5c 5h stability --out paper --format pdf --width 86 --no-caption
      proximity figures drum-motion --glove glove.json --json
    """
    from proximity.cli.output import write_document
    from proximity.decaff.glove.calibrated_glove import read_any_glove
    from proximity.lab.figures import catalogue

    worn = None if glove is None else designed(read_any_glove(glove))
    began, file_count = time.monotonic(), 0
    figures: list[dict[str, Any]] = []
    chosen = catalogue.chosen_names(names or ())
    for number, name in enumerate(chosen, start=1):
        started, title = time.monotonic(), catalogue.PLATES[name].title
        with progress.spinner(f"drawing {title}, figure") as count:
            count(number, len(chosen))
            paths = catalogue.write_figure(name, out, form, worn, printing.sheet())
        seconds = time.monotonic() - started
        file_count += len(paths)
        figures.append(
            {"name": name, "title": title, "files": list(map(str, paths)), "seconds": round(seconds, 3)}
        )
        reported = ", ".join(path.name for path in paths)
        report(f"{reported} ({seconds:.1f} s)")
    seconds = time.monotonic() - began
    if as_json:
        write_document({"out": str(out), "figures": figures, "seconds": round(seconds, 3)})
    else:
        typer.echo(f"{out}: {len(chosen)} figures, {file_count} files, {seconds:.1f} s")


def claims(as_json: Annotated[bool, flag("--json", "Write one JSON document.")] = False) -> None:
    """Compare each claim of the paper with the models of this project.

    Every claim has a verdict and its numbers, whose computation takes some seconds.

    Examples:
      proximity claims
      proximity claims --json > claims.json
    """
    from proximity.cli.output import write_document
    from proximity.cli.tables import Console, table
    from proximity.lab.claims import HOW, SYMBOLS
    from proximity.lab.claims import claims as computed

    with progress.spinner("computing"):
        found = computed()
    if as_json:
        write_document({"how": HOW, "claims": [asdict(one) for one in found]})
        return
    console = Console()
    rows = ((one.paper, one.holds, SENTENCE.sub("\n", LINK.sub(r"\1", one.here))) for one in found)
    made = table(("the paper says", "holds", "here"), rows=rows)
    made.padding, made.columns[0].ratio, made.columns[2].ratio = (0, 1, 1, 0), 2, 4
    made.expand, made.columns[1].min_width = True, len("yes, if")
    width = min(console.width, WIDEST)
    console.print(made, width=width)
    console.print("", *SYMBOLS, HOW, sep="\n", width=width, highlight=False)
