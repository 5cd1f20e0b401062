"""Report of ``proximity bench`` for the terminal."""

import sys
from typing import Any

from rich.table import Table

from proximity.cli.output import counted, print_block, printable
from proximity.cli.tables import results_console, table
from proximity.lab.certificate.report import goal_words
from proximity.lab.certificate.times import UNKNOWN, microseconds, percent
from proximity.lab.paper.walls import FINGER

HASH_DIGITS = 16
WORDS = {"p50": "p50", "p99": "p99", "p999": "p99.9", "max": "max"}


def write(reported: dict[str, Any]) -> None:
    """Write the report to stdout, with the scene, worst positions, times and the verdict."""
    console, scene, settings = results_console(), reported["scene"], reported["settings"]
    machine, felt = reported["machine"], reported["at_the_finger"]
    names, speed = ", ".join(map(printable, scene["files"])), felt["speeds"][0]
    counts = f"{counted(scene['parts'], 'part')}, {counted(scene['faces'], 'face')}"
    walks = f"{counted(settings['fingers'], 'finger')}, budget {settings['budget']} nodes and leaves"
    missing = ", ".join(settings["not_measured"])
    print_block(
        [
            ("scene", f"{names}: {counts}"),
            ("content", scene["sha256"][:HASH_DIGITS]),
            ("ticks", f"{walks}, seed {settings['seed']}"),
            *(
                [("not measured", f"{missing}, which make ticks of this scene file longer")]
                if missing
                else []
            ),
            ("machine", f"{machine['processor']}, {counted(machine['cores'], 'core')}"),
        ]
    )
    for shown in (_positions(reported["search"]), _times(reported)):
        console.print()
        console.print(shown)
    console.print()
    penetration, force, work = (
        f"{float(f'{1e3 * speed[key]:.2g}'):g}" for key in ("penetration", "force_error", "energy_error")
    )
    print_block(
        [
            (
                "at the finger",
                f"{1e3 * felt['delay_s']:.3g} ms of computing and waking (their p99.9 added). A "
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
        coordinates = (f"{round(1e3 * metres, 2) + 0.0:.2f}" for metres in worst["position"])
        typical = goal["typical_work"]
        shown = UNKNOWN if typical != typical else f"{typical:.0f}"
        bounds = f"{1e3 * worst['lower']:.3f} to {1e3 * worst['upper']:.3f}"
        rows.append([goal_words(goal), str(worst["work"]), shown, *coordinates, bounds])
    titles = ("work [nodes]", "at random", "x [mm]", "y [mm]", "z [mm]", "distance between [mm]")
    return table(["worst finger position"], titles, rows)


def _times(reported: dict[str, Any]) -> Table:
    period, loop = reported["verdict"]["period_s"], reported["loop"]
    rows = table(["computing [µs]"], (*WORDS.values(), f"p99.9 of {1e3 * period:g} ms", "ticks over"))
    cases = [
        (case["name"] + ("" if case["counts"] else " (no budget)"), case["compute"])
        for case in reported["cases"]
    ]
    cases += [("service: computing", loop["compute"]), ("service: woken late", loop["lateness"])]
    for name, times in cases:
        share = None if times["p999"] is None else 1e-9 * times["p999"] / period
        shown = (microseconds(times[key]) for key in WORDS)
        rows.add_row(name, *shown, f"{percent(share)} %", str(times["over_period"]))
    return rows
