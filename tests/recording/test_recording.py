"""Recordings: reading, errors with their line, limits of resampling; logs."""

import make_recording
import numpy as np
import pytest
from project import RECORDED_HANDS

from proximity.errors import ArgumentError, RecordingError
from proximity.message import FRAME, ContactFlag, Message
from proximity.pose import Pose
from proximity.recording import FrameLog, Recording, read_recording, recording_reader

HEADER = "time_s,hand,finger,x_m,y_m,z_m\n"
PLAIN = HEADER + "0.0,0,0,1,2,3\n0.0,0,1,4,5,6\n0.01,0,0,1.5,2,3\n0.02,0,0,2,2,3\n0.02,0,1,4,5,7\n"


@pytest.fixture
def read(tmp_path):
    """Read a recording with this content."""

    def read_content(content):
        path = tmp_path / "hand.csv"
        path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
        return read_recording(path)

    return read_content


def recording_of(times_s, points, *, fingers=((0, 1),)):
    """Return a recording of one or several fingers; points (T, 3) or (T, N, 3)."""
    times_ns = np.rint(np.array(times_s) * 1e9).astype(np.int64)
    return Recording(times_ns, np.array(points, dtype=float).reshape(len(times_s), -1, 3), fingers)


def test_samples_become_instants_and_fingers(read):
    recording = read(PLAIN)

    assert recording.times_ns.tolist() == [0, 10_000_000, 20_000_000]
    assert recording.fingers == ((0, 0), (0, 1))
    np.testing.assert_array_equal(recording.positions[:, 0], [[1, 2, 3], [1.5, 2, 3], [2, 2, 3]])
    np.testing.assert_array_equal(recording.positions[:, 1], [[4, 5, 6], [np.nan] * 3, [4, 5, 7]])
    assert recording.notes == ()
    assert (recording.sample_count, recording.hand_count, recording.duration_s) == (5, 1, 0.02)


def hand_lines(time, points, hand=0):
    """Return lines of a hand of five fingers."""
    return "".join(f"{time},{hand},{k},{','.join(map(str, p))}\n" for k, p in enumerate(points))


def test_hand_that_is_lost_at_the_origin_touches_nothing(read):
    """Regression: its five fingers, all at (0, 0, 0), were used: five touches 8.8 mm deep."""
    there = [(0.01 * k, 0.02, 0.3) for k in range(5)]
    lost = [(0.0, 0.0, 0.0)] * 5
    recording = read(HEADER + hand_lines(0.0, there) + hand_lines(0.01, lost) + hand_lines(0.01, there, 1))

    assert recording.is_present.tolist() == [[True] * 5 + [False] * 5, [False] * 5 + [True] * 5]
    assert recording.notes == (
        "5 of 15 positions are of a hand with all fingers at one place: it is lost there",
    )


def test_two_fingers_that_touch_are_not_lost(read):
    recording = read(HEADER + "0,0,0,1,2,3\n0,0,1,1,2,3\n")
    assert recording.is_present.all() and recording.notes == ()


@pytest.mark.parametrize("cut", ["", "1", ".", "0.0"])
def test_last_line_without_its_end_is_said_to_be_cut_perhaps(read, cut):
    """A truncated number is valid: 0.03 may have become 0.0, and show a touch that did not occur."""
    whole = HEADER + "0.0,0,0,1,2,3\n0.01,0,0,1,2,4"
    try:
        recording = read(whole + "\n0.02,0,0,1,2," + cut if cut else whole)
    except RecordingError:
        assert cut == "."  # not numbers
        return

    assert recording.notes == ("the last line has no line end: the file may be cut off",)
    for end in ("\n", "\r\n", "\r", "\n\n", "\n# the end\n"):
        assert read(whole + end).notes == ()


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + PLAIN,
        PLAIN.replace("\n", "\r\n"),
        "# from a sensor\n\n" + PLAIN.replace("\n", "\n\n# more\n   \n"),
        PLAIN.replace("\n", '\n# with a "new", glove\n  # 6, "left hand\n'),
        PLAIN.replace(",", "\t").replace("\n", "\n\t# of\tthe right hand\n"),
        PLAIN.replace("\n", f"\n#{'-' * 200_000}\n", 1),
        PLAIN.replace(",", "\t"),
        PLAIN.replace(",", ";").replace(".", ","),
        "\n".join(",".join(f'"{field}"' for field in line.split(",")) for line in PLAIN.split("\n")[:-1]),
        PLAIN.replace("time_s", "Time_S").replace("x_m", " X_M "),
    ],
    ids=["mark", "crlf", "comments", "quotes in comments", "tabs before comments", "long comment", "tabs",
         "commas", "quotes", "case"],
)  # fmt: skip
def test_same_recording_in_other_clothes(read, content):
    expected, found = read(PLAIN), read(content)

    np.testing.assert_array_equal(found.positions, expected.positions)
    np.testing.assert_array_equal(found.times_ns, expected.times_ns)
    assert found.fingers == expected.fingers


def test_columns_stand_in_any_order_and_others_are_named(read):
    recording = read("z_m,confidence,finger,hand,y_m,time_s,x_m\n3,good,4,7,2,0.5,1\n")

    assert recording.fingers == ((7, 4),)
    np.testing.assert_array_equal(recording.positions, [[[1, 2, 3]]])
    assert recording.notes == ("ignored columns: confidence",)


def test_millimetres_and_milliseconds_are_converted(read):
    recording = read("time_ms,hand,finger,x_mm,y_mm,z_mm\n500,0,0,1000,2000,3000\n")
    assert recording.times_ns.tolist() == [500_000_000]
    np.testing.assert_allclose(recording.positions, [[[1, 2, 3]]], rtol=1e-15)


def test_position_of_nan_is_a_missing_finger(read):
    recording = read(HEADER + "0,0,0,nan,0,0\n0,0,1,1,1,1\n")
    assert np.isnan(recording.positions[0, 0]).all()
    assert recording.notes == ("1 of 2 positions are nan: the finger is missing there",)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "the file is empty, expected columns time_s, hand, finger, x_m, y_m, z_m"),
        (HEADER, "no line after the names of the columns"),
        ("time_s,hand,x_m,z_m\n0,0,1,1\n", "line 1: no column is named finger, y_m: there are 'time_s,"),
        ("x_m," + HEADER, "line 1: two columns are named x_m"),
        (PLAIN + "0.03,0,0,1,2\n", "line 7: 5 fields, expected 6"),
        (PLAIN + "\n0.03,0,0,1,,3\n", "line 8: y_m is '', expected a number"),
        (PLAIN + "0.03,0,0,inf,2,3\n", "line 7: x_m is inf, expected a position within 1e+06 m"),
        (PLAIN + "1e300,0,0,1,2,3\n", "line 7: time_s is 1e+300, expected a time within 146 years"),
        (PLAIN + "0.015,0,0,1,2,3\n", "line 7: time_s is 0.015 after 0.02 on line 6, expected times that"),
        (PLAIN + "0.03,0,5,1,2,3\n", "line 7: finger is 5, expected 0 (thumb) to 4 (little finger)"),
        (PLAIN + "0.03,-1,0,1,2,3\n", "line 7: hand is -1, expected a whole number from 0"),
        (PLAIN + "0.02,0,0,9,9,9\n", "line 7: finger 0 of hand 0 has a position at this time already, on"),
        (HEADER + "0,0,0,nan,2,3\n", "all positions are nan, expected a number in at least one line"),
        (PLAIN + '0.03,0,0,"1,2,3\n', "line 7: unexpected end of data, expected columns time_s"),
        (PLAIN.replace("0.01,0,0,1.5", '0.01,0,0,"1.\n5"'), "line 1: a field in quotes below goes over"),
        ("session,sequence,state\n1,0,ok\n", "line 1: a table of frames, not of a hand: `proximity view LOG"),
        (b"\xff\xfe" + PLAIN.encode("utf-16-le"), "not a text file in UTF-8, expected columns time_s"),
    ],
)
def test_recording_that_cannot_be_used_is_refused_by_line(read, content, message):
    with pytest.raises(RecordingError) as refused:
        read(content)
    assert "hand.csv" in str(refused.value)
    assert message in str(refused.value)


def test_line_is_right_beyond_the_first_chunk(read):
    lines = [f"{0.01 * row:.2f},0,0,1,2,3" for row in range(2 * recording_reader.LINES_PER_CHUNK)]
    lines[recording_reader.LINES_PER_CHUNK + 10] = lines[recording_reader.LINES_PER_CHUNK + 10].replace(
        "1,2,3", "1,?,3"
    )
    with pytest.raises(RecordingError, match=rf"line {recording_reader.LINES_PER_CHUNK + 12}: y_m is '\?'"):
        read(HEADER + "\n".join(lines))


def test_sensor_that_counts_hands_without_end_is_refused(read):
    lines = [f"{row},{row},0,1,2,3" for row in range(recording_reader.MAX_HAND_COUNT + 1)]
    with pytest.raises(RecordingError, match=r"there are 33 hands, expected at most 32"):
        read(HEADER + "\n".join(lines))


def test_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RecordingError, match=r"none\.csv: cannot be read \(No such file"):
        read_recording(tmp_path / "none.csv")


def test_fingers_are_named_with_their_hand_where_there_are_several(read):
    assert read(PLAIN).finger_name(1) == "index"
    assert read(HEADER + "0,0,0,1,2,3\n0,3,4,1,2,3\n").finger_name(1) == "little of hand 3"


@pytest.mark.usefixtures("shared_data")
def test_recordings_of_real_hands_are_read():
    counts = {path.stem: read_recording(path).sample_count for path in RECORDED_HANDS}
    assert counts["two-hands"] == 9830
    assert counts["grab"] == 1870


def test_ticks_lie_on_the_line_between_two_samples():
    recording = recording_of([1.0, 1.010, 1.025], [[0, 0, 0], [1, 0, 0], [1, 3, 0]])

    ticks = recording.resampled(0.001)

    assert ticks.times_ns.tolist() == list(range(1_000_000_000, 1_025_000_001, 1_000_000))
    np.testing.assert_allclose(ticks.positions[:11, 0, 0], np.arange(11) / 10, atol=1e-15)
    np.testing.assert_allclose(ticks.positions[10:, 0, 1], np.arange(16) / 5, atol=1e-15)
    np.testing.assert_array_equal(ticks.positions[[0, 10, 25], 0], recording.positions[:, 0])


def test_gap_is_not_bridged_and_its_ends_are_kept():
    recording = recording_of([0.0, 0.010, 0.061, 0.070], [[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]])

    present = recording.resampled(0.001).is_present[:, 0]

    assert present.tolist() == [True] * 11 + [False] * 50 + [True] * 10
    assert recording.gap_count() == 1
    assert recording.resampled(0.001, gap_limit_s=0.051).is_present.all()


def test_finger_that_comes_late_and_goes_early_is_not_invented():
    missing = [np.nan] * 3
    recording = recording_of(
        [0.0, 0.010, 0.020, 0.030],
        [[[0, 0, 0], missing], [[0, 0, 0], [1, 1, 1]], [[0, 0, 0], [2, 1, 1]], [[0, 0, 0], missing]],
        fingers=((0, 0), (0, 1)),
    )

    ticks = recording.resampled(0.005)

    assert ticks.is_present[:, 1].tolist() == [False, False, True, True, True, False, False]
    assert ticks.positions[3, 1, 0] == 1.5


ONE = recording_of([0.0], [[1, 2, 3]])


@pytest.mark.parametrize(
    ("ask", "error", "message"),
    [
        (lambda: ONE.resampled(0.0), RecordingError, "0 s is too short"),
        (lambda: ONE.resampled(np.nan), RecordingError, "nan s is too short"),
        (lambda: recording_of([0.0, 1e9], np.zeros((2, 3))).resampled(0.001), RecordingError,
         r"1e\+09 s in steps of 0\.001 s are 1000000000001 ticks"),
        (lambda: ONE.first(0.0), RecordingError, "0 s of a recording cannot be taken"),
        (lambda: ONE.placed(Pose(), 0.0), ArgumentError, r"^scale is 0.*, expected a positive number"),
        (lambda: ONE.placed(Pose(), np.nan), ArgumentError, r"^scale is nan, expected a positive number"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(ask, error, message):
    with pytest.raises(error, match=message):
        ask()


def test_beginning_is_taken():
    recording = recording_of([3.0, 3.5, 4.0], np.zeros((3, 3)))
    assert recording.first(0.5).times_ns.tolist() == [3_000_000_000, 3_500_000_000]


def test_placing_scales_then_turns_then_shifts():
    quarter = Pose([[0, -1, 0], [1, 0, 0], [0, 0, 1]], [10, 0, 0])
    placed = recording_of([0.0], [[1, 2, 3]]).placed(quarter, 2.0)
    np.testing.assert_array_equal(placed.positions, [[[6, 2, 6]]])


def test_fitting_puts_the_middle_of_the_hand_in_the_middle_of_the_box():
    points = np.random.default_rng(3).uniform(0.95, 1.05, (400, 3))
    points[:5] += 7.0  # a tracking jump
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    recording = recording_of(np.arange(400) * 0.01, points)

    pose = recording.fitted_to([0, 0, 0], [0.06, 0.04, 0.05], rotation=turn, scale=0.5)

    lower, upper = recording.placed(pose, 0.5).middle()
    np.testing.assert_allclose(0.5 * (lower + upper), [0.03, 0.02, 0.025], atol=1e-12)
    np.testing.assert_allclose(upper - lower, 0.5 * 0.08, atol=0.004)
    np.testing.assert_array_equal(pose.rotation, turn)


def test_generated_recording_is_what_the_script_makes():
    """Byte for byte; or, with another libm, the same positions except for the last digit."""
    kept = (make_recording.FOLDER / make_recording.NAME).read_bytes()
    made = make_recording.recording_bytes()
    if kept != made:
        kept, made = (
            np.array([line.split(b",") for line in content.splitlines()[1:]], dtype=float)
            for content in (kept, made)
        )
        np.testing.assert_allclose(kept, made, atol=2e-6)


def test_generated_recording_is_small_and_has_what_sensors_do():
    recording = read_recording(make_recording.FOLDER / make_recording.NAME)

    assert (make_recording.FOLDER / make_recording.NAME).stat().st_size < 200_000
    assert recording.fingers == tuple((0, finger) for finger in range(5))
    assert 4.0 < recording.duration_s < 6.0
    assert recording.gap_count() == 6  # all five once, the little finger a second time
    steps = np.linalg.norm(np.diff(recording.positions, axis=0), axis=2)
    assert (steps > 0.05).any(axis=1).sum() == 2  # there and back


FRAMES = 40


@pytest.fixture
def log(tmp_path):
    message = Message(FRAME, 2)
    message.records["finger"] = [0, 1]
    message.records["flags"] = [ContactFlag.TRACKED, 0]
    with FrameLog(tmp_path / "run.frames") as frames:
        for number in range(FRAMES):
            message.header["start_ns"] = 10**9 + number * 10**6
            message.records["position"] = (number / 1e3, 0, 0)
            message.records["point_on_part"] = (0, 0, 0) if number % 2 else np.nan
            message.records["signed_distance"] = number / 1e3
            frames.append(message.seal(1, number))
    return tmp_path / "run.frames"
