"""Compile the kernels ahead of time: ``python tools/build_kernels.py [--target linux-x86_64] [--out FOLDER]``.

Without a target, for this machine, into ``proximity/native`` of the checkout.
"""

import argparse
import os
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
os.environ["PROXIMITY_ISA"] = "jit"  # kernels are declared to numba in this process
sys.path[:0] = [str(ROOT / "tools"), str(ROOT)]

from kernel_build.build import build, extension_path, host_target, is_current  # noqa: E402 — needs the paths
from kernel_build.targets import TARGETS  # noqa: E402


def main() -> None:
    """Build for each target that was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--target", choices=sorted(TARGETS), action="append", help="a system; this one if not given")
    parser.add_argument("--out", type=Path, default=ROOT / "proximity" / "native", help="folder of the extension")
    parser.add_argument("--state", action="store_true", help="say what there is, and compile nothing")
    options = parser.parse_args()
    targets = [TARGETS[name] for name in options.target] if options.target else [host_target()]
    if options.state:
        for target in targets:
            print(f"target={target.name}\nwheel={target.wheel}\nextension={extension_path(target, options.out)}")
            print(f"is_current={'yes' if is_current(target, options.out) else 'no'}")
        return
    for path in build(targets, options.out):
        print(path)


if __name__ == "__main__":
    main()
