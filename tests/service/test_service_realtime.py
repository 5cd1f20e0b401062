"""System settings for real time: granted, refused with a message or unavailable; and restored."""

import ctypes
import gc
import os
import re
import subprocess
import sys

import pytest

from proximity.service import RealTime, realtime
from proximity.service.realtime import undisturbed

ON_LINUX = sys.platform.startswith("linux")


class FakeSystem:
    """Replace os and the C library: record calls, and fail those in *refused*."""

    def __init__(self, monkeypatch, refused=(), cores=(0, 1, 2), is_unlimited=True):
        self.calls, self.refused, self.cores = [], refused, set(cores)
        for name in ("sched_setscheduler", "sched_setaffinity"):
            monkeypatch.setattr(os, name, self._asked(name), raising=False)
        monkeypatch.setattr(os, "sched_getscheduler", lambda pid: 0, raising=False)
        monkeypatch.setattr(os, "sched_getparam", lambda pid: "before", raising=False)
        monkeypatch.setattr(os, "sched_getaffinity", lambda pid: self.cores, raising=False)
        monkeypatch.setattr(os, "SCHED_FIFO", 1, raising=False)
        monkeypatch.setattr(os, "sched_param", lambda priority: priority, raising=False)
        monkeypatch.setattr(realtime, "_libc", lambda: self)
        monkeypatch.setattr(realtime, "_may_lock_all", lambda: is_unlimited)

    def _asked(self, name):
        def ask(*arguments):
            self.calls.append((name, *arguments))
            if name in self.refused:
                raise PermissionError(1, "Operation not permitted")

        return ask

    def mlockall(self, flags):
        self.calls.append(("mlockall", flags))
        if "mlockall" in self.refused:
            ctypes.set_errno(12)
            return -1
        return 0

    def munlockall(self):
        self.calls.append(("munlockall",))


def test_all_is_asked_for_and_given_back_in_reverse(monkeypatch):
    system = FakeSystem(monkeypatch)

    with RealTime(priority=42) as real_time:
        assert system.calls == [
            ("mlockall", 7),
            ("sched_setaffinity", 0, {2}),
            ("sched_setscheduler", 0, 1, 42),
        ]
        system.calls.clear()

    assert system.calls == [
        ("sched_setscheduler", 0, 0, "before"),
        ("sched_setaffinity", 0, {0, 1, 2}),
        ("munlockall",),
    ]
    assert real_time.notes == [
        "memory: locked",
        "core: 2, and no other",
        "priority: real-time (SCHED_FIFO 42)",
    ]
    assert real_time.refused == []


def test_what_is_not_permitted_is_a_sentence_and_nothing_to_give_back(monkeypatch):
    system = FakeSystem(monkeypatch, refused={"mlockall", "sched_setscheduler", "sched_setaffinity"})

    with RealTime(core=7) as real_time:
        system.calls.clear()

    assert system.calls == []
    assert (
        real_time.notes
        == real_time.refused
        == [
            f"memory: not permitted ({os.strerror(12)})",
            "core: not permitted (Operation not permitted)",
            "priority: not permitted (Operation not permitted)",
        ]
    )


def test_memory_of_the_future_is_left_alone_where_it_is_limited(monkeypatch):
    """Otherwise later allocations could fail."""
    system = FakeSystem(monkeypatch, is_unlimited=False)
    with RealTime() as real_time:
        assert system.calls[0] == ("mlockall", 5)
    assert real_time.notes[0] == "memory: locked as far as it is in use now"


def test_process_with_one_core_stays_there_anyway(monkeypatch):
    system = FakeSystem(monkeypatch, cores=[3])
    with RealTime(lock_memory=False) as real_time:
        assert system.calls == [("sched_setscheduler", 0, 1, realtime.PRIORITY)]
    assert real_time.notes[0] == "core: the process may use one core only"


def test_system_without_such_things_is_no_error(monkeypatch):
    """Windows has neither these functions nor this C library."""
    for name in ("sched_setscheduler", "sched_getscheduler", "sched_getaffinity", "sched_setaffinity"):
        monkeypatch.delattr(os, name, raising=False)

    def no_library():
        raise TypeError("bad argument type")

    monkeypatch.setattr(realtime, "_libc", no_library)

    with RealTime() as real_time:
        pass
    assert real_time.refused == [
        f"{what}: this system cannot be asked for it" for what in ("memory", "core", "priority")
    ]


@pytest.mark.skipif(not ON_LINUX, reason="asks Linux")
def test_real_system_answers_each_in_a_sentence_and_is_left_as_it_was():
    scheduler, cores = os.sched_getscheduler(0), os.sched_getaffinity(0)
    with RealTime() as real_time:
        assert len(real_time.notes) == 3
    assert os.sched_getscheduler(0) == scheduler and os.sched_getaffinity(0) == cores


@pytest.mark.skipif(not ON_LINUX or os.geteuid() != 0, reason="drops the permissions of root")
def test_user_without_permission_is_told_so():
    code = (
        "import os, resource\n"
        "from proximity.service import RealTime\n"
        "resource.setrlimit(resource.RLIMIT_MEMLOCK, (65536, 65536))\n"
        "resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))\n"
        "os.setgroups([]); os.setgid(65534); os.setuid(65534)\n"
        "with RealTime(core=max(os.sched_getaffinity(0))) as real_time:\n"
        "    print(*real_time.notes, sep='\\n')\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120
    )

    memory, core, priority = result.stdout.splitlines()
    assert memory == f"memory: not permitted ({os.strerror(12)})"
    assert re.fullmatch(r"core: \d+, and no other", core)
    assert priority == "priority: not permitted (Operation not permitted)"


def test_collector_and_turns_of_threads_are_as_before_afterwards():
    interval, slack = sys.getswitchinterval(), realtime._set_timer_slack(50_000)
    assert gc.isenabled()
    try:
        with undisturbed():
            assert not gc.isenabled() and gc.get_freeze_count() > 0
            assert sys.getswitchinterval() == pytest.approx(realtime.SWITCH_INTERVAL)
            if ON_LINUX:
                assert realtime._set_timer_slack(1) == 1
        assert gc.isenabled() and gc.get_freeze_count() == 0
        assert sys.getswitchinterval() == interval
        if ON_LINUX:
            assert realtime._set_timer_slack(50_000) == 50_000
    finally:
        realtime._set_timer_slack(slack)


def test_collector_that_was_off_stays_off():
    gc.disable()
    try:
        with undisturbed():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
