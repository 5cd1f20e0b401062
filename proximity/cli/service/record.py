"""Commands ``proximity record`` and ``export``, which log frames of a service and convert logs to tables."""

import sys
import time
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli import progress
from proximity.cli.options import ADDRESS, JSON_SUMMARY, LIMIT, argument, option, refuse
from proximity.cli.output import STDOUT, counted, report, text_output, write_document
from proximity.cli.program import EXIT_NOTHING, stop_after
from proximity.system.stop_signals import stopped_by_signals

if TYPE_CHECKING:
    import numpy as np

    from proximity.recording import FrameLog
    from proximity.transport import Counts, Inlet, Subscriber

TURN_S = 0.05  # maximum delay of a stop
GATHER_S = 0.002  # wait for several frames, since waking for each costs more; buffers hold 60 and more
ANNOUNCE_AFTER_S = 2.0  # wait for a first frame before a note reports it


def record(
    address: ADDRESS,
    out: Annotated[Path, option("FILE", "Log of frames (.frames). Created if missing, else continued.")],
    limit: LIMIT = None,
    as_json: JSON_SUMMARY = False,
) -> None:
    """Write every frame published at ADDRESS to a log, until Ctrl-C, SIGTERM or --limit.

    Frames are appended: an existing log is continued, and a crash loses at most the frame being
    written. Frames lost in transit are gaps in the sequence numbers. The exit code is 1 if no frame
    arrived.

    Examples:
      proximity record shm://proximity --out run.frames
      proximity record udp://127.0.0.1:9100 --out run.frames --limit 60 --json
      proximity export run.frames --csv run.csv
    """
    from proximity.recording import FrameLog
    from proximity.transport import Subscriber, open_inlet

    with ExitStack() as opened:
        stop = opened.enter_context(stopped_by_signals())
        inlet = open_inlet(address)
        subscriber = opened.enter_context(Subscriber(inlet, address))
        log = opened.enter_context(FrameLog(out))
        if log.cut_size:
            report(f"{out}: {log.cut_size} bytes of a torn frame at its end were cut off")
        started = time.monotonic()
        stop_after(limit, stop)
        try:
            _record(inlet, subscriber, log, stop)
        finally:  # also on a full disk: the summary reports the frames in the log
            summary = _summary(log, time.monotonic() - started, subscriber.counts)
            if as_json:
                write_document(summary)
            else:
                typer.echo(_words(summary))
    if not log.frame_count:
        raise typer.Exit(EXIT_NOTHING)


def _summary(log: "FrameLog", seconds: float, counts: "Counts") -> dict[str, Any]:
    """Return the numbers of recorded, lost and rejected messages, and the reasons of rejections."""
    others = {"from another sender": counts.refused, "not verified by the key": counts.unverified}
    reasons = {defect.value: count for defect, count in counts.flawed.most_common()}
    return {
        "file": str(log.path),
        "frames": log.frame_count,
        "seconds": round(seconds, 3),
        "lost": counts.lost,
        "refused": counts.unused,
        "reasons": reasons | {reason: count for reason, count in others.items() if count},
        "sessions": counts.sessions,
    }


def _words(summary: dict[str, Any]) -> str:
    reasons = ", ".join(f"{count} {reason}" for reason, count in summary["reasons"].items())
    counts = f"{summary['lost']} lost, {summary['refused']} refused" + (f" ({reasons})" if reasons else "")
    counts += f", {summary['sessions']} sessions" if summary["sessions"] > 1 else ""
    return f"{summary['file']}: {counted(summary['frames'], 'frame')} in {summary['seconds']:.1f} s, {counts}"


def _record(inlet: "Inlet", subscriber: "Subscriber", log: "FrameLog", stop: Event) -> None:

    started, has_waited = time.monotonic(), False
    with progress.spinner("recording") as show:
        while not stop.is_set():
            inlet.wait(TURN_S)
            time.sleep(GATHER_S)
            for data in subscriber.frames():
                log.append(data)
            elapsed = time.monotonic() - started
            if log.frame_count:
                show(_words(_summary(log, elapsed, subscriber.counts)))
            elif elapsed > ANNOUNCE_AFTER_S and not has_waited:
                report(f"no frame from {subscriber.address} yet")
                has_waited = True
        for data in subscriber.frames():  # frames received while the last one was written
            log.append(data)


def export(
    file: Annotated[Path, argument("FILE", "Log of frames.")],
    csv: Annotated[Path | None, option("FILE", "Write CSV to this file; - is standard output.")] = None,
    parquet: Annotated[Path | None, option("FILE", "Write Parquet to this file. Requires pyarrow.")] = None,
) -> None:
    """Write the frames in FILE, a log of record or serve, as a table with one line for each finger
    and frame.

    A line has the session, number, state and instants of its frame, then all fields of the contact.
    Vectors take three columns; column names end in the unit. CSV has words for flags, surface, mode
    and source, Parquet their numbers (`proximity client header` lists them). Without --csv and
    --parquet, CSV is written to standard output. Torn or damaged frames are skipped and reported.

    Examples:
      proximity export run.frames --csv run.csv
      proximity export run.frames --parquet run.parquet
      proximity export run.frames | head
    """
    out = csv or parquet or STDOUT
    is_log = out != STDOUT and out.exists() and file.exists() and out.samefile(file)
    refuse(
        (csv and parquet, "--parquet", "expected one of --csv and --parquet"),
        (parquet == STDOUT, "--parquet", "Parquet is not written to standard output"),
        (is_log, "--csv or --parquet", f"{out} is the log itself"),
    )
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
        report(f"{file}: {note}")


def _write(out: Path, runs: "Iterable[np.ndarray]", *, is_parquet: bool) -> int:
    """Write a table, which replaces an existing file at the end. Return the number of lines."""
    from proximity.recording import load_pyarrow, write_frames_csv, write_frames_parquet

    if is_parquet:
        load_pyarrow()  # raises an error before a file is created
        from proximity.system.whole_file import whole_file

        with whole_file(out) as stream:
            return write_frames_parquet(stream, runs)
    with text_output(out) as text:
        return write_frames_csv(text, runs)
