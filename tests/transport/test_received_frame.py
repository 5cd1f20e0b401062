"""The contents of a frame's records, and rejection of invalid ones."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from wire import KNOWN, MS, NOW, Reader, frame

from proximity.message import CONTACT, Defect, Source, State


@pytest.mark.parametrize(
    ("name", "value", "defect"),
    [
        ("lower", 0.051, Defect.CONTENT),
        ("upper", 0.049, Defect.CONTENT),
        ("signed_distance", np.nan, Defect.CONTENT),
        ("predicted_lower", 0.051, Defect.CONTENT),
        ("predicted_upper", np.nan, Defect.CONTENT),
        ("time_to_contact", np.nan, Defect.CONTENT),
        ("time_to_contact", 0.1, Defect.CONTENT),  # before the earliest possible contact
        ("position", (0, 0, np.inf), Defect.CONTENT),
        ("normal", (0, 0, 1.0012), Defect.CONTENT),
        ("normal", (1e300, 0, 0), Defect.CONTENT),
        ("surface", 3, Defect.CONTENT),
        ("mode", 4, Defect.CONTENT),
        ("force_is_valid", 2, Defect.CONTENT),
        ("pose_ns", NOW - MS - 1, Defect.CONTENT),  # older than the oldest pose of the frame
        ("pose_ns", NOW + 5 * MS + 1, Defect.CONTENT),
        ("normal", (0, 0, 1.0009), None),
        ("normal", (np.nan, np.nan, np.nan), None),  # no part
        ("velocity", (np.nan, 0, 0), None),
        ("part_velocity", (np.nan, np.inf, 0), None),
        ("upper", np.inf, None),
        ("pose_ns", NOW + 5 * MS, None),
        ("work", 2**32 - 1, None),
    ],
)
def test_contact_must_make_sense(name, value, defect):
    bench, message = Reader(), frame()
    message.records[name][3] = value
    bench.send(frame(NOW - MS))
    bench.send(message)
    reading = bench.read()

    assert bench.flawed == ({} if defect is None else {defect: 1})
    assert reading.header["sequence"] == (defect is None)
    assert bench.read(30 * MS).state is State.LATE


def test_what_is_said_of_a_finger_that_is_not_tracked_need_not_make_sense():
    bench, message = Reader(), frame()
    message.records["flags"][1] = 0
    for name in ("lower", "signed_distance", "position", "normal", "predicted_upper", "time_to_contact"):
        message.records[name][1] = np.nan
    message.records["pose_ns"][1] = -(2**63)
    bench.send(message)

    assert bench.read().state is State.OK
    late = bench.read(30 * MS)
    assert late.state is State.LATE
    assert late.contacts["flags"][1] == 0 and np.isnan(late.contacts["signed_distance"][1])
    assert late.contacts["lower"][0] < 0.05


@pytest.mark.parametrize(
    ("header", "record"),
    [({"state": 6}, {}), ({"source": 3}, {}), ({}, {"flags": 0, "mode": 9})],
    ids=["state", "source", "mode of a finger that is not tracked"],
)
def test_what_is_none_of_its_kind_is_without_sense(header, record):
    bench, message = Reader(), frame()
    for part, values in ((message.header, header), (message.records[1:2], record)):
        for name, value in values.items():
            part[name] = value
    bench.send(message)

    assert bench.read().state is State.STALE
    assert bench.flawed == {Defect.CONTENT: 1}


def test_sensor_need_not_know_where_the_finger_is():
    bench, message = Reader(), frame()
    message.header["source"] = message.records["source"] = Source.TELEOPERATION
    message.records["position"][2] = np.nan
    bench.send(message)
    assert bench.read().is_valid

    message.records["position"][2] = (np.inf, 0, 0)
    bench.send(message)
    bench.read()
    assert bench.flawed == {Defect.CONTENT: 1}


def test_clock_at_the_end_of_its_numbers_is_not_believed():
    """Its next readings no longer fit into 64 bits."""
    bench, ends = Reader(shares_clock=False), 2**63 - 1 - 25 * MS
    for number in range(10):
        bench.send(frame(ends - (9 - number) * 10 * MS))
        bench.read(10 * MS)

    assert bench.flawed == {Defect.FUTURE: 10}
    assert bench.read(30 * MS).state is State.STALE


@given(st.binary(min_size=2 * CONTACT.itemsize, max_size=2 * CONTACT.itemsize), st.integers(0, 200))
def test_no_contacts_raise(records, ms):
    bench, message = Reader(), frame(count=2)
    message.records.view(np.uint8)[:] = np.frombuffer(records, np.uint8)
    message.records["pose_ns"], message.records["flags"][0] = NOW - MS, KNOWN
    message.records.view(np.uint8).reshape(2, -1)[:, -4:] = (1, 1, 0, 0)
    bench.send(message)
    reading = bench.read(ms * MS)

    assert bool(reading.is_new) != (bench.flawed == {Defect.CONTENT: 1})
    if reading.is_valid:
        told = reading.contacts[0]
        assert told["lower"] <= told["signed_distance"] <= told["upper"]
