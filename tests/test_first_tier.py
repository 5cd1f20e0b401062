"""Tests run by ``python -m pytest``: they start no process, open no port, and need few packages."""

import os
import socket
import subprocess
import sys
import tomllib

import pytest
from project import ROOT

MAX_PACKAGES = 12


def bind():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))


@pytest.mark.parametrize(
    "act",
    [
        bind,
        pytest.param(
            lambda: os.fork() or os._exit(0),
            id="fork",
            marks=pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here"),
        ),
        pytest.param(lambda: subprocess.run([sys.executable, "-c", ""], check=True), id="run"),
    ],
)
def test_process_or_port_fails_a_test_of_the_first_tier(act):
    with pytest.raises(pytest.fail.Exception, match=r"test_process_or_port.*mark it with `processes`"):
        act()


@pytest.mark.processes
def test_marked_test_may_start_a_process():
    assert subprocess.run([sys.executable, "-c", ""], check=False).returncode == 0


@pytest.mark.processes
def test_path_selects_later_tests_in_every_worker():
    selected = ["tests/transport", "-k", "test_option_given_twice_is_refused"]
    command = [sys.executable, "-m", "pytest", "-n", "1", "-p", "no:cacheprovider", *selected]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)

    assert done.returncode == 0, done.stdout + done.stderr  # 5: no tests ran


def test_first_tier_needs_few_packages():
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]

    assert len(groups["test"]) <= MAX_PACKAGES
