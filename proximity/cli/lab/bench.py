"""Command ``proximity bench``, which tests whether the ticks of a scene fit a period."""

from pathlib import Path
from typing import Annotated

import typer

import proximity
from proximity.cli import progress
from proximity.cli.options import JSON_SI, UNITS, argument, flag, option, sample
from proximity.cli.output import report

EXIT_DOES_NOT_FIT = 1
HAND = "hand.csv"


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
        Path | None, option("FILE", "Picture of the report (.png, .svg, .pdf), or its numbers (.json).")
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
            ("Request real-time priority and a core for the loop. Default: as in SCENE, else no."),
            show_default=False,
        ),
    ] = None,
    as_json: JSON_SI = False,
    units: UNITS = "mm",
) -> None:
    """Search SCENE for the positions where a tick takes longest, measure ticks there, and compare
    them with a haptic sample period.

    SCENE is a scene file of the service, whose settings are used, or a file of parts. Ticks are timed
    one by one: along a recorded hand, in random motion, and with all fingers at the worst positions;
    then the service's own loop runs for some seconds. --json prints the numbers; --out writes them, or
    draws a picture.

    There are two verdicts. The scene fits a period if 99.9 % of the ticks of every motion (best of
    three runs), and half of the loop's ticks, take no longer to compute. This machine kept its
    deadlines if the loop missed at most 0.1 % of them, including interruptions and late waking. With
    --gate the exit code is 1 if the scene does not fit PERIOD. A picture requires matplotlib.

    Examples:
      proximity bench meshes/bracket.stl
      proximity bench cell.toml --gate 1ms --out cell-latency.png
      proximity bench gearbox.step --recording grab.csv --gate 5kHz --json > latency.json
    """
    from proximity.cli.lab import bench_report
    from proximity.lab.certificate import certification, subject
    from proximity.lab.certificate import report as reports
    from proximity.lab.certificate.times import parse_period

    period = None if gate is None else parse_period(gate)
    if out is not None:
        reports.check_report(out)
    certification.check_request(ticks, limit, seed)
    progress.prepare_kernels()
    with progress.spinner(f"reading {scene}"):
        read = subject.read_subject(
            scene,
            units=units,
            recording=recording,
            fingers=fingers,
            period=period,
            real_time=real_time,
            sample=lambda: sample(HAND),
        )
    if read.recording is not None:
        for note in read.recording.notes:
            report(f"{read.recording.path}: {note}")
    with progress.bar("measuring") as show:
        found = certification.certify(
            read,
            tick_count=ticks,
            seconds=limit,
            seed=seed,
            progress=lambda doing, share: show(share, 1.0, f"{share:.0%} {doing}"),
        )
    reported = reports.document(found, period, version=proximity.__version__)
    if as_json:
        typer.echo(reports.as_json(reported), nl=False)
    else:
        bench_report.write(reported)
    if out is not None:
        reports.write_report(out, reported, read.scene)
        report(f"wrote {out}")
    if gate is not None and not reported["verdict"]["fits"]:
        report(reported["verdict"]["sentence"])
        raise typer.Exit(EXIT_DOES_NOT_FIT)
