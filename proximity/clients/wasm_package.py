"""The engine for browsers as a folder of ES modules: WebAssembly, types, and the layout of contacts."""

import os
import subprocess
import sys
from pathlib import Path

import proximity
from proximity.clients import client_files, license_text
from proximity.core.library_in_c import NATIVE
from proximity.errors import ProximityError
from proximity.message.javascript_layout import layout_types
from proximity.system.whole_file import write_files

HERE = Path(__file__).parent / "wasm"
MODULES = ("proximity.plain.wasm", "proximity.relaxed.wasm")
"""A checkout may have only the second, for browsers with relaxed vector instructions."""
EXAMPLES = {"example.mjs", "imported.mjs", "imported_worker.mjs"}
CLIENT_FILES = ("proximity_client.mjs", "layout.mjs")
"""From the service's client: its clock, and the layout of contacts."""
TOOL = Path(proximity.__file__).parent.parent / "tools" / "build_kernels.py"
BUILD = "python tools/build_kernels.py --target wasm32 --every-set --isolated"


def package_files() -> dict[str, str | bytes]:
    """Return the files of the package by name, `proximity.plain.wasm` only if it is compiled.

    A checkout compiles the other one if it is missing.
    """
    if not (NATIVE / MODULES[1]).is_file():
        _compile()
    found = [name for name in MODULES if (NATIVE / name).is_file()]
    own = {
        path.name: path.read_text(encoding="utf-8").replace("@VERSION@", proximity.__version__)
        for path in sorted(HERE.iterdir())
        if path.is_file()
    }
    client = client_files("javascript")
    return {
        **own,
        **{name: client[name] for name in CLIENT_FILES},
        "layout.d.mts": layout_types(),
        "LICENSE": license_text(),
        **{name: (NATIVE / name).read_bytes() for name in found},
    }


def _compile() -> None:
    """Compile the engine for browsers in the checkout."""
    if TOOL.is_file():
        print("compiling the engine for browsers, once: about a minute", file=sys.stderr, flush=True)
        command = [sys.executable, os.fspath(TOOL), "--target", "wasm32", "--isolated"]
        done = subprocess.run(command, check=False, stdout=subprocess.DEVNULL)
        if done.returncode == 0:
            return
    raise ProximityError(
        f"the engine for browsers has not been compiled ({MODULES[1]}); wheels have it, and so has a "
        f"checkout after `{BUILD}`"
    )


def write_package(folder: str | os.PathLike[str]) -> dict[str, bool]:
    """Write the package into a folder; return, by path, whether a file was written; examples are kept."""
    return write_files(package_files(), folder, EXAMPLES)
