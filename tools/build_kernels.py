"""Compile the kernels ahead of time: ``python tools/build_kernels.py [--target NAME] [--out FOLDER]``.

Without a target, for this machine, into ``proximity/native`` of the checkout: for the best set of
instructions of its processor. With ``--every-set``, or PROXIMITY_INSTRUCTIONS=all, for every set of the
target.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT / "tools"), str(ROOT)]
sys.dont_write_bytecode = True  # the sources are compared by their digest alone

from kernel_build.state import every_set_is_wanted, is_current  # noqa: E402 — needs the paths
from kernel_build.targets import TARGETS, Target, host_target, made_files  # noqa: E402


def main() -> None:
    """Build each requested target, or print the state of the builds."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--target", choices=sorted(TARGETS), action="append", help="a system; default: this one"
    )
    parser.add_argument(
        "--out", type=Path, default=ROOT / "proximity" / "native", help="folder of the extension"
    )
    parser.add_argument(
        "--every-set", action="store_true", default=every_set_is_wanted(), help="all instructions"
    )
    parser.add_argument("--state", action="store_true", help="print the state of the builds only")
    parser.add_argument(
        "--isolated", action="store_true", help="install what compiling takes into a temporary folder first"
    )
    options = parser.parse_args()
    targets = [TARGETS[name] for name in options.target] if options.target else [host_target()]
    for target in targets if options.state else []:
        made = made_files(target, options.out, every_set=options.every_set)
        files = os.pathsep.join(map(str, made))
        print(f"target={target.name}\nwheel={target.wheel}\nfiles={files}")
        print(f"is_current={'yes' if is_current(target, options.out, every_set=options.every_set) else 'no'}")
    if not options.state:
        if options.isolated and not all(map(find_spec, ("numba", "numpy", "scipy", "ziglang"))):
            _begin_with_requirements()
        _fix_order()
        _build(targets, options.out, every_set=options.every_set)


def _begin_with_requirements() -> None:
    """Restart with the build requirements, installed in a temporary folder."""
    with tempfile.TemporaryDirectory() as folder:
        wanted = ROOT / "tools" / "kernel_build" / "requirements.txt"
        pip = sys.executable, "-m", "pip", "install", "--quiet", "--target", folder, "--requirement"
        subprocess.run([*pip, str(wanted)], check=True)
        again = subprocess.run(
            [sys.executable, *sys.argv], env=os.environ | {"PYTHONPATH": folder}, check=False
        )
    raise SystemExit(again.returncode)


def _fix_order() -> None:
    """Restart with a fixed hash seed: numba iterates over sets, and builds must be reproducible."""
    if os.environ.get("PYTHONHASHSEED") != "0":
        again = subprocess.run(
            [sys.executable, *sys.argv], env=os.environ | {"PYTHONHASHSEED": "0"}, check=False
        )
        raise SystemExit(again.returncode)


def _build(targets: list[Target], folder: Path, *, every_set: bool) -> None:
    os.environ["PROXIMITY_ISA"] = "jit"  # kernels are declared to numba in this process
    os.environ["NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING"] = "1"  # of each type that does not fit
    from proximity.native import jit

    jit.is_kept = False
    from kernel_build.build import build

    for path in build(targets, folder, every_set=every_set):
        print(path)


if __name__ == "__main__":
    main()
