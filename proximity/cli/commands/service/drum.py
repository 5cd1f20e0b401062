"""``proximity drum``: simulated drums for the fingers of a service, run by their controllers."""

import json
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli.options import ADDRESS, LIMIT, check_limit, check_range
from proximity.cli.program import EXIT_NOTHING
from proximity.system.stop_signals import stopped_by_signals

HELP = "\n\n".join(
    (
        "Run the drums of the service that publishes at ADDRESS, until Ctrl-C or --limit.",
        "Each finger has a controller, as a real drum would have it, and a simulated drum: the state, the "
        "positions of drum and finger on the finger's path, the drum's angle, the force between them and "
        "the motor's torque are shown. A sample that comes 10 ms late is a fault, as on a real drum, and the "
        "controller starts again. Fingers without a bend are assumed to bend straight into what is nearest, "
        "and marked so. On a terminal the display is live, elsewhere one line a second; with --json only a "
        "summary at the end. The exit code is 1 if no frame came.",
    )
)

EXAMPLES = """
Examples:
  proximity drum iox2://decaff
  proximity drum iox2://decaff --calibration glove.json --log drum.csv
  proximity drum udp://127.0.0.1:9100 --limit 10 --json
"""

MOST_RATE_HZ = 5000.0
LEAST_RATE_HZ = 150.0  # slower, each sample would trip the watchdog of 10 ms
TURN_S = 0.02  # within that a wish to stop is noticed
SWITCH_S = 1e-3  # that the drums wait at most while a picture is drawn
OTHER_LINES = 5  # of a terminal, beside the fingers


RATE = Annotated[
    float, typer.Option("--rate", metavar="HZ", help="Rate of the controllers; the servos run at 3 kHz.")
]
CALIBRATION = Annotated[
    list[Path] | None,
    typer.Option(
        "--calibration",
        metavar="FILE",
        help="Calibration of the glove: one for all fingers, or one for each. Without it a glove with our "
        "own dimensions.",
    ),
]
MAX_AGE = Annotated[
    float | None,
    typer.Option("--max-age", metavar="DAYS", help="Largest age of a calibration; 30 if not given."),
]
LOG = Annotated[Path | None, typer.Option("--log", metavar="FILE", help="Write every sample to a CSV file.")]
AS_JSON = Annotated[bool, typer.Option("--json", help="Print a summary at the end, as JSON.")]


def command(
    address: ADDRESS,
    limit: LIMIT = None,
    rate: RATE = 500.0,
    calibration: CALIBRATION = None,
    max_age: MAX_AGE = None,
    log: LOG = None,
    as_json: AS_JSON = False,
) -> None:
    """Run drums until asked to stop."""
    check_limit(limit)
    _check(rate, max_age, calibration)
    # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
    from proximity.cli.console import Console
    from proximity.cli.drum_loop import DrumsBeside, line, summary, table
    from proximity.cli.views.drum_log import DrumLog
    from proximity.cli.views.screen import Screen
    from proximity.decaff.glove.glove_set import read_glove
    from proximity.decaff.simulated_drums.service_drums import DrumBench
    from proximity.transport import Reading, open_subscriber

    sys.setswitchinterval(SWITCH_S)
    bench = DrumBench(rate, [read_glove(path, max_age) for path in calibration or ()])
    bench.warm_up()
    started = time.monotonic()
    ends = None if limit is None else started + limit
    with (
        stopped_by_signals() as stop,
        open_subscriber(address) as subscriber,
        DrumLog(log) as written,
        Screen(Console(), is_silent=as_json) as screen,
    ):
        newest = [subscriber.read()]

        def look(reading: Reading) -> None:
            newest[0] = reading
            written.append(reading, bench)

        with DrumsBeside(bench, subscriber, rate, look) as drums:
            while drums.is_running and not stop.wait(TURN_S) and not _is_over(ends):
                for warning in bench.warnings():
                    typer.echo(f"proximity: {warning}", err=True)
                screen.show(
                    lambda: line(newest[0], bench),
                    lambda size: table(newest[0], bench, max(1, size.height - OTHER_LINES)),
                )
        counts = subscriber.counts
    reported = summary(bench, address, counts, time.monotonic() - started)
    if as_json:
        typer.echo(json.dumps(reported, indent=2))
    if not counts.received:
        raise typer.Exit(EXIT_NOTHING)


def _check(rate: float, max_age: float | None, calibration: list[Path] | None) -> None:
    check_range(rate, "--rate", "Hz", LEAST_RATE_HZ, MOST_RATE_HZ)
    if max_age is not None and not calibration:
        raise typer.BadParameter("only a --calibration has an age", param_hint="--max-age")


def _is_over(ends: float | None) -> bool:
    return ends is not None and time.monotonic() >= ends
