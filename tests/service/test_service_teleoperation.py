"""Measured distances as contacts: unmeasured values stay unknown, derived values are correct."""

import math

import numpy as np
import pytest
from fake_service import MS, KeepingOutlet, ManualClock, Newest, QueueInlet, ScriptedInput, filled, publisher

from proximity.errors import ServiceError
from proximity.message import MEASURED, ContactFlag, Message, Mode, Source, State, Surface
from proximity.service import Measurements, MessageInput, SensedContacts, Service
from proximity.transport import Subscriber

NOW = 9000 * MS
KNOWN = ContactFlag.TRACKED | ContactFlag.SIGNED | ContactFlag.IN_RANGE


def measured(distances, measured_ns=NOW, error=0.0001, **fields):
    """Measurements with a distance per finger."""
    samples = Measurements(len(distances))
    samples.distances[:, 0], samples.pose_ns[:] = distances, measured_ns
    for name, value in told(distances, measured_ns, error, **fields).items():
        samples.records[name] = value
    return samples


def told(distances, measured_ns=NOW, error=0.0001, **fields):
    unknown = (
        "position", "velocity", "normal", "approach_speed", "bend", "bend_rate", "force", "stiffness",
        "damping",
    )  # fmt: skip
    known = {"measured_ns": measured_ns, "signed_distance": distances, "error": error}
    return dict.fromkeys(unknown, np.nan) | {"finger": np.arange(len(distances))} | known | fields


def message(distances, measured_ns=NOW, **fields):
    made = Message(MEASURED, len(distances))
    for name, value in told(distances, measured_ns, **fields).items():
        made.records[name] = value
    return made


def answer(distance, now_ns=NOW, *, latency=0.001, **fields):
    """The contact of one finger after one measurement."""
    return filled(SensedContacts(1, latency=latency), measured([distance], **fields), now_ns)[0]


def approach(answers, distance_at, times_ms, *, error=0.0, lag_ms=0.0):
    """Contacts of one finger measured at these times and computed *lag_ms* later."""
    for time_ms in times_ms:
        samples = measured([distance_at(time_ms / 1000)], NOW + round(time_ms * MS), error)
        yield filled(answers, samples, NOW + round((time_ms + lag_ms) * MS))[0].copy()


def test_all_that_a_sensor_tells_is_in_the_contact():
    fields = {
        "position": (1, 2, 3), "velocity": (4, 5, 6), "normal": (0, 0, 1), "approach_speed": 0.2, "bend": 0.4,
        "bend_rate": 2.0, "force": 1.5, "force_is_valid": 1, "surface": Surface.DEFORMABLE,
        "stiffness": 800.0, "damping": 3.0,
    }  # fmt: skip
    contact = answer(0.01, NOW + 2 * MS, measured_ns=NOW, error=0.001, **fields)

    for name, value in fields.items():
        np.testing.assert_array_equal(contact[name], value, err_msg=name)
    assert contact["signed_distance"] == 0.01
    assert (contact["lower"], contact["upper"]) == pytest.approx((0.009, 0.011), rel=1e-15)
    assert contact["pose_ns"] == NOW and contact["age_ns"] == 2 * MS
    assert contact["predicted_ns"] == NOW + 3 * MS
    assert contact["source"] == Source.TELEOPERATION and contact["mode"] == Mode.FORCE
    assert ContactFlag(contact["flags"]) == KNOWN | ContactFlag.PREDICTED


def test_distance_from_after_the_controller_acts_is_predicted_for_its_own_instant():
    contact = answer(0.01, NOW, measured_ns=NOW + 20 * MS, error=0.0, approach_speed=0.5)
    assert contact["predicted_ns"] == contact["pose_ns"] == NOW + 20 * MS
    assert contact["predicted_lower"] == contact["predicted_distance"] == contact["signed_distance"]


def test_what_is_not_told_is_not_made_up():
    contact = answer(0.01)

    unknown = (
        "position", "velocity", "normal", "point_on_finger", "point_on_part", "part_velocity",
        "approach_speed", "bend", "bend_rate", "contact_bend", "contact_bend_error", "contact_bend_rate",
    )  # fmt: skip
    for name in unknown:
        assert np.isnan(contact[name]).all(), name
    assert contact["part"] == contact["face"] == -1 and contact["work"] == 0
    assert contact["force"] == 0.0 and contact["force_is_valid"] == 0
    assert contact["stiffness"] == contact["damping"] == 0.0
    assert ContactFlag(contact["flags"]) == KNOWN
    assert contact["mode"] == Mode.RETRACT and contact["time_to_contact"] == np.inf


def test_finger_that_was_not_measured_is_unknown_whatever_else_is_told():
    samples = measured([0.01, np.nan], error=0.0, force=1.0, force_is_valid=1, bend=0.5, normal=(0, 0, 1))

    contacts = filled(SensedContacts(2), samples, NOW)

    assert contacts["flags"].tolist() == [int(KNOWN | ContactFlag.EXACT), 0]
    lost = contacts[1]
    assert lost["lower"] == lost["predicted_lower"] == -np.inf
    assert lost["upper"] == lost["predicted_upper"] == np.inf
    assert lost["time_to_contact_lower"] == 0.0 and lost["force_is_valid"] == 0
    assert lost["mode"] == Mode.HOLD and lost["source"] == Source.TELEOPERATION
    assert lost["finger"] == 1 and lost["pose_ns"] == NOW
    for name in ("signed_distance", "normal", "bend", "time_to_contact", "contact_bend"):
        assert np.isnan(lost[name]).all(), name


@pytest.mark.parametrize("error", [np.nan, -0.001, np.inf])
def test_error_that_is_not_known_leaves_no_bounds_and_says_so(error):
    contact = answer(0.01, error=error)

    assert contact["lower"] == contact["predicted_lower"] == -np.inf
    assert contact["upper"] == contact["predicted_upper"] == np.inf
    assert contact["time_to_contact_lower"] == 0.0
    assert contact["flags"] & ContactFlag.BOUNDED


def test_force_that_is_no_number_is_not_valid():
    contact = answer(-0.001, force=np.nan, force_is_valid=1)
    assert contact["force"] == 0.0 and contact["force_is_valid"] == 0


def test_speed_of_approach_is_estimated_from_distances():
    answers = SensedContacts(1, latency=0.005)
    contacts = list(approach(answers, lambda t: 0.03 - 0.2 * t, range(6), lag_ms=1.0))

    assert math.isnan(contacts[0]["approach_speed"])
    assert not contacts[0]["flags"] & ContactFlag.PREDICTED
    for k, contact in enumerate(contacts[2:], start=2):
        assert contact["flags"] & ContactFlag.PREDICTED
        assert contact["approach_speed"] == pytest.approx(0.2, abs=1e-9)
        distance = 0.03 - 0.2 * 0.001 * k
        assert contact["time_to_contact"] == pytest.approx(distance / 0.2, rel=1e-8)
        assert contact["time_to_contact_lower"] == pytest.approx(distance / 0.2, rel=1e-8)
        # At the tick, 1 ms after the measurement, and 5 ms later.
        expected = distance - 0.2 * 0.006
        assert contact["predicted_distance"] == pytest.approx(expected, abs=1e-4)
        assert contact["predicted_lower"] <= expected <= contact["predicted_upper"]
        assert contact["mode"] == Mode.POSITION


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("error", "width"), [(3e-4, 0.004), (2e-3, 0.012), (None, 0.020)])
def test_predicted_bounds_hold_however_far_off_the_sensor_says_it_is(error, width, seed):
    """Each distance is off by its stated error, up or down; None: a random error up to 5 cm each."""
    rng = np.random.default_rng(seed)
    amplitude, phase = 0.02, rng.uniform(0, 6)
    omega = math.sqrt(119.0 / amplitude)
    errors = np.full(300, error) if error else 10.0 ** rng.uniform(-5.0, np.log10(0.05), 300)
    times = np.cumsum(rng.uniform(0.8, 4.0, 300))

    def distance_at(t):
        return 0.2 + amplitude * math.sin(omega * t + phase)

    answers = SensedContacts(1, latency=0.002)
    widths = []
    for time_ms, error_told, side in zip(times, errors, rng.choice([-1.0, 1.0], 300), strict=True):
        measured_ns = NOW + round(time_ms * MS)
        samples = measured([distance_at(time_ms / 1000) + side * error_told], measured_ns, error_told)
        contact = filled(answers, samples, measured_ns)[0]
        assert (
            contact["predicted_lower"] <= distance_at(0.001 * time_ms + 0.002) <= contact["predicted_upper"]
        )
        widths.append(contact["predicted_upper"] - contact["predicted_lower"] - 2.0 * error_told)
    assert np.median(widths) < width


def test_speed_that_a_sensor_tells_is_taken_at_its_word():
    contact = answer(0.01, approach_speed=0.1, error=0.0)

    assert contact["approach_speed"] == 0.1 and contact["flags"] & ContactFlag.PREDICTED
    assert contact["time_to_contact"] == contact["time_to_contact_lower"] == pytest.approx(0.1)
    assert contact["predicted_distance"] == pytest.approx(0.01 - 0.1 * 0.001, abs=1e-6)


def test_same_measurement_again_changes_no_speed():
    answers = SensedContacts(1)
    contacts = list(approach(answers, lambda t: 0.03 - 0.2 * t, range(4)))
    samples = measured([0.03 - 0.2 * 0.003], NOW + 3 * MS, 0.0)

    again = filled(answers, samples, NOW + 9 * MS)[0]

    assert again["approach_speed"] == contacts[-1]["approach_speed"]
    assert again["age_ns"] == 6 * MS
    # The prediction is for a later time, from the same measurement.
    assert again["predicted_distance"] == pytest.approx(0.03 - 0.2 * 0.010, abs=2e-4)


def test_jump_of_a_sensor_is_told():
    *_, contact = approach(SensedContacts(1), lambda t: 0.03 if t < 0.003 else 0.3, range(4))
    assert contact["flags"] & ContactFlag.JUMPED
    assert not contact["flags"] & ContactFlag.PREDICTED


def test_speed_before_it_is_known_is_thought_the_highest():
    contact = answer(0.03, error=0.0)

    assert contact["time_to_contact"] == np.inf
    assert contact["time_to_contact_lower"] == pytest.approx(0.03 / 3.0)
    assert contact["predicted_lower"] == pytest.approx(0.03 - 0.001 * 3.0, abs=1e-9)


@pytest.mark.parametrize(
    ("distance", "speed", "time", "free"),
    [
        (0.01, 0.0, np.inf, 0.25),  # at rest
        (0.01, -0.1, np.inf, 0.25),  # receding
        (0.05, 0.1, np.inf, 0.25),  # beyond the horizon
        (0.0001, -0.1, np.inf, 0.0),  # possibly in contact
        (0.0, 0.1, 0.0, 0.0),
        (-0.002, -0.1, 0.0, 0.0),
        (0.0102, 0.1, 0.102, 0.100),
    ],
)
def test_time_to_contact(distance, speed, time, free):
    contact = answer(distance, approach_speed=speed, error=0.0002)

    assert contact["time_to_contact"] == pytest.approx(time, rel=1e-12)
    assert contact["time_to_contact_lower"] == pytest.approx(free, rel=1e-12)
    assert contact["mode"] == (Mode.POSITION if time < np.inf else Mode.RETRACT)


def test_bend_at_contact_follows_from_bend_rate_and_time():
    contact = answer(0.01, approach_speed=0.1, bend=0.3, bend_rate=2.0)
    assert contact["contact_bend"] == pytest.approx(0.3 + 2.0 * 0.1)
    assert contact["contact_bend_error"] == np.inf  # unknown error


@pytest.mark.parametrize(
    "fields",
    [
        {"bend": 0.3, "bend_rate": -2.0, "approach_speed": 0.1},  # extends
        {"bend": 0.3, "bend_rate": 2.0, "approach_speed": -0.1},  # receding
        {"bend": 0.3, "bend_rate": 8.0, "approach_speed": 0.1},  # beyond a fist
        {"bend": 0.3, "bend_rate": np.nan, "approach_speed": 0.1},
    ],
)
def test_bend_at_contact_is_unknown_where_nothing_tells_it(fields):
    contact = answer(0.01, **fields)
    assert np.isnan(contact["contact_bend"]) and np.isnan(contact["contact_bend_error"])


@pytest.mark.parametrize(("distance", "error"), [(-0.002, 0.0), (-0.0001, np.inf)])
def test_bend_at_contact_of_a_finger_that_touches_is_its_bend(distance, error):
    contact = answer(distance, bend=0.6, error=0.001)
    assert contact["contact_bend"] == 0.6 and contact["contact_bend_error"] == error


def test_normals_and_surfaces_that_cannot_be_are_unknown(inlet):
    source = Newest(MessageInput("queue:", 4, is_measured=True), Measurements(4), NOW)
    normals = [(0, 0, 1), (0, 0, 1.01), (0, 0, 1e300), (0, 0, np.nan)]
    inlet.put(message([0.1] * 4, normal=normals, surface=[2, 3, 255, 1]))

    records = source.poll(NOW).records

    assert np.isnan(records["normal"]).any(axis=1).tolist() == [False, True, True, True]
    assert records["surface"].tolist() == [2, 0, 0, 1]
    assert source.notes == ["queue:: 2 normals that are not of unit length"]


def test_place_that_is_known_by_half_is_unknown_and_costs_no_frame(inlet):
    """A reader would refuse the frame, with all other fingers."""
    source, outlet = MessageInput("queue:", 4, is_measured=True), KeepingOutlet()
    places = [(1, 2, 3), (1, np.nan, 3), (1, 2, np.inf), (np.nan,) * 3]
    inlet.put(message([0.1] * 4, position=places))
    Service(SensedContacts(4), source, [publisher(outlet)], period=0.001, clock=ManualClock(NOW - MS)).run(
        tick_count=1
    )
    reader = QueueInlet()
    reader.queue = outlet.sent[:1]

    reading = Subscriber(reader, "queue:", clock=lambda: NOW).read()

    assert reading.state is State.OK
    np.testing.assert_array_equal(reading.contacts["position"], [(1, 2, 3)] + [(np.nan,) * 3] * 3)
    assert source.notes == ["queue:: 2 positions that are not finite"]


@pytest.mark.parametrize("speed", [-1e300, 3.1])
def test_speed_that_a_sensor_cannot_have_measured_is_not_believed_and_costs_no_frame(speed):
    """It once caused an infinite error, and then a prediction of nan."""
    answers = SensedContacts(1, latency=0.0)
    filled(answers, measured([0.1], NOW - MS, approach_speed=speed), NOW - MS)

    contact = filled(answers, measured([0.1]), NOW)[0]

    assert contact["predicted_lower"] == contact["lower"] and contact["predicted_upper"] == contact["upper"]
    assert np.isfinite(contact["predicted_distance"])


def test_measurements_age_as_poses_do():
    outlet = KeepingOutlet()

    def poll(poll, now_ns):
        return measured([0.01, 0.02], now_ns) if poll < 5 else None

    Service(
        SensedContacts(2), ScriptedInput(poll), [publisher(outlet)], period=0.001, clock=ManualClock()
    ).run(tick_count=120)

    assert outlet.states[:5] == [State.OK] * 5
    assert outlet.states[24:26] == [State.OK, State.LATE]
    assert outlet.states[104:106] == [State.LATE, State.STALE]
    assert (outlet.headers[0]["source"], outlet.headers[0]["epoch"]) == (Source.TELEOPERATION, 0)
    assert outlet.records[110]["flags"].tolist() == [0, 0]


def test_subscriber_believes_a_distance_without_a_place_and_widens_it():
    clock, outlet, inlet = ManualClock(NOW), KeepingOutlet(), QueueInlet()

    def poll(poll, now_ns):
        return measured([0.05, 0.05], now_ns, 0.0, approach_speed=[0.2, np.nan])

    Service(SensedContacts(2), ScriptedInput(poll), [publisher(outlet)], period=0.001, clock=clock).run(
        tick_count=1
    )
    inlet.queue = outlet.sent[:1]
    subscriber = Subscriber(inlet, "queue:", clock=clock.now_ns)

    reading = subscriber.read()
    assert reading.state == State.OK and reading.is_valid
    assert np.isnan(reading.contacts["position"]).all()
    assert reading.contacts["signed_distance"].tolist() == [0.05, 0.05]

    clock.now = int(reading.header["pose_ns"]) + 40 * MS
    reading = subscriber.read()
    assert reading.state == State.LATE
    assert (reading.contacts["lower"] <= 0.05 - 0.2 * 0.04).all()
    assert (reading.contacts["upper"] >= 0.05 + 0.2 * 0.04).all()


@pytest.mark.parametrize("fields", [{"latency": 2.0}, {"max_speed": math.nan}])
def test_numbers_that_cannot_be_are_refused(fields):
    with pytest.raises(ServiceError, match=r"expected a latency of 0 to 1 s and the others above zero$"):
        SensedContacts(1, **fields)


def test_rehearsal_leaves_nothing_behind():
    answers = SensedContacts(2)
    answers.rehearse()

    first = filled(answers, measured([0.1, 0.1]), NOW)

    assert not (first["flags"] & (ContactFlag.PREDICTED | ContactFlag.JUMPED)).any()
