"""Command ``proximity experiment``, which compares walls in an experiment with people."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from proximity.cli import output, progress
from proximity.cli.device.drum import ARM, MAX_AGE, MOTOR, RATE, SWITCH_S
from proximity.cli.options import GLOVES, argument, option
from proximity.cli.program import EXIT_INTERRUPTED, Command, Group

if TYPE_CHECKING:
    from collections.abc import Sequence

    from proximity.lab.experiment.analysis import Findings
    from proximity.lab.experiment.design import Design

HELP = (
    "Compare walls in an experiment with people: DECAFF, coupled walls, real surfaces.\n\n"
    "Participants are pseudonyms. Each session is one CSV file, a row per trial. The same command continues "
    "a session that was stopped, even by a crash; only the current trial is lost."
)
SHIPPED = "decaff_against_coupled.toml"

experiment = typer.Typer(name="experiment", cls=Group, help=HELP, no_args_is_help=True, add_completion=False)

DESIGN = Annotated[Path, argument("DESIGN", "Design of the experiment (.toml).")]
OUT = Annotated[Path, option("DIR", "Folder of the sessions; created if missing.", "--data")]


def _command(example: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Register a command. The first word of its example is its name."""
    epilog = f"\nExample:\n  proximity experiment {example}\n"
    return experiment.command(example.partition(" ")[0], cls=Command, epilog=epilog, no_args_is_help=True)


@_command("new --out comparison.toml")
def new(path: Annotated[Path, option("FILE", "File to write.", "--out")]) -> None:
    """Write the sample design: DECAFF and coupled walls, each at 1 and 10 ms."""
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
    interval (1 or 2) that differs from the other, 0 for two equal surfaces, and level that of the stimulus.
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
        if isinstance(step, planning.Text):
            typer.echo(step.name)
        else:
            names = (step.stage, step.task.name, step.condition.name)
            typer.echo("\t".join(map(str, (step.number, step.run, *names, f"{step.level:g}", step.odd))))
    trials = len(planning.trials_of(steps))
    output.report(
        f"{trials} trials, {planning.minutes(read, steps):.0f} minutes as planned, design {read.digest}"
    )
    for sentence in unstable_walls(read):
        output.report(sentence)


@_command("run comparison.toml p07 --address shm://proximity --data people")
def run(
    design: DESIGN,
    participant: Annotated[str, argument("PARTICIPANT", "Pseudonym, such as p07.")],
    address: Annotated[str, option("ADDRESS", "Where the service publishes its frames.")],
    data: OUT = Path("experiment"),
    finger: Annotated[int, option("N", "Finger that presses.", min=0)] = 0,
    rate: RATE = 1000.0,
    glove: GLOVES = None,
    max_age: MAX_AGE = None,
    motor: MOTOR = None,
    arm: ARM = False,
) -> None:
    """Run a session with a participant, on a drum of a service that is simulated or has a motor.

    Before the first participant the power of the design is printed. Ctrl-C retracts the drum and stops.
    """
    from proximity.cli.lab.participant import Drums, run_session
    from proximity.lab.experiment.design_file import read_design
    from proximity.lab.experiment.visit import check_pseudonym

    if bool(motor) != arm:
        raise typer.BadParameter("a motor moves only with both --motor and --arm", param_hint="--motor")
    check_pseudonym(participant)
    read = read_design(design)
    _print_power_before_the_first(read, data)
    sys.setswitchinterval(SWITCH_S)
    drums = Drums(address, rate, finger, glove or [], max_age, motor or [])
    if ending := run_session(read, data, participant, drums):
        output.report(ending)
        raise typer.Exit(EXIT_INTERRUPTED)
    typer.echo(f"{data / participant}.csv: {participant} is done")


@_command("simulate comparison.toml --data simulated")
def simulate(
    design: DESIGN,
    data: OUT = Path("experiment"),
    participant: Annotated[
        str | None, option("NAME", "Only this participant, such as p01; all if not given.")
    ] = None,
) -> None:
    """Run the whole experiment with simulated observers, whose files are those of people."""
    from proximity.lab.experiment.design_file import read_design
    from proximity.lab.experiment.observers import Observer
    from proximity.lab.experiment.visit import check_pseudonym, place, read_visits, run_visit

    read = read_design(design)
    names = [participant] if participant else [f"p{n:02d}" for n in range(1, read.participants + 1)]
    check_pseudonym(names[0])
    _print_power_before_the_first(read, data)
    for name in names:
        with progress.spinner(f"{name} presses and answers"):
            slot = place(read, read_visits(read, data), name, Observer.name, data)[0]
            observer = Observer(read, slot)
            run_visit(read, data, name, observer, observer)
    typer.echo(f"{data}: {len(names)} participants")


@_command("report comparison.toml simulated --out comparison.pdf")
def report(
    design: DESIGN,
    data: Annotated[Path, argument("DATA", "Folder of the sessions.")],
    out: Annotated[Path, option("FILE", "Figure to write (.png, .svg, .pdf).")] = Path("experiment.pdf"),
    table: Annotated[
        Path | None, option("FILE", "CSV to write: a score per participant, task and condition.", "--csv")
    ] = None,
) -> None:
    """Analyse the sessions: a figure with psychometric functions, means and the planned comparisons."""
    from proximity.lab.experiment.analysis import analyse
    from proximity.lab.experiment.design_file import read_design
    from proximity.lab.experiment.figure import write_figure
    from proximity.lab.experiment.visit import read_visits
    from proximity.lab.figures.style import check_format

    check_format(out.suffix.removeprefix("."))
    read = read_design(design)
    if not (rows := read_visits(read, data)):
        raise typer.BadParameter(f"{data}: contains no sessions, expected a folder of run or simulate")
    with progress.spinner("fitting psychometric functions"):
        findings = analyse(read, rows)
        write_figure(findings, out)
    for sentence in (*findings.excluded, findings.simulated_note):
        if sentence:
            output.report(sentence)
    _print_findings(findings)
    if table is not None:
        _write_scores(findings, table)
    typer.echo(f"{out}: written")


@_command("power comparison.toml --participants 8 --participants 32")
def power(
    design: DESIGN,
    participants: Annotated[
        list[int] | None,
        option("N", "Number of participants, instead of the design's. Can be given several times.", min=3),
    ] = None,
) -> None:
    """Estimate by simulation how often the analysis finds the expected differences."""
    from proximity.lab.experiment.design_file import read_design

    read = read_design(design)
    _print_power(read, participants or [read.participants])


def _print_power_before_the_first(design: "Design", data: Path) -> None:
    if not any(data.glob("*.csv")):
        _print_power(design, [design.participants])


def _print_power(design: "Design", sizes: "Sequence[int]") -> None:
    from proximity.cli.tables import results_console, table
    from proximity.lab.experiment.power import power as power_of

    rows = [
        [
            f"{one.participants}", one.task, " against ".join(one.pair),
            " and ".join(f"{value:.2g}" for value in one.expected), f"{one.share:.0%}", f"{one.smallest:.2g}",
        ]
        for size in sizes
        for one in power_of(design, size)
    ]  # fmt: skip
    titles = ("participants", "task", "comparison"), ("expected", "power", "80 % find")
    results_console().print(table(*titles, rows))


def _print_findings(findings: "Findings") -> None:
    from proximity.cli.tables import results_console, table
    from proximity.lab.experiment.analysis import MEANING, shown

    console = results_console()
    rows, pairs = [], []
    for task in findings.design.tasks:
        for condition in findings.design.compared(task):
            mean = findings.mean(task.name, condition.name)
            values = [f"{shown(task.kind, value):.3g}" for value in (mean.value, mean.lower, mean.upper)]
            rows.append([task.name, condition.name, MEANING[task.kind], *values, f"{mean.participants}"])
    for one in findings.comparisons:
        ends = (one.difference.value, one.difference.lower, one.difference.upper)
        pairs.append(
            [one.task, " against ".join(one.pair), *(f"{value:.3f}" for value in ends), f"{one.p:.2g}"]
        )
    titles = ("mean", "lower", "upper")
    console.print(table(("task", "condition", "score"), (*titles, "participants"), rows))
    if pairs:
        typer.echo("\nDifferences of log10 thresholds and of log-odds, 95 % intervals, p by Holm:")
        console.print(table(("task", "comparison"), ("difference", "lower", "upper", "p"), pairs))


def _write_scores(findings: "Findings", path: Path) -> None:
    from proximity.lab.experiment.analysis import shown
    from proximity.lab.figures.style import Table, write_table

    kinds = {task.name: task.kind for task in findings.design.tasks}
    rows = []
    for key, value in findings.scores.items():
        fitted = findings.functions.get(key)
        ends = (
            (fitted.threshold, fitted.lower, fitted.upper)
            if fitted
            else (shown(kinds[key[0]], value), "", "")
        )
        rows.append((*key, *ends))
    write_table(path, Table.of_rows(("task", "condition", "participant", "score", "lower", "upper"), rows))
