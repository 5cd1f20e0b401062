"""The regression gate's verdicts and messages, also for a kernel measured twice.

Clocks and cases are made up.
"""

from pathlib import Path

import gate as gate_command
import pytest

from benchmarks.gate import cases
from benchmarks.gate import limits as limits_module

BENCH = Path(__file__).resolve().parents[2] / "bench"
LIMITS = """\
# What is allowed.
[fast]
measured = 0.5
limit = 0.7
reason = "2026-11-21: first"
"""


@pytest.fixture
def limits(monkeypatch, tmp_path):
    """The module of the limits, with a temporary file."""
    path = tmp_path / "gate.toml"
    path.write_text(LIMITS, encoding="utf-8")
    monkeypatch.setattr(limits_module, "FILE", path)
    monkeypatch.setattr(limits_module, "is_known_machine", lambda: True)
    return limits_module


@pytest.fixture
def gate(limits, monkeypatch):
    """The gate, with cases whose calls take given times on a clock that only they advance."""
    now_ns = [0]

    def takes(nanoseconds):
        return lambda: now_ns.__setitem__(0, now_ns[0] + nanoseconds)

    def with_calls(ours_ns, theirs_ns, name="fast"):
        case = cases.GateCase(name, takes(ours_ns), takes(theirs_ns))
        monkeypatch.setattr(gate_command, "make_cases", lambda: [case])
        return gate_command

    monkeypatch.setattr(gate_command.time, "thread_time_ns", lambda: now_ns[0])
    monkeypatch.setattr(gate_command.proximity, "warm_up", lambda: None)
    return with_calls


def test_case_within_its_limit_passes(gate, capsys):
    assert gate(60_000, 100_000).main([]) == 0

    out = capsys.readouterr().out
    assert "fast" in out and "0.6" in out and "ok" in out


def test_kernel_that_takes_twice_as_long_fails_and_is_named(gate, capsys):
    assert gate(100_000, 100_000).main([]) == 1

    out = capsys.readouterr().out
    assert "Again, over 200 rounds: fast" in out
    assert "fast takes 2.00 times as long as before: 1 times the yardstick's time" in out
    assert "measured was 0.5, the limit is 0.7" in out
    assert 'python bench/gate.py --update fast --reason "why' in out


def test_asking_twice_fails_where_asking_once_passes(gate):
    passing = gate(50_000, 100_000)

    assert passing.main([]) == 0
    assert passing.main(["--twice", "fast"]) == 1


def test_another_processor_has_more_room(gate, limits, monkeypatch):
    module = gate(75_000, 100_000)
    assert module.main([]) == 1

    monkeypatch.setattr(limits, "is_known_machine", lambda: False)
    assert module.main([]) == 0
    assert limits.OTHER_MACHINE * limits.MARGIN < 2.0, "a kernel that takes twice as long must fail"


def test_case_without_a_limit_is_refused(gate, capsys):
    assert gate(1000, 1000, "new").main([]) == 2

    assert "gate.toml has no limit for new: python bench/gate.py --update new" in capsys.readouterr().out


def test_update_writes_a_limit_with_its_reason_and_keeps_the_comments(gate, limits):
    assert gate(100_000, 100_000).main(["--update", "fast", "--reason", "it is exact now"]) == 0

    found = limits.read_limits(limits.FILE)["fast"]
    assert (found.measured, found.limit) == (1.0, limits.MARGIN)
    assert found.reason.endswith(": it is exact now")
    assert limits.FILE.read_text(encoding="utf-8").startswith("# What is allowed.\n")


@pytest.mark.parametrize(
    "fields",
    ["measured = 0.5\nlimit = 0.4\nreason = 'x'", "measured = 0.5", "measured = 1\nlimit = 2\nreason = ''"],
)
def test_line_of_limits_that_cannot_be_used_is_named(limits, fields):
    limits.FILE.write_text(f"[fast]\n{fields}\n", encoding="utf-8")

    with pytest.raises(limits.LimitError, match=r"gate\.toml: \[fast\] has .* a larger limit, and a reason"):
        limits.read_limits(limits.FILE)


def test_no_limit_lets_a_kernel_take_twice_as_long():
    for name, limit in limits_module.read_limits(BENCH / "gate.toml").items():
        assert limit.limit <= 1.5 * limit.measured, f"{name}: a kernel that takes twice as long must fail"
