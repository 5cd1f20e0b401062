"""The receiving side: readings of a frame as it ages, and fields that are rejected."""

import threading
import time

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from wire import MS, NOW, Reader, Wire, frame, is_silent, with_frame

from proximity.errors import ArgumentError
from proximity.message import CONTACT, ContactFlag, Defect, State
from proximity.transport import Subscriber

SECOND = 1000 * MS
INT64 = st.integers(-(2**63), 2**63 - 1)


def test_nothing_is_known_before_the_first_frame():
    reading = Reader().read()

    assert (reading.state, reading.is_new, reading.is_valid) == (State.STALE, False, False)
    assert (reading.age_ns, reading.header, reading.now_ns) == (-1, None, NOW)
    assert reading.contacts.shape == (0,) and reading.contacts.dtype == CONTACT


def test_fresh_frame_is_told_as_it_was_published():
    message = frame(count=3, age=2 * MS)
    bench = Reader()
    bench.send(message)
    reading = bench.read(after=MS)

    assert (reading.state, reading.is_new, reading.is_valid) == (State.OK, True, True)
    assert (reading.age_ns, reading.now_ns) == (3 * MS, NOW + MS)
    assert reading.contacts.tobytes() == message.records.tobytes()
    assert reading.header["period_ns"] == MS and reading.header["sequence"] == 0


def test_newest_of_several_frames_counts_and_is_new_once():
    bench = Reader()
    for number in range(5):
        bench.send(frame(NOW - (5 - number) * MS, distance=0.01 * number))
    reading = bench.read()

    assert reading.is_new and reading.header["sequence"] == 4
    assert reading.contacts["lower"].tolist() == [0.04] * 5
    assert [bench.read(MS).is_new for _ in range(2)] == [False, False]
    bench.send(frame(bench.clock.now))
    assert [bench.read(MS).is_new for _ in range(2)] == [True, False]


@pytest.mark.parametrize(("settings", "stale_from"), [({}, 101), ({"stale_after": 0.0}, 21)])
def test_frame_goes_from_valid_to_late_to_stale(settings, stale_from):
    bench = Reader(**settings)
    bench.send(frame(age=0, valid_for=20 * MS))
    states = [bench.read(after=0 if ms == 0 else MS).state for ms in range(120)]

    assert states[:21] == [State.OK] * 21
    assert states[21:stale_from] == [State.LATE] * (stale_from - 21)
    assert set(states[stale_from:]) == {State.STALE}


def test_late_reading_tells_bounds_for_now_and_nothing_as_exact():
    reading = with_frame(age=0, distance=0.08).read(after=25 * MS)
    contacts = reading.contacts
    way = (0.5 * 120.0 * 0.025) * 0.025  # a finger at rest accelerates for 25 ms

    assert reading.state is State.LATE and not reading.is_valid
    np.testing.assert_allclose(contacts["lower"], 0.08 - way, rtol=1e-12)
    np.testing.assert_allclose(contacts["upper"], 0.08 + way, rtol=1e-12)
    assert contacts["predicted_lower"].tolist() == contacts["lower"].tolist()
    for name in ("signed_distance", "predicted_distance"):
        assert (contacts[name] == 0.08).all()
    assert (contacts["predicted_ns"] == reading.now_ns).all()
    assert (contacts["age_ns"] == 25 * MS).all()
    assert (contacts["flags"] == ContactFlag.TRACKED | ContactFlag.SIGNED | ContactFlag.BOUNDED).all()


def test_last_valid_contact_is_kept_for_a_tenth_of_a_second():
    bench = with_frame(age=0, distance=0.08)
    bench.read(after=40 * MS)
    bench.send(frame(age=0, distance=0.02, state=State.LATE, count=5))
    states = [bench.read(after=after).state for after in (MS, 59 * MS)]
    last = bench.subscriber.last_valid(3)

    assert states == [State.LATE] * 2
    assert last["signed_distance"] == last["lower"] == 0.08 and last["finger"] == 3
    assert bench.subscriber.last_valid(3, max_age=0.05) is None and bench.subscriber.last_valid(5) is None
    bench.read(after=MS)
    assert bench.subscriber.last_valid(3) is None


def test_last_valid_contact_does_not_outlive_the_numbers_of_its_parts():
    bench = with_frame(age=0)
    bench.read()
    later = frame(age=0, state=State.LATE)
    later.header["epoch"] = 1
    bench.send(later)
    bench.read(after=MS)

    assert bench.subscriber.last_valid(0) is None


def test_stale_reading_tells_nothing_but_whose_contacts_these_were():
    bench = with_frame()
    for after in (200 * MS, SECOND):
        reading = bench.read(after)
        assert reading.state is State.STALE
        assert is_silent(reading.contacts)
        assert reading.contacts["finger"].tolist() == [0, 1, 2, 3, 4]
        assert reading.header["sequence"] == 0


@pytest.mark.parametrize("state", [State.OK, State.DEGRADED])
def test_valid_states_are_told_as_they_came(state):
    reading = with_frame(state=state).read()
    assert reading.state is state and reading.is_valid


def test_frame_that_says_it_is_late_tells_bounds_for_now():
    reading = with_frame(state=State.LATE, age=5 * MS).read(after=5 * MS)

    assert reading.state is State.LATE
    assert (reading.contacts["lower"] < 0.05).all() and (reading.contacts["lower"] > 0.04).all()
    assert not (reading.contacts["flags"] & ContactFlag.EXACT).any()


@pytest.mark.parametrize(
    ("state", "later"),
    [
        (State.STARTING, [State.STARTING, State.LATE, State.STALE]),
        (State.STALE, [State.STALE] * 3),
        (State.STOPPING, [State.STOPPING] * 3),
    ],
)
def test_frame_that_says_nothing_is_known_is_taken_at_its_word(state, later):
    bench = with_frame(state=state)
    readings = []
    for after in (0, 30 * MS, 100 * MS):
        reading = bench.read(after)
        assert is_silent(reading.contacts) and not reading.is_valid
        readings.append(reading.state)

    assert readings == later


def test_frame_is_valid_for_a_second_whatever_it_says():
    for valid_for in (10 * SECOND, 2**62):
        bench = with_frame(age=0, valid_for=valid_for)
        assert bench.read(SECOND).state is State.OK
        assert bench.read(1).state is State.LATE
        assert bench.read(80 * MS).state is State.STALE


@given(INT64, INT64, INT64, INT64, st.integers(0, 255), st.integers(0, 3), st.booleans())
@example(2**63 - 1, 2**63 - 1, 2**63 - 1, 2**63 - 1, 1, 0, False)
@example(-(2**63), -(2**63), -(2**63), -(2**63), 1, 0, True)
@example(NOW, -(2**63), NOW, 2**63 - 1, 1, 0, True)
def test_no_instants_raise_or_make_a_frame_valid_for_long(
    pose, contact_pose, publish, valid_until, state, source, shares_clock
):
    bench = Reader(shares_clock)
    message = frame(count=2)
    header = message.header
    header["pose_ns"], header["publish_ns"], header["valid_until_ns"] = pose, publish, valid_until
    header["state"], header["source"], message.records["pose_ns"][1] = state, source, contact_pose
    bench.send(message)
    for after in (0, 60 * MS, 2 * SECOND):
        reading = bench.read(after)
        if reading.is_valid:
            assert reading.now_ns <= min(valid_until, pose + SECOND)
            assert pose <= contact_pose
    assert not reading.is_valid


@pytest.mark.parametrize("name", ["pose_ns", "publish_ns"])
@pytest.mark.parametrize(("ahead", "is_taken"), [(5 * MS, True), (5 * MS + 1, False)])
def test_frame_from_the_future_is_dropped(name, ahead, is_taken):
    bench, message = Reader(), frame(age=0)
    message.header[name] = NOW + ahead
    if name == "pose_ns":
        message.records["pose_ns"] = NOW + ahead
    bench.send(message)
    reading = bench.read()

    assert reading.is_new is is_taken
    assert bench.flawed == ({} if is_taken else {Defect.FUTURE: 1})
    assert reading.age_ns in (-1, 0)


def test_dropped_frames_let_the_one_before_grow_old():
    bench, broken = with_frame(age=0), frame(NOW + 15 * MS)
    broken.records["lower"] = np.nan
    bench.read()
    for after, state in ((15 * MS, State.OK), (10 * MS, State.LATE), (100 * MS, State.STALE)):
        bench.send(broken)
        reading = bench.read(after)
        assert (reading.state, reading.is_new) == (state, False)
    assert bench.flawed == {Defect.CONTENT: 3}


def test_count_of_fingers_may_change():
    bench = Reader()
    for count in (5, 2, 2, 0, 7, 1):
        message = frame(bench.clock.now, count)
        bench.send(message)
        assert bench.read().contacts.tobytes() == message.records.tobytes()
        assert len(bench.read(30 * MS).contacts) == count
        bench.clock.now += MS


def test_readings_cannot_be_written_to():
    bench = with_frame()
    for after in (0, 30 * MS, SECOND):
        reading = bench.read(after)
        with pytest.raises(ValueError, match="read-only"):
            reading.contacts["lower"] = 0.0
        with pytest.raises(ValueError, match="read-only"):
            reading.header["state"] = 1


@given(
    st.lists(st.integers(0, 30 * MS), min_size=2, max_size=12),
    st.sampled_from(list(State)),
    st.floats(-0.01, 0.3),
    st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    st.booleans(),
    st.floats(0, 0.02),
)
def test_without_new_frames_things_only_get_worse(waits, state, distance, velocities, is_predicted, spread):
    bench, message = Reader(), frame(count=1, age=0, distance=distance, state=state)
    contact = message.records[0]
    contact["velocity"], contact["part_velocity"] = velocities[:3], velocities[3:]
    contact["predicted_lower"] -= spread
    contact["predicted_upper"] += spread
    if not is_predicted:
        contact["flags"] &= ~np.uint32(ContactFlag.PREDICTED)
    bench.send(message)
    before = None
    for wait in waits:
        reading = bench.read(wait)
        told = reading.contacts[0].copy()
        left = told["time_to_contact_lower"] - 1e-9 * (reading.now_ns - told["pose_ns"])
        if before is not None:
            assert reading.state >= before[0].state
            assert told["lower"] <= before[1]["lower"] and told["upper"] >= before[1]["upper"]
            assert max(left, 0.0) <= max(before[2], 0.0) + 1e-12
            if reading.now_ns > NOW + 20 * MS:
                assert not reading.is_valid
                # The distance at its pose, never the last value unmarked.
                assert told["signed_distance"] == distance or np.isnan(told["signed_distance"])
                assert not told["flags"] & ContactFlag.EXACT
                assert not told["lower"] >= distance or wait == 0
        before = reading, told, left


def test_recorders_get_every_frame_and_the_reading_is_of_the_last():
    bench = Reader()
    sent = [frame(distance=0.01 * number) for number in range(4)]
    for message in sent:
        bench.send(message)
    bench.wire.put(b"garbage")
    taken = [data.tobytes() for data in bench.subscriber.frames()]

    assert taken == [message.data.tobytes() for message in sent]
    reading = bench.read()
    assert reading.is_new and reading.contacts["lower"][0] == 0.03
    assert not bench.read().is_new


def test_waiting_ends_with_a_new_frame_or_with_the_time():
    bench = with_frame()
    assert bench.subscriber.wait(1000.0).is_new and bench.wire.waits == []
    began = time.monotonic()
    reading = bench.subscriber.wait(0.02)

    assert not reading.is_new and reading.state is State.OK
    assert time.monotonic() - began >= 0.02
    assert all(0.0 < timeout <= 0.02 for timeout in bench.wire.waits)
    bench = Reader()
    for timeout in (0, -1.0):  # no time to wait
        assert bench.subscriber.wait(timeout).state is State.STALE and bench.wire.waits == []
    for timeout in (np.nan, "1"):  # with nan it waited forever, in a busy loop
        with pytest.raises(ArgumentError, match=r"^timeout is .*, expected a number of seconds$"):
            bench.subscriber.wait(timeout)


def test_waiting_for_ever_is_cut_into_hours():
    bench = Reader()
    timer = threading.Timer(0.05, lambda: bench.send(frame()))
    timer.start()
    try:
        assert bench.subscriber.wait(float("inf")).is_new
    finally:
        timer.join()
    assert set(bench.wire.waits) == {3600.0}


@pytest.mark.parametrize(
    ("name", "value"), [("stale_after", -1.0), ("max_speed", np.nan), ("max_acceleration", "1")]
)
def test_settings_are_numbers_of_zero_or_more(name, value):
    with pytest.raises(ArgumentError, match=rf"^{name} is .*, expected a number of .* of 0 or more$"):
        Subscriber(Wire(), "wire:", **{name: value})
