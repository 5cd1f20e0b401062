"""Configuration of all tests: real parts, settings of hypothesis, and tiers."""

import os
import signal
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy.testing  # noqa: F401  NumPy 1.26 starts a process when it is imported
import pytest
from hypothesis import HealthCheck, settings
from project import SHARED_DATA, TESTS

import proximity
from proximity.native import IS_AHEAD
from proximity.system.file_cache import FOLDER_VARIABLE

# Background jobs and nohup start the suite with signals ignored, which programs inherit and keep. Tests that
# send signals need the defaults.
for _name, _handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if getattr(signal, _name, None) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), _handler)


# Caches of commands are in a temporary folder, not in the user's.
_CACHE = tempfile.TemporaryDirectory(prefix="proximity-test-cache-")
os.environ[FOLDER_VARIABLE] = _CACHE.name

settings.register_profile("default", deadline=None)  # the first call compiles, for an unknown time
settings.register_profile(
    "ci", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow], print_blob=True
)
settings.load_profile("ci" if os.environ.get("CI") else "default")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real parts next to the project; tests that need it are skipped without it."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the real parts (shared/data beside the project) are not here")
    return SHARED_DATA


NO_INTERNALS = "internals of compiled code: run with PROXIMITY_ISA=jit"
NO_BROWSER = "the page in a browser: run PROXIMITY_BROWSER=1 python -m pytest -n 0 -m browser by itself"
"""Browsers render in software here, with all cores."""
TESTS_OF_PROCESSES = {"bench", "cli", "examples", "service", "transport", "web"}
"""Folders whose tests start processes, measure time, or use a unique resource of the machine."""
MORE_TESTS_OF_PROCESSES = {
    "test_concurrency.py", "test_frame_log.py", "test_glove_to_drum.py", "test_readme.py",
    "test_receiver_c.py", "test_stopping.py", "test_study.py",
}  # fmt: skip
"""Files in other folders that do the same."""


FIRST_TIER = {
    "formats", "kernels", "mesh", "message", "native", "properties", "recording", "requirements", "scene",
    "system", "tracker",
}  # fmt: skip
"""Folders of the first tier: tests start no process, open no port and need only the group ``test``."""
LATER_TESTS = {
    "test_clients.py", "test_clients_service.py", "test_documentation.py", "test_hostile_text.py",
    "test_kernel_build.py", "test_kernels_uncompiled.py", "test_message_blank.py", "test_message_header.py",
    "test_modes.py", "test_picture.py", "test_refusals.py", "test_release.py", "test_step.py",
    "test_step_cache.py", "test_step_with_occ.py", "test_deviation.py",
}  # fmt: skip
"""Files in these folders that start processes, take minutes, or need the group ``test-all``."""
LONG_TESTS = {
    "test_decaff_calibration_tasks.py", "test_documentation.py", "test_kernel_build.py",
    "test_kernels_uncompiled.py", "test_measurements.py", "test_modes.py", "test_study.py",
}  # fmt: skip
"""Files of a few tests that take minutes: they run first, so that all workers finish together."""
LATER_MARKS = ("browser", "processes", "slow")
MARKS = ("internals", *LATER_MARKS)
EVENTS_OF_PROCESSES = {"os.fork", "os.forkpty", "os.posix_spawn", "socket.bind", "subprocess.Popen"}
_guarded: list[str] = []
"""The running test of the first tier."""


def is_in_first_tier(path: Path) -> bool:
    """Test whether a file is in the first tier; `LATER_MARKS` exclude single tests."""
    folder, *below = path.relative_to(TESTS).parts
    is_listed = folder in FIRST_TIER if below else True
    return is_listed and path.name not in LATER_TESTS | MORE_TESTS_OF_PROCESSES


def has_later_mark(path: Path) -> bool:
    """Test whether the text of a file has a mark of `LATER_MARKS`."""
    text = path.read_text(encoding="utf-8")
    return any(f"mark.{mark}" in text for mark in LATER_MARKS)


def is_marked_later(item: pytest.Item) -> bool:
    """Test whether a test is not in the first tier although its file is."""
    return any(item.get_closest_marker(mark) for mark in LATER_MARKS)


def is_first(item: pytest.Item) -> bool:
    """Test whether a test is in the first tier."""
    return is_in_first_tier(item.path) and not is_marked_later(item)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that select all tests or those of later tiers."""
    parser.addoption("--everything", action="store_true", help="Run all tests, not only the first tier.")
    parser.addoption("--rest", action="store_true", help="Run all tests but those of the first tier.")


def pytest_configure(config: pytest.Config) -> None:
    """Run all tests if paths or marks are given; workers of pytest-xdist have the arguments of their run."""
    is_chosen = config.args_source is pytest.Config.ArgsSource.ARGS or config.option.markexpr
    if is_chosen or config.option.rest:
        config.option.everything = True


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Ignore files without a wanted test, by their text: some need more packages, many compile."""
    if collection_path.suffix != ".py":
        return None
    if config.option.markexpr in MARKS:
        return None if config.option.markexpr in collection_path.read_text(encoding="utf-8") else True
    if config.option.rest and is_in_first_tier(collection_path):
        return None if has_later_mark(collection_path) else True
    return None if config.option.everything or is_in_first_tier(collection_path) else True


def _refuse_processes(event: str, arguments: tuple[Any, ...]) -> None:
    if _guarded and event in EVENTS_OF_PROCESSES:
        pytest.fail(f"{_guarded[0]} is in the first tier and raises {event}: mark it with `processes`")


sys.addaudithook(_refuse_processes)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Forbid processes and open ports during tests of the first tier."""
    if is_first(item):
        _guarded.append(item.nodeid)
    try:
        return (yield)
    finally:
        _guarded.clear()


def has_processes(path: Path) -> bool:
    """Test whether the tests of a file start programs, and need compiled kernels."""
    return path.parent.name in TESTS_OF_PROCESSES or path.name in MORE_TESTS_OF_PROCESSES


@pytest.fixture(autouse=True)
def kernels_of_programs(request: pytest.FixtureRequest) -> None:
    """Compile all kernels before tests of programs, whose output would contain a note on compiling.

    Tests of internals compile only the kernels they call: all of them take six minutes.
    """
    is_of_internals = request.node.get_closest_marker("internals") is not None
    if has_processes(request.path) and not is_of_internals and not proximity.kernels_are_cached():
        proximity.warm_up()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip tests whose requirements are missing; start with the files that take longest."""
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
