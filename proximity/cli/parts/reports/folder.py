"""Report of ``proximity check`` on a folder.

Each file is checked in a separate process, with a time limit.
"""

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import typer

from proximity.cli import progress
from proximity.cli.options import Reading
from proximity.cli.output import counted, printable, write_document
from proximity.cli.tables import results_console, table_of
from proximity.formats.format_detection import EXTENSIONS
from proximity.scene.saved.archive import EXTENSION

Values = dict[str, Any]

SUFFIXES = {*EXTENSIONS, EXTENSION}
_PARTICULARS = re.compile(r"""'[^']*'|"[^"]*"|\d[\d_.,]*(?:e[+-]?\d+)?""")
"""Pattern of names and numbers, which are the differences between sentences of one kind."""


def check_files(folder: Path, words: Sequence[str], limit: float) -> Iterator[Values]:
    """Check the files below a folder in the order of their paths.

    Yield ``file``, ``status``, ``notes``, ``reason`` and ``report`` of each.
    """
    for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES):
        if path.is_file():
            yield {"file": str(path), **_check(path, words, limit)}


def counts_by_kind(results: Iterable[Values]) -> dict[str, dict[str, int]]:
    """Return the numbers of files that were loaded without a note, noted and rejected.

    They are counted by the kind of their notes or reasons.
    """
    counts: dict[str, dict[str, int]] = {"loaded": {}, "noted": {}, "refused": {}}
    for result in results:
        for kind in {_kind(sentence) for sentence in result["notes"] or [result["reason"]]}:
            counts[result["status"]][kind] = counts[result["status"]].get(kind, 0) + 1
    return {
        status: dict(sorted(kinds.items(), key=lambda each: -each[1])) for status, kinds in counts.items()
    }


def check_folder(folder: Path, reading: Reading, limit: float, *, as_json: bool, is_strict: bool) -> bool:
    """Report on every file below a folder.

    Return whether a file was rejected or, if *is_strict*, a part has no inside.
    """
    words = ["--units", reading.units, "--step-tolerance", str(reading.step_tolerance)]
    words += ["--unpacked-limit", str(reading.unpacked_limit), "--scale", str(reading.scale)]
    words += ["--no-cache"] * reading.no_cache
    results = []
    with progress.spinner(f"reading {folder}, files") as count:
        for result in check_files(folder, words, limit):
            results.append(result)
            count(len(results), None)
    if not results:
        raise typer.BadParameter(f"{folder} contains no file of parts", param_hint="FILE")
    if as_json:
        write_document({"folder": str(folder), "counts": counts_by_kind(results), "files": results})
    else:
        _print_folder(results)
    parts = [part for result in results if result["report"] for part in result["report"]["parts"]]
    has_open_part = is_strict and not all(part["has_inside"] for part in parts)
    return has_open_part or any(result["reason"] for result in results)


def _print_folder(results: Sequence[Values]) -> None:
    """Print a table of kinds with their counts, and a line for each rejected file."""
    counts = counts_by_kind(results)
    columns = [("result", False), ("what", False), ("files", True)]
    rows = (
        (status, printable(kind) or "without a note", str(count))
        for status, kinds in counts.items()
        for kind, count in kinds.items()
    )
    results_console().print(table_of(columns, rows))
    refused = [result for result in results if result["status"] == "refused"]
    typer.echo(f"\n{counted(len(results), 'file')}, {len(refused)} refused")
    for result in refused:
        typer.echo(printable(f"{result['file']}: {result['reason']}"))


def _kind(sentence: str) -> str:
    return _PARTICULARS.sub("\N{HORIZONTAL ELLIPSIS}", sentence)


def _check(path: Path, words: Sequence[str], limit: float) -> Values:
    command = [sys.executable, "-P", "-m", "proximity", "check", "--json", *words, "--", str(path)]
    pipe: Any = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, start_new_session=True) as running:
        try:
            out, said = running.communicate(timeout=limit)
        except BaseException as ended:
            _end(running)
            if not isinstance(ended, subprocess.TimeoutExpired):
                raise
            return _refused(f"it was not read within {limit:g} s")
    if out and running.returncode >= 0:
        report = json.loads(out)
        status = "noted" if report["notes"] else "loaded"
        return {"status": status, "notes": report["notes"], "reason": "", "report": report}
    lines = said.decode(errors="replace").strip().splitlines() or ["no message"]
    sentence = lines[-1].removeprefix("proximity: ").removeprefix(f"{path}: ")
    is_refusal = running.returncode == 2  # another code is due to a bug, or to the system
    return _refused(sentence if is_refusal else f"reading ended with code {running.returncode}: {sentence}")


def _refused(reason: str) -> Values:
    return {"status": "refused", "notes": [], "reason": reason, "report": None}


def _end(running: "subprocess.Popen[bytes]") -> None:
    """End a process and its children."""
    if os.name == "nt":
        running.kill()
    else:
        os.killpg(running.pid, signal.SIGKILL)
    running.communicate()
