"""Command ``proximity watch``, which shows the frames of a service live."""

import time
from threading import Event
from typing import Annotated

import typer

from proximity.cli.options import ADDRESS, LIMIT, flag
from proximity.cli.output import write_document
from proximity.cli.program import EXIT_NOTHING, stop_after
from proximity.system.stop_signals import stopped_by_signals

TURN_S = 0.02  # maximum delay of a stop, and of showing that no frames arrive


def watch(
    address: ADDRESS,
    limit: LIMIT = None,
    as_json: Annotated[bool, flag("--json", "Write every frame as one line of JSON, in SI units.")] = False,
) -> None:
    """Show the fingers of the service that publishes at ADDRESS, until Ctrl-C or --limit.

    For each finger: the nearest part, the distance or its bounds, the time until touch, the approach
    speed, the advised mode of the drum, and flags. Above the table: the state, the frame rate, the age
    of the oldest pose, and the numbers of lost and rejected frames. If the output is not a terminal, one
    line a second is written. --json writes every frame as one line of JSON instead, in SI units, with
    `received_ns`, the time of arrival by this machine's clock: on the machine of the service, its
    difference to `pose_ns` is the age of the pose. The exit code is 1 if no frame arrived.

    Examples:
      proximity watch shm://proximity
      proximity watch udp://127.0.0.1:9100 --limit 10 > lines.txt
      proximity watch shm://proximity --json | head -1
    """
    with stopped_by_signals() as stop:
        stop_after(limit, stop)
        received = (_write_lines if as_json else _show)(address, stop)
    if not received:
        raise typer.Exit(EXIT_NOTHING)


def _show(address: str, stop: Event) -> int:
    """Show the newest frame until stopped. Return the number of received frames."""
    from proximity.cli.service.watch_view import Follower, show
    from proximity.cli.tables import Console, Screen
    from proximity.transport import open_subscriber

    with open_subscriber(address) as subscriber, Screen(Console()) as screen:
        follower = Follower(subscriber)
        while not stop.is_set():
            show(screen, *follower.look(TURN_S))
        return subscriber.counts.received


def _write_lines(address: str, stop: Event) -> int:
    """Write every frame as a line until stopped. Return the number of received frames."""
    from proximity.cli.service.finger_view import frame_document
    from proximity.recording.frame_bytes import frame_type
    from proximity.transport import Subscriber, open_inlet

    inlet = open_inlet(address)
    with Subscriber(inlet, address) as subscriber:
        while not stop.is_set():
            inlet.wait(TURN_S)
            received_ns = time.monotonic_ns()
            for data in subscriber.frames():
                (frame,) = data.view(frame_type(len(data)))
                document = {"received_ns": received_ns} | frame_document(frame, subscriber.part_names)
                write_document(document, indent=None)
        return subscriber.counts.received
