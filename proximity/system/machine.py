"""Describe the processor, system and versions of this machine, without names of computers or users."""

import datetime
import importlib.metadata
import os
import platform
import subprocess
from functools import lru_cache
from pathlib import Path

from proximity.native import MODE

CHECKOUT = Path(__file__).resolve().parents[2]
"""Folder of the project, if this is a checkout of it."""


def processor_name() -> str:
    """Return the name of the processor, with its widest vector instructions if known."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = [line.partition(":") for line in cpuinfo.read_text().split("\n\n")[0].splitlines()]
        fields = {key.strip(): value.strip() for key, _, value in lines}
        if "model name" in fields:
            flags = fields.get("flags", "").split()
            widest = next((each for each in ("avx512f", "avx2") if each in flags), "sse")
            kind = f"family {fields.get('cpu family', '?')} model {fields.get('model', '?')}"
            return f"{fields['model name']} ({kind}, {widest})"
    return platform.processor() or platform.machine()


def versions() -> dict[str, str]:
    """Return the versions that affect the duration of a tick."""
    return {
        "python": platform.python_version(),
        "numpy": importlib.metadata.version("numpy"),
        "kernels": MODE,
    }


@lru_cache(maxsize=1)
def commit() -> str:
    """Return the short commit of the checkout that contains this program, or "none" if it is installed."""
    short = _git("rev-parse", "--short", "HEAD")
    if not short:
        return "none"
    return short + (" with changes" if _git("status", "--porcelain") else "")


def _git(*words: str) -> str:
    if not (CHECKOUT / ".git").exists():  # installed; the folder may be in another checkout
        return ""
    try:
        done = subprocess.run(["git", *words], cwd=CHECKOUT, capture_output=True, text=True, check=False)
    except OSError:  # git is not installed
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def describe() -> dict[str, object]:
    """Return processor, number of cores, system, load and date, for JSON."""
    loads = os.getloadavg() if hasattr(os, "getloadavg") else ()
    return {
        "processor": processor_name(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.release()} {platform.machine()}",
        "load": [round(load, 2) for load in loads],
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
    }
