"""``proximity record``: write every frame that a service publishes to a file."""

import time
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING, Annotated

import typer

from proximity.cli.options import ADDRESS, LIMIT, check_limit
from proximity.cli.program import EXIT_NOTHING
from proximity.system.stop_signals import stopped_by_signals

if TYPE_CHECKING:
    from proximity.recording import FrameLog
    from proximity.transport import Counts, Inlet, Subscriber

HELP = "\n\n".join(
    (
        "Write every frame published at ADDRESS to FILE, until Ctrl-C, SIGTERM or --limit.",
        "FILE is only appended to: an existing log is continued, and a crash loses at most the frame that "
        "was being written. Frames that were lost in transit are gaps in the sequence numbers. The exit "
        "code is 1 if no frame came.",
    )
)

EXAMPLES = """
Examples:
  proximity record iox2://decaff run.frames
  proximity record udp://127.0.0.1:9100 run.frames --limit 60 --json
  proximity export run.frames --csv run.csv
"""

TURN_S = 0.05  # within that a wish to stop is noticed
GATHER_S = 0.002  # that frames are let come: to wake for each would cost more; buffers hold 60 and more
ANNOUNCE_AFTER_S = 2.0  # of waiting for a first frame before that is said


def command(
    address: ADDRESS,
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Log of frames. Created if missing, otherwise continued.")
    ],
    limit: LIMIT = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write the summary as a JSON document.")] = False,
) -> None:
    """Record frames until asked to stop."""
    check_limit(limit)
    # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
    from proximity.recording import FrameLog
    from proximity.transport import Subscriber, open_inlet

    with ExitStack() as opened:
        stop = opened.enter_context(stopped_by_signals())
        inlet = open_inlet(address)
        subscriber = opened.enter_context(Subscriber(inlet, address))
        log = opened.enter_context(FrameLog(file))
        if log.cut_size:
            typer.echo(
                f"proximity: {file}: {log.cut_size} bytes of a torn frame at its end were cut off", err=True
            )
        started = time.monotonic()
        try:
            _record(inlet, subscriber, log, stop, limit)
        finally:  # also on a full disk: the log holds what is reported here
            seconds = time.monotonic() - started
            _write_summary(file, log.frame_count, seconds, subscriber.counts, as_json=as_json)
    if not log.frame_count:
        raise typer.Exit(EXIT_NOTHING)


def _write_summary(file: Path, frame_count: int, seconds: float, counts: "Counts", *, as_json: bool) -> None:
    from proximity.cli.views.json_output import write_document

    if not as_json:
        typer.echo(f"{file}: {summary(frame_count, seconds, counts)}")
        return
    write_document(
        {
            "file": str(file),
            "frames": frame_count,
            "seconds": round(seconds, 3),
            "lost": counts.lost,
            "refused": counts.unused,
            "reasons": _reasons(counts),
            "sessions": counts.sessions,
        }
    )


def _reasons(counts: "Counts") -> dict[str, int]:
    """How many messages were refused, and why."""
    reasons = {defect.value: count for defect, count in counts.flawed.items()}
    others = {"from another sender": counts.refused, "not verified by the key": counts.unverified}
    return reasons | {reason: count for reason, count in others.items() if count}


def summary(frame_count: int, seconds: float, counts: "Counts") -> str:
    """Return what was recorded, in words."""
    reasons = [f"{count} {reason}" for reason, count in _reasons(counts).items()]
    frames = "1 frame" if frame_count == 1 else f"{frame_count} frames"
    return (
        f"{frames} in {seconds:.1f} s, {counts.lost} lost, {counts.unused} refused"
        + (f" ({', '.join(reasons)})" if reasons else "")
        + (f", {counts.sessions} sessions" if counts.sessions > 1 else "")
    )


def _record(
    inlet: "Inlet", subscriber: "Subscriber", log: "FrameLog", stop: Event, limit: float | None
) -> None:
    from proximity.cli.progress import Status

    started = time.monotonic()
    with Status() as status:
        while not stop.is_set():
            elapsed = time.monotonic() - started
            if limit is not None and elapsed >= limit:
                break
            inlet.wait(TURN_S if limit is None else min(TURN_S, limit - elapsed))
            time.sleep(GATHER_S)
            for data in subscriber.frames():
                log.append(data)
            if log.frame_count:
                status.show(f"{log.path}: {summary(log.frame_count, elapsed, subscriber.counts)}")
            elif elapsed > ANNOUNCE_AFTER_S:
                status.say_once(f"no frame has come from {subscriber.address} yet")
        for data in subscriber.frames():  # what came while the last was being written
            log.append(data)
