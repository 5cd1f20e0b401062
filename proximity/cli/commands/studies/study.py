"""``proximity study``: run a job for every condition of a study file, and make a page of the results."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli.program import EXIT_INTERRUPTED

if TYPE_CHECKING:
    from proximity.lab.sweep.jobs import Job
    from proximity.lab.sweep.study_file import Study
    from proximity.lab.sweep.study_run import Progress

HELP = "\n\n".join(
    (
        "Run the study in STUDY, a TOML file: a job for every combination of factors, on all cores.",
        "Jobs are press (a simulated press on a wall), replay (a hand through a scene), certificate (whether "
        "a scene holds its period), check (repairs and sign of parts) and field (signed distance for others "
        "to train on). Results go to a folder named like STUDY, as Parquet: one row a condition. A study "
        "that was stopped or killed goes on where it was.",
        "With the word report and the folder of the results it makes one page: factors, effects, plots, the "
        "worst conditions, and a key that repeats each of them with --only.",
        "The exit code is 1 if conditions failed. Needs: pip install 'cad-proximity[study]'.",
    )
)

EXAMPLES = """
Examples:
  proximity study force-error.toml
  proximity study report force-error.results
  proximity study force-error.toml --only KEY
  proximity study catalogue.toml --address 10.0.0.5:6379
"""

REPORT = "report"
PAGE = "study.html"
EXIT_FAILED = 1
SAY_EVERY_S = 30.0  # where no terminal shows a bar

STUDY = Annotated[
    Path, typer.Argument(metavar="STUDY", help="A study file (.toml); or the word report, with DIR.")
]
FOLDER = Annotated[Path | None, typer.Argument(metavar="DIR", help="With report: the folder of results.")]
OUT = Annotated[
    Path | None,
    typer.Option("--out", metavar="PATH", help="Folder of results; with report the page, else in DIR."),
]
ADDRESS = Annotated[
    str | None,
    typer.Option("--address", metavar="HOST:PORT", help="Ray cluster; this machine if not given."),
]
CORES = Annotated[
    int | None, typer.Option("--cores", metavar="N", min=1, help="Cores of this machine; all if not given.")
]
RESUME = Annotated[
    bool,
    typer.Option("--resume/--from-scratch", help="Keep the rows that are there, or remove them first."),
]
RETRY_FAILED = Annotated[
    bool, typer.Option("--retry-failed", help="Do conditions again whose row says that they failed.")
]
ONLY = Annotated[
    str | None,
    typer.Option("--only", metavar="KEY", help="Repeat one condition here, beside what its row says."),
]


def command(
    study: STUDY,
    folder: FOLDER = None,
    out: OUT = None,
    address: ADDRESS = None,
    cores: CORES = None,
    resume: RESUME = True,
    retry_failed: RETRY_FAILED = False,
    only: ONLY = None,
) -> None:
    """Run a study, repeat one condition of it, or make its page."""
    is_report = str(study) == REPORT
    if is_report != (folder is not None):
        expected = "proximity study report DIR" if is_report else "proximity study STUDY, or report DIR"
        raise typer.BadParameter(f"expected {expected}", param_hint="DIR")
    # NumPy, the library and Ray: only now, so that --help answers at once.
    from proximity.cli import progress
    from proximity.lab.sweep.study_file import read_study

    if folder is not None:
        _report(folder, out)
        return
    with progress.spinner(f"reading {study}"):
        read = read_study(study, _jobs())
    results = out or study.with_suffix(".results")
    progress.prepare_kernels()
    if only is not None:
        _repeat(read, results, only)
        return
    options = {"address": address, "cores": cores, "is_resumed": resume, "with_failed": retry_failed}
    _run(read, results, options)


def _run(study: "Study", results: Path, options: dict[str, Any]) -> None:
    """Run a study; Ctrl-C says what is kept."""
    from proximity.lab.sweep.study_run import run_study

    newest: Progress | None = None
    try:
        with _progress(study.name or Path(study.path).stem) as show:

            def watch(progress: "Progress") -> None:
                nonlocal newest
                newest = progress
                show(progress)

            ended = run_study(study, results, watch=watch, **options)
    except KeyboardInterrupt:
        kept = (
            ""
            if newest is None
            else f": {newest.earlier + newest.done} of {newest.total} conditions are kept"
        )
        typer.echo(f"proximity: stopped{kept}; the same command goes on", err=True)
        raise typer.Exit(EXIT_INTERRUPTED) from None
    _say_end(ended, results)


def _jobs() -> "dict[str, Job]":
    from proximity.lab.certificate.certificate_job import CERTIFICATE
    from proximity.lab.sweep.field_job import FIELD
    from proximity.lab.sweep.part_jobs import CHECK, REPLAY
    from proximity.lab.sweep.press_job import PRESS

    return {job.name: job for job in (CERTIFICATE, REPLAY, PRESS, FIELD, CHECK)}


def _report(folder: Path, out: Path | None) -> None:
    from proximity.cli import progress
    from proximity.errors import ServiceError
    from proximity.lab.sweep.page.study_page import study_page
    from proximity.lab.sweep.study_file import read_study
    from proximity.system.whole_file import whole_file

    source = folder / "study.toml"
    if not source.is_file():
        raise ServiceError(f"{folder}: holds no results of a study, expected the folder of proximity study")
    page = folder / PAGE if out is None else out
    with progress.spinner(f"writing {page}"):
        content = study_page(read_study(source, _jobs(), with_files=False), folder)
        with whole_file(page) as stream:
            stream.write(content.encode())
    typer.echo(f"proximity: wrote {page}", err=True)


def _repeat(study: "Study", out: Path, key: str) -> None:
    from proximity.cli.console import print_block, results_console, table
    from proximity.cli.wording import MISSING
    from proximity.lab.sweep.page.study_page import shown
    from proximity.lab.sweep.repetition import repeat

    found = repeat(study, out, key)
    console = results_console()
    given = {name: value for name, value in found.condition.values.items() if value is not None}
    print_block(console, [("key", found.condition.key), *((name, shown(given[name])) for name in given)])
    console.print()
    rows = table([""], ("now", "recorded"))
    for name in study.job.measures:
        value = found.results[name]
        recorded = MISSING if found.recorded is None else _digits(found.recorded.get(name))
        rows.add_row(name, _digits(value), recorded)
    console.print(rows)
    print_block(console, [(name, found.results[name]) for name in study.job.texts])


def _digits(value: Any) -> str:
    from proximity.lab.sweep.page.study_page import shown

    return f"{value:.9g}" if isinstance(value, float) else shown(value)


def _say_end(ended: "Progress", results: Path) -> None:
    earlier = f" ({ended.earlier} of them earlier)" if ended.earlier else ""
    took = f" in {ended.seconds:.1f} s, {ended.rate:.3g} a second" if ended.done else ""
    failed = f"; {ended.failed} failed, see their rows" if ended.failed else ""
    typer.echo(f"{results}: {ended.total} conditions{earlier}{took}{failed}")
    typer.echo(f"proximity: for the page: proximity study report {results}", err=True)
    if ended.failed:
        raise typer.Exit(EXIT_FAILED)


@contextlib.contextmanager
def _progress(name: str) -> "Iterator[Callable[[Progress], None]]":
    """A bar with rate and time left; where stderr is no terminal, a line now and then."""
    from rich import progress as rich_progress
    from rich.markup import escape

    from proximity.cli.console import Console

    console = Console(stderr=True)
    due = time.monotonic() + SAY_EVERY_S

    def said(ended: "Progress") -> str:
        left = "" if ended.seconds_left == float("inf") else f", {_duration(ended.seconds_left)} left"
        return f"{ended.rate:.3g}/s{left}{f', {ended.failed} failed' if ended.failed else ''}"

    def say(ended: "Progress") -> None:
        nonlocal due
        if time.monotonic() >= due:
            due = time.monotonic() + SAY_EVERY_S
            typer.echo(f"proximity: {ended.earlier + ended.done} of {ended.total}, {said(ended)}", err=True)

    if not console.is_terminal:
        yield say
        return
    columns = (
        rich_progress.TextColumn(escape(name)),
        rich_progress.BarColumn(),
        rich_progress.MofNCompleteColumn(),
        rich_progress.TextColumn("{task.description}"),
    )
    with rich_progress.Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting Ray", total=None)
        yield lambda ended: bar.update(
            task, description=said(ended), total=ended.total, completed=ended.earlier + ended.done
        )


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
