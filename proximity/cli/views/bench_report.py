"""The terminal report of a latency certificate."""

import sys
from typing import Any

from rich.table import Table

from proximity.cli.console import Lines, print_block, results_console, table
from proximity.cli.wording import printable
from proximity.lab.certificate import wording
from proximity.lab.certificate.wording import microseconds, percent

HASH_DIGITS = 16


def write(reported: dict[str, Any]) -> None:
    """Write the certificate to stdout: scene, worst positions, times against periods, the verdict."""
    console = results_console()
    print_block(console, _scene(reported))
    console.print()
    console.print(_positions(reported["search"]))
    console.print()
    console.print(_times(reported))
    console.print()
    print_block(console, _ends(reported))
    sys.stdout.flush()


def _scene(reported: dict[str, Any]) -> Lines:
    scene, settings, machine = reported["scene"], reported["settings"], reported["machine"]
    files = ", ".join(map(printable, scene["files"]))
    return [
        (
            "scene",
            f"{files}: {wording.counted(scene['parts'], 'part')}, {wording.counted(scene['faces'], 'face')}",
        ),
        ("content", scene["sha256"][:HASH_DIGITS]),
        (
            "ticks",
            f"{wording.counted(settings['fingers'], 'finger')}, budget {settings['budget']} nodes and "
            f"leaves, seed {settings['seed']}{wording.fed(settings)}",
        ),
        ("machine", f"{machine['processor']}, {wording.counted(machine['cores'], 'core')}"),
    ]


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
    for case in reported["cases"]:
        name = case["name"] + ("" if case["counts"] else " (no budget)")
        _add(rows, name, case["compute"], case["periods"])
    for name, kind in (("service: computing", "compute"), ("service: woken late", "lateness")):
        counted = reported["loop"][kind]
        _add(rows, name, counted, counted["periods"])
    return rows


def _add(rows: Table, name: str, times: dict[str, Any], periods: list[dict[str, Any]]) -> None:
    shares = (percent(row["share"]["p999"]) for row in periods)
    rows.add_row(name, *(microseconds(times[key]) for key in wording.WORDS), *shares)


def _ends(reported: dict[str, Any]) -> Lines:
    loop, felt = reported["loop"], reported["feeling"][-1]
    speed = felt["speeds"][0]
    return [
        (
            "deadlines",
            f"{loop['missed']} of {loop['ticks'] + loop['missed']} missed by the loop at "
            f"{1e3 * loop['period_s']:g} ms: {wording.missed(loop)}",
        ),
        (
            "at the finger",
            f"{wording.three(1e3 * felt['delay_s'])} ms of computing and waking: "
            f"a finger at {speed['speed']:g} m/s enters a wall by "
            f"{wording.two(1e3 * speed['penetration'])} mm, its force is "
            f"{wording.two(1e3 * speed['force_error'])} mN and its work "
            f"{wording.two(1e3 * speed['energy_error'])} mJ too large",
        ),
        ("scene verdict", reported["verdict"]["sentence"]),
        ("machine verdict", reported["machine_verdict"]["sentence"]),
    ]
