"""End-to-end runs: the sample hand at the sample part, in real time and as fast as possible."""

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from far_end import until
from project import MESHES

import proximity
from proximity.message import FRAME, ContactFlag, State, parts_of
from proximity.pose import Pose
from proximity.recording import read_recording
from proximity.service import RecordingInput, Service, SkippingClock, TrackedContacts
from proximity.transport import open_publisher, open_subscriber

RADIUS = 0.007
PATIENCE = 60.0  # s


@pytest.fixture(scope="module")
def hand():
    return read_recording(MESHES / "hand.csv").resampled(0.001)


def bracket():
    return proximity.load(MESHES / "bracket.stl")


def answers(scene, hand):
    return TrackedContacts(proximity.Tracker(scene, fingers=len(hand.fingers), radius=RADIUS))


class KeepingLog:
    def __init__(self):
        self.frames = []

    def append(self, data):
        self.frames.append(data.copy())

    def close(self):
        pass


def test_every_frame_of_a_second_is_received_or_counted_as_lost(hand):
    service = Service(
        answers(bracket(), hand),
        RecordingInput(hand.first(1.0), latency=0.001),
        [open_publisher("mailbox:real run")],
        period=0.001,
    )
    with open_subscriber("mailbox:real run") as subscriber:
        thread = threading.Thread(target=service.run)
        began = time.monotonic()
        thread.start()
        states, late_and_valid, before = set(), 0, None
        ends = time.monotonic() + PATIENCE
        while State.STOPPING not in states and time.monotonic() < ends:
            reading = subscriber.wait(0.1)
            states.add(reading.state)
            if before is None and subscriber.counts.received == 1:
                before = int(reading.header["sequence"])  # unknown to a late subscriber
            if reading.is_valid and reading.now_ns > reading.header["valid_until_ns"]:
                late_and_valid += 1
        thread.join(PATIENCE)
        lasted = time.monotonic() - began
        subscriber.read()
        counts = subscriber.counts

    report = service.report
    assert not thread.is_alive()
    assert State.STOPPING in states and late_and_valid == 0
    # The last pose comes a second after the first tick; missed ticks have no frame.
    assert 1001 <= report.ticks + report.missed <= 1000 * lasted
    assert before + counts.received + counts.lost == report.ticks + 3
    assert counts.received > 0 and counts.flawed.total() == 0
    assert report.publish_failures == {"mailbox:real run": 0} and report.notes == []
    assert report.compute.count == report.lateness.count == report.ticks


def test_recording_as_fast_as_it_goes_is_answered_as_the_scene_is(hand):
    scene, log = bracket(), KeepingLog()
    service = Service(
        answers(scene, hand),
        RecordingInput(hand.first(2.0), latency=0.001),
        [open_publisher("mailbox:fast run")],
        period=0.001,
        clock=SkippingClock(),
        log=log,
    )

    report = service.run()

    frames = [parts_of(data, FRAME) for data in log.frames]
    assert len(frames) == report.log_written == report.ticks + 3
    assert report.ticks == 2001 and report.missed == 0
    contacts = np.array([records for _, records in frames[: report.ticks]])
    is_tracked = (contacts["flags"] & ContactFlag.TRACKED) != 0
    # Each frame has the poses of one time of the recording, and exact distances for them.
    taken = np.isfinite(hand.positions[: len(contacts)]).all(axis=2)
    np.testing.assert_array_equal(contacts["position"][taken], hand.positions[: len(contacts)][taken])
    np.testing.assert_array_equal(is_tracked, taken)
    true = scene.signed_distance(contacts["position"][is_tracked]) - RADIUS
    assert (contacts["lower"][is_tracked] <= true + 1e-12).all()
    assert (contacts["upper"][is_tracked] >= true - 1e-12).all()
    assert (contacts["age_ns"][is_tracked] == 1_000_000).all()


def ticks_on(service, count=5):
    """Wait for *count* more ticks."""
    expected = service.report.ticks + count
    until(lambda: service.report.ticks >= expected, PATIENCE)


def test_parts_that_move_come_and_go_while_they_are_served(hand):
    """Another thread edits the scene; the epoch of each frame identifies its parts."""
    scene, log = bracket(), KeepingLog()
    (ball,) = proximity.load(MESHES / "sphere.stl").parts
    ball = replace(ball, name="ball", pose=Pose(translation=(0, 0, 0.5)))
    stop = threading.Event()
    source = answers(scene, hand)
    source.takes_changes = True
    service = Service(source, RecordingInput(hand, repeat=True), [], period=0.001, log=log)
    thread = threading.Thread(target=service.run, kwargs={"stop": stop})
    thread.start()
    try:
        ticks_on(service)
        part_counts = {scene.epoch: 1}
        for step in range(8):
            scene.move("bracket", Pose(translation=(0, 0, 1e-4 * step)), velocity=(0, 0, 0.01))
            if step % 2:
                scene.remove("ball")
            else:
                scene.add(ball)
            part_counts[scene.epoch] = 2 - step % 2
            ticks_on(service)
        other = proximity.load(MESHES / "assembly.glb")
        epoch = scene.epoch
        service.replace(answers(other, hand))
        ticks_on(service)
    finally:
        stop.set()
        thread.join(PATIENCE)

    assert not thread.is_alive()
    seen = []
    for data in log.frames:
        header, records = parts_of(data, FRAME)
        seen.append(int(header["epoch"]))
        parts = part_counts.get(seen[-1], len(other.parts))
        assert (records["part"] < parts).all()
    assert seen == sorted(seen)
    assert set(part_counts) <= set(seen)
    assert seen[-1] == epoch + 1  # the other scene
