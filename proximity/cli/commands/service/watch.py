"""``proximity watch``: show live what a service publishes."""

import time

import typer

from proximity.cli.options import ADDRESS, LIMIT, check_limit
from proximity.cli.program import EXIT_NOTHING
from proximity.system.stop_signals import stopped_by_signals

HELP = "\n\n".join(
    (
        "Show the fingers of the service that publishes at ADDRESS, until Ctrl-C or --limit.",
        "Per finger: the nearest part, the distance or its bounds, when it will touch, how fast it comes "
        "near, what the drum is advised to do, and flags. Above: the state, the rate, the age of the oldest "
        "pose, frames lost and refused. Where the output is no terminal it is one line a second. The exit "
        "code is 1 if no frame came.",
    )
)

EXAMPLES = """
Examples:
  proximity watch iox2://decaff
  proximity watch udp://127.0.0.1:9100 --limit 10 > lines.txt
"""

TURN_S = 0.02  # within that a wish to stop is noticed, and a silence shown


def command(address: ADDRESS, limit: LIMIT = None) -> None:
    """Show a service until asked to stop."""
    check_limit(limit)
    # NumPy, Rich and the library: only now, so that --help and mistakes above answer at once.
    from proximity.cli.console import Console
    from proximity.cli.views.screen import Screen
    from proximity.cli.views.service_watch import Follower, show
    from proximity.transport import open_subscriber

    ends = None if limit is None else time.monotonic() + limit
    with stopped_by_signals() as stop, open_subscriber(address) as subscriber, Screen(Console()) as screen:
        follower = Follower(subscriber)
        while not stop.is_set() and (ends is None or time.monotonic() < ends):
            show(screen, *follower.look(TURN_S))
        received = subscriber.counts.received
    if not received:
        raise typer.Exit(EXIT_NOTHING)
