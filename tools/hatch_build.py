"""Build hook: compiles kernels ahead of time for the checkout, and for wheels.

``PROXIMITY_TARGET`` names another system to build a wheel for, see ``kernel_build/targets.py``.
"""

import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

REQUIREMENTS = Path(__file__).with_name("kernel_build") / "requirements.txt"
"""Build requirements: internals of numba are used, so its version is fixed."""
PLACE = "proximity/native/{}"
SECONDS = 100


class KernelHook(BuildHookInterface):  # type: ignore[type-arg]
    """Compiles kernels unless they are up to date."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        """Return the requirements of this build.

        Installers ask in a process whose arguments name the hook, as ``get_requires_for_build_editable``.
        """
        is_editable = any(argument.endswith("_editable") for argument in sys.argv)
        if self.target_name != "wheel" or self._is_current(every_set=not is_editable):
            return []
        return REQUIREMENTS.read_text(encoding="ascii").split()

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile, and set the files of a wheel."""
        if self.target_name != "wheel":
            return
        every_set = version != "editable"  # a wheel is for all processors of its system
        state = self._state(every_set=every_set)
        if not self._is_current(every_set=every_set):
            self._say(
                f"compiling kernels for {state['target']} ahead of time, at most {SECONDS} s on two cores"
            )
            started = time.perf_counter()
            try:
                targets = "--target", state["target"], *self._web_target(every_set)
                self._tool(*targets, *self._sets(every_set))
            except subprocess.CalledProcessError:
                if version != "editable":
                    raise
                self._say(
                    "compiling failed: numba compiles kernels when they are called; drums and the "
                    "page in the browser do not run"
                )
                return
            self._say(f"compiled in {time.perf_counter() - started:.0f} s")
        if version != "editable":
            build_data["pure_python"] = False
            build_data["tag"] = f"cp311-abi3-{state['wheel']}"
            modules = self._state("wasm32", every_set=True)["files"]
            for made in f"{state['files']}{os.pathsep}{modules}".split(os.pathsep):
                build_data["force_include"][made] = PLACE.format(Path(made).name)

    def _state(self, target: str | None = None, *, every_set: bool) -> dict[str, str]:
        """Return name, tag and files of the target, and whether they are up to date."""
        chosen = ["--target", target] if target else self._target()
        lines = self._tool("--state", *chosen, *self._sets(every_set), capture=True).splitlines()
        return dict(line.split("=", 1) for line in lines)

    def _is_current(self, *, every_set: bool) -> bool:
        targets = None, *self._web_target(every_set)[1:]
        states = (self._state(target, every_set=every_set)["is_current"] for target in targets)
        return all(state == "yes" for state in states)

    def _web_target(self, every_set: bool) -> list[str]:
        """Return the modules for browsers: a checkout compiles them on first use, or with all sets."""
        is_wanted = every_set or os.environ.get("PROXIMITY_INSTRUCTIONS") == "all"
        return ["--target", "wasm32"] if is_wanted else []

    def _sets(self, every_set: bool) -> list[str]:
        return ["--every-set"] if every_set else []

    def _target(self) -> list[str]:
        target = os.environ.get("PROXIMITY_TARGET")
        return ["--target", target] if target else []

    def _tool(self, *options: str, capture: bool = False) -> str:
        tool = str(Path(self.root, "tools", "build_kernels.py"))
        output = subprocess.PIPE if capture else None
        done = subprocess.run([sys.executable, tool, *options], check=True, text=True, stdout=output)
        return done.stdout or ""

    def _say(self, sentence: str) -> None:
        print(f"proximity: {sentence}", file=sys.stderr, flush=True)
