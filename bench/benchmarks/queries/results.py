"""Rows of the comparison with other libraries, and the requirements on them."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.queries.agreement import OURS, Agreement
from benchmarks.support.interleaving import Samples
from benchmarks.support.verdicts import Verdict

OUR_TREE = "proximity (tree alone)"
POINTS, SIGNED, FIVE_SIGNED = "points, unsigned", "points, signed", "five points, signed"
RAYS, FIVE_RAYS = "rays", "five rays"
BUILD, PROCESS = "build", "command line"
MAX_BYTES_PER_FACE = 300.0


@dataclass(frozen=True, slots=True)
class Row:
    """One contender in one section of one case."""

    section: str
    case: str
    contender: str
    version: str
    unit: str  # of the four times: "µs a query", "µs a call", "ms", "s"
    median: float
    minimum: float
    p99: float
    maximum: float
    call_count: int
    times_ours: float | None = None  # its time divided by ours, median over paired rounds
    beside: str = OURS  # the row of ours by which it was divided
    agreement: Agreement | None = None
    bytes_per_face: float | None = None


@dataclass(frozen=True, slots=True)
class Requirement:
    """Minimum of a rival's time divided by ours, for the fastest of the named ones."""

    section: str
    text: str
    least: float
    rivals: tuple[str, ...]  # prefixes of their names


REQUIREMENTS = (
    Requirement(POINTS, "3 times the best of FCPW, Open3D and Warp", 3.0, ("FCPW", "Open3D", "Warp")),
    Requirement(SIGNED, "4 times the best of FCPW, Open3D and Warp", 4.0, ("FCPW", "Open3D", "Warp")),
    Requirement(FIVE_SIGNED, "0.4 of the time of the fastest", 1 / 0.4, ("FCPW", "Open3D", "Warp")),
    Requirement(RAYS, "as fast as embreex", 1.0, ("embreex",)),
    Requirement(FIVE_RAYS, "half the time of embreex", 2.0, ("embreex",)),
    Requirement(BUILD, "at most 1.5 times FCPW's build", 1 / 1.5, ("FCPW",)),
)
PROCESS_SECONDS = {"--version": 0.3, "--help": 0.3, "query": 2.0}


def make_row(
    section: str, case: str, contender: str, version: str, unit: str, samples: Samples, **extra: Any
) -> Row:
    """Return the row of *samples*, whose times are already in *unit*."""
    return Row(
        section,
        case,
        contender,
        version,
        unit,
        median=samples.median,
        minimum=float(samples.calls.min()),
        p99=float(np.percentile(samples.calls, 99)),
        maximum=float(samples.calls.max()),
        call_count=len(samples.calls),
        **extra,
    )


def judge(rows: list[Row]) -> list[Verdict]:
    """Compare the rows with the requirements; none if this package was not measured."""
    verdicts = [
        verdict
        for requirement in REQUIREMENTS
        for case in dict.fromkeys(row.case for row in rows if row.section == requirement.section)
        for verdict in _verdicts(requirement, case, rows)
    ]
    for row in rows:
        if row.section == BUILD and row.bytes_per_face is not None:
            verdicts.append(
                Verdict(
                    f"memory, {row.case}: at most {MAX_BYTES_PER_FACE:g} bytes a face",
                    f"{row.bytes_per_face:.0f}",
                    row.bytes_per_face <= MAX_BYTES_PER_FACE,
                )
            )
        if row.section == PROCESS:
            bound = next(seconds for word, seconds in PROCESS_SECONDS.items() if word in row.case)
            verdicts.append(Verdict(f"{row.case}: {bound:g} s", f"{row.median:.2f} s", row.median <= bound))
    return verdicts


def _verdicts(requirement, case, rows):
    rivals = [
        row
        for row in rows
        if (row.section, row.case) == (requirement.section, case)
        and row.contender.startswith(requirement.rivals)
        and row.times_ours is not None
    ]
    ours = (requirement.section, case, OURS)
    is_measured = any((row.section, row.case, row.contender) == ours for row in rows)
    if not rivals or not is_measured:
        return []
    best = min(rivals, key=lambda row: row.median)
    wrong_count = best.agreement.wrong_sign_count if best.agreement else 0
    remark = f" ({wrong_count} of its signs are wrong)" if wrong_count else ""
    return [
        Verdict(
            f"{requirement.section}, {case}: {requirement.text}",
            f"{best.times_ours:.2f} times as fast as {best.contender}{remark}",
            best.times_ours >= requirement.least,
        )
    ]
