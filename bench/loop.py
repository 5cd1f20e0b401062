"""Measure the loop of a service on this machine: ``python bench/loop.py [--realtime] [--busy]``.

A pose of five fingers above a part is published at instants unrelated to ticks, and the publisher polls
without pause for the frame of that pose. Times are in µs; *published* and *seen* count from the pose.
``--recording``: poses are played from one, and both count from the start of a tick. ``--moving``: the part
moves with each pose. ``--sensor``: measured distances replace poses. ``--busy``: with another process that
computes all the time; ``--thread``: with such a Python thread in the service's process; ``--rate HZ``: of
ticks. ``--csv FILE`` appends their lateness, ``--plot FILE`` draws such a file.
"""

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from proximity import MEASURED, MOVES, POSES, Message
from proximity.lab.figures.style import LOOK
from proximity.message import FRAME
from proximity.service.hosting import serve
from proximity.transport import open_inlet, open_publisher
from proximity.transport.link import NOTHING

SCENE = """\
[service]
rate_hz = {rate}
publish = ["{frames}"]
real_time = {real_time}
{parts}[fingers]
count = 5
[input]
{input}
"""
RECORDING = f'recording = "{ROOT / "meshes" / "hand.csv"}"\nrepeat = true'
ABOVE = np.linspace([0.05, 0.03, 0.07], [0.07, 0.03, 0.07], 5)
COLOURS = {"python": "#D55E00", "compiled": "#0072B2"}  # Okabe and Ito
LINES = {"alone": "-", "busy process": "--", "busy thread": ":"}
Delays = tuple[float, float]
INSTANTS = {POSES: "pose_ns", MEASURED: "measured_ns"}
SPIN = "while True: pass"
POSE_NS_AT, START_NS_AT, PUBLISH_NS_AT = 96 + 8, 40, 48
"""Offsets in a frame: in the first contact, and in the header."""
FRAME_MAGIC = FRAME.magic.to_bytes(4, "little")


def child(path: str, *, has_thread: bool) -> None:
    """Serve a file in this process, and write the report at the end of standard input."""
    stop = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), stop.set()), daemon=True).start()
    if has_thread:
        threading.Thread(target=exec, args=(SPIN, {}), daemon=True).start()
    began: list[float] = []

    def begun(_: object) -> None:
        began[:] = time.process_time(), time.monotonic()
        print("begun", flush=True)

    report = serve(path, stop=stop, begun=begun)
    share = (time.process_time() - began[0]) / (time.monotonic() - began[1])
    print(json.dumps({**report.as_dict(), "cpu": share}), flush=True)


def seen_after(publisher, mover, inlet, message, seconds: float, rng) -> list[Delays]:
    """Publish poses for a time; return the delays, µs, until a frame of each was published, and seen."""
    data, taken, ends = np.zeros(1 << 16, np.uint8), [], time.monotonic() + seconds
    move = Message(MOVES, 1)
    move.records["name"], move.records["rotation"], move.records["angular_velocity"] = (
        b"bracket",
        np.eye(3),
        0.0,
    )
    of_frame, published = (data[at : at + 8].view("<i8") for at in (POSE_NS_AT, PUBLISH_NS_AT))
    while time.monotonic() < ends:
        pose_ns = time.monotonic_ns()
        message.header["send_ns"] = message.records[INSTANTS[message.kind]] = pose_ns
        if message.kind is POSES:
            message.records["position"] = ABOVE + 0.01 * np.sin(1e-9 * pose_ns) * np.eye(3)[2]
        else:
            message.records["signed_distance"] = 0.05 + 0.01 * np.sin(1e-9 * pose_ns)
        if mover is not None:
            move.header["send_ns"] = move.records["pose_ns"] = pose_ns
            move.records["translation"] = 0.001 * np.sin(3e-9 * pose_ns) * np.eye(3)[0]
            move.records["velocity"] = 0.003 * np.cos(3e-9 * pose_ns) * np.eye(3)[0]
            mover.publish(move)
        publisher.publish(message)
        while time.monotonic_ns() < pose_ns + 50_000_000:
            if inlet.receive(data) != NOTHING and int(of_frame[0]) == pose_ns:
                taken.append((1e-3 * (int(published[0]) - pose_ns), 1e-3 * (time.monotonic_ns() - pose_ns)))
                break
        time.sleep(rng.uniform(0.0005, 0.0015))
    return taken


def seen_frames(inlet, seconds: float) -> list[Delays]:
    """Return the delays, µs, from the start of its tick until each frame was published, and seen."""
    data, taken, ends = np.zeros(1 << 16, np.uint8), [], time.monotonic() + seconds
    started, published = (data[at : at + 8].view("<i8") for at in (START_NS_AT, PUBLISH_NS_AT))
    while time.monotonic() < ends:
        if inlet.receive(data) != NOTHING and data[:4].tobytes() == FRAME_MAGIC:
            start_ns = int(started[0])
            taken.append((1e-3 * (int(published[0]) - start_ns), 1e-3 * (time.monotonic_ns() - start_ns)))
    return taken


def measured(options: argparse.Namespace, folder: str) -> tuple[dict, list[Delays]]:
    """Return the report of one run, and delays from pose to frame."""
    name = f"shm://bench-{os.getpid()}-{time.time_ns()}"
    path = Path(folder, "scene.toml")
    kind, key = (MEASURED, "sensor") if options.sensor else (POSES, "poses")
    source = RECORDING if options.recording else f'{key} = "{name}-poses"'
    source += f'\nmoves = "{name}-moves"' * options.moving
    parts = "" if options.sensor else f'[[parts]]\nfile = "{ROOT / "meshes" / "bracket.stl"}"\n'
    values = {"frames": name, "input": source, "parts": parts}
    text = SCENE.format(rate=options.rate, real_time=str(options.realtime).lower(), **values)
    path.write_text(text, encoding="utf-8")
    command = [sys.executable, __file__, "--child", str(path)] + ["--thread"] * options.thread
    service = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert service.stdout is not None and service.stdin is not None
    assert service.stdout.readline() == "begun\n"
    message = Message(kind, len(ABOVE))
    message.records["finger"] = np.arange(len(ABOVE))
    with open_publisher(f"{name}-poses") as publisher, open_publisher(f"{name}-moves") as mover:
        inlet, rng = open_inlet(name), np.random.default_rng(0)
        if options.recording:
            delays = seen_frames(inlet, options.seconds)
        else:
            moves = mover if options.moving else None
            delays = seen_after(publisher, moves, inlet, message, options.seconds, rng)
        print("stop", file=service.stdin, flush=True)
        report = json.loads(service.stdout.readline())
    service.wait()
    return report, delays


def main() -> None:
    """Measure and print, or draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("seconds", 20.0), ("rate", 1000.0)):
        parser.add_argument(f"--{name}", type=float, default=default)
    for switch in ("realtime", "busy", "thread", "recording", "moving", "sensor"):
        parser.add_argument(f"--{switch}", action="store_true")
    for name in ("csv", "plot"):
        parser.add_argument(f"--{name}", type=Path)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(options.child, has_thread=options.thread)
        return
    if options.plot:
        draw(options.csv or ROOT / "bench" / "published" / "lateness.csv", options.plot)
        return
    busy = [subprocess.Popen([sys.executable, "-c", SPIN])] if options.busy else []
    with tempfile.TemporaryDirectory() as folder:
        report, delays = measured(options, folder)
    for process in busy:
        process.kill()
    if options.csv:
        append(options.csv, options, report["lateness"]["rows"])
    print(f"load {os.getloadavg()[0]:.1f}; {os.cpu_count()} cores; {report['cpu']:.2f} of a core; µs")
    for name in ("compute", "lateness"):
        shares = ((share, 1e-3 * report[name][f"{share}_ns"]) for share in ("p50", "p99", "p999", "max"))
        print(f"{name:9}", ", ".join(f"{share} {late:.1f}" for share, late in shares))
    since = "beginning of the tick" if options.recording else "pose"
    for name, times in zip(("published", "seen"), np.transpose(delays), strict=True):
        p50, p99 = np.percentile(times, (50, 99))
        print(f"{name:9} p50 {p50:.0f}, p99 {p99:.0f} after the {since}")
    print(f"{report['missed']} of {report['missed'] + report['ticks']} ticks were missed")


COLUMNS = "loop,beside,priority,load,min_ns,max_ns,ticks"


def append(path: Path, options: argparse.Namespace, rows: list[tuple[int, int, int]]) -> None:
    """Append a row a bin: the load, and the number of ticks with a lateness."""
    beside = "busy process" if options.busy else "busy thread" if options.thread else "alone"
    priority = "real-time" if options.realtime else "ordinary"
    lines = [] if path.exists() else [COLUMNS]
    for row in rows:
        numbers = f"{os.getloadavg()[0]:.1f},{','.join(map(str, row))}"
        lines.append(f"compiled,{beside},{priority},{numbers}")
    with path.open("a", encoding="ascii") as file:
        file.write("".join(f"{line}\n" for line in lines))


def draw(source: Path, path: Path) -> None:
    """Draw the share of ticks that were woken later than a time, a panel for each priority."""
    with source.open(encoding="ascii") as file:
        rows = list(csv.DictReader(file))
    with matplotlib.rc_context(LOOK):
        figure = Figure((7.6, 3.1), layout="constrained")
        panels = figure.subplots(1, 2, sharey=True)
        for panel, priority in zip(panels, ("real-time", "ordinary"), strict=True):
            own = [row for row in rows if row["priority"] == priority]
            for key in dict.fromkeys((row["loop"], row["beside"]) for row in own):
                bins = [row for row in own if (row["loop"], row["beside"]) == key]
                late = np.array([1e-3 * float(row["max_ns"]) for row in bins])
                ticks = np.array([int(row["ticks"]) for row in bins])[np.argsort(late)]
                share = 1.0 - np.cumsum(ticks)[:-1] / ticks.sum()
                style = {"color": COLOURS[key[0]], "linestyle": LINES[key[1]]}
                label = f"{key[0]}, {key[1]}, load {bins[0]['load']}"
                panel.plot(np.sort(late)[:-1], share, label=label, linewidth=1.1, **style)
            panel.set(
                xscale="log",
                yscale="log",
                xlim=(5.0, 1e5),
                title=f"{priority} priority",
                xlabel="woken late, µs",
            )
            panel.axvline(1000.0, color="0.8", linewidth=0.8, zorder=0)
            panel.legend(fontsize=6.0, handlelength=2.4)
        panels[0].set_ylabel("share of ticks that are later")
        figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
