"""The motor of ``proximity calibrate``: opened with a word of warning, and homed before a swing."""

from collections.abc import Iterator
from contextlib import contextmanager

import typer

from proximity.cli.drum_motors import watch_motors
from proximity.decaff.calibrating.motor_port import MotorPort
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.decaff.motors.motor_drum import NOT_ON_HARDWARE
from proximity.decaff.motors.motor_set import opened_motors
from proximity.system.stop_signals import stopped_by_signals


def report(sentence: str) -> None:
    """Say something about the motor."""
    typer.echo(f"proximity: {sentence}", err=True)


@contextmanager
def opened_port(address: str, glove: Glove) -> Iterator[MotorPort]:
    """Open a motor, which stays off until its port homes it; it ends switched off."""
    report(NOT_ON_HARDWARE)
    path = FingerPath(glove)
    with opened_motors([address], [path], report) as (motor,), MotorPort(motor, path.drum) as port:
        yield port


def watch(address: str, glove: Glove) -> None:
    """Show what a motor answers until Ctrl-C; it stays off."""
    report(NOT_ON_HARDWARE)
    with (
        stopped_by_signals() as stop,
        opened_motors([address], [FingerPath(glove)], report) as motors,
    ):
        watch_motors(motors, stop, None)
