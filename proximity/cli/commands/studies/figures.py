"""``proximity figures``: the figures of the paper and of this project, with their numbers."""

import time
from pathlib import Path
from typing import Annotated

import typer

HELP = "\n\n".join(
    (
        "Draw the figures that are named, or all, into a folder; each with its numbers beside it, as CSV in "
        "SI units.",
        "5a to 5h are those of the paper; 5 has all eight on a page. stability shows the sampled wall's "
        "region; error-speed and error-latency compare coupled walls and drums with the real wall, "
        "error-engine a drum that the distance service controls at a CAD part; cable shows what the cable of "
        "a glove costs; drum-motion and arrival show when a drum is in position. Existing files are "
        "replaced. All take less than a minute. Needs matplotlib.",
    )
)

EXAMPLES = """
Examples:
  proximity figures
  proximity figures 5c 5h stability --out paper --format pdf
"""


def command(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help="5a to 5h, 5, stability, error-speed, error-latency, error-engine, cable, drum-motion, "
            "arrival; else all.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="Output folder; created if missing.")
    ] = Path("figures"),
    form: Annotated[str, typer.Option("--format", metavar="FORMAT", help="png, svg or pdf.")] = "png",
) -> None:
    """Write figures and their numbers."""
    # NumPy, Rich and the models: only now, so that --help answers at once.
    from proximity.cli import progress
    from proximity.studies.figures import catalogue

    began, file_count = time.monotonic(), 0
    chosen = catalogue.chosen_names(names or ())
    for name in chosen:
        started = time.monotonic()
        with progress.spinner(f"drawing {catalogue.PLATES[name].title}"):
            paths = catalogue.write_figure(name, out, form)
        file_count += len(paths)
        reported = ", ".join(path.name for path in paths)
        typer.echo(f"proximity: {reported} ({time.monotonic() - started:.1f} s)", err=True)
    typer.echo(f"{out}: {len(chosen)} figures, {file_count} files, {time.monotonic() - began:.1f} s")
