"""Times of the machine alone, for comparison."""

import time

import numpy as np

from benchmarks.service.publishing import PERIOD_S, ServiceRow
from benchmarks.ticks.timing import figures_of
from proximity.service import RealTime
from proximity.service.realtime import undisturbed

COUNTS = 2000  # additions, some 50 µs: about the time of a frame
PERIOD_NS = round(1e9 * PERIOD_S)


def bare_loop(seconds: float) -> list[ServiceRow]:
    """Return the lateness of a counting loop at 1 kHz, and the duration of its 50 µs."""
    now_ns = time.monotonic_ns
    late, took = [], []
    with undisturbed(), RealTime():
        due_ns = now_ns() + PERIOD_NS
        ends_ns = due_ns + round(1e9 * seconds)
        while due_ns < ends_ns:
            while (left_ns := due_ns - now_ns()) > 0:
                time.sleep(1e-9 * left_ns)
            start_ns = now_ns()
            sum(range(COUNTS))
            took.append(now_ns() - start_ns)
            late.append(start_ns - due_ns)
            due_ns += PERIOD_NS * (1 + max(now_ns() - due_ns, 0) // PERIOD_NS)
    return [
        ServiceRow("no service", name, len(times), figures_of(np.array(times)))
        for name, times in (("a loop that counts: compute", took), ("a loop that counts: lateness", late))
    ]
