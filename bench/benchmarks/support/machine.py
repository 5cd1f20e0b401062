"""The machine on which figures were taken: processor, versions, commit, date and load."""

import datetime
import importlib.metadata
import os
import platform
import subprocess

from benchmarks.support.project import PROJECT
from proximity.certificate.machine import processor_name
from proximity.native import MODE


def describe_machine(threads: str) -> dict[str, str]:
    """Return where, when and with what figures are taken; *threads* is a sentence of `support.threads`."""
    versions = [f"numpy {importlib.metadata.version('numpy')}", f"kernels {MODE}"]
    loads = os.getloadavg() if hasattr(os, "getloadavg") else ()
    return {
        "processor": processor_name(),
        "system": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "python": ", ".join([f"Python {platform.python_version()}", *versions]),
        "threads": threads,
        "commit": _commit(),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "load": ", ".join(f"{load:.1f}" for load in loads) or "unknown",
    }


def _commit():
    def git(*words):
        done = subprocess.run(["git", *words], cwd=PROJECT, capture_output=True, text=True, check=False)
        return done.stdout.strip() if done.returncode == 0 else ""

    commit = git("rev-parse", "--short", "HEAD")
    if not commit:
        return "none"
    return commit + (" with changes" if git("status", "--porcelain") else "")
