"""A study on three nodes, of which one is killed in the middle: every condition once, none lost."""

import os
import threading
import time

import pytest
import ray
from project import IMPORT_PATHS
from ray.cluster_utils import Cluster
from study_jobs import HELD, study_of

from proximity.errors import ServiceError
from proximity.lab.sweep.row_files import read_rows, row_paths
from proximity.lab.sweep.study_run import run_study

STORE_BYTES = 80 << 20


@pytest.fixture
def cluster(monkeypatch):
    """Three nodes of one core on loopback; the driver is on the first."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(IMPORT_PATHS))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    monkeypatch.setenv("STUDY_PAUSE", "0.02")
    ray.shutdown()
    node = {"num_cpus": 1, "object_store_memory": STORE_BYTES, "include_dashboard": False}
    nodes = Cluster(initialize_head=True, head_node_args=node)
    yield nodes
    ray.shutdown()
    nodes.shutdown()


@pytest.mark.slow
def test_every_condition_has_one_row_though_a_node_is_killed(cluster, tmp_path):
    held = tmp_path / "held"
    doomed = cluster.add_node(num_cpus=1, object_store_memory=STORE_BYTES, env_vars={HELD: str(held)})
    cluster.add_node(num_cpus=1, object_store_memory=STORE_BYTES)
    cluster.wait_for_nodes()
    study, out = study_of(tmp_path, "number = { from = 1000, to = 2199, count = 1200 }"), tmp_path / "out"
    killed = []

    def kill():
        deadline = time.monotonic() + 120.0
        while not (held.exists() and row_paths(out)) and time.monotonic() < deadline:
            time.sleep(0.02)
        cluster.remove_node(doomed, allow_graceful=False)
        killed.append(len(row_paths(out)))

    killer = threading.Thread(target=kill)
    killer.start()
    ended = run_study(study, out, address=cluster.address)
    killer.join()
    rows = read_rows(out).rows.to_pylist()
    attempts = [row["attempts"] for row in rows]

    assert killed and killed[0] < len(row_paths(out))  # it was in the middle
    assert (ended.total, ended.done, ended.failed) == (1200, 1200, 0)
    assert sorted(row["number"] for row in rows) == list(range(1000, 2200))
    assert len({row["node"] for row in rows}) >= 2
    assert max(attempts) > 1  # the batch that was on the node
    assert sum(attempts) < 2 * len(attempts)


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("127.0.0.1:1", r"^no Ray cluster at 127\.0\.0\.1:1 \(.*refused\)$"),
        ("127.0.0.1:99999", r"^no Ray cluster at 127\.0\.0\.1:99999 \("),
        ("head", r"^no Ray cluster at 'head', expected HOST:PORT as ray start --head prints it$"),
    ],
)
def test_cluster_that_is_not_there_is_one_sentence(tmp_path, address, said):
    ray.shutdown()
    with pytest.raises(ServiceError, match=said):
        run_study(study_of(tmp_path, "number = 1"), tmp_path / "out", address=address)
