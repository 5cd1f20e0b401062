"""Time to publish a frame, and until another process has read it."""

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import proximity
from benchmarks.service.addresses import new_addresses
from benchmarks.support.project import environment
from benchmarks.support.verdicts import Verdict
from benchmarks.ticks.timing import Figures, figures_of
from proximity.errors import PublishError

FINGERS = 5
PERIOD_S = 0.001
VALID_NS = 20_000_000
MAX_PUBLISH_US, MAX_SEEN_US, MAX_SEEN_P99_US = 5.0, 50.0, 500.0
SCHEMES = ("shm", "udp", "zenoh")
JUDGED = "shm"
READER = Path(__file__).with_name("reader.py")


@dataclass(frozen=True, slots=True)
class ServiceRow:
    """A row of the table of the service."""

    address: str
    what: str
    count: int
    figures: Figures  # µs


def measure_publishing(options) -> tuple[list[ServiceRow], list[Verdict]]:
    """Publish to a reader in another process: at 1 kHz to each kind of address, to one without pauses."""
    count = 200 if options.small else 20_000
    rows: list[ServiceRow] = []
    for scheme in SCHEMES:
        read_at, publish_at = new_addresses(scheme)
        try:
            for is_spinning in (True, False):
                sent, seen = _published(read_at, publish_at, count, is_spinning)
                manner = "spins" if is_spinning else "waits"
                rows.append(ServiceRow(scheme, f"publish, reader {manner}", count, figures_of(sent)))
                rows.append(
                    ServiceRow(scheme, f"seen by a reader that {manner}", len(seen), figures_of(seen))
                )
            if scheme == JUDGED:
                sent, _ = _published(read_at, publish_at, count, is_spinning=False, period_s=0.0)
                rows.append(ServiceRow(scheme, "publish, one after another", count, figures_of(sent)))
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
                f"publish from Python, {JUDGED}, {when}: p50 at most {MAX_PUBLISH_US:g} µs",
                f"{figures.p50:.1f} µs",
                figures.p50 <= MAX_PUBLISH_US,
            )
            for when, figures in (("one after another", hot), ("at 1 kHz, woken for each", publish))
        ),
        Verdict(
            f"seen by a second process: p50 at most {MAX_SEEN_US:g} µs, p99 at most {MAX_SEEN_P99_US:g} µs",
            f"{seen.p50:.1f} and {seen.p99:.1f} µs",
            seen.p50 <= MAX_SEEN_US and seen.p99 <= MAX_SEEN_P99_US,
        ),
    ]


def _published(read_at, publish_at, count, is_spinning, period_s=PERIOD_S):
    """Return times of publishing and of being seen, ns."""
    message = proximity.Message(proximity.FRAME, FINGERS)
    message.records["normal"] = (0.0, 0.0, 1.0)
    sent = np.zeros(count, np.int64)
    with _reader(read_at, is_spinning) as reader, proximity.open_publisher(publish_at) as publisher:
        for _ in range(300):  # until the reader is connected, and caches are warm
            stamp(message)
            publisher.publish(message)
            time.sleep(PERIOD_S)
        first = publisher.sequence
        due = time.monotonic()
        for k in range(count):
            due += period_s
            if period_s:
                time.sleep(max(due - time.monotonic(), 0.0))
            stamp(message)
            start = time.perf_counter_ns()
            publisher.publish(message)
            sent[k] = time.perf_counter_ns() - start
        printed, _ = reader.communicate("", timeout=30.0)
    sequence, seen = np.fromstring(printed, np.int64, sep=" ").reshape(-1, 2).T
    return sent, seen[sequence >= first]


def stamp(message: proximity.Message) -> None:
    """Stamp a frame with the present instant, so that it is valid for `VALID_NS`."""
    now = time.monotonic_ns()
    header = message.header
    header["pose_ns"] = header["start_ns"] = header["publish_ns"] = now
    header["valid_until_ns"], header["state"] = now + VALID_NS, proximity.State.OK


@contextmanager
def _reader(address, is_spinning) -> Iterator[subprocess.Popen]:
    process = subprocess.Popen(
        [sys.executable, str(READER), address, "spin" if is_spinning else "wait"],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=environment(),
    )
    try:
        if not process.stdout.readline():
            raise PublishError(f"{address}: the reader could not open it")
        yield process
    finally:
        process.kill()
        process.wait()
