"""The terminal report of ``proximity bench``: a latency certificate."""

import sys
from typing import Any

from rich.table import Table

from proximity.cli.output import counted, print_block, printable
from proximity.cli.tables import results_console, table
from proximity.lab.certificate import wording
from proximity.lab.certificate.wording import microseconds, percent
from proximity.lab.paper.walls import FINGER

HASH_DIGITS = 16


def write(reported: dict[str, Any]) -> None:
    """Write the certificate to stdout: scene, worst positions, times against periods, the verdict."""
    console, scene, settings = results_console(), reported["scene"], reported["settings"]
    machine, loop, felt = reported["machine"], reported["loop"], reported["feeling"][-1]
    names, speed = ", ".join(map(printable, scene["files"])), felt["speeds"][0]
    counts = f"{counted(scene['parts'], 'part')}, {counted(scene['faces'], 'face')}"
    walks = f"{counted(settings['fingers'], 'finger')}, budget {settings['budget']} nodes and leaves"
    print_block(
        [
            ("scene", f"{names}: {counts}"),
            ("content", scene["sha256"][:HASH_DIGITS]),
            ("ticks", f"{walks}, seed {settings['seed']}{wording.fed(settings)}"),
            ("machine", f"{machine['processor']}, {counted(machine['cores'], 'core')}"),
        ]
    )
    for shown in (_positions(reported["search"]), _times(reported)):
        console.print()
        console.print(shown)
    console.print()
    deadlines = f"{loop['missed']} of {loop['ticks'] + loop['missed']} missed by the loop"
    penetration, force, work = (
        wording.two(1e3 * speed[key]) for key in ("penetration", "force_error", "energy_error")
    )
    print_block(
        [
            ("deadlines", f"{deadlines} at {1e3 * loop['period_s']:g} ms: {wording.missed(loop)}"),
            (
                "at the finger",
                f"{wording.three(1e3 * felt['delay_s'])} ms of computing and waking (their p99.9 added). A "
                f"drum: exact at a part at rest, and {penetration} mm off at one that moves by "
                f"{speed['speed']:g} m/s, unless frames have its velocity. A wall coupled by spring and "
                f"damper: a fingertip of {FINGER.stiffness:g} N/m at {speed['speed']:g} m/s enters it by "
                f"{penetration} mm, its force is {force} mN and its work {work} mJ too large",
            ),
            ("scene verdict", reported["verdict"]["sentence"]),
            ("machine verdict", reported["machine_verdict"]["sentence"]),
        ]
    )
    sys.stdout.flush()


def _positions(goals: list[dict[str, Any]]) -> Table:
    rows = []
    for goal in goals:
        worst = goal["places"][0]
        coordinates = map(wording.millimetres, worst["position"])
        typical = goal["typical_work"]
        shown = wording.UNKNOWN if typical != typical else f"{typical:.0f}"
        bounds = f"{1e3 * worst['lower']:.3f} to {1e3 * worst['upper']:.3f}"
        rows.append([wording.goal(goal), str(worst["work"]), shown, *coordinates, bounds])
    titles = ("work [nodes]", "at random", "x [mm]", "y [mm]", "z [mm]", "distance between [mm]")
    return table(["worst finger position"], titles, rows)


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
