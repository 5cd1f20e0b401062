"""``proximity export``: a frame log as a table for other programs."""

import io
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy as np

HELP = "\n\n".join(
    (
        "Write the frames in FILE, a log of record or serve, as a table with one line for each finger and "
        "frame.",
        "A line has the session, number, state and instants of its frame, then all fields of the contact. "
        "Vectors take three columns, instants are in nanoseconds, lengths in metres. Without --csv and "
        "--parquet, CSV is written to standard output. Torn or damaged frames are skipped and reported.",
    )
)

EXAMPLES = """
Examples:
  proximity export run.frames --csv run.csv
  proximity export run.frames --parquet run.parquet
  proximity export run.frames | head
"""

STDOUT = Path("-")


def command(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Log of frames.")],
    csv: Annotated[
        Path | None,
        typer.Option("--csv", metavar="OUT", help="Write CSV to this file; - is standard output."),
    ] = None,
    parquet: Annotated[
        Path | None,
        typer.Option("--parquet", metavar="OUT", help="Write Parquet to this file. Requires pyarrow."),
    ] = None,
) -> None:
    """Write a log of frames as a table."""
    out = csv or parquet or STDOUT
    if csv and parquet:
        raise typer.BadParameter("expected one of --csv and --parquet", param_hint="--parquet")
    if parquet == STDOUT:
        raise typer.BadParameter("Parquet is not written to standard output", param_hint="--parquet")
    if out != STDOUT and out.exists() and file.exists() and out.samefile(file):
        raise typer.BadParameter(f"{out} is the log itself", param_hint="OUT")
    # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
    from proximity.cli import progress
    from proximity.recording import FrameReader, write_frames_csv

    reader = FrameReader(file)
    if out == STDOUT:
        write_frames_csv(sys.stdout, reader)
    else:
        with progress.spinner(f"writing {out}, frames") as count:
            runs = progress.counted(reader, count)
            line_count = _write(out, runs, is_parquet=parquet is not None)
        typer.echo(f"{out}: {reader.frame_count} frames, {line_count} lines")
    for note in reader.notes:
        typer.echo(f"proximity: {file}: {note}", err=True)


def _write(out: Path, runs: "Iterable[np.ndarray]", *, is_parquet: bool) -> int:
    """Write a table in place of what is there, at once and wholly; how many lines."""
    from proximity.recording import load_pyarrow, write_frames_csv, write_frames_parquet
    from proximity.system.whole_file import whole_file

    if is_parquet:
        load_pyarrow()  # where it is missing, not even an unfinished file is made
        with whole_file(out) as stream:
            return write_frames_parquet(stream, runs)
    with whole_file(out) as stream, io.TextIOWrapper(stream, encoding="utf-8", newline="") as text:
        return write_frames_csv(text, runs)
