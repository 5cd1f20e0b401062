"""Run all measurements, and write the figures and pictures of the documentation: ``python bench/publish.py``.

Runs `report.py`, `ticks.py`, `service.py`, `vr.py` and `growth.py` in turn, on a quiet machine if possible,
stores their JSON in ``bench/published``, and makes the pages, pictures and charts of ``docs`` and the
README's table from it. `report.py` and `ticks.py` run twice: ``NAME_v3.json`` is of kernels for AVX2, which
most processors have, ``NAME.json`` of the best kernels for this one. The ticks of another machine are in
``ticks_MACHINE.json``. ``--from-json`` skips the measurements.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.growth.fit import Fit
from benchmarks.growth.plots import write_plots
from benchmarks.growth.samples import GrowthRow
from benchmarks.publication import sections
from benchmarks.publication.charts import charts
from benchmarks.publication.vr_tables import draw_vr
from benchmarks.support.project import BENCH, environment

# Together half an hour on a quiet machine of two cores; twice that on a busy one (2026-11-26).
RUNS = {
    "report_v3": ["--rounds", "5"],
    "report": ["--rounds", "5"],
    "ticks_v3": [],
    "ticks": [],
    "service": ["publish", "minute"],
    "vr": [],
    "growth": [],
}
QUICK_RUNS = {
    "report_v3": ["--quick", "--cases", "plate/near", "plate/rays"],
    "report": ["--quick", "--cases", "plate/near", "plate/rays"],
    "ticks_v3": ["--small"],
    "ticks": ["--small"],
    "service": ["--small"],
    "vr": ["--small"],
    "growth": ["--small"],
}
JUDGED = (0, 1)  # exit codes of a complete run: every requirement met, or one not


def main(arguments: list[str] | None = None) -> int:
    """Measure and write; the exit code is 1 if a run failed, and then no page is written."""
    options = _parse(arguments)
    if not options.from_json:
        with tempfile.TemporaryDirectory(prefix="proximity_published_") as folder:
            runs = QUICK_RUNS if options.quick else RUNS
            for name in options.only or runs:
                if not _measured(name, runs[name], Path(folder)):
                    return 1
            options.published.mkdir(parents=True, exist_ok=True)
            for path in Path(folder).iterdir():
                shutil.copy(path, options.published / path.name)
    documents = sections.read(options.published)
    folder = options.pages / sections.PERFORMANCE
    draw_pictures(documents, folder)
    for name, chart in charts(documents).items():
        (folder / name).write_text(chart, encoding="utf-8")
    try:
        for name, runs in sections.PAGES_OF.items():
            sections.write(options.pages / name, sections.section(documents, runs))
        if {"report", "ticks"} <= documents.keys():
            sections.write(options.readme, sections.summary(documents))
    except ValueError as reason:
        print(f"{options.pages}, {options.readme}: {reason}", file=sys.stderr)
        return 1
    return 0


def draw_pictures(documents: dict[str, dict], folder: Path) -> None:
    """Write the pictures that the page shows."""
    drawn: list[Path] = []
    with tempfile.TemporaryDirectory(prefix="proximity_pictures_") as made:
        if "growth" in documents:
            growth = documents["growth"]
            rows = [GrowthRow(**row) for row in growth["rows"]]
            drawn += write_plots(Path(made), growth["machine"], rows, [Fit(**fit) for fit in growth["fits"]])
        if "vr" in documents:
            drawn += draw_vr(documents["vr"], Path(made) / sections.VR_PICTURE[0])
        for path in drawn:
            if path.suffix == ".png" and path.stem in {*sections.PICTURES, sections.VR_PICTURE[0]}:
                shutil.copy(path, folder / path.name)


def _measured(name, words, folder):
    """Run a command with its output shown; return whether it wrote its figures."""
    script, _, kernels = name.partition("_")
    command = [sys.executable, str(BENCH / f"{script}.py"), *words, "--json", str(folder / f"{name}.json")]
    chosen = {"PROXIMITY_ISA": kernels} if kernels else {}
    print("---", *(f"{variable}={value}" for variable, value in chosen.items()), *command[1:], flush=True)
    start = time.monotonic()
    done = subprocess.run(command, env=environment() | chosen, check=False)
    print(f"--- {name}: {time.monotonic() - start:.0f} s", flush=True)
    if done.returncode in JUDGED and (folder / f"{name}.json").is_file():
        return True
    print(f"{script}.py ended with {done.returncode}: no figures are published", file=sys.stderr)
    return False


def _parse(arguments):
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--from-json", action="store_true", help="pages and pictures from the stored JSON")
    parser.add_argument("--only", nargs="+", choices=list(RUNS), metavar="RUN", help=", ".join(RUNS))
    parser.add_argument("--quick", action="store_true", help="a look whether all runs: no figure means much")
    parser.add_argument("--published", type=Path, default=sections.PUBLISHED, metavar="FOLDER")
    parser.add_argument("--pages", type=Path, default=sections.PAGES, metavar="FOLDER")
    parser.add_argument("--readme", type=Path, default=sections.README, metavar="FILE")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
