"""A service in a separate process, with a recorded hand: every frame is counted, memory is watched."""

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

import proximity
from benchmarks.service.addresses import new_addresses
from benchmarks.service.publishing import ServiceRow
from benchmarks.support.project import MESHES, SHARED_HANDS, TEMPORARY_PREFIX
from benchmarks.support.verdicts import Verdict
from benchmarks.ticks.timing import Figures
from proximity.recording import FrameReader

RATE_HZ = 1000
MAX_GROWTH = 2 << 20  # bytes, after the first minute: variation of the allocator
WARM_UP_SHARE = 0.1  # share of the time after which memory should be constant
SCENE = """
[service]
rate_hz = {rate}
publish = ["{address}"]
log = {log}
[[parts]]
file = {part}
[input]
recording = {recording}
fit = true
repeat = true
"""


def measure_minute(options) -> tuple[list[ServiceRow], list[Verdict]]:
    """Serve at 1 kHz with the log on; compare the counts published, received, and written."""
    seconds = 2.0 if options.small else options.seconds
    with tempfile.TemporaryDirectory(prefix=TEMPORARY_PREFIX) as folder:
        (address, _), log = new_addresses("shm"), Path(folder) / "run.frames"
        scene = _scene_file(folder, address, log)
        wrongly_valid = 0
        with (
            proximity.open_subscriber(address) as frames,
            proximity.start_service(scene) as service,
        ):
            ends = time.monotonic() + seconds
            while time.monotonic() < ends:
                reading = frames.wait(0.05)
                if reading.is_valid and reading.now_ns > int(reading.header["valid_until_ns"]):
                    wrongly_valid += 1
            report = service.stop()
            frames.read()  # the last ones
        last = int(frames.read().header["sequence"])
        logged = sum(len(run) for run in FrameReader(log))
    counts = frames.counts
    published = last + 1
    rows = [
        ServiceRow("a tick", name, report[name]["count"], _figures(report[name]))
        for name in ("compute", "lateness")
    ]
    accounted = counts.received + counts.lost
    judged = [
        Verdict(
            f"{seconds:g} s at {RATE_HZ} Hz: received and counted gaps are what was published",
            f"{counts.received} + {counts.lost} of {published}; {logged} in the log",
            accounted == published == logged and counts.received > 0.5 * published,
        ),
        Verdict("no frame is used as valid after valid_until", f"{wrongly_valid} were", wrongly_valid == 0),
        Verdict(
            "a tick's compute is within the period, always",
            f"longest {report['compute']['max_ns'] / 1e3:.0f} µs; {report['missed']} ticks missed, "
            f"woken late p99.9 {report['lateness']['p999_ns'] / 1e3:.0f} µs",
            report["compute"]["max_ns"] <= 1e9 / RATE_HZ,
        ),
    ]
    return rows, judged


def measure_memory(options) -> tuple[list[ServiceRow], list[Verdict]]:
    """Watch the memory of a service's process."""
    seconds = 2.0 if options.small else 60.0 * options.minutes
    with tempfile.TemporaryDirectory(prefix=TEMPORARY_PREFIX) as folder:
        (address, _), log = new_addresses("shm"), Path(folder) / "run.frames"
        scene = _scene_file(folder, address, log)
        sizes = []
        with proximity.start_service(scene) as service, proximity.open_subscriber(address) as frames:
            process = psutil.Process(service.beginning["pid"])
            ends = time.monotonic() + seconds
            while time.monotonic() < ends:
                sizes.append(process.memory_info().rss)
                pause = time.monotonic() + 1.0
                while time.monotonic() < pause:
                    frames.wait(0.05)
            report = service.stop()
    sizes_after = np.array(sizes[int(WARM_UP_SHARE * len(sizes)) :])
    growth = int(sizes_after[-1] - sizes_after[0])
    verdict = Verdict(
        f"memory over {seconds / 60:.3g} minutes of serving: grows by at most {MAX_GROWTH >> 20} MiB",
        f"{sizes_after[0] / 2**20:.1f} MiB, then {growth / 2**20:+.2f} MiB in {report['ticks']} ticks",
        growth <= MAX_GROWTH,
    )
    return [], [verdict]


def _scene_file(folder, address, log):
    part, recording = MESHES / "bracket.stl", SHARED_HANDS / "grab.csv"
    if not recording.is_file():
        print(f"{recording} is not here: the generated hand instead", file=sys.stderr)
        recording = MESHES / "hand.csv"
    path = Path(folder) / "scene.toml"
    quoted = {"log": log, "part": part, "recording": recording}
    texts = {name: json.dumps(str(file)) for name, file in quoted.items()}
    path.write_text(SCENE.format(rate=RATE_HZ, address=address, **texts), encoding="utf-8")
    return path


def _figures(histogram):
    micro = {name: histogram[name] / 1e3 for name in ("p50_ns", "p99_ns", "p999_ns", "max_ns")}
    return Figures(micro["p50_ns"], float("nan"), micro["p99_ns"], micro["p999_ns"], micro["max_ns"])
