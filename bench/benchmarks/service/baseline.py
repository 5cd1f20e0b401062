"""Times of the machine and of iceoryx2 by themselves, for comparison."""

import ctypes
import time
import uuid

import numpy as np

import proximity
from benchmarks.service.publishing import FINGERS, PERIOD_S, ServiceRow
from benchmarks.ticks.timing import figures_of
from proximity.service import RealTime
from proximity.service.realtime import undisturbed

COUNTS = 2000  # additions, some 50 µs: about what a frame takes
PERIOD_NS = round(1e9 * PERIOD_S)


def bare_loop(seconds: float) -> list[ServiceRow]:
    """Return how late a loop that only counts is woken at 1 kHz, and how long its 50 µs take."""
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


def bare_iceoryx(count: int) -> list[ServiceRow]:
    """Return how long iceoryx2 itself takes to loan, fill and send a frame's bytes at 1 kHz."""
    import iceoryx2

    size = proximity.FRAME.size(FINGERS)
    data, block = bytes(size), ctypes.c_char * size
    node = iceoryx2.NodeBuilder.new().create(iceoryx2.ServiceType.Ipc)
    name = iceoryx2.ServiceName.new(f"bench-{uuid.uuid4().hex[:8]}")
    topic = node.service_builder(name).publish_subscribe(iceoryx2.Slice[ctypes.c_uint8]).open_or_create()
    publisher = topic.publisher_builder().initial_max_slice_len(size).create()
    subscriber = topic.subscriber_builder().create()
    took = np.zeros(count, np.int64)
    due = time.monotonic()
    for k in range(count):
        due += PERIOD_S
        time.sleep(max(due - time.monotonic(), 0.0))
        start = time.perf_counter_ns()
        sample = publisher.loan_slice_uninit(size)
        block.from_address(sample.payload_ptr).raw = data
        sample.assume_init().send()
        took[k] = time.perf_counter_ns() - start
        while (received := subscriber.receive()) is not None:
            received.delete()
    for opened in (subscriber, publisher):
        opened.delete()
    return [ServiceRow("no service", "iceoryx2 alone: loan, fill, send", count, figures_of(took))]
