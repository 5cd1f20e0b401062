"""What all tests share: where the real parts lie, and how hypothesis runs."""

import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings
from project import SHARED_DATA, TESTS

import proximity
from proximity.native import IS_AHEAD
from proximity.system.file_cache import FOLDER_VARIABLE

# A suite in the background, or one that may not hang up, is started with signals ignored, and programs
# rightly leave them so. Tests that send them mean a program in the foreground.
for _name, _handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if getattr(signal, _name, None) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), _handler)


# What commands keep for the next one is not the user's in tests, and goes with the run.
_CACHE = tempfile.TemporaryDirectory(prefix="proximity-test-cache-")
os.environ[FOLDER_VARIABLE] = _CACHE.name

settings.register_profile("default", deadline=None)  # a first call compiles, which no deadline can know
settings.register_profile(
    "ci", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile("ci" if os.environ.get("CI") else "default")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real parts beside the project; tests that need it are skipped where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the real parts (shared/data beside the project) are not here")
    return SHARED_DATA


NO_INTERNALS = "internals of compiled code: run with PROXIMITY_ISA=jit"
NO_BROWSER = "the page in a browser: run PROXIMITY_BROWSER=1 python -m pytest -n 0 -m browser by itself"
"""Pictures are drawn in software here, which takes the machine of all other tests."""
TESTS_OF_PROCESSES = {"bench", "cli", "examples", "service", "transport", "web"}
"""Folders whose tests start processes, look at clocks, or use what a machine has once."""
MORE_TESTS_OF_PROCESSES = {
    "test_concurrency.py", "test_frame_log.py", "test_glove_to_drum.py", "test_readme.py",
    "test_receiver_c.py", "test_stopping.py", "test_study.py",
}  # fmt: skip
"""Files elsewhere that do so too."""


FIRST_TIER = {
    "formats", "kernels", "mesh", "message", "native", "properties", "recording", "scene", "system",
    "tracker",
}  # fmt: skip
"""Folders of the tests that run without --everything: no process, no port, only the extra ``test``."""
LATER_TESTS = {
    "test_clients.py", "test_clients_service.py", "test_documentation.py", "test_hostile_text.py",
    "test_kernel_build.py", "test_kernels_uncompiled.py", "test_message_blank.py", "test_message_header.py",
    "test_modes.py", "test_picture.py", "test_refusals.py", "test_release.py", "test_step.py",
    "test_step_cache.py",
}  # fmt: skip
"""Files in these folders that start processes, take minutes, or need the extra ``test-all``."""
LONG_TESTS = {
    "test_decaff_calibration_tasks.py", "test_documentation.py", "test_kernel_build.py",
    "test_measurements.py", "test_modes.py", "test_study.py",
}  # fmt: skip
"""Files of few tests that take minutes: the workers of a run begin with them, and so end together."""
LATER_MARKS = ("browser", "processes", "slow")
EVENTS_OF_PROCESSES = {"os.fork", "os.forkpty", "os.posix_spawn", "socket.bind", "subprocess.Popen"}
_guarded: list[str] = []
"""The test of the first tier that runs now."""


def is_in_first_tier(path: Path) -> bool:
    """Whether the tests of a file run without --everything; single ones may be marked as later ones."""
    folder, *below = path.relative_to(TESTS).parts
    is_listed = folder in FIRST_TIER if below else True
    return is_listed and path.name not in LATER_TESTS | MORE_TESTS_OF_PROCESSES


def is_marked_later(item: pytest.Item) -> bool:
    """Whether a test is not in the first tier although its file is."""
    return any(item.get_closest_marker(mark) for mark in LATER_MARKS)


def is_first(item: pytest.Item) -> bool:
    """Whether a test is in the first tier."""
    return is_in_first_tier(item.path) and not is_marked_later(item)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option for all tests."""
    parser.addoption("--everything", action="store_true", help="Run all tests, not only the first tier.")
    parser.addoption("--rest", action="store_true", help="Run all tests but those of the first tier.")


def pytest_configure(config: pytest.Config) -> None:
    """Run all tests of given paths and marks; workers of pytest-xdist have the arguments of their run."""
    is_chosen = config.args_source is pytest.Config.ArgsSource.ARGS or config.option.markexpr
    if is_chosen or config.option.rest:
        config.option.everything = True


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave out files of later tests, which may import packages that are not here."""
    if config.option.everything or collection_path.suffix != ".py":
        return None
    return None if is_in_first_tier(collection_path) else True


def _refuse_processes(event: str, arguments: tuple[Any, ...]) -> None:
    if _guarded and event in EVENTS_OF_PROCESSES:
        pytest.fail(f"{_guarded[0]} is in the first tier and raises {event}: mark it with `processes`")


sys.addaudithook(_refuse_processes)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Let no test of the first tier start a process or open a port."""
    if is_first(item):
        _guarded.append(item.nodeid)
    try:
        return (yield)
    finally:
        _guarded.clear()


def has_processes(path: Path) -> bool:
    """Whether the tests of a file start programs, and so begin with kernels compiled before."""
    return path.parent.name in TESTS_OF_PROCESSES or path.name in MORE_TESTS_OF_PROCESSES


@pytest.fixture(autouse=True)
def kernels_of_programs(request: pytest.FixtureRequest) -> None:
    """Have the tests of programs begin with compiled kernels: a program says that it compiles.

    Tests of internals start none, and compile what they call: all kernels take six minutes.
    """
    is_of_internals = request.node.get_closest_marker("internals") is not None
    if has_processes(request.path) and not is_of_internals and not proximity.kernels_are_cached():
        proximity.warm_up()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what this run has not, and begin with the files that take longest."""
    if config.option.rest or not config.option.everything:
        left = [item for item in items if is_first(item) == config.option.rest]
        config.hook.pytest_deselected(items=left)
        items[:] = [item for item in items if is_first(item) != config.option.rest]
    if IS_AHEAD:
        for item in items:
            if item.get_closest_marker("internals"):
                item.add_marker(pytest.mark.skip(reason=NO_INTERNALS))
    if not os.environ.get("PROXIMITY_BROWSER"):
        for item in items:
            if item.get_closest_marker("browser"):
                item.add_marker(pytest.mark.skip(reason=NO_BROWSER))
    counts = Counter(item.path for item in items)
    items.sort(key=lambda item: (item.path.name not in LONG_TESTS, -counts[item.path], item.path))
