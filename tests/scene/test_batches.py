"""Batches in slices: every row is asked once, and Ctrl-C is answered long before the end."""

import json
import subprocess
import sys

import numpy as np
import pytest
from project import SUPPORT

from proximity.checks import COPIED_AT_ONCE, as_points
from proximity.scene.queries import batches
from proximity.scene.queries.batches import run_batch


def backwards(rows, *_):
    return np.arange(len(rows))[::-1].copy()


@pytest.mark.parametrize("order_of", [None, backwards], ids=["as they come", "sorted"])
@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize("count", [0, 47, 5000, 2 * 700 + 1])
def test_every_row_is_asked_once(monkeypatch, count, workers, order_of):
    monkeypatch.setattr(batches, "BLOCK", 700)
    rows, one, counts = np.arange(float(count)), np.array([7.0]), np.zeros(count, int)

    def ask(order, some, limit, tally):
        assert limit is one
        tally[order if len(order) else slice(None)] += 1
        return some[0] if len(some) else -1.0

    found = run_batch(ask, [rows, one, counts], workers, order_of, 16)

    assert (counts == 1).all()
    assert all(first == answer for first, answer in found if count)


def test_long_arrays_are_converted_in_parts():
    values = np.arange(3 * COPIED_AT_ONCE + 9, dtype=np.float32).reshape(-1, 3)[: COPIED_AT_ONCE + 1]

    points = as_points(values)

    assert points.dtype == np.float64
    assert points.flags.carray
    assert np.array_equal(points, values)


INTERRUPTED = """
import json, os, signal, threading, time
import numpy as np, shapes
from proximity.scene.scene import Scene

scene = Scene.from_mesh(*shapes.sphere(subdivisions=6))
few = 1e-9 * np.random.default_rng(0).normal(size=(48, 3))  # where a search looks at every face
asks = {
    "closest": lambda points, workers=1: scene.closest(points, workers=workers),
    "signed_distance": lambda points, workers=1: scene.signed_distance(points, workers=workers),
    "closest_to_segments": lambda points, workers=1: scene.closest_to_segments(points, points + 1e-9),
}
report = {}
for name, workers in (("closest", 1), ("closest", 2), ("signed_distance", 1), ("closest_to_segments", 1)):
    ask = asks[name]
    ask(few), ask(np.repeat(few, 50, axis=0)[:100], workers=workers)  # kernels are there from then on
    begun = time.perf_counter()
    before = ask(few)
    each = (time.perf_counter() - begun) / len(few)
    whole = 10.0  # s
    points = np.resize(few, (max(2048, int(whole / each)), 3))
    timer = threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT))
    begun = time.perf_counter()
    try:
        timer.start()
        ask(points, workers=workers)
        is_interrupted = False
    except KeyboardInterrupt:
        is_interrupted = True
    seconds = time.perf_counter() - begun
    timer.join()
    after = ask(few)
    tables = [getattr(answer, "_table", answer) for answer in (before, after)]
    is_same = np.array_equal(*tables, equal_nan=True)
    others = len(threading.enumerate()) - 1
    report[f"{name}, {workers}"] = is_interrupted, seconds, is_same, others
print(json.dumps(report))
"""


def test_batch_of_slow_rows_is_interrupted_long_before_its_end():
    """The whole would take ten seconds; the scene answers as before, and threads are gone."""
    done = subprocess.run(
        [sys.executable, "-c", INTERRUPTED], cwd=SUPPORT, capture_output=True, text=True, timeout=100
    )

    assert done.returncode == 0, done.stderr
    for name, (is_interrupted, seconds, is_same, others) in json.loads(done.stdout).items():
        assert is_interrupted, name
        assert seconds < 4.0, name
        assert is_same, name
        assert others == 0, name
