"""``proximity calibrate``: measure a finger's glove and its drum, step by step, into a calibration."""

import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from proximity.cli.program import EXIT_INTERRUPTED, EXIT_NOTHING

if TYPE_CHECKING:
    from proximity.decaff.calibrating.results import Session
    from proximity.decaff.calibrating.simulated_glove import SimulatedGlove

HELP = "\n\n".join(
    (
        "Calibrate the glove of one finger, guided step by step, and write FILE.",
        "Seven poses, the cable in both directions and pulled, touches of the drum, a step; and where a "
        "motor swings the drum, its mass, friction, latency and encoder, and the cable's stiffness. "
        "Each number gets the uncertainty that its repeats show; readings that differ are asked again. "
        "Ctrl-C keeps what was measured, and the same command goes on there.",
        "Numbers are typed, or the counts are taken from the glove_poses messages at --counts. --simulate "
        "measures a simulated glove instead, whose true numbers are shown beside. Readings and results lie "
        "beside FILE as .readings.json, a drawing of them as .png (needs matplotlib).",
    )
)

EXAMPLES = """
Examples:
  proximity calibrate glove.json --simulate
  proximity calibrate right-index.json --name "right index" --phalanges 45 26 20
  proximity calibrate glove.json --counts iox2://decaff/poses --finger 1
  proximity calibrate glove.json --again touches
"""

OLD_READINGS_H = 12.0  # after that straps may sit otherwise
MM = 1e-3

FILE = Annotated[Path, typer.Argument(metavar="FILE", help="Calibration to write, as glove.json.")]
SIMULATE = Annotated[bool, typer.Option("--simulate", help="Measure a simulated glove, for practice.")]
SEED = Annotated[int, typer.Option("--seed", metavar="N", help="Which simulated glove.")]
COUNTS = Annotated[
    str | None,
    typer.Option(
        "--counts", metavar="ADDRESS", help="Where glove_poses messages bring the counts; else typed."
    ),
]
FINGER = Annotated[int, typer.Option("--finger", metavar="N", help="Finger in these messages.")]
NAME = Annotated[str, typer.Option("--name", metavar="TEXT", help="Hand and finger, for people.")]
PHALANGES = Annotated[
    tuple[float, float, float],
    typer.Option("--phalanges", metavar="MM MM MM", help="Lengths of the phalanges, from the knuckle on."),
]
DRUM = Annotated[
    str, typer.Option("--drum", metavar="DRUM", help="Drum as designed: direct, gear4 or gear10.")
]
SKIP = Annotated[
    list[str] | None, typer.Option("--skip", metavar="TASK", help="Leave out 'free drum' or 'held drum'.")
]
AGAIN = Annotated[
    str | None,
    typer.Option(
        "--again", metavar="TASK", help="Forget the readings of a task, or of all, and measure anew."
    ),
]
YES = Annotated[bool, typer.Option("--yes", help="With --simulate: do not wait for Enter.")]
AS_JSON = Annotated[bool, typer.Option("--json", help="Print the results as JSON.")]


def command(
    path: FILE,
    simulate: SIMULATE = False,
    seed: SEED = 0,
    counts: COUNTS = None,
    finger: FINGER = 0,
    name: NAME = "",
    phalanges: PHALANGES = (45.0, 26.0, 20.0),
    drum: DRUM = "gear4",
    skip: SKIP = None,
    again: AGAIN = None,
    yes: YES = False,
    as_json: AS_JSON = False,
) -> None:
    """Guide through a calibration."""
    _check(simulate, seed, counts, yes, drum, skip)
    # NumPy, Rich and the models: only now, so that --help and mistakes above answer at once.
    from proximity.cli.guided_calibration import print_results
    from proximity.cli.views.json_output import write_document
    from proximity.decaff.calibrating.results import as_document, contradiction
    from proximity.decaff.glove.calibration import write_calibration

    lengths = (MM * phalanges[0], MM * phalanges[1], MM * phalanges[2])
    session, simulated = _opened(path, lengths, drum, seed if simulate else None, counts, finger, skip)
    _begin(session, again)
    with redirect_stdout(sys.stderr if as_json else sys.stdout):
        ending = _guided(session, simulated, waits=not yes and (simulate or counts is not None))
    estimates = session.estimates()
    if not ending:
        write_calibration(path, session.calibration(name, lengths))
        session.readings.write(as_document(estimates))
    if as_json:
        write_document(as_document(estimates))
    else:
        typer.echo("")
        print_results(estimates, simulated.truth if simulated is not None else None)
    if ending:
        kept = f"{len(session.readings.all)} readings are kept in {session.readings.path}"
        typer.echo(f"proximity: {kept}; the same command goes on there", err=True)
        raise typer.Exit(ending)
    if sentence := contradiction(session):
        typer.echo(f"proximity: {sentence}", err=True)
    typer.echo(f"{path}: written{_drawn(session, path.with_suffix('.png'))}", err=as_json)


def _opened(
    path: Path,
    lengths: tuple[float, float, float],
    drum: str,
    seed: int | None,
    counts: str | None,
    finger: int,
    skip: list[str] | None,
) -> tuple["Session", "SimulatedGlove | None"]:
    """Return the calibration under way, and the simulated glove where there is one."""
    from proximity.cli.guided_calibration import TypedGlove
    from proximity.decaff.calibrating.instruments import Instruments
    from proximity.decaff.calibrating.readings import Readings
    from proximity.decaff.calibrating.results import Session
    from proximity.decaff.calibrating.simulated_glove import SimulatedGlove
    from proximity.decaff.calibrating.tasks import Bench
    from proximity.decaff.drum.drum_model import DRUMS
    from proximity.decaff.glove.finger import Finger
    from proximity.decaff.glove.glove import Glove

    design = Glove(finger=Finger(phalanges=lengths))
    simulated = None if seed is None else SimulatedGlove(seed, design, DRUMS[drum])
    if simulated is not None:
        instruments = simulated.instruments
    else:
        typed = TypedGlove(counts, finger)
        instruments = Instruments("a person's instruments", typed, typed)
    readings = Readings(path.with_suffix(".readings.json"), f"{instruments.name}, {drum} drum")
    return Session(Bench(instruments, design, DRUMS[drum]), readings, skip or ()), simulated


def _guided(session: "Session", simulated: "SimulatedGlove | None", *, waits: bool) -> int:
    """Measure what is left to do; return the exit code of a calibration that was interrupted, else 0."""
    from proximity.cli.guided_calibration import UnfinishedError, guide

    try:
        guide(session, simulated, waits=waits)
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except UnfinishedError:
        return EXIT_NOTHING
    return 0


def _begin(session: "Session", again: str | None) -> None:
    """Forget what is to be measured again, and say from where it goes on."""
    from datetime import UTC, datetime, timedelta

    readings = session.readings
    if again is not None and not readings.drop("" if again == "all" else again):
        raise typer.BadParameter(
            f"there are no readings of {again!r}, expected 'all' or the beginning of a task's name: "
            f"{', '.join(task.key for task in session.tasks)}",
            param_hint="--again",
        )
    if not readings.all:
        readings.began = datetime.now(UTC)
        return
    hours = (datetime.now(UTC) - readings.began) / timedelta(hours=1)
    old = "; straps may sit otherwise by now: --again all begins anew" if hours > OLD_READINGS_H else ""
    typer.echo(
        f"{readings.path}: {len(readings.all)} readings since {readings.began:%Y-%m-%d %H:%M} UTC{old}",
        err=True,
    )


def _drawn(session: "Session", path: Path) -> str:
    """Draw the results; return words for the last line."""
    from proximity.errors import DecaffError
    from proximity.studies.figures import calibration_plots

    try:
        calibration_plots.write(session, path)
    except DecaffError as missing:
        return f"; not drawn: {missing}"
    return f"; drawn in {path}"


def _check(
    simulate: bool, seed: int, counts: str | None, yes: bool, drum: str, skip: list[str] | None
) -> None:
    if drum not in ("direct", "gear4", "gear10"):
        raise typer.BadParameter(f"{drum!r}: expected direct, gear4 or gear10", param_hint="--drum")
    if simulate and counts is not None:
        raise typer.BadParameter("a simulated glove has its own counts", param_hint="--counts")
    if not simulate and (seed or yes):
        raise typer.BadParameter("requires --simulate", param_hint="--seed" if seed else "--yes")
    for task in skip or ():
        if task not in ("free drum", "held drum"):
            raise typer.BadParameter(f"{task!r}: expected 'free drum' or 'held drum'", param_hint="--skip")
