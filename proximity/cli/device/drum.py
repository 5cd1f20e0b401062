"""Command ``proximity drum``, which runs drums for the fingers of a service, simulated or with motors."""

import json
import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from proximity.cli.options import ADDRESS, CABLE, GLOVES, LIMIT, cable_stiffness, flag, option, refuse, within
from proximity.cli.output import report
from proximity.cli.program import EXIT_NOTHING, stop_after
from proximity.system.stop_signals import stopped_by_signals

MAX_RATE_HZ = 5000.0
MIN_RATE_HZ = 150.0  # slower, each sample would trip the watchdog of 10 ms
TURN_S = 0.02  # maximum delay of a stop
SWITCH_S = 1e-3  # maximum delay of the drums while the display is drawn


RATE = Annotated[
    float,
    option(
        "HZ",
        "Rate of the controllers; the servos run at 3 kHz.",
        "--rate",
        callback=within(MIN_RATE_HZ, MAX_RATE_HZ, "Hz"),
    ),
]
MAX_AGE = Annotated[
    float | None, option("DAYS", "Largest age of a calibration; 30 if not given.", "--max-age")
]
MOTOR = Annotated[
    list[str] | None,
    option("URL", "Motor of finger 0; a second one is that of finger 1, and so on.", "--motor"),
]
ARM = Annotated[bool, flag("--arm", "Let the motors move: home them, then follow. Requires --motor.")]


def drum(
    address: ADDRESS,
    limit: LIMIT = None,
    rate: RATE = 500.0,
    glove: GLOVES = None,
    max_age: MAX_AGE = None,
    cable: CABLE = None,
    motor: MOTOR = None,
    arm: ARM = False,
    log: Annotated[Path | None, option("FILE", "Write every sample to a CSV file.")] = None,
    as_json: Annotated[bool, flag("--json", "Print a summary at the end, as JSON.")] = False,
) -> None:
    """Run the drums of the service that publishes at ADDRESS, until Ctrl-C or --limit.

    Each finger has a controller, the same as for a real drum, and a simulated drum. The table shows
    the state, the positions of drum and finger on the finger's path, the drum's angle, the force between
    them and the torque of the motor. A sample that is 10 ms late is a fault, as on a real drum, and the
    controller restarts. With --cable the drum compensates the stretch of the cable while a finger
    is on it. A finger whose frames have no bend is assumed to bend straight towards the nearest
    surface, and marked. A terminal shows a live table, any other output one line a second; --json
    prints a summary at the end only. The exit code is 1 if no frame arrived.

    --motor URL drives a real drum instead: odrive-can://CHANNEL, or another with driver=FILE.
    Without --arm the motor is only read and never moves. With --arm it searches its mechanical stop,
    which moves it, and then follows. Any uncertainty switches all motors off; the reason is printed and
    the exit code is 2. These drivers were tested with simulated motors only, never on hardware.

    Examples:
      proximity drum shm://proximity
      proximity drum shm://proximity --glove glove.json --log drum.csv
      proximity drum udp://127.0.0.1:9100 --limit 10 --json
      proximity drum shm://proximity --motor "odrive-can://can0?node=0&kt=0.05"
      proximity drum shm://proximity --motor "odrive-can://can0?node=0&kt=0.05" --arm
    """
    refuse(
        (max_age is not None and not glove, "--max-age", "requires --glove"),
        (arm and not motor, "--arm", "requires --motor"),
    )
    from proximity.cli.device.drum_loop import DrumLog, DrumThread, show_drums, summary
    from proximity.cli.device.motors import armable_motors, watch_motors
    from proximity.cli.tables import Console, Screen
    from proximity.decaff.controller.settings import CableRule
    from proximity.decaff.glove.calibrated_glove import read_any_glove
    from proximity.decaff.motors.motor_drum import home_all
    from proximity.decaff.simulated_drums import DrumBench
    from proximity.transport import Reading, open_subscriber

    sys.setswitchinterval(SWITCH_S)
    rule = CableRule() if cable is None else CableRule(cable_stiffness(cable, max_age))
    gloves = [read_any_glove(path, max_age) for path in glove or ()]
    with stopped_by_signals() as stop, armable_motors(motor or [], gloves) as motors:
        if motors and not arm:
            stop_after(limit, stop)
            watch_motors(motors, stop)
            return
        with (
            open_subscriber(address) as subscriber,
            DrumLog(log) as written,
            Screen(Console(), is_silent=as_json) as screen,
        ):
            bench = DrumBench(rate, gloves, motors=motors, cable=rule)
            bench.warm_up()  # takes long, so that it is done before a motor is on
            home_all(motors, stop.wait, report)
            started = time.monotonic()
            stop_after(limit, stop)
            newest = [subscriber.read()]

            def look(reading: Reading) -> None:
                newest[0] = reading
                written.append(reading, bench)

            with DrumThread(bench, subscriber, rate, look) as drums:
                while drums.is_running and not stop.wait(TURN_S):
                    show_drums(screen, newest[0], bench)
            counts = subscriber.counts
    if as_json:
        typer.echo(json.dumps(summary(bench, address, counts, time.monotonic() - started), indent=2))
    if not counts.received:
        raise typer.Exit(EXIT_NOTHING)
