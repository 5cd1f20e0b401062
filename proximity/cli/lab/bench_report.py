"""The terminal report of ``proximity bench``: a latency certificate."""

import sys
from typing import Any

from rich.table import Table

from proximity.cli.output import block, print_block, printable
from proximity.cli.tables import results_console, table
from proximity.lab.certificate import wording
from proximity.lab.certificate.wording import microseconds, percent

HASH_DIGITS = 16
SCENE = (
    ("scene", "{names}: {scene.parts:1/part}, {scene.faces:1/face}"),
    ("content", f"{{scene.sha256:.{HASH_DIGITS}}}"),
    (
        "ticks",
        "{settings.fingers:1/finger}, budget {settings.budget} nodes and leaves, seed {settings.seed}{fed}",
    ),
    ("machine", "{machine.processor}, {machine.cores:1/core}"),
)
VERDICTS = (
    ("deadlines", "{loop.missed} of {all} missed by the loop at {period_ms:g} ms: {missed}"),
    (
        "at the finger",
        "{delay_ms} ms of computing and waking: a finger at {speed.speed:g} m/s enters a wall by "
        "{penetration_mm} mm, its force is {force_mn} mN and its work {work_mj} mJ too large",
    ),
    ("scene verdict", "{verdict.sentence}"),
    ("machine verdict", "{machine_verdict.sentence}"),
)


def write(reported: dict[str, Any]) -> None:
    """Write the certificate to stdout: scene, worst positions, times against periods, the verdict."""
    console = results_console()
    names = ", ".join(map(printable, reported["scene"]["files"]))
    print_block(block(SCENE, reported | {"names": names, "fed": wording.fed(reported["settings"])}))
    for shown in (_positions(reported["search"]), _times(reported)):
        console.print()
        console.print(shown)
    console.print()
    loop, felt = reported["loop"], reported["feeling"][-1]
    speed = felt["speeds"][0]
    values = {
        "all": loop["ticks"] + loop["missed"],
        "period_ms": 1e3 * loop["period_s"],
        "missed": wording.missed(loop),
        "delay_ms": wording.three(1e3 * felt["delay_s"]),
        "speed": speed,
        "penetration_mm": wording.two(1e3 * speed["penetration"]),
        "force_mn": wording.two(1e3 * speed["force_error"]),
        "work_mj": wording.two(1e3 * speed["energy_error"]),
    }
    print_block(block(VERDICTS, reported | values))
    sys.stdout.flush()


def _positions(goals: list[dict[str, Any]]) -> Table:
    rows = table(["worst finger position"], ("work", "at random", "x", "y", "z", "bracket [mm]"))
    for goal in goals:
        worst = goal["places"][0]
        coordinates = map(wording.millimetres, worst["position"])
        typical = goal["typical_work"]
        shown = wording.UNKNOWN if typical != typical else f"{typical:.0f}"
        bracket = f"{1e3 * worst['lower']:.3f} to {1e3 * worst['upper']:.3f}"
        rows.add_row(wording.goal(goal), str(worst["work"]), shown, *coordinates, bracket)
    return rows


def _times(reported: dict[str, Any]) -> Table:
    periods = reported["cases"][0]["periods"]
    shares = (f"{1e3 * row['period_s']:g} ms" for row in periods)
    rows = table(["computing [µs]; p99.9 in % of"], (*wording.WORDS.values(), *shares))
    cases = [
        (case["name"] + ("" if case["counts"] else " (no budget)"), case["compute"], case["periods"])
        for case in reported["cases"]
    ]
    for name, kind in (("service: computing", "compute"), ("service: woken late", "lateness")):
        cases.append((name, reported["loop"][kind], reported["loop"][kind]["periods"]))
    for name, times, periods in cases:
        shares = (percent(row["share"]["p999"]) for row in periods)
        rows.add_row(name, *(microseconds(times[key]) for key in wording.WORDS), *shares)
    return rows
