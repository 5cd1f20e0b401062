"""Surfaces displayed by a service's drum in an experiment: DECAFF, coupled walls, limits and stops."""

import threading

import numpy as np
import pytest
from experiments import SHIPPED
from paper_drums import PAPER_DESIGN
from sealed_frames import frame

from proximity.decaff.glove.finger_path import FingerPath
from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError
from proximity.lab.experiment.design_file import read_design
from proximity.lab.experiment.display import Interval
from proximity.lab.experiment.drum_display import DrumDisplay
from proximity.lab.simulation.simulated_press import Wall
from proximity.message import Mode, State
from proximity.transport import Reading

PATH = FingerPath(Glove())
WALL = PATH.position(0.5)
RATE, MS = 1000.0, 1_000_000
IN, DEEP, OUT = 150, 1400, 1600  # ms: at the surface, leaving, away


def depth_at(ms, depth):
    """Return the depth in m past the surface: 30 mm away, in, held, and away again."""
    return float(
        np.interp(ms, [0, IN, IN + 60, DEEP, DEEP + 60, OUT], [-0.03, 0.0, depth, depth, 0.0, -0.03])
    )


def reading(ms, depth):
    now_ns = 1_000_000_000_000 + round(ms * MS)
    message = frame(1, now_ns)
    contact = message.records
    contact["mode"], contact["contact_bend"] = Mode.POSITION, 0.5
    contact["bend"] = PATH.bend(WALL + depth_at(ms, depth))
    for name in ("signed_distance", "lower", "upper"):
        contact[name] = -depth_at(ms, depth)
    message.header["sequence"] = round(ms)
    return Reading(State.OK, True, now_ns, 0, message.header[()], contact)


def press(
    wall, stiffness, *, depth=0.004, latency=0.001, force=4.0, seconds=3.0, at=lambda display, ms: None
):
    """Present an interval while stepping the drum through a press; return the recorded result."""
    display, felt = DrumDisplay(RATE, gloves=[PAPER_DESIGN]), []
    display.step(reading(0, depth), 0)
    interval = Interval(wall, stiffness, 2.0, latency, 1500.0, 0.2)
    thread = threading.Thread(target=lambda: felt.append(display.present(interval, force, seconds)))
    thread.start()
    while display._interval is None:
        pass
    for ms in range(1, 3500):
        at(display, ms)
        display.step(reading(ms, depth), ms * MS)
        if display._is_over.is_set():
            break
    thread.join()
    for more in range(ms + 1, ms + 400):
        display.step(reading(more, depth), more * MS)
    assert display.fingers[0].plant.position == pytest.approx(PATH.retracted, abs=1e-3)
    return felt[0]


def held(felt):
    """Mean force during the hold, N; the drum oscillates on the undamped pad."""
    return float(felt.frames["force"][(felt.frames["time"] > 0.4) & (felt.frames["time"] < 1.4)].mean())


def test_rigid_wall_of_the_drum_stands_at_the_surface():
    felt = press(Wall.DECAFF, None)

    assert not felt.stopped
    assert held(felt) == pytest.approx(200.0 * 0.004, rel=0.05)  # the pad's
    assert abs(felt.frames["wall"][350]) < 3e-4
    assert abs(felt.onset) < 0.02 and felt.frames["time"][-1] < 2.0  # over once the finger has left


def in_series(stiffness, depth=0.004):
    """Force of a pressed finger, N: the springs of surface and pad in series."""
    return depth / (1.0 / 200.0 + 1.0 / stiffness)


@pytest.mark.parametrize(
    ("wall", "stiffness", "rel"),
    [(Wall.DECAFF, 150.0, 0.1), *((Wall.COUPLED, stiffness, 0.2) for stiffness in (50.0, 100.0, 200.0))],
)
def test_soft_wall_gives_way_by_its_spring(wall, stiffness, rel):
    felt = press(wall, stiffness, latency=0.001 if wall is Wall.DECAFF else 0.003)

    assert not felt.stopped
    assert held(felt) == pytest.approx(in_series(stiffness), rel=rel)


def test_late_coupled_wall_swings():
    early, late = (press(Wall.COUPLED, 200.0, latency=latency).frames for latency in (0.001, 0.050))

    assert np.ptp(late["force"][600:1400]) > 2.0 * np.ptp(early["force"][600:1400])


def test_real_surface_has_the_drum_out_of_the_path():
    felt = press(Wall.REAL, None, seconds=0.8)

    assert felt.peak == 0.0 and not felt.stopped
    assert felt.frames["time"][-1] == pytest.approx(0.8, abs=0.002)


def test_force_beyond_the_limit_ends_the_interval_and_the_drum_retracts():
    felt = press(Wall.DECAFF, None, depth=0.008, force=0.9)

    assert felt.stopped.endswith("are beyond the limit of 0.9 N")
    assert felt.frames["time"][-1] < 0.35


def test_emergency_stop_ends_the_interval_and_the_drum_retracts():
    felt = press(
        Wall.DECAFF, None, at=lambda display, ms: display.stop("emergency stop") if ms == 300 else None
    )

    assert felt.stopped == "emergency stop" and felt.frames["time"][-1] < 0.31


def test_stop_before_an_interval_counts_as_well():
    """A stop between the participant's "go on" and the first sample."""
    display = DrumDisplay(RATE)
    display.step(reading(0, 0.004), 0)
    display.stop("emergency stop")
    felt = display.present(Interval(Wall.DECAFF, None, 2.0, 0.001, 1500.0, 0.2), 4.0, 3.0)
    for ms in range(1, 400):
        display.step(reading(ms, 0.004), ms * MS)

    assert felt.stopped == "emergency stop" and len(felt.frames) == 0 and felt.peak == 0.0
    assert display.fingers[0].peak_force == 0.0


def test_surface_that_the_drum_cannot_display_is_refused():
    design = read_design(SHIPPED)

    DrumDisplay(1000.0).check(design)
    with pytest.raises(
        ArgumentError, match=r"task stiffness, condition decaff1ms: 188 N/m with 1 N s/m are requested"
    ):
        DrumDisplay(100.0).check(design)


def test_fault_of_the_controller_ends_the_interval():
    def late(display, ms):
        if ms == 200:
            display.step(reading(ms, 0.004), ms * MS - 50 * MS)

    assert press(Wall.DECAFF, None, at=late).stopped == "the drum's controller had a fault"


def test_without_frames_that_is_said():
    display = DrumDisplay(RATE)
    with pytest.raises(ArgumentError, match="the drum of finger 0 does not move: no frames come"):
        display.present(Interval(Wall.DECAFF, None, 2.0, 0.001, 1500.0, 0.2), 4.0, -1.95)
    display.switch_off("the port is gone")
    with pytest.raises(ArgumentError, match="does not move: the port is gone"):
        display.present(Interval(Wall.DECAFF, None, 2.0, 0.001, 1500.0, 0.2), 4.0, -1.95)
