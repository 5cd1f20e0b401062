"""Limits of the gate: the permitted time of each call, as a share of the yardstick's."""

import datetime
import json
import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import llvmlite.binding
import numba

from benchmarks.support.project import BENCH
from proximity.native import MODE

FILE = BENCH / "gate.toml"
MARGIN = 1.4
"""Ratio of a limit to the measured ratio. Runs differ by less, also while another process takes a core; a
kernel of twice the time exceeds it (`gate.toml` has the spreads)."""
MEASURED_ON = "emeraldrapids"
"""LLVM's name of the processor that the limits were measured on."""
OTHER_MACHINE = 1.35
"""Factor of the limits on another processor, or with narrower vectors: the engine's have eight lanes, the
yardstick one. With AVX2 alone on that Xeon ratios were 0.96 (building) to 1.28 (segments) times as large."""


@dataclass(frozen=True, slots=True)
class Limit:
    """Limit of one case."""

    measured: float  # ours / yardstick
    limit: float
    reason: str


@dataclass(frozen=True, slots=True)
class GateVerdict:
    """One line of the gate's table."""

    case: str
    ratio: float
    limit: Limit

    @property
    def is_met(self) -> bool:
        """True if the case is within its limit; nan is not."""
        return self.ratio <= self.limit.limit

    @property
    def sentence(self) -> str:
        """The failure and its remedy, of a verdict that is not met."""
        slower, known = self.ratio / self.limit.measured, self.limit
        return (
            f"{self.case} takes {slower:.2f} times as long as before: {self.ratio:.3g} times the yardstick's "
            f"time, measured was {known.measured:.3g}, the limit is {known.limit:.3g}; make it fast again, "
            f'or run: python bench/gate.py --update {self.case} --reason "why it is worth that"'
        )


class LimitError(Exception):
    """The file of limits cannot be used, or does not match the cases."""


def read_limits(path: Path | None = None) -> dict[str, Limit]:
    """Return the limits by case.

    Raises
    ------
    LimitError
        If a line is invalid; the message names it.
    """
    path, found = path or FILE, {}
    for name, fields in tomllib.loads(path.read_text(encoding="utf-8")).items():
        try:
            found[name] = Limit(**fields)
            is_right = 0.0 < found[name].measured < found[name].limit and found[name].reason
        except TypeError:
            is_right = False
        if not is_right:
            raise LimitError(
                f"{path.name}: [{name}] has {fields}, expected measured, a larger limit, and a reason"
            )
    return found


def is_known_machine() -> bool:
    """Return whether kernels and yardstick are compiled as when the limits were measured."""
    is_chosen = numba.config.CPU_NAME or numba.config.CPU_FEATURES or MODE not in ("v4", "jit")
    return not is_chosen and llvmlite.binding.get_host_cpu_name() == MEASURED_ON


def allowed_here(limits: dict[str, Limit]) -> dict[str, Limit]:
    """Return the limits for this machine."""
    factor = 1.0 if is_known_machine() else OTHER_MACHINE
    return {name: replace(limit, limit=factor * limit.limit) for name, limit in limits.items()}


def write_limits(limits: dict[str, Limit], path: Path | None = None) -> None:
    """Write the file; the comments at its head stay."""
    path = path or FILE
    old = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    head = [line for line in old if line.startswith("#")]
    blocks = [
        f"[{name}]\nmeasured = {limit.measured:.3g}\nlimit = {limit.limit:.3g}\n"
        f"reason = {json.dumps(limit.reason, ensure_ascii=False)}\n"
        for name, limit in limits.items()
    ]
    path.write_text("\n".join(["\n".join(head), *blocks]), encoding="utf-8")


def judge(ratios: dict[str, float], limits: dict[str, Limit]) -> list[GateVerdict]:
    """Compare measured ratios with the limits.

    Raises
    ------
    LimitError
        If a case has no limit.
    """
    for name in ratios:
        if name not in limits:
            raise LimitError(
                f'{FILE.name} has no limit for {name}: python bench/gate.py --update {name} --reason "new"'
            )
    return [GateVerdict(name, ratio, limits[name]) for name, ratio in ratios.items()]


def new_limit(ratio: float, reason: str) -> Limit:
    """Return a limit from a new ratio."""
    assert math.isfinite(ratio), "a ratio that was measured is a number"
    today = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d")
    return Limit(float(f"{ratio:.3g}"), float(f"{MARGIN * ratio:.3g}"), f"{today}: {reason}")
