"""The measuring machine: processor, versions, commit, date and load."""

import datetime
import importlib.metadata
import os
import platform

from proximity.native import MODE
from proximity.system.machine import commit, processor_name


def describe_machine(threads: str) -> dict[str, str]:
    """Return place, time and conditions of figures; *threads* is a sentence of `support.threads`."""
    versions = [f"numpy {importlib.metadata.version('numpy')}", f"kernels {MODE}"]
    loads = os.getloadavg() if hasattr(os, "getloadavg") else ()
    return {
        "processor": processor_name(),
        "system": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores",
        "python": ", ".join([f"Python {platform.python_version()}", *versions]),
        "threads": threads,
        "commit": commit(),
        "date": datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "load": ", ".join(f"{load:.1f}" for load in loads) or "unknown",
    }
