"""Open the motors of ``drum`` and ``calibrate`` with a warning, and show them while they are not armed."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from proximity.cli.output import report
from proximity.decaff.calibration.instruments import MotorPort
from proximity.decaff.glove.calibrated_glove import CalibratedGlove
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.decaff.motors.motor_drum import NOT_ON_HARDWARE, MotorDrum, opened_motors

LOOK_S, SHOWN_S = 0.005, 1.0  # s between two readings of unarmed motors, and between two lines


@contextmanager
def armable_motors(addresses: list[str], gloves: list[Glove | CalibratedGlove]) -> Iterator[list[MotorDrum]]:
    """Open motors, which stay off, and switch them off at the end of the block.

    A warning reports that the drivers were not tested.
    """
    if addresses:
        report(NOT_ON_HARDWARE)
    each: list[Glove | CalibratedGlove] = [*gloves] or [Glove()]
    each = each if len(each) > 1 else each * len(addresses)
    if len(addresses) > len(each):
        raise typer.BadParameter("there are fewer calibrations than motors", param_hint="--motor")
    paths = [FingerPath(glove) for glove in each[: len(addresses)]]
    with opened_motors(addresses, paths, report) as motors:
        yield motors


def watch_motors(motors: list[MotorDrum], stop: threading.Event) -> None:
    """Show the readings of motors every second without moving them."""
    report("not armed: the motors are read, and stay off (--arm lets them move)")
    due = 0.0
    for motor in motors:
        motor.await_answer(stop.wait)
    while not stop.wait(LOOK_S):
        for motor in motors:
            motor.look()
        if time.monotonic() >= due:
            due = time.monotonic() + SHOWN_S
            for i, motor in enumerate(motors):
                seen = motor.reading
                state = "on" if seen.is_on else "off"
                typer.echo(f"motor {i}: {seen.turns:.4f} turns, {seen.current:.3f} A, {state}")


@contextmanager
def opened_port(address: str, glove: Glove) -> Iterator[MotorPort]:
    """Open a motor and switch it off at the end of the block. It stays off until its port homes it."""
    with (
        armable_motors([address], [glove]) as (motor,),
        MotorPort(motor, FingerPath(glove).drum) as port,
    ):
        yield port
