"""Runs of studies on Ray: every condition once, whatever fails, is lost, or is killed."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter

import pyarrow.dataset as dataset
import pytest
import ray
from project import IMPORT_PATHS
from ray.cluster_utils import Cluster
from study_jobs import HELD, done, study_of

from proximity.errors import MissingLibraryError, ServiceError
from proximity.lab.sweep import study_run
from proximity.lab.sweep.row_files import locked, read_rows, row_paths
from proximity.lab.sweep.study_run import Progress, run_study


@pytest.fixture(scope="module", autouse=True)
def cores():
    """Ray with two cores, begun once: that takes seconds."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", os.pathsep.join(IMPORT_PATHS))
        with study_run._ray(None, 2) as running:
            yield running


def rows_of(out):
    """The rows of a folder, as dictionaries."""
    return read_rows(out).rows.to_pylist()


def test_every_condition_has_a_row_with_all_that_made_it(tmp_path):
    out = tmp_path / "out"
    study = study_of(tmp_path, "number = { from = 20, to = 119, count = 100 }\nspeed = 2")
    ended = run_study(study, out)
    rows = rows_of(out)

    assert (ended.total, ended.earlier, ended.done, ended.failed) == (100, 0, 100, 0)
    assert [(row["number"], row["square"], row["cube"]) for row in rows] == [
        (number, float(number**2), 2.0 * number**3) for number in range(20, 120)
    ]
    assert dataset.dataset(out / "rows", partitioning="hive").to_table().num_rows == 100
    assert set(done(out).values()) == {1}
    made_by = {name: rows[0][name] for name in ("proximity", "python", "numpy", "ray", "kernels")}
    assert all(made_by.values())
    assert rows[0]["node"] and rows[0]["processor"] and rows[0]["commit"]
    assert rows[0]["attempts"] == 1 and rows[0]["failure"] is None


def test_second_run_does_what_is_missing_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    run_study(study_of(tmp_path, "number = [1, 2, 3]"), out)
    ended = run_study(study_of(tmp_path, "number = [2, 3, 4, 5]"), out)

    assert (ended.total, ended.earlier, ended.done) == (4, 2, 2)
    assert set(done(out).values()) == {1}
    assert [row["number"] for row in rows_of(out)] == [2, 3, 4, 5]  # 1 is no condition of the study any more


def test_interrupted_run_counts_the_rows_that_it_wrote(tmp_path):
    seen = []

    def watch(progress):
        if progress.done:  # a busy machine may say first that nothing has come yet
            seen.append(progress)
            if len(seen) == 1:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(
            study_of(tmp_path, "number = { from = 1, to = 99, count = 99 }"), tmp_path / "out", watch=watch
        )

    assert len(seen) == 2 and 0 < seen[-1].done == len(rows_of(tmp_path / "out"))


def test_from_scratch_does_all_again(tmp_path):
    out, study = tmp_path / "out", study_of(tmp_path, "number = [1, 2]")
    run_study(study, out)
    ended = run_study(study, out, is_resumed=False)

    assert (ended.earlier, ended.done) == (0, 2)
    assert set(done(out).values()) == {2}
    assert len(rows_of(out)) == 2


def test_job_that_fails_three_times_is_a_row_with_its_error(tmp_path):
    out = tmp_path / "out"
    study = study_of(tmp_path, "number = [12, 13, 14]")
    ended = run_study(study, out)
    row = next(row for row in rows_of(out) if row["number"] == 13)

    assert (ended.done, ended.failed) == (3, 1)
    assert row["failure"] == "13 is an unlucky number"
    assert (row["attempts"], row["square"]) == (3, None)
    assert sorted(done(out).values()) == [1, 1, 3]
    assert run_study(study, out).done == 0
    assert run_study(study, out, with_failed=True).failed == 1
    assert len(rows_of(out)) == 3


def test_job_that_takes_its_worker_along_is_a_row_and_the_others_go_on(tmp_path):
    out = tmp_path / "out"
    ended = run_study(study_of(tmp_path, "number = [1, 2, 3, 666, 4, 5, 6, 7]"), out)
    failures = {row["number"]: row["failure"] for row in rows_of(out) if row["failure"]}

    assert (ended.total, ended.done, ended.failed) == (8, 8, 1)
    assert list(failures) == [666]
    assert failures[666].startswith("its worker was lost: ")


def test_batches_grow_to_a_second_and_are_bounded_in_number(tmp_path, monkeypatch):
    flying, sizes = [], []
    send = study_run._Run._batch

    def batch(run, pending, limit):
        conditions = send(run, pending, limit)
        flying.append(len(run._flying) + bool(conditions))
        sizes.append(len(conditions))
        return conditions

    monkeypatch.setattr(study_run._Run, "_batch", batch)
    study = study_of(tmp_path, "number = { from = 1000, to = 1999, count = 1000 }")
    run_study(study, tmp_path / "out")

    assert max(flying) <= 2 * 2
    assert sizes[0] == 1
    assert 50 < max(sizes) <= 5000


def test_progress_tells_rate_and_time_left():
    seen = Progress(total=100, earlier=20, done=30, failed=0, seconds=60.0)

    assert seen.rate == 0.5
    assert seen.seconds_left == 100.0
    assert Progress(5, 0, 0, 0, 0.0).seconds_left == float("inf")


PROGRAM = """
import sys
from pathlib import Path
from study_jobs import JOBS
from proximity.lab.sweep.study_file import read_study
from proximity.lab.sweep.study_run import run_study
ended = run_study(read_study(sys.argv[1], JOBS), Path(sys.argv[2]), cores=2)
print(ended.total, ended.earlier, ended.done)
"""


def program(study, out, pause):
    """A run of its own, with a Ray of its own."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(IMPORT_PATHS), "STUDY_PAUSE": pause}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, study.path, str(out)], env=environment,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_killed_study_goes_on_with_nothing_lost_and_nothing_twice(tmp_path):
    study, out = study_of(tmp_path, "number = { from = 1000, to = 1399, count = 400 }"), tmp_path / "out"
    killed = program(study, out, "0.02")
    deadline = time.monotonic() + 120.0
    while not row_paths(out) and killed.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    written = Counter(row["key"] for row in read_rows(out).rows.to_pylist())
    time.sleep(0.5)  # its workers end with it
    resumed = program(study, out, "0")
    said, wrong = resumed.communicate(timeout=120)
    keys = [row["key"] for row in rows_of(out)]

    assert 0 < len(written) < 400
    assert said.split() == ["400", str(len(written)), str(400 - len(written))], wrong
    assert sorted(keys) == sorted(condition.key for condition in study.conditions)
    assert len(set(keys)) == 400
    files = read_rows(out).rows.num_rows, sum(ray_rows(path) for path in row_paths(out))
    assert files == (400, 400)  # and no condition in two files
    assert all(done(out)[key] == 1 for key in written)


def ray_rows(path):
    """Rows of one file."""
    import pyarrow.parquet

    return pyarrow.parquet.read_metadata(path).num_rows


def test_folder_of_another_run_or_another_job_is_refused(tmp_path):
    out = tmp_path / "out"
    run_study(study_of(tmp_path, "number = 1"), out)
    (tmp_path / "a.stl").write_text("a")
    with pytest.raises(ServiceError, match=r"holds results of the job count, expected another folder"):
        run_study(study_of(tmp_path, 'scene = "a.stl"', job="draw"), out)
    with locked(out), pytest.raises(ServiceError, match=r"out: another study is running in it"):
        run_study(study_of(tmp_path, "number = 1"), out)


def test_ray_that_does_not_start_is_a_sentence(tmp_path, monkeypatch):
    def fail(**_):
        raise Exception("The current node timed out during startup.\nMore lines follow.")

    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", fail)
    sentence = r"^Ray cannot be started here \(The current node timed out during startup\.\)$"
    with pytest.raises(ServiceError, match=sentence):
        run_study(study_of(tmp_path, "number = 1"), tmp_path / "out")


def test_folder_that_cannot_be_made_or_read_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ServiceError, match=r"file/out: cannot be written \(Not a directory\)"):
        run_study(study_of(tmp_path, "number = 1"), tmp_path / "file" / "out")
    with pytest.raises(ServiceError, match="holds no results of a study, expected the folder of"):
        read_rows(tmp_path)
    out = tmp_path / "out"
    run_study(study_of(tmp_path, "number = 1"), out)
    row_paths(out)[0].write_bytes(b"PAR1 and then nothing")
    with pytest.raises(ServiceError, match="a file of results cannot be read"):
        read_rows(out)


def test_library_that_is_not_installed_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingLibraryError, match=r"a study needs pyarrow, which is not installed: pip inst"):
        run_study(study_of(tmp_path, "number = 1"), tmp_path / "out")


def test_ray_sends_nothing_to_its_makers():
    assert os.environ["RAY_USAGE_STATS_ENABLED"] == "0"
    usage = pytest.importorskip("ray._common.usage.usage_lib")  # where this version of Ray has it
    assert not usage.usage_stats_enabled()


LISTENING = """
import os, sys
import psutil
from proximity.lab.sweep import study_run

with study_run._ray(None, 1) as ray:
    assert ray.get(ray.remote(lambda: 2).remote()) == 2
    processes = [psutil.Process(), *psutil.Process().children(recursive=True)]
    bound = {each.laddr.ip for one in processes for each in one.net_connections() if each.status == "LISTEN"}
    token = os.environ["RAY_AUTH_TOKEN_PATH"]
    modes = ",".join(oct(os.stat(path).st_mode)[-4:] for path in (token, os.path.dirname(token)))
    print(ray.get_runtime_context().gcs_address, modes, *bound, flush=True)
    sys.stdin.read()
print(os.path.exists(os.path.dirname(token)))
"""
STRANGER = """
import os, sys
import ray

ray.init(address=sys.argv[1], log_to_driver=False)
print("code ran in process", ray.get(ray.remote(os.getpid).remote()))
"""


@pytest.mark.slow
def test_another_user_cannot_run_code_in_the_ray_of_a_study(tmp_path):
    """Every address was bound, and whoever reached a port could have any code run."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("RAY_")}
    environment |= {"PYTHONPATH": os.pathsep.join(IMPORT_PATHS), "RAY_AUTH_MODE": "disabled"}
    stranger = environment | {"HOME": str(tmp_path), "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0"}  # no token
    with subprocess.Popen(
        [sys.executable, "-c", LISTENING], env=environment, stdin=-1, stdout=-1, text=True
    ) as study:
        address, mode, *bound = study.stdout.readline().split()
        refused = subprocess.run(
            [sys.executable, "-c", STRANGER, address],
            env=stranger,
            capture_output=True,
            text=True,
            timeout=120,
        )
        is_left, _ = study.communicate("")
    assert address.startswith("127.0.0.1:") and mode == "0600,0700" and is_left == "True\n"
    assert {each.removeprefix("::ffff:") for each in bound} == {"127.0.0.1"}
    assert refused.returncode != 0 and "code ran" not in refused.stdout


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
