"""Compiled code on disk: what is damaged is made anew, with one sentence; Ctrl-C is heard meanwhile."""

import os
import signal
import subprocess
import sys
import time

import pytest

COMPILE = """
import sys
from proximity.kernels.compiler import kernel
sys.path.insert(0, {folder!r})
import own_kernel
print(own_kernel.doubled(21.0))
"""


@pytest.fixture
def run(tmp_path):
    """Run a program that calls one small kernel; its compiled code is kept in a folder of the test's."""
    (tmp_path / "own_kernel.py").write_text(
        "from proximity.kernels.compiler import kernel\n\n\n@kernel\ndef doubled(x):\n    return 2.0 * x\n"
    )

    def start():
        program = [sys.executable, "-c", COMPILE.format(folder=str(tmp_path))]
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        ended = subprocess.run(program, env=environment, capture_output=True, text=True, timeout=120)
        assert (ended.returncode, ended.stdout) == (0, "42.0\n"), ended.stderr
        return ended.stderr

    start.cache = tmp_path / "cache"
    return start


@pytest.mark.parametrize("ending", ["nbi", "nbc"])
@pytest.mark.parametrize("damage", ["cut", "flipped", "noise", "folder"])
def test_damaged_code_is_made_anew_with_one_sentence(run, ending, damage):
    assert run() == ""
    (path,) = run.cache.rglob(f"own_kernel.doubled*.{ending}")
    data = bytearray(path.read_bytes())
    path.unlink()
    if damage == "folder":
        path.mkdir()
    else:
        data[len(data) // 2] ^= 1
        path.write_bytes({"cut": data[: len(data) // 2], "flipped": data, "noise": b"noise"}[damage])

    said = run()

    assert said.startswith("proximity: compiled kernels in ")
    assert said.count("\n") == 1 and "are damaged" in said
    assert run() == ""


SLOW = """
import sys, time, signal
from proximity.kernels import interruptible
slow = interruptible.interruptible(lambda types: time.sleep(60))
print("begun", flush=True)
try:
    slow(())
except KeyboardInterrupt:
    print("heard", flush=True)
"""


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_is_heard_while_something_compiles():
    program = subprocess.Popen([sys.executable, "-c", SLOW], stdout=subprocess.PIPE, text=True)
    assert program.stdout.readline() == "begun\n"
    time.sleep(0.2)
    program.send_signal(signal.SIGINT)
    assert program.communicate(timeout=20)[0] == "heard\n"


OWN_FUNCTION = """
import numba
from proximity.kernels import compiler

@compiler.kernel
def doubled(value):
    return 2.0 * value

@numba.njit
def user_function(value):
    return doubled(value) + 1.0

print(user_function(3.0), flush=True)
"""


def test_compiled_function_of_a_user_may_call_a_kernel(tmp_path):
    """Both wait for the lock of numba's compiler; one in another thread waited for ever."""
    (tmp_path / "own_function.py").write_text(OWN_FUNCTION, encoding="utf-8")
    ran = subprocess.run(
        [sys.executable, "own_function.py"],
        cwd=tmp_path,
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ran.stdout == "7.0\n", ran.stderr
