"""``proximity bench``: the latency certificate of a scene, and whether the scene fits a period."""

from pathlib import Path
from typing import Annotated, Any

import typer

import proximity
from proximity.cli import progress
from proximity.cli.options import JSON_SI, UNITS, argument, flag, option, sample
from proximity.cli.output import report

EXIT_DOES_NOT_FIT = 1
HAND = "hand.csv"
REPORT = Path("latency.html")


def bench(
    scene: Annotated[Path, argument("SCENE", "Scene file (.toml), or a file of parts.")],
    recording: Annotated[
        Path | None,
        option("CSV", "Recording of a hand, fitted to the parts. Default: that of SCENE, else a sample."),
    ] = None,
    gate: Annotated[
        str | None, option("PERIOD", "Period that the scene must fit: 1ms, 200us, 1kHz ...")
    ] = None,
    out: Annotated[
        Path | None,
        option(
            "FILE",
            (f"File of the report: .html (with .json), or .json alone. Default: {REPORT}, none with --json."),
        ),
    ] = None,
    fingers: Annotated[
        int | None, option("N", "Number of fingers at the worst positions. Default: that of SCENE, else 5.")
    ] = None,
    ticks: Annotated[int, option("N", "Number of ticks for each motion.")] = 20_000,
    limit: Annotated[float, option("S", "Duration of the service's loop.")] = 3.0,
    seed: Annotated[int, option("N", "Seed of the search and of the random motion.")] = 0,
    real_time: Annotated[
        bool | None,
        flag(
            "--realtime/--no-realtime",
            ("Ask the system for real-time priority and a core for the loop. Default: as in SCENE, else no."),
            show_default=False,
        ),
    ] = None,
    as_json: JSON_SI = False,
    units: UNITS = "mm",
) -> None:
    """Search SCENE for the positions where a tick takes longest, measure ticks there, and compare
    them with haptic sample periods.

    SCENE is a scene file of the service, whose settings are used, or a file of parts. Ticks are timed
    one by one: along a recorded hand, in random motion, and with all fingers at the worst positions;
    then the service's own loop runs for some seconds. The report is one page (.html) and its numbers in
    a file of the same name (.json). --json prints the numbers; files are then written only with --out.

    There are two verdicts. The scene fits a period if 99.9 % of the ticks of every motion (best of
    three runs), and half of the loop's ticks, take no longer to compute. This machine kept its
    deadlines if the loop missed at most 0.1 % of them, for whatever reason: interruptions and late
    waking count here. With --gate the exit code is 1 if the scene does not fit PERIOD. The page
    requires jinja2 and matplotlib.

    Examples:
      proximity bench meshes/bracket.stl
      proximity bench cell.toml --gate 1ms --out cell-latency.html
      proximity bench gearbox.step --recording grab.csv --gate 5kHz --json > latency.json
    """
    from proximity.cli.lab import bench_report
    from proximity.lab import certificate

    period = None if gate is None else certificate.parse_period(gate)
    page = REPORT if out is None and not as_json else out
    if page is not None:
        certificate.check_report_name(page)
    if out is not None:
        certificate.check_libraries(out)
    certificate.check_request(ticks, limit, seed)
    progress.prepare_kernels()
    with progress.spinner(f"reading {scene}"):
        subject = certificate.read_subject(
            scene,
            units=units,
            recording=recording,
            fingers=fingers,
            period=period,
            real_time=real_time,
            sample=lambda: sample(HAND),
        )
    if subject.recording is not None:
        for note in subject.recording.notes:
            report(f"{subject.recording.path}: {note}")
    with progress.bar("measuring") as show:
        found = certificate.certify(
            subject,
            tick_count=ticks,
            seconds=limit,
            seed=seed,
            progress=lambda doing, share: show(share, 1.0, f"{share:.0%} {doing}"),
        )
    reported = certificate.document(found, period, version=proximity.__version__)
    if as_json:
        typer.echo(certificate.as_json(reported), nl=False)
    else:
        bench_report.write(reported)
    if page is not None:
        _write(page, reported, subject.scene)
    if gate is not None and not reported["verdict"]["fits"]:
        report(reported["verdict"]["sentence"])
        raise typer.Exit(EXIT_DOES_NOT_FIT)


def _write(page: Path, reported: dict[str, Any], scene: "proximity.Scene") -> None:
    """Write the report, or the numbers alone where a library is missing."""
    from proximity.lab import certificate

    try:
        with progress.spinner(f"writing {page}"):
            written = certificate.write_report(page, reported, scene)
    except proximity.MissingLibraryError as missing:
        report(f"wrote {page.with_suffix('.json')} alone: {missing}")
        return
    report(f"wrote {' and '.join(map(str, written))}")
