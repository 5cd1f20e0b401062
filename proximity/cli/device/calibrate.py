"""Command ``proximity calibrate``, which measures a finger's glove and its drum and writes a calibration."""

import sys
from contextlib import AbstractContextManager, nullcontext, redirect_stdout
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from proximity.cli.options import GEAR, GLOVE, argument, flag, option, refuse, with_option_groups
from proximity.cli.output import report, write_document
from proximity.cli.program import EXIT_INTERRUPTED, EXIT_NOTHING
from proximity.system.stop_signals import stopped_by_signals

if TYPE_CHECKING:
    from proximity.cli.device.typed_instruments import TypedInstruments
    from proximity.decaff.calibration.instruments import MotorPort
    from proximity.decaff.calibration.results import Session
    from proximity.decaff.calibration.simulated_glove import SimulatedGlove
    from proximity.decaff.glove.glove import Glove

OLD_READINGS_H = 12.0  # hours after which the glove was probably taken off
MM = 1e-3


@dataclass(frozen=True)
class Measured:
    """Options that select the glove to measure and its instruments."""

    simulate: Annotated[bool, flag("--simulate", "Measure a simulated glove, for practice.")] = False
    seed: Annotated[int, option("N", "Seed of the simulated glove.")] = 0
    counts: Annotated[
        str | None,
        option("ADDRESS", "Address of glove_poses messages with the counts. Default: typed counts."),
    ] = None
    finger: Annotated[int, option("N", "Number of the finger in these messages, from 0.")] = 0
    phalanges: Annotated[
        tuple[float, float, float] | None,
        option("MM MM MM", "Lengths of the phalanges, from the knuckle to the tip; 45 26 20 if not given."),
    ] = None
    drum: GEAR = None
    glove: GLOVE = None
    motor: Annotated[str | None, option("URL", "Motor of the drum. Its encoder gives the angle.")] = None
    arm: Annotated[
        bool, flag("--arm", "Let the motor search its stop and swing the drum. Requires --motor.")
    ] = False


@with_option_groups
def calibrate(
    path: Annotated[Path, argument("FILE", "Calibration to write, for example glove.json.")],
    measured: Measured,
    yes: Annotated[bool, flag("--yes", "With --simulate: do not wait for Enter.")] = False,
    name: Annotated[str, option("TEXT", "Name of hand and finger, written into FILE.")] = "",
    skip: Annotated[
        list[str] | None, option("TASK", "Leave out 'free drum' or 'held drum'. Can be given twice.")
    ] = None,
    again: Annotated[
        str | None, option("TASK", "Delete the readings of this task, or of all, and measure it again.")
    ] = None,
    as_json: Annotated[bool, flag("--json", "Print the results as JSON.")] = False,
) -> None:
    """Calibrate the glove of one finger, step by step, and write FILE.

    You close the finger to seven poses, touch a block from both directions, pull the cable, turn the
    drum until it touches, and run a step test. If a motor drives the drum, the motor then swings it,
    which gives its mass, friction, latency and encoder step, and the stiffness of the cable. Each
    number is printed with its uncertainty. Readings that differ too much are repeated. Ctrl-C stops and
    keeps all readings; the same command continues from there.

    With --motor alone the motor of the drum is only read, without a calibration. With --arm as well
    it searches its mechanical stop and swings the drum. The URL is the same as for proximity drum. The
    drivers were tested with simulated motors only, never on hardware.

    Type the counts of the potentiometer, or read them from messages with --counts. --simulate measures
    a simulated glove, and also prints its true numbers. Readings and results are written to FILE with
    the suffix .readings.json.

    Examples:
      proximity calibrate glove.json --simulate
      proximity calibrate right-index.json --name "right index" --phalanges 45 26 20
      proximity calibrate glove.json --counts shm://proximity/poses --finger 1
      proximity calibrate glove.json --motor "odrive-can://can0?node=0&kt=0.05" --arm
      proximity calibrate glove.json --again touches
    """
    _check(measured, yes, skip)
    from proximity.cli.device.calibration_terminal import Terminal, print_results
    from proximity.cli.device.guide import UnfinishedError, guide, result_rows
    from proximity.decaff.calibration.results import as_document, contradiction

    design = _design(measured)
    if measured.motor is not None and not measured.arm:
        from proximity.cli.device.motors import armable_motors, watch_motors

        with stopped_by_signals() as stop, armable_motors([measured.motor], [design]) as motors:
            watch_motors(motors, stop)
        return
    ending, sentence = 0, ""
    with _port(measured.motor, design) as port, redirect_stdout(sys.stderr if as_json else sys.stdout):
        session, asked, simulated = _opened(path, measured, design, port, skip)
        truth = None if simulated is None else simulated.truth
        _begin(session, again)
        try:
            terminal = Terminal()
            asked.numbers = terminal.numbers
            if port is not None:
                report("the motor moves now to find its stop: keep the finger away from the drum")
                port.home()
            waits = not yes and (measured.simulate or measured.counts is not None)
            guide(session, terminal, simulated, waits=waits)
            sentence = _written(session, path, name)
        except KeyboardInterrupt:
            ending = EXIT_INTERRUPTED
        except UnfinishedError as unfinished:
            ending, sentence = EXIT_NOTHING, str(unfinished)
    if as_json:
        write_document(as_document(session.estimates()))
    else:
        typer.echo("")
        print_results(result_rows(session.estimates(), truth))
    if ending:
        kept = f"{len(session.readings.all)} readings are kept in {session.readings.path}"
        why = f"{sentence}; " if sentence else ""
        report(f"{why}{kept}; the same command continues from there")
        raise typer.Exit(ending)
    if contradicts := contradiction(session):
        report(contradicts)
    typer.echo(sentence, err=as_json)


def _design(measured: Measured) -> "Glove":
    """Return the glove as designed, from the file or the default, with the given lengths."""
    from proximity.cli.options import designed
    from proximity.decaff.glove.calibrated_glove import read_any_glove
    from proximity.decaff.glove.glove import Glove, with_gear

    worn = Glove() if measured.glove is None else designed(read_any_glove(measured.glove))
    if measured.phalanges is not None:
        first, middle, last = (MM * length for length in measured.phalanges)
        worn = replace(worn, finger=replace(worn.finger, phalanges=(first, middle, last)))
    return worn if measured.drum is None else with_gear(worn, measured.drum)


def _port(address: str | None, design: "Glove") -> "AbstractContextManager[MotorPort | None]":
    if address is None:
        return nullcontext()
    from proximity.cli.device.motors import opened_port

    return opened_port(address, design)


def _opened(
    path: Path, measured: Measured, design: "Glove", port: "MotorPort | None", skip: list[str] | None
) -> tuple["Session", "TypedInstruments", "SimulatedGlove | None"]:
    """Return the session, the typed instruments, and the simulated glove or None."""
    from proximity.cli.device.typed_instruments import TypedInstruments
    from proximity.decaff.calibration.instruments import Instruments
    from proximity.decaff.calibration.readings import Readings
    from proximity.decaff.calibration.results import Session
    from proximity.decaff.calibration.simulated_glove import SimulatedGlove
    from proximity.decaff.calibration.tasks import Bench

    asked = TypedInstruments(measured.counts, measured.finger)
    simulated = SimulatedGlove(measured.seed, design) if measured.simulate else None
    if simulated is not None:
        instruments = simulated.instruments
    elif port is not None:
        instruments = Instruments("a person's instruments and a motor", asked, port)
    else:
        instruments = Instruments("a person's instruments", asked, asked)
    readings = Readings(path.with_suffix(".readings.json"), f"{instruments.name}, {design.gear.name} drum")
    return Session(Bench(instruments, design), readings, skip or ()), asked, simulated


def _written(session: "Session", path: Path, name: str) -> str:
    """Write the calibration. Return a sentence that reports it."""
    from proximity.cli.device.guide import UnfinishedError
    from proximity.decaff.calibration.results import as_document
    from proximity.decaff.glove.calibration import write_calibration

    if missing := session.missing():
        raise UnfinishedError(f"{', '.join(missing)}: not measured, but required for a calibration")
    write_calibration(path, session.calibration(name))
    session.readings.write(as_document(session.estimates()))
    return f"{path}: written"


def _begin(session: "Session", again: str | None) -> None:
    """Delete the readings of the tasks *again*, and report the remaining ones."""
    from datetime import UTC, datetime, timedelta

    readings = session.readings
    if again is not None and not readings.drop("" if again == "all" else again):
        raise typer.BadParameter(
            f"there are no readings of {again!r}, expected 'all' or the first letters of a task: "
            f"{', '.join(task.key for task in session.tasks)}",
            param_hint="--again",
        )
    if not readings.all:
        readings.began = datetime.now(UTC)
        return
    is_old = (datetime.now(UTC) - readings.began) / timedelta(hours=1) > OLD_READINGS_H
    old = "; if the glove was taken off since then, start over with --again all" if is_old else ""
    began = f"{readings.began:%Y-%m-%d %H:%M} UTC"
    typer.echo(f"{readings.path}: {len(readings.all)} readings since {began}{old}", err=True)


def _check(measured: Measured, yes: bool, skip: list[str] | None) -> None:
    is_simulated, motor = measured.simulate, measured.motor
    refuse(
        (is_simulated and measured.counts is not None, "--counts", "a simulated glove has its own counts"),
        (is_simulated and motor is not None, "--motor", "a simulated glove has its own drum"),
        (measured.arm and motor is None, "--arm", "requires --motor"),
        (not is_simulated and measured.seed, "--seed", "requires --simulate"),
        (not is_simulated and yes, "--yes", "requires --simulate"),
        *(
            (
                task not in ("free drum", "held drum"),
                "--skip",
                f"{task!r}: expected 'free drum' or 'held drum'",
            )
            for task in skip or ()
        ),
    )
