"""The report for people: one HTML file that opens anywhere, without anything from outside."""

from collections.abc import Iterable
from html import escape
from typing import Any

import numpy as np

from proximity.certificate import wording
from proximity.certificate.report import plots
from proximity.certificate.wording import microseconds, percent, three

STYLE = """
:root { color-scheme: light dark; --ink: #1a1a1a; --paper: #fdfdfc; --faint: #dddddd; --dim: #666666;
  --good: #0a6b4b; --bad: #b03a00; --panel: #f3f3f0; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e3; --paper: #161616; --faint: #3a3a3a;
  --dim: #a0a0a0; --good: #4fc79c; --bad: #ff9a62; --panel: #202020; } }
body { color: var(--ink); background: var(--paper); font: 15px/1.5 system-ui, sans-serif; max-width: 66rem;
  margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; } h2 { font-size: 1.1rem; margin: 2.2rem 0 .4rem; }
p { margin: .4rem 0; } .dim, small { color: var(--dim); } small { white-space: nowrap; }
.verdict { border-left: .4rem solid var(--good); background: var(--panel); padding: .7rem 1rem;
  margin: 1rem 0; } .verdict b { color: var(--good); }
.verdict.bad { border-color: var(--bad); } .verdict.bad b { color: var(--bad); }
.wide { overflow-x: auto; } table { border-collapse: collapse; font-size: .88rem; margin: .5rem 0; }
th, td { text-align: right; padding: .25rem .6rem; border-bottom: 1px solid var(--faint);
  font-variant-numeric: tabular-nums; vertical-align: top; } th { font-weight: 600; }
th:first-child, td:first-child { text-align: left; padding-left: 0;
  white-space: nowrap; } td.over { color: var(--bad); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: .1rem 1rem; font-size: .88rem;
  margin: 1rem 0; }
dt { color: var(--dim); } dd { margin: 0; overflow-wrap: anywhere; } svg { width: 100%; height: auto; }
figure { margin: .8rem 0; } figcaption { font-size: .85rem; color: var(--dim); }
"""
TIMES_NOTE = """<p class="dim">Computing is the processor's time for the thread; wall time holds what
others took as well. Best: of each tick the shortest of three runs that are the same. Work: nodes and
leaves of all fingers in the dearest tick. * To compare with: without a budget, as no service ticks.</p>"""
SHARES_NOTE = """<p class="dim">Share of the period at p50 · p99 · p99.9 · max, and how many ticks in a
million took longer; in brackets what the true rate does not exceed with 95 % certainty, were ticks
independent.</p>"""
PLACES_NOTE = """<p class="dim">Work: nodes and leaves for one finger. The bracket is certified: the true
signed distance of the fingertip lies in it. A search, not a proof: within the budget, the budget bounds
the worst.</p>"""
FEELING_NOTE = """<p class="dim">A simulated wall is entered by speed × delay before it answers; the force
at rest is too high by k·x, equation (10) of the paper (0.8 N would be right), and the work by equation
(15). The delay is at worst a period until the touch is noticed, then late waking and computing, p99.9 of
each; where that is longer than a period, ticks are left out. A drum that stands before the touch has none
of this; it needs its distances in time.</p>"""
METHOD = """<h2>How it was measured</h2><p>Every tick was timed on its own, one thread, without pauses
between ticks: <i>recording</i> and <i>random</i> motion, then all fingers at the worst places: at rest,
passing through, and anew, as if each tick were the first{fed}. The service's own loop ran {ran} with fingers
that pass through the worst places; caches are colder there, and a frame is made and published. A scene
fits a period if the computing of 99.9 % of the ticks of every motion, of three runs the best, takes no
longer, and that of half of the loop's ticks. Interruptions and late waking are the machine's.</p> <p>What
the system gave the loop:</p><ul>{given}</ul>"""
HASH_DIGITS = 16  # shown in the title


def page(reported: dict[str, Any], surface: np.ndarray) -> str:
    """Return the report.

    Parameters
    ----------
    reported : dict
        See `document`.
    surface : (K, 3) float64, m
        Points of the surface, for the picture of the worst places.

    Raises
    ------
    DecaffError
        If matplotlib is not there; it says what to install.
    """
    name = escape(reported["scene"]["files"][0] if reported["scene"]["files"] else "scene")
    parts = [
        f"<h1>Latency certificate: {name}</h1>",
        f'<p class="dim">scene {reported["scene"]["sha256"][:HASH_DIGITS]} · '
        f"{reported['machine']['date']}</p>",
        _verdict(reported),
        _facts(reported),
        _times(reported, plots.draw_tails(reported)),
        _shares(reported),
        _places(reported, plots.draw_places(reported, surface)),
        _feeling(reported, plots.draw_feeling(reported)),
        _method(reported),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>Latency certificate: {name}</title><style>{STYLE}</style></head>\n<body>\n"
        + "\n".join(parts)
        + "\n</body></html>\n"
    )


def _verdict(reported: dict[str, Any]) -> str:
    verdict, loop = reported["verdict"], reported["loop"]
    word, kind = ("Fits", "verdict") if verdict["fits"] else ("Does not fit", "verdict bad")
    sentence = verdict["sentence"]
    woken = microseconds(loop["lateness"]["p99"])
    return (
        f'<div class="{kind}"><b>{word}.</b> {escape(sentence[0].upper() + sentence[1:])}.'
        f"<br>The loop was woken late by p50 {microseconds(loop['lateness']['p50'])}, p99 {woken} µs; "
        f"deadlines missed at {three(1e3 * loop['period_s'])} ms: {wording.missed(loop)}.</div>"
    )


def _facts(reported: dict[str, Any]) -> str:
    scene, machine, settings = reported["scene"], reported["machine"], reported["settings"]
    size = (np.array(scene["bounds"][1]) - scene["bounds"][0]) * 1e3
    facts = {
        "files": ", ".join(scene["files"]),
        "SHA-256 of the content": scene["sha256"],
        "scene": f"{wording.counted(scene['parts'], 'part')}, {wording.counted(scene['faces'], 'face')}, "
        f"{' × '.join(three(value) for value in size)} mm",
        "ticks": f"{settings['fingers']} fingers, budget {settings['budget']} nodes and leaves each, "
        f"working range {three(1e3 * settings['working_range_m'])} mm, seed {settings['seed']}",
        "machine": f"{machine['processor']}, {machine['cores']} cores, {machine['system']}; "
        f"load {', '.join(f'{load:g}' for load in machine['load'])}",
        "versions": ", ".join(f"{name} {version}" for name, version in reported["versions"].items()),
    }
    return (
        "<dl>" + "".join(f"<dt>{key}</dt><dd>{escape(value)}</dd>" for key, value in facts.items()) + "</dl>"
    )


def _times(reported: dict[str, Any], picture: str) -> str:
    rows = [
        [
            case["name"] + ("" if case["counts"] else " *"),
            str(case["ticks"]),
            str(case["most_work"]),
            *(microseconds(case["compute"][key]) for key in wording.WORDS),
            *(microseconds(case["wall"][key]) for key in ("p999", "max")),
            microseconds(case["best"]["p999"]) if case["counts"] else "",
        ]
        for case in reported["cases"]
    ]
    loop = reported["loop"]
    for name, kind in (("service: computing", "compute"), ("service: woken late", "lateness")):
        rows.append(
            [
                name,
                str(loop["ticks"]),
                "",
                *(microseconds(loop[kind][key]) for key in wording.WORDS),
                "",
                "",
                "",
            ]
        )
    heads = ["µs", "ticks", "most work", *wording.WORDS.values(), "wall p99.9", "wall max", "best p99.9"]
    return (
        "<h2>What a tick takes</h2>"
        + _table(heads, rows)
        + TIMES_NOTE
        + _figure(picture, "Share of ticks that took longer; dotted: the periods.")
    )


def _shares(reported: dict[str, Any]) -> str:
    rows = [(case["name"] + ("" if case["counts"] else " *"), case["periods"]) for case in reported["cases"]]
    rows += [
        ("service: computing", reported["loop"]["compute"]["periods"]),
        ("service: woken late", reported["loop"]["lateness"]["periods"]),
    ]
    heads = ["%, missed"] + [
        f"{1e3 * row['period_s']:g} ms<br><small>{escape(row['source'])}</small>" for row in rows[0][1]
    ]
    body = "".join(
        f"<tr><td>{escape(name)}</td>" + "".join(map(_share, periods)) + "</tr>" for name, periods in rows
    )
    head = "".join(f"<th>{each}</th>" for each in heads)
    return (
        "<h2>Against the period</h2>"
        f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'
        + SHARES_NOTE
    )


def _share(row: dict[str, Any]) -> str:
    shares = " · ".join(percent(row["share"][key]) for key in wording.WORDS)
    kind = ' class="over"' if row["missed"] else ""
    return f"<td{kind}>{shares}<br><small>{escape(wording.missed(row, ''))}</small></td>"


def _places(reported: dict[str, Any], picture: str) -> str:
    rows = []
    for goal in reported["search"]:
        worst = goal["places"][0]
        typical = goal["typical_work"]
        rows.append(
            [
                wording.goal(goal),
                str(worst["work"]),
                wording.UNKNOWN if typical is None or typical != typical else f"{typical:.0f}",
                " ".join(wording.millimetres(value) for value in worst["position"]),
                f"{1e3 * worst['lower']:.3f} to {1e3 * worst['upper']:.3f}",
                f"{1e3 * worst['width']:.3f}",
                worst["origin"] + ("" if goal["is_complete"] else " (cut short)"),
            ]
        )
    heads = ["finger", "work", "at random", "place, mm", "distance, mm", "bracket, mm", "found from"]
    return (
        "<h2>The worst places that were found</h2>"
        + _table(heads, rows)
        + PLACES_NOTE
        + _figure(picture, "The surface as dots, seen along z and along y.")
    )


def _feeling(reported: dict[str, Any], picture: str) -> str:
    rows = []
    for row in reported["feeling"]:
        name = row["source"] if row["period_s"] is None else f"{1e3 * row['period_s']:g} ms: {row['source']}"
        cells = [
            f"{three(1e3 * felt['penetration'])} mm, {three(felt['force_error'])} N, "
            f"{three(1e3 * felt['energy_error'])} mJ"
            for felt in row["speeds"]
        ]
        rows.append([name, three(1e3 * row["delay_s"]), *cells])
    heads = ["period", "delay, ms", *(f"{felt['speed']:g} m/s" for felt in reported["feeling"][0]["speeds"])]
    return (
        "<h2>What that means at the finger</h2>"
        + _table(heads, rows)
        + FEELING_NOTE
        + _figure(picture, "Dots: the rows of the table.")
    )


def _method(reported: dict[str, Any]) -> str:
    loop, notes = reported["loop"], reported["loop"]["notes"] or ["nothing was asked for"]
    given = "".join(f"<li>{escape(note)}</li>" for note in notes)
    ran = f"{three(reported['settings']['loop_s'])} s at {three(1e3 * loop['period_s'])} ms"
    return METHOD.format(ran=ran, given=given, fed=wording.fed(reported["settings"]))


def _table(heads: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = "".join(f"<th>{escape(each)}</th>" for each in heads)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _figure(picture: str, caption: str) -> str:
    return f"<figure>{picture}<figcaption>{escape(caption)}</figcaption></figure>"
