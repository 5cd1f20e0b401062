"""Motors of several fingers: opened together, and switched off together whatever happens."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.motors.motor_driver import open_motor
from proximity.decaff.motors.motor_drum import MotorDrum


@contextmanager
def opened_motors(
    addresses: Sequence[str], paths: Sequence[FingerPath], report: Callable[[str], None]
) -> Iterator[list[MotorDrum]]:
    """Open motors that stay off; at the end all of them are switched off and closed.

    *report*: is given a sentence for each motor that does not confirm that it is off.
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
            motor.switch_off(is_emergency=False)  # first all of them: closing takes time
        for motor in motors:
            sentence = motor.close()
            if sentence:
                report(sentence)


def home_all(
    motors: Sequence[MotorDrum], pause: Callable[[float], bool], report: Callable[[str], None]
) -> None:
    """Home motors one after the other; those that are homed hold their drums retracted meanwhile.

    *pause*: waits for a time, s, and returns whether to give up.
    """
    for count, motor in enumerate(motors):

        def held_pause(seconds: float, homed: Sequence[MotorDrum] = motors[:count]) -> bool:
            for other in homed:
                other.hold()
            return pause(seconds)

        report(f"motor {count} moves now, to find its stop")
        motor.home(held_pause)
