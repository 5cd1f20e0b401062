"""The loop on a manual clock: tick times, frame contents, and late ticks."""

import json
import threading
import time
import tracemalloc

import numpy as np
import pytest
from fake_service import (
    MS,
    FakeAnswers,
    KeepingOutlet,
    ManualClock,
    ScriptedInput,
    hands_at,
    publisher,
    serve,
    steady,
)

from proximity.errors import ServiceError
from proximity.message import FRAME, ContactFlag, Source, State, validate
from proximity.service import Service, SkippingClock, loop_memory

START = 1000 * MS
FAREWELL = [State.STOPPING] * 3


def flagged(answers, flags):
    """Add flags to the first finger from the next tick on."""
    fill = answers.fill

    def fill_with_flags(contacts, poses, now_ns):
        fill(contacts, poses, now_ns)
        contacts["flags"][0] |= int(flags)

    answers.fill = fill_with_flags
    return answers


def test_ticks_come_at_deadlines_and_not_after_pauses():
    clock = ManualClock()

    report, outlet, answers, _ = serve(during=lambda tick: clock.spend(MS // 4), ticks=5, clock=clock)

    assert [now for *_, now in answers.seen] == [START + k * MS for k in range(1, 6)]
    assert report.ticks == 5 and report.missed == 0
    assert report.compute.count == report.lateness.count == 5
    assert report.compute.max_ns == MS // 4 and report.lateness.max_ns == 0
    assert outlet.states == [State.OK] * 5 + FAREWELL


@pytest.mark.parametrize(
    ("slept_ns", "starts_ns", "missed", "states"),
    [
        ([0, 200_000, 0], [MS, 2 * MS + 200_000, 3 * MS], 0, [State.OK] * 3),
        ([0, 2 * MS + 1, 0], [MS, 4 * MS + 1, 5 * MS], 2, [State.OK, State.LATE, State.OK]),
    ],
)
def test_waking_late_is_counted_apart_from_computing_and_so_are_deadlines_slept_through(
    slept_ns, starts_ns, missed, states
):
    report, outlet, _, _ = serve(ticks=3, clock=ManualClock(oversleeps=slept_ns))

    assert (report.lateness.max_ns, report.compute.max_ns, report.missed) == (max(slept_ns), 0, missed)
    assert [int(header["start_ns"]) - START for header in outlet.headers[:3]] == starts_ns
    assert outlet.states[:3] == states


def test_answer_of_three_periods_and_a_half_skips_three_deadlines_and_hurries_after_none():
    clock = ManualClock()

    report, outlet, answers, _ = serve(
        during=lambda tick: clock.spend(7 * MS // 2) if tick == 2 else None, ticks=6, clock=clock
    )

    # The third tick began at 3 ms and ended at 6.5 ms, past the deadlines at 4, 5 and 6 ms.
    assert [(now - START) // MS for *_, now in answers.seen] == [1, 2, 3, 7, 8, 9]
    assert report.missed == 3
    assert [int(header["missed"]) for header in outlet.headers[:6]] == [0, 0, 3, 3, 3, 3]
    assert outlet.states == [State.OK, State.OK, State.LATE, State.OK, State.OK, State.OK, *FAREWELL]
    assert report.states[State.LATE] == 1


def test_frame_of_parts_that_nothing_more_is_told_of_is_late():
    answers = FakeAnswers()
    answers.during = lambda tick: setattr(answers, "is_late", tick in (1, 2))

    report, outlet, _, _ = serve(ticks=4, answers=answers)

    assert outlet.states == [State.OK, State.LATE, State.LATE, State.OK, *FAREWELL]
    assert report.states[State.LATE] == 2 and report.missed == 0


def test_tick_that_fails_midway_still_says_stopping_closes_and_leaves_none_of_its_contacts():
    def fail(tick):  # after the contacts were written
        if tick == 2:
            raise ZeroDivisionError

    outlet = KeepingOutlet()
    service = Service(
        FakeAnswers(during=fail),
        ScriptedInput(steady),
        [publisher(outlet)],
        period=0.001,
        clock=ManualClock(),
    )

    with pytest.raises(ZeroDivisionError):
        service.run(tick_count=5)

    assert outlet.states == [State.OK, State.OK, *FAREWELL]
    assert outlet.is_closed
    last = outlet.records[-1]
    assert not last["flags"].any() and (last["lower"] == -np.inf).all()
    assert last["finger"].tolist() == [0, 1]


def test_no_tick_waits_for_contacts_that_python_makes():
    outlet, has_ticked = KeepingOutlet(), threading.Event()
    send = outlet.send
    outlet.send = lambda data: (send(data), has_ticked.set() if outlet.count == 10 else None)
    waits = FakeAnswers(during=lambda tick: has_ticked.wait(60.0))
    service = Service(waits, ScriptedInput(steady), [publisher(outlet)], period=0.001)

    service.run(tick_count=2000, stop=has_ticked)

    assert has_ticked.is_set() and waits.ticks >= 1
    assert not outlet.records[0]["flags"].any()  # no contact was known yet


def test_header_tells_times_period_epoch_and_count():
    clock = ManualClock()

    _, outlet, _, _ = serve(
        lambda poll, now_ns: hands_at([[0.1, 0, 0], [0.2, 0, 0]], [now_ns - 3 * MS, now_ns - MS]),
        during=lambda tick: clock.spend(1000),
        ticks=1,
        clock=clock,
        answers=FakeAnswers(during=lambda tick: clock.spend(1000), epoch=7),
    )

    header = outlet.headers[0]
    assert header["pose_ns"] == START + MS - 3 * MS  # of the oldest
    assert header["start_ns"] == START + MS
    assert header["publish_ns"] == START + MS + 1000
    assert header["valid_until_ns"] == header["pose_ns"] + 20 * MS
    assert header["period_ns"] == MS
    assert header["epoch"] == 7 and header["missed"] == 0 and header["count"] == 2
    assert header["source"] == Source.GEOMETRY
    assert header["reserved"].tolist() == [0, 0]
    np.testing.assert_array_equal(outlet.records[0]["signed_distance"], [0.1, 0.2])


def test_every_frame_is_whole_and_numbered():
    _, outlet, _, _ = serve(ticks=4)

    assert all(validate(data, FRAME) is None for data in outlet.sent)
    assert [int(header["sequence"]) for header in outlet.headers] == list(range(7))
    assert len({int(header["session"]) for header in outlet.headers}) == 1


HOUR = 3600_000 * MS


def both(now_ns, *, left=0.1, right=0.1, right_ns=None):
    """Poses of two fingers now; nan means untracked."""
    return hands_at([[left, 0, 0], [right, 0, 0]], [now_ns, now_ns if right_ns is None else right_ns])


@pytest.mark.parametrize(
    ("poll", "states", "refused"),
    [
        (lambda poll, now: both(now) if poll >= 3 else None, [(3, State.STARTING), (2, State.OK)], (0, 0, 0)),
        (lambda poll, now: both(now, left=np.nan if poll >= 2 else 0.1, right=np.nan if poll else 0.1),
         [(1, State.OK), (1, State.DEGRADED), (1, State.STALE)], (0, 0, 0)),
        (lambda poll, now: both(now, right_ns=START), [(100, State.OK), (5, State.DEGRADED)], (0, 0, 0)),
        (lambda poll, now: both(now + (HOUR if 10 <= poll < 200 else 0)),
         [(10, State.OK), (105, None), (85, State.STALE), (10, State.OK)], (2 * 190, 0, 0)),
        (lambda poll, now: both(now - (HOUR if 10 <= poll < 200 else 0)),
         [(10, State.OK), (105, None), (85, State.STALE), (10, State.OK)], (0, 0, 2 * 190)),
        (lambda poll, now: both(now - (50 * MS if poll >= 10 else 0)), [(80, State.OK)], (0, 2 * 49, 0)),
        (lambda poll, now: both(START), [(10, State.OK)], (0, 0, 0)),
    ],
    ids=["none yet", "lost", "one too old", "clock ahead", "clock behind", "clock put back", "the same"],
)  # fmt: skip
def test_state_follows_from_the_poses_that_come(poll, states, refused):
    """None allows any state. A clock that jumps leads to STALE, and recovers when it is right."""
    count = sum(times for times, _ in states)

    report, outlet, answers, _ = serve(poll, ticks=count, valid_for=1.0)

    assert len(answers.seen) == count  # still at the full rate
    expected = [state for times, state in states for _ in range(times)]
    assert [told for told, state in zip(outlet.states, expected, strict=False) if state is not None] == [
        state for state in expected if state is not None
    ]
    assert (report.future, report.backwards, report.too_old) == refused
    for records, state in zip(outlet.records, expected, strict=False):
        tracked = int((records["flags"] != 0).sum())
        assert tracked == {State.OK: 2, State.DEGRADED: 1}.get(state, 0) or state is None


def test_pose_that_comes_while_a_tick_is_kept_from_running_is_not_from_the_future():
    clock = ManualClock()

    def poll(poll, now_ns):
        clock.spend(30 * MS * (poll == 1))
        return both(clock.now_ns())

    report, outlet, _, _ = serve(poll, ticks=3, clock=clock)

    assert report.future == 0
    assert outlet.states[:3] == [State.OK, State.LATE, State.OK]


def test_state_goes_from_late_to_stale_as_the_only_pose_grows_old():
    _, outlet, answers, _ = serve(lambda poll, now_ns: steady(poll, now_ns) if poll == 0 else None, ticks=110)
    # The first tick's pose is valid for 20 ms and becomes stale after 100 ms.
    assert outlet.states[:110] == [State.OK] * 21 + [State.LATE] * 80 + [State.STALE] * 9
    assert np.isfinite(answers.seen[100][0]).all() and np.isnan(answers.seen[101][0][:, 0]).all()


@pytest.mark.parametrize(
    ("flags", "state"),
    [
        (ContactFlag.BOUNDED | ContactFlag.IN_RANGE, State.DEGRADED),
        (ContactFlag.BOUNDED, State.OK),
        (ContactFlag.IN_RANGE | ContactFlag.EXACT, State.OK),
    ],
)
def test_state_is_degraded_where_a_finger_is_near_with_bounds_only(flags, state):
    _, outlet, _, _ = serve(ticks=1, answers=flagged(FakeAnswers(), flags))
    assert outlet.states[0] == state


def test_poses_from_the_future_or_going_back_are_left_out_and_counted():
    instants = [0, 4 * MS, 6 * MS, -MS, 0]  # ahead of the tick

    def poll(poll, now_ns):
        return hands_at([[0.1 * (poll + 1), 0, 0]] * 2, now_ns + instants[poll])

    report, _, answers, _ = serve(poll, ticks=5)

    # Kept: 1 ms, 2 + 4 ms. Rejected: 3 + 6 as future; 4 - 1 and 5 as backwards, both before 6 ms.
    assert [positions[0, 0] for positions, *_ in answers.seen] == pytest.approx([0.1, 0.2, 0.2, 0.2, 0.2])
    assert report.future == 2 and report.backwards == 4


def test_input_that_is_over_ends_the_service_after_its_last_pose():
    report, outlet, answers, _ = serve(ticks=None, over_after=4)
    assert report.ticks == 4 and len(answers.seen) == 4
    assert outlet.states == [State.OK] * 4 + FAREWELL


def test_stopping_is_said_three_times_a_period_apart_and_all_is_closed():
    clock, outlet, answers, pose_input = ManualClock(), KeepingOutlet(), FakeAnswers(), ScriptedInput(steady)
    service = Service(answers, pose_input, [publisher(outlet)], period=0.001, clock=clock)

    service.run(tick_count=2)

    farewells = outlet.headers[2:]
    assert outlet.states[2:] == FAREWELL
    assert np.diff([int(header["publish_ns"]) for header in farewells]).tolist() == [MS, MS]
    assert [int(header["pose_ns"]) for header in farewells] == [START + 2 * MS] * 3
    assert outlet.is_closed and answers.is_closed and pose_input.is_closed


def test_event_stops_the_loop():
    stop = threading.Event()
    clock, outlet = ManualClock(), KeepingOutlet()
    answers = FakeAnswers(during=lambda tick: stop.set() if tick == 4 else None)
    service = Service(answers, ScriptedInput(steady), [publisher(outlet)], period=0.001, clock=clock)

    report = service.run(stop=stop)

    assert report.ticks == 5
    assert outlet.states[5:] == FAREWELL


def test_service_runs_once():
    service = Service(FakeAnswers(), ScriptedInput(steady), [], period=0.001, clock=ManualClock())
    service.run(tick_count=1)
    with pytest.raises(ServiceError, match=r"^this service has already run and is closed"):
        service.run()


def test_report_tells_all_in_numbers_and_in_lines():
    report, *_ = serve(
        lambda poll, now_ns: hands_at([[0.1, 0, 0]] * 2, now_ns + (9 * MS if poll == 1 else 0)), ticks=3
    )

    told = report.as_dict()
    assert told["states"] == {
        "starting": 0, "ok": 3, "degraded": 0, "late": 0, "stale": 0, "stopping": 0
    }  # fmt: skip
    assert (told["ticks"], told["missed"], told["future"], told["backwards"]) == (3, 0, 2, 0)
    assert told["compute"]["count"] == 3 and told["lateness"]["rows"] == [[0, 0, 3]]
    assert json.loads(json.dumps(told)) == told
    assert str(report).splitlines() == [
        "3 ticks (3 ok), 0 missed",
        "computing: p50 0 µs, p99 0 µs, max 0 µs",
        "woken late: p50 0 µs, p99 0 µs, max 0 µs",
        "left out: 2 poses from the future, 0 older than the one before, 0 too old",
    ]


def test_publisher_that_fails_is_counted_and_the_others_go_on(caplog):
    failing, outlet = KeepingOutlet(refused={1, 2}), KeepingOutlet()
    service = Service(
        FakeAnswers(),
        ScriptedInput(steady),
        [publisher(failing, "failing:"), publisher(outlet, "keeping:")],
        period=0.001,
        clock=ManualClock(),
    )

    report = service.run(tick_count=5)

    assert len(outlet.sent) == 8 and len(failing.sent) == 6
    assert [int(header["sequence"]) for header in failing.headers] == [0, 3, 4, 5, 6, 7]
    assert report.publish_failures == {"failing:": 2, "keeping:": 0}
    assert report.notes == ["failing:: 2 frames were not published, first: keeping: no room"]
    assert [record.message for record in caplog.records] == ["a frame cannot be published: keeping: no room"]


class KeepingLog:
    def __init__(self):
        self.frames, self.is_closed = [], False

    def append(self, data):
        self.frames.append(data.copy())

    def close(self):
        self.is_closed = True


def test_log_has_every_frame_as_the_first_publisher_sealed_it():
    log, first, second = KeepingLog(), KeepingOutlet(), KeepingOutlet()
    service = Service(
        FakeAnswers(),
        ScriptedInput(steady),
        [publisher(first), publisher(second)],
        period=0.001,
        clock=ManualClock(),
        log=log,
    )

    report = service.run(tick_count=20)

    assert log.is_closed
    np.testing.assert_array_equal(np.array(log.frames), np.array(first.sent))
    assert report.log_written == 23 and report.log_lost == 0


def test_waits_that_are_skipped_leave_frames_as_old_as_they_were():
    began = time.monotonic_ns()
    clock = SkippingClock()
    _, outlet, answers, _ = serve(
        lambda poll, now_ns: hands_at([[0.1, 0, 0]] * 2, now_ns - 2 * MS), ticks=500, clock=clock, period=0.01
    )
    ended = time.monotonic_ns()

    assert clock.skipped_ns > 4.9e9 - (ended - began)  # 5 s of ticks, less their duration
    ticked = [now for *_, now in answers.seen]
    assert np.diff(ticked).min() > 9 * MS
    for header, records in zip(outlet.headers[:500], outlet.records[:500], strict=True):
        assert began < header["start_ns"] <= header["publish_ns"] < ended
        assert header["start_ns"] - header["pose_ns"] == 2 * MS
        assert (records["pose_ns"] == header["pose_ns"]).all()
        assert (records["predicted_ns"] - records["pose_ns"] == 3 * MS).all()


def test_replacement_answers_from_the_next_tick_on_and_the_epoch_grows():
    after = FakeAnswers(epoch=0)
    outlet = KeepingOutlet()
    before = FakeAnswers(during=lambda tick: service.replace(after) if tick == 2 else None, epoch=5)
    service = Service(before, ScriptedInput(steady), [publisher(outlet)], period=0.001, clock=ManualClock())

    service.run(tick_count=6)

    assert before.ticks == 3 and after.ticks == 3 and after.rehearsals == 1
    assert [int(header["epoch"]) for header in outlet.headers] == [5] * 3 + [6] * 6
    assert not before.is_closed and after.is_closed


def test_replacement_from_another_thread_returns_when_it_answers():
    after = FakeAnswers()
    swapped = threading.Event()
    before = FakeAnswers()
    service = Service(before, ScriptedInput(steady), [], period=0.001)
    stop = threading.Event()
    thread = threading.Thread(target=service.run, kwargs={"stop": stop})
    thread.start()
    try:
        while not before.ticks:
            swapped.wait(0.001)
        service.replace(after)
        swapped.wait(0.01)
        ticks = before.ticks
        while not after.ticks and thread.is_alive():
            swapped.wait(0.001)
    finally:
        stop.set()
        thread.join(10.0)
    assert before.ticks == ticks and after.ticks > 0


def test_replacement_for_other_fingers_is_refused():
    service = Service(FakeAnswers(), ScriptedInput(steady), [], period=0.001)
    with pytest.raises(
        ServiceError,
        match=r"^contacts of 3 fingers from geometry cannot replace those of 2 from geometry in a running "
        r"service$",
    ):
        service.replace(FakeAnswers(3))


@pytest.mark.parametrize(
    ("name", "value"), [("period", 0.0), ("valid_for", float("nan")), ("stale_after", "1"), ("period", 1e-7)]
)
def test_times_that_cannot_be_are_refused(name, value):
    times = {"period": 0.001, name: value}
    with pytest.raises(ServiceError, match=f"^{name} is .*, expected 1e-05 to 10 s$"):
        Service(FakeAnswers(), ScriptedInput(steady), [], **times)


def test_service_without_compiled_kernels_is_refused_with_what_to_run(monkeypatch):
    monkeypatch.setattr(loop_memory, "IS_AHEAD", False)
    with pytest.raises(ServiceError, match=r"needs compiled kernels: run `python tools/build_kernels\.py`"):
        Service(FakeAnswers(), ScriptedInput(steady), [], period=0.001)


def test_memory_does_not_grow_with_ticks():
    sizes = []

    def look(tick):
        if tick in (200, 3200):
            sizes.append(tracemalloc.get_traced_memory()[0])

    class Blind(FakeAnswers):
        """Keep no record of calls."""

        def fill(self, contacts, poses, now_ns):
            self.seen.clear()
            super().fill(contacts, poses, now_ns)

    class Nowhere(KeepingOutlet):
        def send(self, data):
            self.count += 1

    class Forgetful(ManualClock):
        def sleep_until(self, due_ns):
            super().sleep_until(due_ns)
            self.sleeps.clear()

    outlet = Nowhere()
    service = Service(
        Blind(during=look), ScriptedInput(steady), [publisher(outlet)], period=0.001, clock=Forgetful()
    )
    tracemalloc.start()
    try:
        service.run(tick_count=3201)
    finally:
        tracemalloc.stop()

    assert outlet.count == 3204
    # The smallest object per tick would add 48 kB; other threads of the test run allocate some memory.
    assert abs(sizes[1] - sizes[0]) < 16_000
