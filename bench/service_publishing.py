"""What it takes to publish a frame, and how long until another process has read it."""

import os
import socket
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from results import Verdict
from tick_timing import Figures, figures_of

import proximity
from cases import PROJECT
from proximity.errors import PublishError

FINGERS = 5
PERIOD_S = 0.001
VALID_NS = 20_000_000
MOST_PUBLISH_US, MOST_SEEN_US, MOST_SEEN_P99_US = 5.0, 50.0, 500.0
JUDGED = "iox2"
READER = Path(__file__).with_name("service_reader.py")


@dataclass(frozen=True, slots=True)
class PublishRow:
    """A line of the table."""

    address: str
    what: str
    count: int
    figures: Figures  # µs


def measure_publishing(options) -> tuple[list[PublishRow], list[Verdict]]:
    """Publish to a reader in another process: at 1 kHz at each kind of address, at one without pauses."""
    count = 200 if options.small else 20_000
    rows: list[PublishRow] = []
    for scheme, address, to in _addresses():
        try:
            for is_spinning in (True, False):
                sent, seen = _published(address, to, count, is_spinning)
                way = "spins" if is_spinning else "waits"
                rows.append(PublishRow(scheme, f"publish, reader {way}", count, figures_of(sent)))
                rows.append(PublishRow(scheme, f"seen by a reader that {way}", len(seen), figures_of(seen)))
            if scheme == JUDGED:
                sent, _ = _published(address, to, count, is_spinning=False, period_s=0.0)
                rows.append(PublishRow(scheme, "publish, one after another", count, figures_of(sent)))
        except PublishError as reason:
            print(f"{scheme}: left out ({reason})", file=sys.stderr)
    return rows, _verdicts(rows)


def _verdicts(rows):
    found = {row.what: row.figures for row in rows if row.address == JUDGED}
    hot, publish, seen = (
        found.get(what)
        for what in ("publish, one after another", "publish, reader waits", "seen by a reader that spins")
    )
    if hot is None or publish is None or seen is None:
        return []
    return [
        *(
            Verdict(
                f"publish from Python, {JUDGED}, {when}: p50 at most {MOST_PUBLISH_US:g} µs",
                f"{figures.p50:.1f} µs",
                figures.p50 <= MOST_PUBLISH_US,
            )
            for when, figures in (("one after another", hot), ("at 1 kHz, woken for each", publish))
        ),
        Verdict(
            f"seen by a second process: p50 at most {MOST_SEEN_US:g} µs, p99 at most {MOST_SEEN_P99_US:g} µs",
            f"{seen.p50:.1f} and {seen.p99:.1f} µs",
            seen.p50 <= MOST_SEEN_US and seen.p99 <= MOST_SEEN_P99_US,
        ),
    ]


def _addresses():
    """Scheme, where to read, where to publish."""
    name = f"bench-{uuid.uuid4().hex[:8]}"
    port, other = _free_port(socket.SOCK_DGRAM), _free_port(socket.SOCK_STREAM)
    return [
        ("iox2", f"iox2://{name}", f"iox2://{name}"),
        ("udp", f"udp://127.0.0.1:{port}", f"udp://127.0.0.1:{port}"),
        (
            "zenoh",
            f"zenoh://{name}?listen=tcp/127.0.0.1:{other}",
            f"zenoh://{name}?connect=tcp/127.0.0.1:{other}",
        ),
    ]


def _free_port(kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _published(read_at, publish_at, count, is_spinning, period_s=PERIOD_S):
    """Times of publishing and of being seen, ns."""
    message = proximity.Message(proximity.FRAME, FINGERS)
    message.records["normal"] = (0.0, 0.0, 1.0)
    sent = np.zeros(count, np.int64)
    with _reader(read_at, is_spinning) as reader, proximity.open_publisher(publish_at) as publisher:
        for _ in range(300):  # until the reader is there, and all is warm
            _stamp(message)
            publisher.publish(message)
            time.sleep(PERIOD_S)
        first = publisher.sequence
        due = time.monotonic()
        for k in range(count):
            due += period_s
            if period_s:
                time.sleep(max(due - time.monotonic(), 0.0))
            _stamp(message)
            start = time.perf_counter_ns()
            publisher.publish(message)
            sent[k] = time.perf_counter_ns() - start
        told, _ = reader.communicate("", timeout=30.0)
    sequence, seen = np.fromstring(told, np.int64, sep=" ").reshape(-1, 2).T
    return sent, seen[sequence >= first]


def _stamp(message):
    now = time.monotonic_ns()
    header = message.header
    header["pose_ns"] = header["start_ns"] = header["publish_ns"] = now
    header["valid_until_ns"], header["state"] = now + VALID_NS, proximity.State.OK


@contextmanager
def _reader(address, is_spinning) -> Iterator[subprocess.Popen]:
    environment = dict(os.environ)
    folders = [str(PROJECT), *filter(None, [environment.get("PYTHONPATH")])]
    environment["PYTHONPATH"] = os.pathsep.join(folders)
    process = subprocess.Popen(
        [sys.executable, str(READER), address, "spin" if is_spinning else "wait"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    try:
        if not process.stdout.readline():
            raise PublishError(f"{address}: the reader could not open it")
        yield process
    finally:
        process.kill()
        process.wait()
