"""Fixtures of the pytest-benchmark suites: contenders built once, answers compared, one table for each case.

``python -m pytest bench`` runs all suites, ``python -m pytest bench -k "points and plate"`` a part. One group
is one query of one case; its rows are the contenders. Times are those of one point, ray or call, in processor
time, so that other programs do not count, and in wall-clock time for frames. Libraries that are not installed
are left out and named below the tables. `report.py` compares more fairly, since it interleaves; these suites
also cover functions without rivals, from commit to commit.
"""

from benchmarks.support import threads

threads.limit_to_one_thread()

import time

import pytest

from benchmarks.queries import agreement, cases
from benchmarks.queries.agreement import OURS
from benchmarks.rivals import registry
from benchmarks.rivals.embreex import Embreex
from benchmarks.rivals.ours import Proximity, ProximityTree
from benchmarks.rivals.trimesh import Trimesh

DEFAULTS = {
    # pytest-benchmark's default and ours
    "benchmark_max_time": ("1.0", "0.1"),  # s, of one row
    "benchmark_timer": ("time.perf_counter", "time.process_time"),
    "benchmark_sort": ("min", "median"),
    "benchmark_columns": ("None", ["min", "median", "max", "rounds"]),
    "benchmark_disable_gc": ("False", True),
}
SMALL_CONTENDERS = (Proximity, ProximityTree, Trimesh, Embreex)
TIMES = ("min", "max", "mean", "median", "stddev", "iqr")
PAIR_COUNT, SMALL_PAIR_COUNT = 2_000_000, 20_000  # queries times faces that the oracle computes
ROUND_S = 20e-6  # a shorter call is repeated within a round
MAX_ROUNDS = 1000
SLOW_S = 0.5  # a longer call is timed once

left_out: dict[str, str] = {}


def pytest_addoption(parser):
    """Add the option of the suites."""
    parser.addoption("--small", action="store_true", help="smoke test: small meshes, no figures")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config):
    """Replace defaults of pytest-benchmark; options given on the command line stay."""
    config.option.dist = "no"  # of pytest-xdist: one process measures
    for name, (theirs, ours) in DEFAULTS.items():
        if str(getattr(config.option, name)) == theirs:
            setattr(config.option, name, ours)
    if config.getoption("--small"):
        config.option.benchmark_disable = True
        cases.MESHES.update(dict.fromkeys(cases.MESHES, cases.MESHES["ball"]))
        registry.CONTENDERS = SMALL_CONTENDERS


def pytest_collection_modifyitems(items):
    """Ignore warnings of the rivals."""
    for item in items:
        item.add_marker(pytest.mark.filterwarnings("ignore"))


def pytest_terminal_summary(terminalreporter):
    """Print the omitted cases and the reasons."""
    for name, reason in left_out.items():
        terminalreporter.write_line(f"left out: {name} ({reason})")


@pytest.hookimpl(tryfirst=True)
def pytest_benchmark_group_stats(benchmarks):
    """Replace times in the tables by those of one query; JSON keeps those of the call."""
    for bench in benchmarks:
        for column in TIMES:
            bench[column] /= bench["extra_info"].get("count", 1)


@pytest.fixture(scope="session")
def made():
    """Objects built once: contenders by name and mesh, answers by case and question."""
    return {}


@pytest.fixture
def is_small(request):
    """Return whether this run is only a smoke test."""
    return request.config.getoption("--small")


@pytest.fixture
def leave_out():
    """Return a call that skips a test, and has the reason printed below the tables."""

    def skip(name, reason):
        left_out[name] = str(reason)
        pytest.skip(f"{name} is left out: {reason}")

    return skip


@pytest.fixture
def contender(made, leave_out):
    """Return a call for the contender *name* with its structure for a mesh (of `cases`), each built once."""

    def give(name, mesh_name, mesh=None):
        if (name, mesh_name) not in made:
            if name in left_out:
                leave_out(name, left_out[name])
            kinds = tuple(kind for kind in registry.CONTENDERS if kind.name == name)
            found, missing = registry.available(kinds)
            if missing:
                leave_out(name, missing[name])
            found[0].build(*(mesh or load_mesh(mesh_name, leave_out)))
            made[name, mesh_name] = found[0]
        return made[name, mesh_name]

    return give


def load_mesh(name, leave_out):
    """Return the mesh, or skip the test if it is missing."""
    try:
        return cases.load_mesh(name)
    except cases.MissingMeshError as reason:
        leave_out(name, reason)


@pytest.fixture
def load_case(leave_out):
    """Return a call that makes the case *name*, or skips if its mesh is missing."""

    def load(name, query_count):
        load_mesh(name.partition("/")[0], leave_out)
        return cases.make_case(name, query_count)

    return load


@pytest.fixture
def timed(benchmark, request):
    """Return a call that times *run*, which answers *count* queries, as a row called *who* of a group."""

    def time_it(who, group, run, count=1, *, arguments=None):
        benchmark.name, benchmark.group = who, group
        benchmark.extra_info["count"] = count
        if benchmark.disabled:
            return benchmark.pedantic(run, setup=arguments)
        if arguments is not None:  # other ones each time
            return benchmark.pedantic(run, setup=arguments, rounds=MAX_ROUNDS, warmup_rounds=20)
        seconds = _seconds(run)
        if seconds < SLOW_S:
            seconds = min(seconds, _seconds(run))
        budget = float(request.config.option.benchmark_max_time)
        iterations = max(1, round(ROUND_S / seconds))
        rounds = min(MAX_ROUNDS, max(3, round(budget / (seconds * iterations))))
        return benchmark.pedantic(run, rounds=1 if seconds > SLOW_S else rounds, iterations=iterations)

    return time_it


def _seconds(run):
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


@pytest.fixture
def compared(made, contender, is_small):
    """Return a call that compares a contender's answers with the oracle's and ours."""

    def compare(asked, case, mesh_name, question):
        key = case.name, len(case.points), question
        if key not in made:
            own = contender(OURS, mesh_name)
            made[key] = agreement.answers_of(own, case, question)
            found = agreement.check_all(
                case, question, [own], pair_count=SMALL_PAIR_COUNT if is_small else PAIR_COUNT
            )[OURS]
            wrong = found.off_count + found.wrong_sign_count
            assert not wrong, f"{wrong} of our {found.checked_count} answers are wrong"
        if asked.name == OURS:
            return ""
        answers = agreement.answers_of(asked, case, question)
        return _words(agreement.compare(case, answers, made[key], OURS, asked.name))

    return compare


def _words(found):
    wrong = [(found.off_count, "lengths"), (found.wrong_sign_count, "signs")]
    remarks = [f"{count} of {found.checked_count} {what} wrong" for count, what in wrong if count]
    return f" ({', '.join(remarks)})" if remarks else ""


@pytest.fixture
def ask_case(timed, contender, compared, load_case):
    """Return a call that compares and times the answers of one contender, as a row of the group."""

    def ask(title, question, case_name, count, name):
        case, mesh_name = load_case(case_name, count), case_name.partition("/")[0]
        asked = contender(name, mesh_name)
        remark = compared(asked, case, mesh_name, question)
        asked_count = min(count, asked.query_limit or count)
        remark += f" ({asked_count} asked)" if asked_count < count else ""
        group = f"{title}, {case_name}, {len(case.faces):,} faces, {count} a call"
        timed(f"{name} {asked.version}{remark}", group, agreement.ask(asked, case, question).run, asked_count)

    return ask
