"""The build of kernels: reproducible bytes, without unwanted content."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

import proximity
from proximity import native

ROOT = Path(proximity.__file__).parent.parent
TOOL = ROOT / "tools" / "build_kernels.py"
pytestmark = pytest.mark.skipif(
    not (TOOL.is_file() and importlib.util.find_spec("numba") and importlib.util.find_spec("ziglang")),
    reason="kernels are built from a checkout, with numba and ziglang",
)


def build(*options: str) -> str:
    """Run the tool; return its output."""
    done = subprocess.run(
        [sys.executable, TOOL, *options], capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.skipif(not native.IS_AHEAD, reason="there is nothing to compare with")
def test_building_again_gives_the_same_bytes(tmp_path):
    native_folder = ROOT / "proximity" / "native"
    installed = next(native_folder.glob("_kernels*"))
    has_every_set = "yes" in build("--state", "--every-set").split("is_current=")[1]
    sets = ["--every-set"] if has_every_set else []
    made = [Path(each) for each in build("--anew", "--out", str(tmp_path), *sets).split()]

    assert installed.name in {path.name for path in made}
    for path in made:
        assert path.read_bytes() == (native_folder / path.name).read_bytes(), path.name
    assert b"site-packages" not in installed.read_bytes()  # nor does it contain the path of the build


def test_what_there_is_is_told_without_building():
    state = dict(line.split("=", 1) for line in build("--state").splitlines())

    assert state["is_current"] == ("yes" if native.IS_AHEAD else "no")
    assert Path(state["files"].split(os.pathsep)[0]).parent == ROOT / "proximity" / "native"


def test_code_that_asks_for_what_is_not_there_is_refused(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    from kernel_build.objects import emit_object
    from kernel_build.targets import TARGETS

    code = """
    declare void @numba_do_raise(i8*)
    define void @bad(i8* %x) {
        call void @numba_do_raise(i8* %x)
        ret void
    }
    """
    target = TARGETS["linux-x86_64"]
    with pytest.raises(SystemExit, match="kernels need numba_do_raise, which the engine does not have"):
        emit_object(code, target, target.sets[0])
