"""What all tests share: where the real parts lie, and how hypothesis runs."""

import os
import signal
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings
from project import SHARED_DATA

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
NO_BROWSER = "the page in a browser: run PROXIMITY_BROWSER=1 python -m pytest tests/web by itself"
"""Pictures are drawn in software here, which takes the machine of all other tests."""
TESTS_OF_PROCESSES = {"bench", "cli", "examples", "service", "transport", "web"}
"""Folders whose tests start processes, look at clocks, or use what a machine has once."""
MORE_TESTS_OF_PROCESSES = {
    "test_concurrency.py", "test_frame_log.py", "test_glove_to_drum.py", "test_readme.py",
    "test_receiver_c.py", "test_stopping.py", "test_study_run.py",
}  # fmt: skip
"""Files elsewhere that do so too."""


def has_processes(path: Path) -> bool:
    """Whether the tests of a file are kept in one worker, with kernels compiled before."""
    return path.parent.name in TESTS_OF_PROCESSES or path.name in MORE_TESTS_OF_PROCESSES


@pytest.fixture(autouse=True)
def kernels_of_programs(request: pytest.FixtureRequest) -> None:
    """Have the tests of programs begin with compiled kernels: a program says that it compiles."""
    if has_processes(request.path) and not proximity.kernels_are_cached():
        proximity.warm_up()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Skip what this run has not; with pytest-xdist a file stays with one worker, and all of processes do."""
    if IS_AHEAD:
        for item in items:
            if item.get_closest_marker("internals"):
                item.add_marker(pytest.mark.skip(reason=NO_INTERNALS))
    if not os.environ.get("PROXIMITY_BROWSER"):
        for item in items:
            if item.get_closest_marker("browser"):
                item.add_marker(pytest.mark.skip(reason=NO_BROWSER))
    if config.pluginmanager.hasplugin("xdist"):
        for item in items:
            group = "processes" if has_processes(item.path) else item.path.name
            item.add_marker(pytest.mark.xdist_group(group))
