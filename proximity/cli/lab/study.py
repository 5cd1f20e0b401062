"""Command ``proximity study``, which runs a job for every condition of a study file and draws the results."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from proximity.cli import output, progress
from proximity.cli.options import argument, option
from proximity.cli.program import EXIT_INTERRUPTED, group_of

if TYPE_CHECKING:
    from proximity.lab.study.study_file import Study
    from proximity.lab.study.study_run import Progress

EXIT_FAILED = 1
SAY_EVERY_S = 30.0  # interval of lines if stderr is not a terminal

STUDY = Annotated[Path, argument("STUDY", "Study file (.toml).")]
RESULTS = Annotated[Path | None, option("DIR", "Folder of results. Default: next to STUDY.", "--results")]


def run(
    study: STUDY,
    results: RESULTS = None,
    address: Annotated[str | None, option("HOST:PORT", "Ray cluster; this machine if not given.")] = None,
    cores: Annotated[int | None, option("N", "Cores of this machine; all if not given.", min=1)] = None,
) -> None:
    """Run a study: a job for every condition, on all cores.

    Jobs are press (a simulated press on a wall), certificate (whether a scene fits its period), and
    module:function, your own Python function. Results are written to a folder named like STUDY: Parquet
    files, and rows.csv. The same command continues a study that was stopped, and repeats failed
    conditions.

    The exit code is 1 if conditions failed. Requires: pip install 'cad-proximity[study]'.

    Examples:
      proximity study run force-error.toml
      proximity study run catalogue.toml --address 10.0.0.5:6379
    """
    from proximity.lab.study.study_run import run_study

    read = _read(study)
    folder = results or read.results
    progress.prepare_kernels()
    newest: Progress | None = None
    try:
        with _progress(read.name) as show:

            def watch(seen: "Progress") -> None:
                nonlocal newest
                newest = seen
                show(seen)

            ended = run_study(read, folder, address=address, cores=cores, watch=watch)
    except KeyboardInterrupt:
        kept = f": {newest.earlier + newest.done} of {newest.total} conditions are kept" if newest else ""
        output.report(f"stopped{kept}; the same command continues from there")
        raise typer.Exit(EXIT_INTERRUPTED) from None
    earlier = f" ({ended.earlier} of them earlier)" if ended.earlier else ""
    took = f" in {ended.seconds:.1f} s, {ended.rate:.3g} a second" if ended.done else ""
    failed = f"; {ended.failed} failed, see their rows" if ended.failed else ""
    typer.echo(f"{folder}: {ended.total} conditions{earlier}{took}{failed}")
    if ended.failed:
        raise typer.Exit(EXIT_FAILED)


def report(
    study: STUDY,
    results: RESULTS = None,
    out: Annotated[
        Path | None, option("FILE", "Figure to write (.png, .svg, .pdf); study.png in DIR if not given.")
    ] = None,
) -> None:
    """Draw the results of a study: a measure over a factor, a line for each level of another.

    They are set in the table [plot] of STUDY. Default: the first factors that vary.

    Examples:
      proximity study report force-error.toml
      proximity study report force-error.toml --out force-error.pdf
    """
    from proximity.errors import ServiceError
    from proximity.lab.figures.style import check_format
    from proximity.lab.study.row_files import read_rows, write_csv
    from proximity.lab.study.study_figure import write_figure

    read = _read(study)
    folder = results or read.results
    figure = out or folder / "study.png"
    check_format(figure.suffix.removeprefix("."))
    if not (rows := read_rows(folder, read.conditions)):
        raise ServiceError(f"{folder}: no results of this study, expected the folder of proximity study run")
    write_csv(folder, rows)
    write_figure(read, rows, figure)
    typer.echo(f"{figure}: {len(rows)} of {len(read.conditions)} conditions")


def _read(path: Path) -> "Study":
    from proximity.lab.study.certificate_job import certificate
    from proximity.lab.study.press_job import press
    from proximity.lab.study.study_file import read_study

    with progress.spinner(f"reading {path}"):
        return read_study(path, {"press": press, "certificate": certificate})


@contextlib.contextmanager
def _progress(name: str) -> "Iterator[Callable[[Progress], None]]":
    """Show a bar with the rate and the remaining time.

    If stderr is not a terminal, write a line every `SAY_EVERY_S` instead.
    """

    due = time.monotonic() + SAY_EVERY_S
    with progress.bar(name) as show:

        def watch(ended: "Progress") -> None:
            nonlocal due
            done, total = ended.earlier + ended.done, ended.total
            left = "" if ended.seconds_left == float("inf") else f", {_duration(ended.seconds_left)} left"
            failed = f", {ended.failed} failed" if ended.failed else ""
            words = f"{done} of {total}, {ended.rate:.3g}/s{left}{failed}"
            show(done, total, words)
            if not progress.is_terminal() and time.monotonic() >= due:
                due = time.monotonic() + SAY_EVERY_S
                output.report(words)

        yield watch


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


study = group_of(
    "study",
    "Run a study, and draw its results.\n\n"
    "A study is a TOML file: a job, and the levels of its factors. Every combination is a condition.",
    *(run, report),
)
