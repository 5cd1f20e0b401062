"""What all tests share: where the real parts lie, and how hypothesis runs."""

import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

import proximity

# A suite in the background, or one that may not hang up, is started with signals ignored, and programs
# rightly leave them so. Tests that send them mean a program in the foreground.
for _name, _handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if getattr(signal, _name, None) and signal.getsignal(getattr(signal, _name)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), _handler)

SHARED_DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"

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


PROCESSES = (
    "test_bench",
    "test_cli",
    "test_concurrency",
    "test_demo",
    "test_frame_log",
    "test_glove_to_drum",
    "test_readme",
    "test_receiver",
    "test_service",
    "test_serving",
    "test_stopping",
    "test_transport",
)
"""Files whose tests start processes, look at clocks, or use what a machine has once."""


@pytest.fixture(autouse=True)
def kernels_of_programs(request: pytest.FixtureRequest) -> None:
    """Have the tests of programs begin with compiled kernels: a program says that it compiles."""
    if request.path.name.startswith(PROCESSES) and not proximity.kernels_are_cached():
        proximity.warm_up(workers=-1)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With pytest-xdist: a file stays with one worker, and so do all that start processes."""
    if config.pluginmanager.hasplugin("xdist"):
        for item in items:
            file = item.path.name
            group = "processes" if file.startswith(PROCESSES) else file
            item.add_marker(pytest.mark.xdist_group(group))
