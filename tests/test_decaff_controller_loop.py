"""The drum's controller with hand, finger and drum in closed loop."""

import numpy as np
import pytest

from proximity.decaff.closed_loop import decaff
from proximity.decaff.controller import FingerController
from proximity.decaff.controller_door import ControllerDoor
from proximity.decaff.controller_states import DrumState
from proximity.decaff.devices import SERVO_RATE, Decaff
from proximity.decaff.finger_path import FingerPath
from proximity.decaff.glove import Glove
from proximity.decaff.hand import Hand
from proximity.decaff.policies import Target

HAND = Hand()
PATH = FingerPath(Glove())


@pytest.mark.parametrize("speed", [0.25, 0.5])
def test_controller_displays_what_the_plain_rule_does(speed):
    """With good frames the limits and states of PAPER 10 cost no force; the states go once through.

    At the touch a few micrometres of the drum, which friction holds, make some hundredths of a newton.
    """
    press = HAND.press(speed)
    door = ControllerDoor(FingerController(PATH, SERVO_RATE), PATH)
    states = []

    class Watched:
        def command(self, sight):
            command = door.command(sight)
            states.append(door.action.state)
            return command

    ours = decaff(HAND, press, Decaff(), Watched())
    plain = decaff(HAND, press, Decaff(), Target.TIME_STAMPED)

    changes = [state for i, state in enumerate(states) if i == 0 or state is not states[i - 1]]
    assert changes[:3] == [DrumState.RETRACTED, DrumState.APPROACH, DrumState.CONTACT_POSITION]
    assert DrumState.FAULT not in states
    off = np.abs(ours.force - plain.force)
    assert off.max() < 0.1 * plain.force.max()
    assert off.mean() < 0.005 * plain.force.max()
