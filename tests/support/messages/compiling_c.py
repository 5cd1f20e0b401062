"""The C compiler, if installed."""

import shutil
import subprocess

import pytest

WARNINGS = ["-Wall", "-Wextra", "-Werror", "-Wpedantic"]


def compiler(*names):
    """The first of these compilers that is installed; skip the test without any."""
    for name in names:
        if found := shutil.which(name):
            return found
    pytest.skip(f"there is no compiler {' or '.join(names)}")
    return None


def c_compiler():
    return compiler("cc", "gcc", "clang")


def run(*command):
    """Run a command that must succeed; return its output."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout
