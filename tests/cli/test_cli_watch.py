"""``proximity watch``: what is shown of a reading, and that it follows a service and ends when told."""

import io
import json
import os
import re
import signal
import threading
import time
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import queued_transport
from ports import free_port
from rich.console import Console
from sealed_frames import SESSION, frame, sealed

from proximity.cli import tables
from proximity.cli.service import finger_view, follower, watch_view
from proximity.cli.service.follower import frame_document
from proximity.message import CONTACT, FRAME, ContactFlag, Flaw, Mode, State
from proximity.recording.frame_bytes import frame_type
from proximity.transport import Counts, Reading, forget, open_outlet, open_publisher, open_subscriber
from proximity.transport.message_key import write_key

ADDRESS = "queue:decaff"
SEEN = watch_view.Seen(
    ADDRESS, Counts(received=500, lost=2, refused=1, flawed=Counter({Flaw.CHECKSUM: 3})), 999.6, 0.001
)

COMMAND = ("watch",)


def reading(state=State.OK, count=3, age_ns=1_300_000, **fields):
    """A reading of fingers 10 mm, 20 mm, … away; fields are of the first finger."""
    message = frame(count)
    message.header["session"], message.header["epoch"], message.header["missed"] = SESSION, 4, 17
    for name, value in fields.items():
        message.records[name][0] = value
    return Reading(state, True, 0, age_ns, message.header[()].copy(), message.records.copy())


def drawn(shown, *, width=120, color=False, row_count=20, seen=SEEN, drums=None):
    """What a terminal of that width would show, line by line."""
    stream = io.StringIO()
    console = Console(
        file=stream, width=width, force_terminal=color, color_system="standard" if color else None
    )
    console.print(watch_view.picture(shown, seen, width=width, row_count=row_count, drums=drums))
    return stream.getvalue().splitlines()


def row_of(finger, *arguments, **options):
    """The line of a finger."""
    return next(text for text in drawn(*arguments, **options) if bare(text).split()[:1] == [str(finger)])


def bare(text):
    """Text without colours and without what moves the cursor."""
    return re.sub(r"\x1b\[[\d;?]*[a-zA-Z]", "", text)


# ------------------------------------------------------------------------------------------------ one reading


def test_headline_tells_state_rate_age_and_what_is_missing():
    lines = drawn(reading(State.DEGRADED))

    since = time.strftime("session of %H:%M:%S", time.localtime(SESSION / 1e9))
    assert lines[0].strip() == "DEGRADED   in time; a finger is near with bounds only"
    assert lines[1].strip() == (
        f"{ADDRESS}  1000 Hz,  age 1.3 ms,  2 lost,  4 refused,  17 ticks missed,  epoch 4,  {since}"
    )


def test_finger_has_part_distance_bar_time_speed_mode_and_flags():
    shown = reading(
        part=12,
        signed_distance=0.03,
        lower=0.03,
        upper=0.03,
        predicted_distance=0.06,
        time_to_contact=0.0414,
        approach_speed=0.2124,
        mode=Mode.POSITION,
    )

    lines = drawn(shown, width=120)

    width = lines[2].index("touch in") - lines[2].index("0  ") - 1
    bar = lines[3][lines[2].index("0  ") :][:width]
    assert " ".join(lines[2].split()) == "finger part distance mm 0 30 60 90 120 touch in closing mode flags"
    assert lines[3].replace(bar, " ").split() == [
        *("0", "12", "30.00", "41", "ms", "212", "mm/s", "position", "TPE··S·R····")
    ]
    assert bar.count("█") == pytest.approx(width / 4, abs=1)
    assert bar.index("◆") == width // 2


def test_bounds_are_told_where_the_distance_is_not_exact():
    flags = ContactFlag.TRACKED | ContactFlag.BOUNDED
    shown = reading(lower=0.03, upper=0.0905, flags=flags, time_to_contact=0.2, time_to_contact_lower=0.011)

    row = row_of(0, shown)

    assert "30.0…90.5" in row
    assert "≥ 11 ms" in row
    assert row.count("▒") == pytest.approx(2 * row.count("█"), abs=2)
    assert "◆" not in row  # nothing is predicted of a finger whose velocity is not known


@pytest.mark.parametrize("width", [70, 120])
def test_touch_is_a_red_field(width):
    shown = reading(signed_distance=-0.0012, lower=-0.0012, upper=-0.0012, time_to_contact=0.0)

    row = row_of(0, shown, width=width, color=True)

    red = re.search(r"\x1b\[1;37;41m([^\x1b]+)\x1b", row)
    assert "1.20 mm inside" in red[1]
    assert "now" in row


def test_finger_that_is_not_tracked_shows_no_number():
    shown = reading()
    forget(shown.contacts[:1])

    row = row_of(0, shown)

    assert re.fullmatch(r" +0 +\? +\? nothing is known +\? +\? hold +·{12} *", row)


def test_stale_is_a_red_line_and_no_number_is_left():
    shown = reading(State.STALE, age_ns=3_300_000_000)
    forget(shown.contacts)
    seen = watch_view.Seen(ADDRESS, Counts(received=500), 0.0, 3.21)

    lines = drawn(shown, seen=seen, color=True)

    red = re.search(r"\x1b\[1;37;41m([^\x1b]+)\x1b", lines[0])[1]
    assert len(red) == 120
    assert red.strip() == "STALE  no frame for 3.2 s: nothing is known of any finger"
    assert "0 Hz,  age 3.3 s" in lines[1]
    assert all("nothing is known" in row for row in lines[3:6])


def test_stale_says_whether_nothing_came_ever_or_only_poses_are_missing():
    never = Reading(State.STALE, False, 0, -1, None, np.zeros(0, CONTACT))
    seen = watch_view.Seen(ADDRESS, Counts(), 0.0, 2.0)
    assert "no frame has come from queue:decaff yet, for 2.0 s" in drawn(never, seen=seen)[0]
    assert len(drawn(never, seen=seen)) == 2

    poseless = reading(State.STALE)
    poseless.header["state"] = State.STALE
    assert "the service has no new poses" in drawn(poseless)[0]


@pytest.mark.parametrize("state", [State.STARTING, State.STALE])
def test_frame_without_a_pose_has_no_age(state):
    """It had that of the tick: 0.4 ms, beside STALE."""
    shown = reading(state)
    shown.header["state"] = state
    forget(shown.contacts)

    assert " age " not in drawn(shown)[1] and " age " not in watch_view.line(shown, SEEN)


@pytest.mark.parametrize(
    ("count", "lost", "words"),
    [
        (10, slice(0, 5), "in time; the left hand is not seen"),
        (10, slice(5, 10), "in time; the right hand is not seen"),
        (10, slice(3, 8), "in time; 5 of 10 fingers are not tracked"),
        (5, slice(1, 2), "in time; 1 of 5 fingers is not tracked"),
    ],
)
def test_degraded_says_what_is_lacking(count, lost, words):
    """Whoever holds up one hand reads DEGRADED, which sounds like a fault."""
    shown = reading(State.DEGRADED, count)
    forget(shown.contacts[lost])

    assert drawn(shown)[0].strip() == f"DEGRADED   {words}"


@pytest.mark.parametrize("state", State)
def test_every_state_can_be_shown(state):
    assert state.name in drawn(reading(state))[0]
    assert f" {state.name}: 1000 Hz" in watch_view.line(reading(state), SEEN)


def test_of_more_fingers_than_fit_the_nearest_are_shown():
    shown = reading(count=12)
    shown.contacts["lower"][7] = -1.0
    forget(shown.contacts[1:2])

    lines = drawn(shown, row_count=3)

    assert [row.split()[0] for row in lines[3:6]] == ["0", "2", "7"]
    assert lines[6].strip() == "and 9 more, farther away"
    assert watch_view.line(shown, SEEN).endswith("and 4 more")


@pytest.mark.parametrize("width", [40, 91, 92])
def test_picture_fits_the_terminal(width):
    shown = reading(lower=-12.5, upper=999.9, flags=ContactFlag.TRACKED, part=4095)

    lines = drawn(shown, width=width)

    assert max(map(len, lines)) <= width
    if width >= 80:
        assert ("TPE" in row_of(1, shown, width=width)) == (width >= 92)
        assert " 4095 -12500…999900 " in row_of(0, shown, width=width)


def test_controller_that_had_no_frame_yet_has_no_drums_to_show():
    """It runs beside, and may be later than the picture."""
    shown = reading()

    lines = drawn(shown, width=120, drums=[])

    assert "drum" in lines[2].split()
    assert sum(bare(line).split()[:1] in (["0"], ["1"], ["2"]) for line in lines) == len(shown.contacts)


def test_unknown_numbers_are_shown_as_they_are():
    row = row_of(0, reading(mode=77, part=-1, approach_speed=np.nan))

    assert re.search(r" 0 +- +10\.00 .* - +\? 77 +TPE", row)


def test_parts_are_shown_by_name_where_it_is_known():
    seen = replace(SEEN, part_names=("lid", "a name of many more letters"))

    assert row_of(0, reading(part=0), seen=seen).split()[1] == "lid"
    assert "a name of many …" in row_of(0, reading(part=1), seen=seen)
    assert row_of(0, reading(part=2), seen=seen).split()[1] == "2"
    assert row_of(0, reading(part=-1), seen=seen).split()[1] == "-"


def test_line_tells_the_fingers_in_words():
    shown = reading(time_to_contact=0.0414, mode=Mode.POSITION)
    forget(shown.contacts[1:2])

    told = watch_view.line(shown, SEEN)

    assert re.match(
        r"\d\d:\d\d:\d\d OK: 1000 Hz, age 1.3 ms, 2 lost, 4 refused, 17 ticks missed, epoch 4", told
    )
    assert told.split("; ")[1:] == [
        "0: 10.00 mm, touch in 41 ms, position",
        "1: not tracked",
        "2: 30.00 mm, retract",
    ]


def test_line_of_what_is_stale_tells_no_finger():
    shown = reading(State.STALE)
    seen = watch_view.Seen(ADDRESS, Counts(received=500), 0.0, 3.21)

    assert watch_view.line(shown, seen).endswith("; no frame for 3.2 s: nothing is known of any finger")


@pytest.mark.parametrize("width", [14, 60])
def test_bar_is_as_wide_as_its_ruler_and_grows_with_the_distance(width):
    free = [finger_view.bar(mm, mm, np.nan, width, "green").plain for mm in (0.5, 30.0, 60.0, 119.0, 500.0)]

    assert all(len(text) == width for text in [*free, finger_view.ruler(width)])
    assert finger_view.ruler(width).split()[-1] == "120"
    full = [text.count("█") for text in free]
    assert full[1:3] == [width // 4, width // 2]
    assert full[0] == 0 and free[0].strip()
    assert free[4].endswith("»") and not free[3].endswith("»")


# ------------------------------------------------------------------------------------------------- following


def test_rate_is_of_the_last_second(monkeypatch):
    queued_transport.register(monkeypatch)
    now = [100.0]
    with open_subscriber(ADDRESS) as subscriber, open_publisher(ADDRESS) as publisher:
        following = follower.Follower(subscriber, gather=0.0, clock=lambda: now[0])
        rates, silences = [], []
        for turn in range(120):
            now[0] += 0.05
            if turn < 80:
                for _ in range(20 if turn < 40 else 10):
                    publisher.publish(frame(now_ns=time.monotonic_ns()))
            _, seen = following.look(0.0)
            rates.append(seen.rate_hz)
            silences.append(seen.silent_s)

    assert rates[39] == pytest.approx(400.0)
    assert rates[79] == pytest.approx(200.0)
    assert rates[-1] == 0.0
    assert silences[79] == 0.0
    assert silences[-1] == pytest.approx(2.0)


@pytest.fixture(autouse=True)
def queued(monkeypatch):
    """Frames come through a queue of this process."""
    queued_transport.register(monkeypatch)


@pytest.fixture
def service():
    """Publishes until the test is over."""
    over = threading.Event()

    def publish():
        with open_publisher(ADDRESS) as publisher:
            while not over.wait(0.005):
                message = frame(2, now_ns=time.monotonic_ns())
                message.header["valid_until_ns"] += 10**10  # so that a slow machine is not shown as LATE
                publisher.publish(message)

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    over.set()
    thread.join()


def test_pipe_gets_plain_lines(run, service, monkeypatch):
    monkeypatch.setattr(tables, "LINE_EVERY_S", 0.1)

    result = run(ADDRESS, "--limit", 1)

    lines = result.out.splitlines()
    assert (result.code, result.err) == (0, "")
    assert len(lines) >= 2
    assert "\x1b" not in result.out
    assert all(re.fullmatch(r"[\d:]{8} [A-Z]+: \d+ Hz, .*", text) for text in lines)
    assert "; 0: 10.00 mm, retract; 1: 20.00 mm, retract" in result.out


def test_json_is_a_line_for_every_frame_that_came(run):
    outlet = open_outlet(ADDRESS)
    for number in range(20):
        outlet.send(np.frombuffer(sealed([number], 2), np.uint8))

    result = run(ADDRESS, "--limit", 0.2, "--json")

    assert (result.code, result.err) == (0, "")
    frames = list(map(json.loads, result.out.splitlines()))
    assert [told["sequence"] for told in frames] == list(range(20))
    assert (frames[0]["state"], frames[0]["session"], len(frames[0]["fingers"])) == ("ok", SESSION, 2)
    finger = frames[0]["fingers"][1]
    assert (finger["finger"], finger["signed_distance"], finger["mode"]) == (1, 0.02, "retract")
    assert finger["flags"] == ["tracked", "predicted", "exact", "signed", "in_range"]
    assert finger["time_to_contact"] is None  # infinite: JSON has no word for that
    assert finger["normal"] == [0.0, 0.0, 1.0] and finger["part_name"] is None


def test_json_names_parts_states_and_numbers_that_are_not_known():
    message = frame(2)
    message.records["part"], message.records["mode"] = [1, 7], [Mode.FORCE, 99]
    message.header["state"] = State.LATE
    (one,) = message.seal(SESSION, 3).view(frame_type(FRAME.size(2)))

    told = frame_document(one, ("lid", "box"))

    assert (told["state"], told["sequence"]) == ("late", 3)
    assert [finger["part_name"] for finger in told["fingers"]] == ["box", None]
    assert [finger["mode"] for finger in told["fingers"]] == ["force", "99"]


def test_json_of_nothing_is_exit_code_1(run):
    result = run(ADDRESS, "--limit", 0.1, "--json")

    assert (result.code, result.out) == (1, "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_terminal_gets_a_table_until_told_to_stop(run, service, monkeypatch, number):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("COLUMNS", "120")
    monkeypatch.setenv("LINES", "30")
    shown = follower.picture
    count = []

    def picture(*arguments, **options):
        count.append(1)
        if len(count) == 3:
            os.kill(os.getpid(), number)
        return shown(*arguments, **options)

    monkeypatch.setattr(follower, "picture", picture)
    result = run(ADDRESS)

    assert (result.code, result.err) == (0, "")
    assert re.search(r"^ +1 +0 +20\.00 █", bare(result.out), re.MULTILINE)
    assert result.out.endswith("\x1b[?25h")  # the cursor is back


def test_nothing_that_comes_is_exit_code_1(run):
    result = run(ADDRESS, "--limit", 0.3)

    assert result.code == 1
    assert "STALE: 0 Hz, 0 lost, 0 refused; no frame has come from queue:decaff yet, for 0." in result.out


def test_address_that_is_none_is_told(run):
    result = run("decaff")

    assert result.code == 2
    assert result.err.startswith("proximity: decaff: expected an address such as iox2://NAME")


def test_key_of_another_is_told(run, tmp_path):
    """Nothing is verified: the line says so, not that nothing comes."""
    path, port, is_enough = tmp_path / "frames.key", free_port(), threading.Event()
    write_key(str(path))

    def publish():
        with open_publisher(f"udp://127.0.0.1:{port}") as publisher:
            while not is_enough.wait(0.01):
                publisher.publish(frame(now_ns=time.monotonic_ns()))

    thread = threading.Thread(target=publish)
    thread.start()
    try:
        result = run(f"udp://127.0.0.1:{port}?key={path}", "--limit", 1.2)
    finally:
        is_enough.set()
        thread.join()

    assert result.code == 1
    assert f"messages are not verified by the key of udp://127.0.0.1:{port}?key={path}" in result.out
