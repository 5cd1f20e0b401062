"""``proximity study``: run a job for every condition of a study file, and make a page of the results."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli import output, progress
from proximity.cli.options import WIDTH, argument, flag, option
from proximity.cli.program import EXIT_INTERRUPTED, group_of

if TYPE_CHECKING:
    from proximity.lab.sweep.design import Job
    from proximity.lab.sweep.study_file import Study
    from proximity.lab.sweep.study_run import Progress

PAGE = "study.html"
EXIT_FAILED = 1
SAY_EVERY_S = 30.0  # where no terminal shows a bar


def run(
    study: Annotated[Path, argument("STUDY", "Study file (.toml).")],
    out: Annotated[Path | None, option("DIR", "Folder of results; beside STUDY if not given.")] = None,
    address: Annotated[str | None, option("HOST:PORT", "Ray cluster; this machine if not given.")] = None,
    cores: Annotated[int | None, option("N", "Cores of this machine; all if not given.", min=1)] = None,
    resume: Annotated[
        bool, flag("--resume/--from-scratch", "Keep the rows that are there, or remove them first.")
    ] = True,
    retry_failed: Annotated[
        bool, flag("--retry-failed", "Run conditions again whose row says that they failed.")
    ] = False,
    only: Annotated[
        str | None,
        option("CONDITION", "Repeat one condition, named as on the page, and compare it with its row."),
    ] = None,
) -> None:
    """Run a study: a job for every combination of factors, on all cores.

    Jobs are press (a simulated press on a wall), replay (a hand through a scene), certificate (whether
    a scene holds its period), check (repairs and sign of parts) and field (signed distances to train
    on). Results go to a folder named like STUDY, as Parquet: one row for each condition. The same
    command continues a study that was stopped.

    The exit code is 1 if conditions failed. Requires: pip install 'cad-proximity[study]'.

    Examples:
      proximity study run force-error.toml
      proximity study run force-error.toml --only 3f2a91c07b55
      proximity study run catalogue.toml --address 10.0.0.5:6379
    """
    from proximity.lab.sweep.study_file import read_study

    with progress.spinner(f"reading {study}"):
        read = read_study(study, _jobs())
    results = out or study.with_suffix(".results")
    progress.prepare_kernels()
    if only is not None:
        _repeat(read, results, only)
        return
    options = {"address": address, "cores": cores, "is_resumed": resume, "with_failed": retry_failed}
    _run(read, results, options)


def report(
    folder: Annotated[Path, argument("DIR", "Folder of results.")],
    out: Annotated[Path | None, option("FILE", "Page to write; study.html in DIR if not given.")] = None,
    width: WIDTH = None,
) -> None:
    """Write the results of a study as a page: factors, effects, plots and the worst conditions.

    Plots and their numbers are written beside the page, too (PNG, PDF, CSV).

    Examples:
      proximity study report force-error.results
      proximity study report force-error.results --width 86
    """
    _write_page(folder, out, width)


def _run(study: "Study", results: Path, options: dict[str, Any]) -> None:
    """Run a study; Ctrl-C says what is kept."""
    from proximity.lab.sweep.study_run import run_study

    newest: Progress | None = None
    try:
        with _progress(study.name or Path(study.path).stem) as show:

            def watch(seen: "Progress") -> None:
                nonlocal newest
                newest = seen
                show(seen)

            ended = run_study(study, results, watch=watch, **options)
    except KeyboardInterrupt:
        kept = (
            ""
            if newest is None
            else f": {newest.earlier + newest.done} of {newest.total} conditions are kept"
        )
        output.report(f"stopped{kept}; the same command goes on")
        raise typer.Exit(EXIT_INTERRUPTED) from None
    _report_end(ended, results)


def _jobs() -> "dict[str, Job]":
    from proximity.lab.certificate.certification import CERTIFICATE
    from proximity.lab.sweep.field_job import FIELD
    from proximity.lab.sweep.part_jobs import CHECK, REPLAY
    from proximity.lab.sweep.press_job import PRESS

    return {job.name: job for job in (CERTIFICATE, REPLAY, PRESS, FIELD, CHECK)}


def _write_page(folder: Path, out: Path | None, width: float | None) -> None:
    from proximity.errors import ServiceError
    from proximity.lab.figures import style
    from proximity.lab.sweep.study_file import read_study
    from proximity.lab.sweep.study_page import study_report

    source, sheet = folder / "study.toml", style.Sheet(None if width is None else width / 1e3)
    if not source.is_file():
        raise ServiceError(f"{folder}: no results of a study, expected the folder of proximity study run")
    page = folder / PAGE if out is None else out
    with progress.spinner(f"writing {page}"):
        report = study_report(read_study(source, _jobs(), with_files=False), folder)
        style.write_bytes(page, report.page.encode())
        for name, plot in report.plots.items():
            beside = page.with_name(f"{page.stem}-{name}.csv")
            style.write_table(beside, plot.numbers)
            for form in ("png", "pdf"):
                drawn = style.render(plot.draw, None, plot.size, form, sheet=sheet)
                style.write_bytes(beside.with_suffix(f".{form}"), drawn)
    plots = "".join(f", {page.stem}-{name}.png, .pdf, .csv" for name in report.plots)
    output.report(f"wrote {page}{plots}")


def _repeat(study: "Study", out: Path, key: str) -> None:
    from proximity.cli.output import MISSING, print_block
    from proximity.cli.tables import results_console, table
    from proximity.lab.sweep.study_page import shown
    from proximity.lab.sweep.study_run import repeat

    found = repeat(study, out, key)
    console = results_console()
    given = {name: value for name, value in found.condition.values.items() if value is not None}
    print_block([("key", found.condition.key), *((name, shown(given[name])) for name in given)])
    console.print()
    recorded = found.recorded
    rows = [
        [name, _digits(found.results[name]), MISSING if recorded is None else _digits(recorded.get(name))]
        for name in study.job.measures
    ]
    console.print(table([""], ("now", "recorded"), rows))
    print_block([(name, found.results[name]) for name in study.job.texts])


def _digits(value: Any) -> str:
    from proximity.lab.sweep.study_page import shown

    return f"{value:.9g}" if isinstance(value, float) else shown(value)


def _report_end(ended: "Progress", results: Path) -> None:
    earlier = f" ({ended.earlier} of them earlier)" if ended.earlier else ""
    took = f" in {ended.seconds:.1f} s, {ended.rate:.3g} a second" if ended.done else ""
    failed = f"; {ended.failed} failed, see their rows" if ended.failed else ""
    typer.echo(f"{results}: {ended.total} conditions{earlier}{took}{failed}")
    output.report(f"for the page: proximity study report {results}")
    if ended.failed:
        raise typer.Exit(EXIT_FAILED)


@contextlib.contextmanager
def _progress(name: str) -> "Iterator[Callable[[Progress], None]]":
    """A bar with rate and time left; where stderr is no terminal, a line now and then."""

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
    "Run a study, and write its report.\n\n"
    "A study is a TOML file: a job, and the levels of its factors. Every combination is a condition.",
    *(run, report),
)
