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


@pytest.fixture
def kernel_build(monkeypatch):
    """The package of the build, with its modules."""
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import kernel_build
    from kernel_build import kept_code, objects, targets  # noqa: F401 — members of the package

    return kernel_build


def build(*options: str) -> str:
    """Run the tool; return its output."""
    done = subprocess.run(
        [sys.executable, TOOL, *options], capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def kept_codes(kernel_build):
    """The files with the codes that the last build has kept, the shortest first."""
    paths = sorted(kernel_build.kept_code.FOLDER.glob("*.z"), key=lambda path: path.stat().st_size)
    if not paths:
        pytest.skip("no build has kept its code")
    return paths


@pytest.mark.slow
@pytest.mark.skipif(not native.IS_AHEAD, reason="there is nothing to compare with")
def test_building_again_gives_the_same_bytes(kernel_build, tmp_path):
    """Code of all kernels is new, and linked again; objects of equal code are kept: see the next test."""
    native_folder = ROOT / "proximity" / "native"
    installed = next(native_folder.glob("_kernels*"))
    has_every_set = "yes" in build("--state", "--every-set").split("is_current=")[1]
    sets = ["--every-set"] if has_every_set else []
    codes = kept_codes(kernel_build)
    for code in codes:
        code.unlink()
    made = [Path(each) for each in build("--out", str(tmp_path), *sets).split()]

    assert kept_codes(kernel_build) == codes
    assert installed.name in {path.name for path in made}
    for path in made:
        assert path.read_bytes() == (native_folder / path.name).read_bytes(), path.name
    assert b"site-packages" not in installed.read_bytes()  # nor does it contain the path of the build


@pytest.mark.slow
def test_objects_of_the_same_code_are_the_same(kernel_build):
    """The shorter module for each set of this system, in another process than that of the earlier build."""
    kept, target = kernel_build.kept_code, kernel_build.targets.host_target()
    _, code = kept.read(tuple(map(int, kept_codes(kernel_build)[0].stem.split("-")[1:])))
    objects = {each: kept.read_object(code, target, each) for each in target.sets}
    if not any(objects.values()):
        pytest.skip("no build has kept its objects")
    for each in filter(objects.get, target.sets):
        assert kernel_build.objects.emit_object(code, target, each) == objects[each], each.name


def test_what_there_is_is_told_without_building():
    state = dict(line.split("=", 1) for line in build("--state").splitlines())

    assert state["is_current"] == ("yes" if native.IS_AHEAD else "no")
    assert Path(state["files"].split(os.pathsep)[0]).parent == ROOT / "proximity" / "native"


def test_code_that_asks_for_what_is_not_there_is_refused(kernel_build):
    code = """
    declare void @numba_do_raise(i8*)
    define void @bad(i8* %x) {
        call void @numba_do_raise(i8* %x)
        ret void
    }
    """
    target = kernel_build.targets.TARGETS["linux-x86_64"]
    with pytest.raises(SystemExit, match="kernels need numba_do_raise, which the engine does not have"):
        kernel_build.objects.emit_object(code, target, target.sets[0])


def test_references_are_not_counted_up_and_down_again(kernel_build):
    """Regression: a call in each step of a loop; checksums of a saved scene took five times as long."""
    code = """
    declare void @NRT_incref(i8*)
    declare void @NRT_decref(i8*)
    define void @proximity_entry_pair(i8* %x) {
        call void @NRT_incref(i8* %x)
        call void @NRT_decref(i8* %x)
        ret void
    }
    """
    target = kernel_build.targets.TARGETS["linux-x86_64"]
    assert b"NRT_incref" not in kernel_build.objects.emit_object(code, target, target.sets[0])
