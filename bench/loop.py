"""Compare both loops of a service on this machine, in turns: ``python bench/loop.py [--rounds N] [--busy]``.

A pose of five fingers above a part is published at instants that have nothing to do with ticks, and who
published it looks without pause for the frame that has been made of it. Times are in µs; *published* and
*seen* count from the pose. ``--busy``: a
process beside that computes all the time; ``--thread``: a thread of Python in the service's process that
does; ``--rate HZ``: of ticks.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from proximity import POSES, Message
from proximity.service.hosting import serve
from proximity.service.report import Histogram
from proximity.transport import open_inlet, open_publisher
from proximity.transport.link import NOTHING

SCENE = """\
[service]
rate_hz = {rate}
publish = ["{frames}"]
real_time = {real_time}
loop = "{loop}"
[[parts]]
file = "{part}"
[fingers]
count = 5
[input]
poses = "{poses}"
"""
ABOVE = np.linspace([0.05, 0.03, 0.07], [0.07, 0.03, 0.07], 5)
Delays = tuple[float, float]
SPIN = "while True: pass"
POSE_NS_AT, PUBLISH_NS_AT = 96 + 8, 48
"""In a frame: of the first contact, and of the header."""


def child(path: str, *, has_thread: bool) -> None:
    """Serve a file in this process, and write the report at the end of standard input."""
    stop = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), stop.set()), daemon=True).start()
    if has_thread:
        threading.Thread(target=exec, args=(SPIN, {}), daemon=True).start()
    report = serve(path, stop=stop, begun=lambda _: print("begun", flush=True))
    print(json.dumps(report.as_dict()), flush=True)


def seen_after(publisher, inlet, message, seconds: float, rng) -> list[Delays]:
    """Publish poses for so long; after how many µs a frame of each was published, and seen."""
    data, taken, ends = np.zeros(1 << 16, np.uint8), [], time.monotonic() + seconds
    of_frame, published = (data[at : at + 8].view("<i8") for at in (POSE_NS_AT, PUBLISH_NS_AT))
    while time.monotonic() < ends:
        pose_ns = time.monotonic_ns()
        message.records["pose_ns"] = message.header["send_ns"] = pose_ns
        message.records["position"] = ABOVE + 0.01 * np.sin(1e-9 * pose_ns) * np.eye(3)[2]
        publisher.publish(message)
        while time.monotonic_ns() < pose_ns + 50_000_000:
            if inlet.receive(data) != NOTHING and int(of_frame[0]) == pose_ns:
                taken.append((1e-3 * (int(published[0]) - pose_ns), 1e-3 * (time.monotonic_ns() - pose_ns)))
                break
        time.sleep(rng.uniform(0.0005, 0.0015))
    return taken


def measured(loop: str, options: argparse.Namespace, folder: str) -> tuple[dict, list[Delays]]:
    """Report of one run, and delays from pose to frame."""
    name = f"shm://bench-{os.getpid()}-{time.time_ns()}"
    path = Path(folder, f"{loop}.toml")
    addresses = {"frames": name, "poses": f"{name}-poses", "part": ROOT / "meshes" / "bracket.stl"}
    text = SCENE.format(rate=options.rate, loop=loop, real_time=str(options.realtime).lower(), **addresses)
    path.write_text(text, encoding="utf-8")
    command = [sys.executable, __file__, "--child", str(path)] + ["--thread"] * options.thread
    service = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert service.stdout is not None and service.stdin is not None
    assert service.stdout.readline() == "begun\n"
    message = Message(POSES, len(ABOVE))
    message.records["finger"] = np.arange(len(ABOVE))
    with open_publisher(f"{name}-poses") as publisher:
        inlet = open_inlet(name)
        delays = seen_after(publisher, inlet, message, options.seconds, np.random.default_rng(0))
        print("stop", file=service.stdin, flush=True)
        report = json.loads(service.stdout.readline())
    service.wait()
    return report, delays


def main() -> None:
    """Print a table, a row a loop."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name, default in (("rounds", 3), ("seconds", 5.0), ("rate", 1000.0)):
        parser.add_argument(f"--{name}", type=type(default), default=default)
    for switch in ("realtime", "busy", "thread"):
        parser.add_argument(f"--{switch}", action="store_true")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.child:
        child(options.child, has_thread=options.thread)
        return
    found: dict[str, list[tuple[dict, list[Delays]]]] = {"python": [], "compiled": []}
    busy = [subprocess.Popen([sys.executable, "-c", SPIN])] if options.busy else []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(options.rounds):
            for loop, runs in found.items():
                runs.append(measured(loop, options, folder))
    for process in busy:
        process.kill()
    print(f"load {os.getloadavg()[0]:.1f}; {os.cpu_count()} cores; µs")
    print(
        "loop      tick p50   p99 | late p50   p99  p99.9 | published p50   p99 | seen p50   p99 | missed of"
    )
    for loop, runs in found.items():
        numbers = [_figures(_merged(runs, key)) for key in ("compute", "lateness")]
        made, seen = np.percentile(np.concatenate([each for _, each in runs]), (50, 99), axis=0).T
        missed, ticks = (sum(report[key] for report, _ in runs) for key in ("missed", "ticks"))
        (tick, tick99, _), (late, late99, late999) = numbers
        print(
            f"{loop:9} {tick:8.1f} {tick99:5.0f} | {late:8.1f} {late99:5.0f} {late999:6.0f} | "
            f"{made[0]:13.0f} {made[1]:5.0f} | {seen[0]:8.0f} {seen[1]:5.0f} | {missed} {missed + ticks}"
        )


def _merged(runs: list[tuple[dict, list[Delays]]], key: str) -> Histogram:
    """The durations of all runs."""
    merged = Histogram()
    for report, _ in runs:
        for lower, _, count in report[key]["rows"]:
            for _ in range(count):
                merged.record(lower)
    return merged


def _figures(histogram: Histogram) -> list[float]:
    return [1e-3 * histogram.percentile(share) for share in (50.0, 99.0, 99.9)]


if __name__ == "__main__":
    main()
