"""Drum moved by a real motor, which is homed first, limited, and switched off at any uncertainty.

The interface is that of `DrumPlant`, the simulated drum. Uncertainties are a late answer, a fault or an end
reported by the motor, a jump of the encoder, a drum beyond its limits, and a shaft that does not turn
although it is free. In these cases the motor is switched off, a `MotorError` gives the reason, and only a
person can restart it.
"""

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress

from proximity.decaff.controller.controller import IN_CONTACT, DrumAction, DrumState
from proximity.decaff.drum.servo import DriveMode
from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.motors.motor_driver import (
    MotorCommand,
    MotorDriver,
    MotorReading,
    MotorScale,
    MotorSettings,
    open_motor,
)
from proximity.errors import MotorError

NOT_ON_HARDWARE = (
    "No motor driver was ever run on hardware, only against simulated motors that speak the same protocol."
)
MAX_STEP = 0.02  # s, limit of the time between two readings; a longer one is a delay of this program
MOTION_LEAD = 0.15  # rad, lead of a target over the drum
OVER_LIMIT = 0.1  # rad beyond the stop or the flat hand; assumed
JUMP = 0.05  # rad, in addition to motion at the maximum speed
JUMP_SPEED = 3.0  # as a multiple of the maximum speed, which no drum exceeds
STALL_LEAD, STALL_MOTION, STALL_TIME = 0.03, 0.003, 0.3  # rad behind, rad turned in that time, s; assumed
START_TIME = 3.0  # s, for a motor's first answer, as some boards start when their port is opened
CONFIRM_TIME = 1.0  # s for a motor to confirm that it is on, and a fifth of that for off
HOMING_SPEED, HOMING_SHARE = 0.4, 0.2  # rad/s of the drum, and share of the torque
HOMING_PERIOD = 0.004  # s
CLEAR_OF_STOP = 0.02  # rad between the retracted drum and the stop
BACK_OFF, STOP_TOLERANCE = 0.1, 0.03  # rad, to back off from the stop, and between two touches at most


class MotorDrum:
    """Drum that is moved by the driver of a motor."""

    reading: MotorReading

    def __init__(self, driver: MotorDriver, settings: MotorSettings, path: FingerPath) -> None:
        self._driver, self.settings, self._path = driver, settings, path
        self._scale = MotorScale(path, settings)
        self._least, retracted = path.drum_angles
        # Homing gives the stop its designed angle, the origin of a calibration's touches.
        self._stop = path.designed_retracted + settings.stop
        self._retracted = min(retracted, self._stop - CLEAR_OF_STOP)
        self._time: float | None = None
        self._silence = self._behind = 0.0
        self._marked_angle = self._reference = 0.0
        self._command = MotorCommand()
        self._is_on = self.is_homed = False
        self.reading = MotorReading()

    @property
    def angle(self) -> float:
        """Angle of the drum, rad. Until the drum is homed, it is relative to the angle at switch-on."""
        return self._scale.angle(self.reading.turns)

    @property
    def position(self) -> float:
        """Position of the drum on the finger's path, m."""
        return self._scale.position(self.angle)

    @property
    def torque(self) -> float:
        """Torque of the motor at its shaft by its current, N m, positive if it presses on the finger."""
        return -self.settings.direction * self.reading.torque

    @property
    def drum_torque(self) -> float:
        """Torque at the drum by the motor's current, N m, positive away from the finger."""
        return self.settings.direction * self.settings.ratio * self.reading.torque

    @property
    def force(self) -> float:
        """Force on the finger by the motor's current, N, including friction, or 0 for a pull."""
        return max(0.0, self._scale.force(self.reading.torque, self.angle))

    def look(self) -> None:
        """Read the motor and check the reading, without a command."""
        before, first = self.angle, self.reading.answers == 0
        answers, elapsed = self.reading.answers, self._elapsed()
        try:
            self.reading = self._driver.read()
        except MotorError as failure:
            raise self.failed(str(failure)) from failure
        self._silence = 0.0 if self.reading.answers > answers else self._silence + elapsed
        if self._silence > (self.settings.watchdog if self.reading.answers else START_TIME):
            raise self.failed(f"the motor has not answered for {1e3 * self._silence:.0f} ms")
        if self.reading.fault:
            raise self.failed(f"the motor {self.reading.fault}")
        if not self._is_on or first:
            return
        if not self.reading.is_on:
            raise self.failed("the motor has switched itself off")
        speed = self._scale.drum_speed(self.settings.speed, self.angle)
        span = max(elapsed, MAX_STEP) + self._silence
        if abs(self.angle - before) > JUMP + JUMP_SPEED * speed * span:
            raise self.failed(f"the encoder jumped by {abs(self.angle - before):.2f} rad of the drum")
        if self.is_homed and not self._least - OVER_LIMIT <= self.angle <= self._stop + OVER_LIMIT:
            raise self.failed(
                f"the drum is at {self.angle:.2f} rad, beyond its limits of {self._least:.2f} to "
                f"{self._stop:.2f} rad"
            )

    def await_answer(self, pause: Callable[[float], bool] | None = None) -> None:
        """Wait for the first answer of the motor.

        *pause*: function that waits for a time, s, and returns whether to give up.
        """
        while not self.reading.answers:
            self.look()
            self._pause(pause or _slept)

    def refresh(self, pause: Callable[[float], bool] | None = None) -> None:
        """Wait for an answer to a new request.

        *pause*: function that waits for a time, s, and returns whether to give up.
        """
        answers = self.reading.answers + 1  # the next may be under way already
        while self.reading.answers <= answers:
            self.look()
            self._pause(pause or _slept)

    def home(self, pause: Callable[[float], bool] | None = None) -> None:
        """Switch the motor on, and find the mechanical stop beyond the retracted drum by two touches.

        *pause*: function that waits for a time, s, and returns whether to give up.
        """
        pause = pause or _slept
        self.await_answer(pause)
        self._scale.set_home(self.reading.turns, 0.0)
        self._reference = 0.0
        self._switch_on(MotorCommand(turns=self.reading.turns), pause)
        cap = HOMING_SHARE * self.settings.torque
        first = self._touched_stop(cap, pause)
        self._travel(first - BACK_OFF, cap, pause)
        again = self._touched_stop(cap, pause)
        if abs(again - first) > STOP_TOLERANCE:
            raise self.failed(
                f"two touches of the mechanical stop are {abs(again - first):.2f} rad apart, expected "
                f"at most {STOP_TOLERANCE:g} rad: the stop is not firm, or the path is blocked"
            )
        self._scale.set_home(self.reading.turns, self._stop)
        self.is_homed = True
        self._travel(self._retracted, cap, pause)

    def advance(self, action: DrumAction, finger: float, seconds: float) -> None:
        """Command a controller's action to the motor.

        *finger*: not used, as a real drum needs no model of the finger.
        """
        if not (self.is_homed and self._is_on):
            raise self.failed("a motion was commanded before the motor was homed")
        self.look()
        if action.mode not in (DriveMode.POSITION, DriveMode.FORCE):
            raise self.failed("the controller reports a fault")
        cap = min(abs(self._scale.torque(min(action.force_cap, 1e3), self.angle)), self.settings.torque)
        if action.mode is DriveMode.FORCE:
            torque = self._scale.torque(action.force, self.angle)
            self._reference, self._behind = self.angle, 0.0
            self._send(MotorCommand(DriveMode.FORCE, 0.0, max(-cap, min(torque, cap)), cap))
            return
        speed = self._scale.drum_speed(min(action.speed_cap, self.settings.speed), self.angle)
        target = min(max(action.angle, self._least), self._retracted)
        self._follow(target, speed * min(max(seconds, 0.0), MAX_STEP), cap)
        if action.state in IN_CONTACT:
            self._behind = 0.0  # a finger may hold it
        self._check_stall(seconds, action.state)

    def resume(self, pause: Callable[[float], bool] | None = None) -> None:
        """Switch a homed motor on again, without torque, after the drum may have been turned by hand.

        *pause*: function that waits for a time, s, and returns whether to give up.
        """
        if not self.is_homed:
            raise self.failed("a motion was commanded before the motor was homed")
        self.refresh(pause)
        self._switch_on(MotorCommand(DriveMode.FORCE, torque_cap=self.settings.torque), pause or _slept)

    def rest(self, pause: Callable[[float], bool] | None = None) -> None:
        """Switch the motor off until `resume`, and wait for its confirmation.

        *pause*: function that waits for a time, s, and returns whether to give up.
        """
        self.switch_off(is_emergency=False)
        self._confirm("off", pause or _slept)

    def push(self, torque: float) -> float:
        """Command a torque of the drum, N m, positive away from the finger.

        Return the torque within the limits.
        """
        if not (self.is_homed and self._is_on):
            raise self.failed("a motion was commanded before the motor was homed")
        self.look()
        settings = self.settings
        most = settings.torque * settings.ratio
        given = max(-most, min(torque, most))
        shaft = settings.direction * given / settings.ratio
        self._send(MotorCommand(DriveMode.FORCE, 0.0, shaft, settings.torque))
        return given

    def hold(self) -> None:
        """Hold the motor at its last target while there is no controller yet."""
        self.look()
        self._send(self._command)

    def switch_off(self, *, is_emergency: bool = True) -> None:
        """Switch the motor off without waiting for an answer.

        *is_emergency*: whether a motor that supports it latches the stop, so that a person must check it.
        """
        self._is_on = False
        with suppress(MotorError):
            if is_emergency:
                self._driver.stop()
            else:
                self._driver.switch_off()

    def failed(self, reason: str) -> MotorError:
        """Switch the motor off, and return an error with the reason."""
        self.switch_off()
        return MotorError(f"{self.settings.name}: {reason}; the motor was switched off")

    def close(self) -> str:
        """Switch the motor off and close its connection.

        Return a message if the motor does not confirm that it is off, or an empty string.
        """
        self._is_on, ends = False, time.monotonic() + 0.2 * CONFIRM_TIME
        answers, is_off = self.reading.answers, False
        with suppress(MotorError):
            while not is_off and time.monotonic() < ends:
                self._driver.switch_off()
                time.sleep(HOMING_PERIOD)
                self.reading = self._driver.read()
                is_off = self.reading.answers > answers + 1 and not self.reading.is_on
        self._driver.close()
        return "" if is_off else f"{self.settings.name}: the motor did not confirm that it is off"

    def _elapsed(self) -> float:
        now, before = time.monotonic(), self._time
        self._time = now
        return 0.0 if before is None else min(now - before, MAX_STEP)

    def _send(self, command: MotorCommand) -> None:
        self._command = command
        try:
            self._driver.send(command)
        except MotorError as failure:
            raise self.failed(str(failure)) from failure

    def _follow(self, target: float, step: float, cap: float) -> None:
        """Send the next target, which is never far ahead of the drum."""
        nearer = min(max(target, self._reference - step), self._reference + step)
        self._reference = min(max(nearer, self.angle - MOTION_LEAD), self.angle + MOTION_LEAD)
        self._send(MotorCommand(DriveMode.POSITION, self._scale.turns(self._reference), 0.0, cap))

    def _is_stalled(self, seconds: float) -> bool:
        """Return whether the drum has been behind its target for a while without turning."""
        is_behind = abs(self._reference - self.angle) > STALL_LEAD
        if not is_behind or self._behind == 0.0 or abs(self.angle - self._marked_angle) > STALL_MOTION:
            self._behind, self._marked_angle = 0.0, self.angle
        self._behind = self._behind + max(seconds, 1e-9) if is_behind else 0.0
        return self._behind > STALL_TIME

    def _check_stall(self, seconds: float, state: DrumState) -> None:
        if state not in IN_CONTACT and self._is_stalled(seconds):
            raise self.failed(f"the shaft does not turn (drum at {self.angle:.2f} rad, {state.value})")

    def _switch_on(self, command: MotorCommand, pause: Callable[[float], bool]) -> None:
        self._command = command
        try:
            self._driver.switch_on(self._command)
        except MotorError as failure:
            raise self.failed(str(failure)) from failure
        self._confirm("on", pause)
        self._is_on = True

    def _confirm(self, state: str, pause: Callable[[float], bool]) -> None:
        """Wait until the motor confirms that it is on or off, according to *state*."""
        ends = time.monotonic() + CONFIRM_TIME
        while self.reading.is_on != (state == "on"):
            if time.monotonic() > ends:
                raise self.failed(f"the motor does not report that it is {state}")
            self._pause(pause)
            self.look()

    def _pause(self, pause: Callable[[float], bool]) -> None:
        if pause(HOMING_PERIOD):
            raise self.failed("it was stopped before it was ready")

    def _touched_stop(self, cap: float, pause: Callable[[float], bool]) -> float:
        """Turn the drum away from the finger until it is blocked. Return the angle reached, rad."""
        most = self.angle + (self._stop - self._least) + OVER_LIMIT
        self._behind = 0.0
        while not self._step(math.inf, cap, pause):
            if self.angle > most:
                raise self.failed("no mechanical stop was found over the drum's whole range")
        self._behind = 0.0
        return self.angle

    def _travel(self, angle: float, cap: float, pause: Callable[[float], bool]) -> None:
        self._reference, self._behind = self.angle, 0.0
        while abs(self.angle - angle) > STOP_TOLERANCE or abs(self._reference - angle) > 1e-9:
            if self._step(angle, cap, pause):
                raise self.failed("the shaft does not turn back from the stop: it is jammed, or the encoder")

    def _step(self, angle: float, cap: float, pause: Callable[[float], bool]) -> bool:
        """Run one period of homing. Return whether the drum is stalled."""
        self._pause(pause)
        self.look()
        self._follow(angle, HOMING_SPEED * HOMING_PERIOD, cap)
        return self._is_stalled(HOMING_PERIOD)


def _slept(seconds: float) -> bool:
    time.sleep(seconds)
    return False


@contextmanager
def opened_motors(
    addresses: Sequence[str], paths: Sequence[FingerPath], report: Callable[[str], None]
) -> Iterator[list[MotorDrum]]:
    """Open the motors, which stay off, and yield them. At the end, switch all motors off and close them.

    *report*: called with a message for each motor that does not confirm that it is off.
    """
    motors: list[MotorDrum] = []
    try:
        for address, path in zip(addresses, paths, strict=True):
            motors.append(MotorDrum(*open_motor(address, path.drum), path))
        yield motors
    except BaseException:
        for motor in motors:
            motor.switch_off()
        raise
    finally:
        for motor in motors:
            motor.switch_off(is_emergency=False)  # all are off before the first is closed, which takes time
        for motor in motors:
            sentence = motor.close()
            if sentence:
                report(sentence)


def home_all(
    motors: Sequence[MotorDrum], pause: Callable[[float], bool], report: Callable[[str], None]
) -> None:
    """Home the motors one after the other. Homed motors hold their drums retracted.

    *pause*: function that waits for a time, s, and returns whether to give up.
    """
    for count, motor in enumerate(motors):

        def held_pause(seconds: float, homed: Sequence[MotorDrum] = motors[:count]) -> bool:
            for other in homed:
                other.hold()
            return pause(seconds)

        report(f"motor {count} moves now, to find its stop")
        motor.home(held_pause)
