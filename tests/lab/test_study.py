"""Studies: files, jobs and figure, and runs on Ray: each condition once, also after a failure or a kill."""

import csv
import inspect
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import pyarrow.parquet
import pytest
import ray
from project import IMPORT_PATHS, MESHES, ROOT
from study_jobs import study_of

from proximity.errors import ArgumentError, MissingLibraryError, ServiceError
from proximity.lab.simulation.devices import Hand
from proximity.lab.simulation.simulated_press import Setup, Wall, simulate
from proximity.lab.simulation.sweeps import best_coupled_wall
from proximity.lab.study import study_run
from proximity.lab.study.certificate_job import certificate
from proximity.lab.study.press_job import press
from proximity.lab.study.row_files import locked, read_rows, row_paths
from proximity.lab.study.study_figure import chosen_axes, write_figure
from proximity.lab.study.study_file import read_study
from proximity.lab.study.study_run import Progress, run_study

JOBS = {"press": press, "certificate": certificate}


def values_of(*arguments, **options):
    """Return the conditions of a study as their factors."""
    return [condition.values for condition in study_of(*arguments, **options).conditions]


def test_grid_has_every_combination_once(tmp_path):
    found = values_of(tmp_path, "number = [1, 2, 3, 2]\nspeed = [0.5, 1.5]")

    assert sorted((one["number"], one["speed"]) for one in found) == [
        (number, speed) for number in (1, 2, 3) for speed in (0.5, 1.5)
    ]
    assert {(one["wall"], one["stiffness"]) for one in found} == {("hard", None)}


def test_each_row_of_conditions_has_every_combination_of_the_factors(tmp_path):
    rows = '[[conditions]]\nnumber = [1, 2]\nspeed = 2\n[[conditions]]\nnumber = 3\nstiffness = ["none", 9]'
    found = values_of(tmp_path, 'wall = ["hard", "soft"]', tail=rows)

    assert [(one["number"], one["speed"], one["stiffness"]) for one in found if one["wall"] == "soft"] == [
        (1, 2.0, None), (2, 2.0, None), (3, 1.0, None), (3, 1.0, 9.0),
    ]  # fmt: skip
    assert len(found) == 8


def test_key_follows_the_content_of_files_not_their_names(tmp_path):
    def keys():
        return [one.key for one in study_of(tmp_path, 'scene = "*.stl"', job="measured").conditions]

    (tmp_path / "a.stl").write_text("one")
    first = keys()
    (tmp_path / "a.stl").rename(tmp_path / "b.stl")
    assert keys() == first
    (tmp_path / "b.stl").write_text("two")
    assert keys() != first and len(first) == 1


@pytest.mark.parametrize(
    ("job", "factors", "sentence"),
    [
        ("count", "number = 1\nsped = 1",
         r"some.toml:6: \[factors\] has no key 'sped': did you mean speed\?"),
        ("count", "speed = 1", "factors.number is missing: the job count needs it"),
        ("count", 'number = "many"', r"some.toml:5: number is 'many', expected a whole number"),
        ("count", "number = 1.5", "number is 1.5, expected a whole number"),
        ("count", "number = []", "number has no values, expected one or more"),
        ("count", 'number = 1\nspeed = "none"', "speed is 'none', expected a number"),
        ("count", "number = 1\n[plot]\nz = 'speed'", "has no key 'z': expected measure, x, lines"),
        ("count", "number = 1\n[more]", "the file has no key 'more'"),
        ("measured", 'scene = "no*.stl"', r"scene: 'no\*.stl' matches no file in"),
        ("pres", "number = 1", 'job is \'pres\', expected "count" or "measured" or "module:func'),
    ],
)  # fmt: skip
def test_mistake_is_named_by_its_line(tmp_path, job, factors, sentence):
    with pytest.raises(ServiceError, match=sentence):
        study_of(tmp_path, factors, job=job)


def test_job_may_be_a_function_of_a_module(tmp_path):
    study = study_of(tmp_path, "number = 1", job="study_jobs:count")

    assert study.job is not None and len(study.conditions) == 1


def test_studies_that_are_shipped_can_be_read(monkeypatch):
    folder = ROOT / "bench" / "studies"
    counts = {
        name: len(read_study(folder / f"{name}.toml", JOBS).conditions) for name in ("force-error", "hunting")
    }

    assert counts == {"force-error": 5 * 4 * (9 + 1), "hunting": 6 * 4 * 3 * 2 * 8}


@pytest.mark.parametrize("job", [press, certificate], ids=["press", "certificate"])
def test_page_of_the_documentation_names_every_factor(job):
    page = (ROOT / "docs" / "guide" / "studies.md").read_text(encoding="utf-8")

    assert f"**`{job.__name__}`**" in page
    for name in inspect.signature(job).parameters:
        assert f"`{name}`" in page, name


def test_press_with_all_defaults_is_that_of_simulate():
    found, simulated = press(), simulate(Setup())

    assert found["force_error"] == simulated.force_error
    assert found["peak"] == simulated.felt.peak


def test_press_on_a_coupled_wall_is_tuned_unless_it_has_gains():
    tuned = press(wall="coupled", speed=0.5, latency=0.003)
    given = press(wall="coupled", stiffness=734.0, damping=4.4, latency=0.003)

    assert tuned["force_error"] == simulate(Setup(Wall.COUPLED, 0.5, 0.003)).force_error
    setup = Setup(Wall.COUPLED, latency=0.003, stiffness=734.0, damping=4.4)
    assert given["force_error"] == simulate(setup).force_error
    wall = best_coupled_wall(Hand(), 1000.0, 0.003)
    assert (tuned["stiffness_used"], tuned["damping_used"]) == (wall.stiffness, wall.damping)


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"wall": "coupled", "stiffness": 500.0}, "stiffness and damping belong together: expected both"),
        ({"speed": -1.0}, r"speed is -1.0, expected a number from .* \(m/s\)"),
        ({"wall": "springy"}, "wall is 'springy', expected one of real, coupled, decaff"),
    ],
)
def test_press_that_cannot_be_is_refused(values, sentence):
    with pytest.raises(ArgumentError, match=sentence):
        press(**values)


def test_press_on_a_real_wall_has_no_error():
    assert press(wall="real")["force_error"] == 0.0
    assert press(cable_stiffness=1000.0)["force_error"] > press()["force_error"]


def test_certificate_holds_or_does_not():
    found = certificate(scene=MESHES / "box.stl", ticks=1000, loop_seconds=0.02)

    assert found["worst_work"] >= found["typical_work"] > 0.0
    assert found["faces"] == 12 and found["fits"] in (0.0, 1.0) and "1 ms" in found["verdict"]


@pytest.fixture(scope="module", autouse=True)
def cores(tmp_path_factory):
    """Ray with two cores, started once: that takes seconds."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("PYTHONPATH", os.pathsep.join(IMPORT_PATHS))
        patched.setenv("STUDY_DONE", str(tmp_path_factory.mktemp("study") / "done.txt"))
        with study_run._ray(None, 2) as running:
            yield running


@pytest.fixture(autouse=True)
def nothing_done():
    """Clear the record of earlier tests."""
    Path(os.environ["STUDY_DONE"]).write_text("")


def done():
    """Return the number of runs by number."""
    return Counter(map(int, Path(os.environ["STUDY_DONE"]).read_text().split()))


def test_every_condition_has_a_row_with_its_origin(tmp_path):
    study, out = study_of(tmp_path, f"number = {list(range(20, 120))}\nspeed = 2"), tmp_path / "out"
    ended = run_study(study, out)
    rows = read_rows(out, study.conditions)

    assert (ended.total, ended.earlier, ended.done, ended.failed) == (100, 0, 100, 0)
    assert [(row["number"], row["square"], row["cube"]) for row in rows] == [
        (number, float(number**2), 2.0 * number**3) for number in range(20, 120)
    ]
    assert set(done().values()) == {1}
    assert all(rows[0][name] for name in ("proximity", "commit", "python", "numpy", "kernels", "processor"))
    with (out / "rows.csv").open() as stream:
        table = list(csv.DictReader(stream))
    assert [int(row["number"]) for row in table] == list(range(20, 120))
    assert {row["word"] for row in table} == {"'=1"}


def test_second_run_does_only_the_missing_conditions(tmp_path):
    out = tmp_path / "out"
    run_study(study_of(tmp_path, "number = [1, 2, 3]"), out)
    study = study_of(tmp_path, "number = [2, 3, 4, 5]")
    ended = run_study(study, out)

    assert (ended.total, ended.earlier, ended.done) == (4, 2, 2)
    assert set(done().values()) == {1}
    assert [row["number"] for row in read_rows(out, study.conditions)] == [2, 3, 4, 5]


def test_interrupted_run_counts_the_rows_that_it_wrote(tmp_path):
    seen, study = [], study_of(tmp_path, f"number = {list(range(1000, 1099))}")

    def watch(progress):
        if progress.done:  # on a loaded machine the first report may have none
            seen.append(progress)
            if len(seen) == 1:
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_study(study, tmp_path / "out", watch=watch)
    assert 0 < seen[-1].done == len(read_rows(tmp_path / "out", study.conditions))


def test_failed_job_is_a_row_with_its_error_and_is_tried_again_by_the_next_run(tmp_path):
    out, study = tmp_path / "out", study_of(tmp_path, "number = [12, 13, 14]")
    ended, again = run_study(study, out), run_study(study, out)
    row = next(row for row in read_rows(out, study.conditions) if row["number"] == 13)

    assert (ended.done, ended.failed) == (3, 1) and (again.earlier, again.done, again.failed) == (2, 1, 1)
    assert row["failure"] == "13 is an unlucky number" and row.get("square") is None
    assert len(read_rows(out, study.conditions)) == 3


def test_job_that_takes_its_worker_along_is_a_row_and_the_others_continue(tmp_path):
    out, study = tmp_path / "out", study_of(tmp_path, "number = [1, 2, 3, 666, 4, 5, 6, 7]")
    ended = run_study(study, out)
    failures = {row["number"]: row["failure"] for row in read_rows(out, study.conditions) if row["failure"]}

    assert (ended.total, ended.done, ended.failed) == (8, 8, 1)
    assert list(failures) == [666] and failures[666].startswith("its worker was lost: ")
    assert done()[666] == 3


def test_progress_has_rate_and_time_left():
    seen = Progress(total=100, earlier=20, done=30, failed=0, seconds=60.0)

    assert seen.rate == 0.5 and seen.seconds_left == 100.0
    assert Progress(5, 0, 0, 0, 0.0).seconds_left == float("inf")


PROGRAM = """
import sys
from pathlib import Path
from study_jobs import JOBS
from proximity.lab.study.study_file import read_study
from proximity.lab.study.study_run import run_study
ended = run_study(read_study(Path(sys.argv[1]), JOBS), Path(sys.argv[2]), cores=2)
print(ended.total, ended.earlier, ended.done)
"""


def program(study, out, pause):
    """Start a run in another process, with its own Ray."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(IMPORT_PATHS), "STUDY_PAUSE": pause}
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(study.path), str(out)], env=environment,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.mark.slow
def test_killed_study_continues_and_no_condition_is_lost_or_in_two_files(tmp_path):
    study, out = study_of(tmp_path, f"number = {list(range(1000, 1400))}"), tmp_path / "out"
    killed = program(study, out, "0.02")
    deadline = time.monotonic() + 120.0
    while not row_paths(out) and killed.poll() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    killed.send_signal(signal.SIGKILL)
    killed.communicate()
    written = {row["number"] for row in read_rows(out, study.conditions)}
    time.sleep(0.5)  # its workers exit with it
    resumed = program(study, out, "0")
    said, wrong = resumed.communicate(timeout=120)

    assert 0 < len(written) < 400
    assert said.split() == ["400", str(len(written)), str(400 - len(written))], wrong
    assert [row["number"] for row in read_rows(out, study.conditions)] == list(range(1000, 1400))
    assert sum(pyarrow.parquet.read_metadata(path).num_rows for path in row_paths(out)) == 400
    assert all(done()[number] == 1 for number in written)


def test_folder_of_another_run_or_with_a_damaged_file_is_refused(tmp_path):
    out, study = tmp_path / "out", study_of(tmp_path, "number = 1")
    run_study(study, out)
    with locked(out), pytest.raises(ServiceError, match=r"out: another study is running in it"):
        run_study(study, out)
    row_paths(out)[0].write_bytes(b"PAR1 and then nothing")
    with pytest.raises(ServiceError, match=r"parquet: cannot be read"):
        read_rows(out, study.conditions)
    (tmp_path / "file").write_text("")
    with pytest.raises(ServiceError, match=r"file/out: cannot be written \(Not a directory\)"):
        run_study(study, tmp_path / "file" / "out")


def test_ray_that_does_not_start_is_a_sentence(tmp_path, monkeypatch):
    def fail(**_):
        raise Exception("The current node timed out during startup.\nMore lines follow.")

    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", fail)
    sentence = r"^Ray cannot be started here \(The current node timed out during startup\.\)$"
    with pytest.raises(ServiceError, match=sentence):
        run_study(study_of(tmp_path, "number = 1"), tmp_path / "out")


def test_library_that_is_not_installed_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingLibraryError, match=r"a study needs pyarrow, which is not installed: pip inst"):
        run_study(study_of(tmp_path, "number = 1"), tmp_path / "out")


def test_ray_sends_nothing_to_its_makers():
    assert os.environ["RAY_USAGE_STATS_ENABLED"] == "0"
    usage = pytest.importorskip("ray._common.usage.usage_lib")  # in versions of Ray that have it
    assert not usage.usage_stats_enabled()


def rows_for(study):
    """Return rows as written by a run, without running."""
    return [
        {"key": one.key, **one.values, "failure": None, "square": one.values["number"] ** 2.0, "seconds": 1.0}
        for one in study.conditions
    ]


def test_figure_has_lines_and_panels_of_the_factors_that_vary(tmp_path):
    study = study_of(tmp_path, 'number = [1, 2, 30]\nspeed = [1, 2]\nwall = ["hard", "soft"]')
    rows = rows_for(study)
    write_figure(study, rows, tmp_path / "study.svg")
    drawn = (tmp_path / "study.svg").read_text()

    assert chosen_axes(study, rows) == {
        "measure": "square", "x": "number", "lines": "speed", "columns": "wall", "points": "median",
    }  # fmt: skip
    for words in ("number", "square", "speed = 2", "wall = soft"):
        assert f">{words}<" in drawn


def test_figure_of_the_axes_that_the_file_names(tmp_path):
    plot = '[plot]\nx = "stiffness"\nlines = "number"\npoints = "worst"'
    study = study_of(tmp_path, 'number = [1, 2]\nstiffness = ["none", 10, 1000]\nspeed = [1, 2]', tail=plot)
    write_figure(study, rows_for(study), tmp_path / "study.svg")

    assert ">number = 2<" in (tmp_path / "study.svg").read_text()
    wrong = study_of(tmp_path, "number = 1", tail='[plot]\nx = "sped"')
    with pytest.raises(ArgumentError, match=r"plot.x is 'sped', expected one of number, speed"):
        write_figure(wrong, rows_for(wrong), tmp_path / "study.svg")
    failed = [row | {"failure": "no"} for row in rows_for(study)]
    with pytest.raises(ArgumentError, match="no condition has results to draw"):
        write_figure(study, failed, tmp_path / "study.svg")


LISTENING = """
import os, sys
import psutil
from proximity.lab.study import study_run

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
    """Regression: it listened on all addresses, and any client of a port could run code."""
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
