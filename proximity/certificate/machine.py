"""Description of the machine that measured: processor, system, versions. No names of computers or people."""

import datetime
import importlib.metadata
import os
import platform
from pathlib import Path

PACKAGES = ("numpy", "numba")


def processor_name() -> str:
    """Return what the processor is called, with its widest vectors where the system tells."""
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
    """Return the versions of what has a share in how long a tick takes."""
    found = {name: importlib.metadata.version(name) for name in PACKAGES}
    return {"python": platform.python_version(), **found}


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
