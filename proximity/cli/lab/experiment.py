"""``proximity experiment``: experiments with people, from the design to the report."""

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli import output, progress
from proximity.cli.device.drum import ARM, MAX_AGE, MOTOR, RATE, SWITCH_S
from proximity.cli.options import GLOVES, argument, flag, option
from proximity.cli.program import EXIT_INTERRUPTED, Command, Group

HELP = (
    "Compare walls in an experiment with people: DECAFF, coupled walls, real surfaces.\n\n"
    "Participants are pseudonyms. The data are a BIDS folder. The same command continues a session that was "
    "stopped, even by a crash; only the current trial is lost."
)
SHIPPED = "decaff_against_coupled.toml"

experiment = typer.Typer(name="experiment", cls=Group, help=HELP, no_args_is_help=True, add_completion=False)

DESIGN = Annotated[Path, argument("DESIGN", "Design of the experiment (.toml).")]
DATA = Annotated[Path, argument("DATA", "Folder of the data.")]
PARTICIPANT = Annotated[str, argument("PARTICIPANT", "Pseudonym, such as p07.")]
OUT = Annotated[Path, option("DIR", "Folder of the data; created if missing.", "--data")]


def _command(example: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A command that is called as its example, whose first word is the command's name."""
    epilog = f"\nExample:\n  proximity experiment {example}\n"
    return experiment.command(example.partition(" ")[0], cls=Command, epilog=epilog, no_args_is_help=True)


@_command("new --out comparison.toml")
def new(path: Annotated[Path, option("FILE", "File to write.", "--out")]) -> None:
    """Write the sample design: DECAFF against coupled walls of 1, 3 and 10 ms."""
    from importlib.resources import files

    text = (files("proximity.lab.experiment") / SHIPPED).read_text(encoding="utf-8")
    try:
        with path.open("x", encoding="utf-8") as stream:
            stream.write(text)
    except OSError as failed:
        hint = ": choose another name" if isinstance(failed, FileExistsError) else ""
        raise typer.BadParameter(f"{path} cannot be written ({failed.strerror}){hint}") from failed
    typer.echo(f"{path}: written")


@_command("plan comparison.toml --slot 3")
def plan(
    design: DESIGN,
    slot: Annotated[int, option("N", "Number of the participant in the plan, from 0.")] = 0,
) -> None:
    """Print the trials of a participant in their order, as tab-separated lines; notes go to stderr.

    The column step is the number of the trial, run the pass of its task through the conditions, odd the
    interval (1 or 2) that differs from the other, and level that of the stimulus.
    """
    from proximity.lab.experiment import plan as planning
    from proximity.lab.experiment.design_file import read_design
    from proximity.lab.experiment.observers import unstable_walls

    read = read_design(design)
    if not 0 <= slot < read.participants:
        raise typer.BadParameter(
            f"{slot}: the design has {read.participants} participants, expected 0 to {read.participants - 1}",
            param_hint="--slot",
        )
    steps = planning.plan(read, slot)
    typer.echo("step\trun\tstage\ttask\tcondition\tlevel\todd")
    for step in steps:
        if isinstance(step, planning.PlannedTrial):
            level = "chosen" if step.level is None else f"{step.level:g}"
            cells = (step.number, step.run, step.stage, step.task, step.condition, level, step.odd + 1)
            typer.echo("\t".join(map(str, cells)))
        else:
            typer.echo(getattr(step, "name", None) or f"question {getattr(step, 'key', '')}")
    trials = len(planning.trials_of(steps))
    output.report(
        f"{trials} trials, {planning.minutes(read, steps):.0f} minutes as planned, design {read.sha256[:16]}"
    )
    for sentence in unstable_walls(read):
        output.report(sentence)


@_command("run comparison.toml p07 --address shm://decaff --data people")
def run(
    design: DESIGN,
    participant: PARTICIPANT,
    address: Annotated[str, option("ADDRESS", "Where the service publishes its frames.")],
    data: OUT = Path("experiment"),
    finger: Annotated[int, option("N", "Finger that presses.", min=0)] = 0,
    terminal: Annotated[bool, flag("--terminal", "Ask in the terminal instead of on a page.")] = False,
    browser: Annotated[
        bool, flag("--browser/--no-browser", "Open the participant's page in a browser.")
    ] = True,
    rate: RATE = 1000.0,
    glove: GLOVES = None,
    max_age: MAX_AGE = None,
    motor: MOTOR = None,
    arm: ARM = False,
) -> None:
    """Run a session with a participant, on a drum of a service that is simulated or has a motor."""
    from proximity.cli.lab.participant_session import Drums, run_session
    from proximity.lab.experiment.dataset import Dataset, check_pseudonym
    from proximity.lab.experiment.design_file import read_design

    if bool(motor) != arm:
        raise typer.BadParameter("a motor moves only with both --motor and --arm", param_hint="--motor")
    check_pseudonym(participant)
    dataset = Dataset(data, read_design(design))
    sys.setswitchinterval(SWITCH_S)
    drums = Drums(address, rate, finger, glove or [], max_age, motor or [])
    ending = run_session(dataset, participant, drums, at_terminal=terminal, opens_browser=browser)
    if ending:
        output.report(ending)
        raise typer.Exit(EXIT_INTERRUPTED)
    typer.echo(f"{data}: {participant} is done")


@_command("simulate comparison.toml --data simulated")
def simulate(
    design: DESIGN,
    data: OUT = Path("experiment"),
    participant: Annotated[
        str | None, option("NAME", "Only this participant, such as p01; all if not given.")
    ] = None,
) -> None:
    """Run the whole experiment with simulated observers, which fill the same log as people."""
    from proximity.lab.experiment.dataset import Dataset
    from proximity.lab.experiment.design_file import read_design
    from proximity.lab.experiment.observers import Observer
    from proximity.lab.experiment.session import run_visit

    read = read_design(design)
    dataset, started = Dataset(data, read), time.monotonic()
    names = [participant] if participant else [f"p{n:02d}" for n in range(1, read.participants + 1)]
    for name in names:
        observer = Observer(read, dataset.register(name, Observer.name))
        with progress.spinner(f"{name} presses and answers"):
            run_visit(dataset, name, observer, observer)
        output.report(f"{name} is done ({time.monotonic() - started:.0f} s)")
    typer.echo(f"{data}: {len(names)} participants")


@_command("report simulated")
def report(
    data: DATA,
    out: Annotated[
        Path | None, option("DIR", "Folder to write to; derivatives/report in DATA if not given.")
    ] = None,
) -> None:
    """Analyse the data: a page, plots, tables as CSV, and a methods paragraph."""
    from proximity.lab.experiment.analysis.findings import find
    from proximity.lab.experiment.analysis.report import write_report
    from proximity.lab.experiment.dataset import DERIVED, Dataset

    dataset = Dataset(data)
    entries = dataset.trials()
    with progress.spinner("fitting psychometric functions"):
        findings = find(dataset.design, entries)
        files = write_report(findings, out or data / DERIVED / "report")
    for one in findings.comparisons.values():
        if one is not None:
            typer.echo(f"{one.task}: F({one.df[0]}, {one.df[1]}) = {one.f:.2f}, p = {one.p:.2g}")
    for missing in findings.missing:
        output.report(f"not analysed: {missing}")
    if findings.simulated:
        output.report(findings.simulated_note)
    typer.echo(f"{files[0]}: written, with {len(files) - 1} files beside it")


@_command("power comparison.toml --participants 8 --participants 12 --effect 1.5")
def power(
    design: DESIGN,
    participants: Annotated[
        list[int] | None, option("N", "Number of participants. Can be given several times.", min=3)
    ] = None,
    effect: Annotated[
        float | None,
        option(
            "RATIO",
            "Thresholds of the other conditions divided by the first; as designed if not given.",
            min=0.01,
        ),
    ] = None,
    repetitions: Annotated[int, option("N", "Number of simulated experiments.", min=10)] = 1000,
) -> None:
    """Simulate how often the analysis finds an effect, for several numbers of participants."""
    from proximity.cli.tables import results_console, table
    from proximity.lab.experiment.analysis import simulation
    from proximity.lab.experiment.design_file import read_design

    read = read_design(design)
    read = read if effect is None else simulation.with_effect(read, effect)
    sizes = tuple(participants or simulation.PARTICIPANTS)
    with progress.spinner("simulating participants") as show:
        found = simulation.power(read, sizes, repetitions, watch=show)
    rows = []
    for task, comparison in dict.fromkeys((one.task, one.comparison) for one in found):
        own = [one.share for one in found if (one.task, one.comparison) == (task, comparison)]
        rows.append([task, comparison, *(f"{share:.0%}" for share in own)])
    results_console().print(table(("task", "comparison"), [f"{size} participants" for size in sizes], rows))


@_command("check comparison.toml --repetitions 100")
def check(
    design: DESIGN, repetitions: Annotated[int, option("N", "Number of simulated experiments.", min=1)] = 100
) -> None:
    """Check the analysis with simulated observers: false positives, and errors of thresholds."""
    from proximity.lab.experiment.analysis import simulation
    from proximity.lab.experiment.design_file import read_design

    read = read_design(design)
    with progress.spinner("simulating experiments") as show:
        shares = simulation.false_positives(read, repetitions, show)
        found = simulation.recovery(read)
    for task, share in shares.items():
        typer.echo(f"{task}: a difference was found in {share:.0%} of {repetitions} experiments without one")
    typer.echo(
        f"{found.covered} of {found.count} thresholds lie in their 95 % credible intervals; on average they "
        f"are found {abs(found.bias):.1%} too {'high' if found.bias > 0.0 else 'low'}"
    )


@_command("forget people p07")
def forget(data: DATA, participant: PARTICIPANT) -> None:
    """Delete all data of a participant, and the reports made with them."""
    from proximity.lab.experiment.dataset import Dataset

    Dataset(data).remove(participant)
    typer.echo(f"{data}: all data of {participant} are deleted, and reports with them")
