"""Time the engine for browsers against three-mesh-bvh: ``python bench/browser.py --three FOLDER PART...``.

FOLDER is where ``npm install three three-mesh-bvh`` was run. Every part answers the signed distances of five
points a call, in Node and in headless Chromium, interleaved in one run, after a comparison of answers. Times
are microseconds a call, in the fastest of many rounds; *native* is the same call in Python. *apart* is the
largest difference from Python's signed distances, in metres; three-mesh-bvh has no sign, and is compared with
their magnitudes.
"""

import argparse
import functools
import http.server
import json
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import ClassVar

import numpy as np

import proximity
from benchmarks.support.project import project_module
from proximity.clients.wasm_package import write_package

COMPARE = Path(__file__).parent / "benchmarks" / "browser" / "compare.mjs"
POINTS, CALL = 5000, 5
ROUNDS, CALLS = 120, 50  # as in `COMPARE`
NEAR = 0.05  # of the part's size: maximum distance of points from its surface
RELAXED = "--experimental-wasm-relaxed-simd"  # default in Node since version 21
MODULES = {
    "three/build/three.module.js": "three.mjs",
    "three/build/three.core.js": "three.core.js",
    "three-mesh-bvh/build/index.module.js": "bvh.mjs",
}
PAGE = """<!doctype html>
<script type="module">
import { compare } from "./compare.mjs";
import * as engine from "./proximity.mjs";
import * as three from "./three.mjs";
import * as bvh from "./bvh.mjs";
const given = async (name) => (await fetch(`./${name}`)).arrayBuffer();
window.report = await compare(given, engine, three, bvh);
</script>"""


class Files(http.server.SimpleHTTPRequestHandler):
    """Files of a folder, quietly; modules are scripts."""

    extensions_map: ClassVar[dict[str, str]] = {
        ".mjs": "text/javascript", ".html": "text/html", "": "application/octet-stream"
    }  # fmt: skip

    def end_headers(self) -> None:
        """Isolate the page, which gives it a finer clock."""
        self.send_header("Cross-Origin-Opener-Policy", "same-origin")
        self.send_header("Cross-Origin-Embedder-Policy", "require-corp")
        super().end_headers()

    def log_message(self, *unused: object) -> None:
        """Suppress the log."""


def main() -> None:
    """Print a row for each part and place."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="+", type=Path)
    parser.add_argument("--three", type=Path, required=True, help="where npm installed three-mesh-bvh")
    parser.add_argument("--node", default="node", help="its program")
    options = parser.parse_args()
    print(f"{'part':<16}{'faces':>8}  {'in':<9}{'native':>8}{'relaxed':>9}{'plain':>8}{'bvh':>8}  apart, m")
    for part in options.parts:
        with tempfile.TemporaryDirectory(prefix="proximity_browser_") as folder:
            native = prepare(part, Path(folder), options.three / "node_modules")
            for place, report in (
                ("Node", in_node(options.node, folder)),
                ("Chromium", in_chromium(folder)),
            ):
                us = [report["us"].get(name, float("nan")) for name in ("relaxed", "plain", "bvh")]
                apart = ", ".join(f"{name} {size:.1e}" for name, size in report["apart"].items())
                row = "".join(f"{each:8.1f}" for each in (native, *us))
                print(f"{part.stem:<16}{report['faces']:>8}  {place:<9}{row}  {apart}", flush=True)


def prepare(part: Path, folder: Path, installed: Path) -> float:
    """Write all inputs into a folder; return microseconds of a native call."""
    scene = proximity.load(part, units="mm")
    scene.save(folder / "scene.prox")
    write_package(folder)
    corners = np.concatenate([each.solid.mesh.vertices[each.solid.mesh.faces] for each in scene.parts])
    rng = np.random.default_rng(46)
    chosen = corners[rng.integers(len(corners), size=POINTS)]
    weights = rng.dirichlet(np.ones(3), POINTS)
    size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    offsets = rng.normal(size=(POINTS, 3))
    offsets *= NEAR * size * rng.random((POINTS, 1)) / np.linalg.norm(offsets, axis=1, keepdims=True)
    points = np.einsum("pk,pkx->px", weights, chosen) + offsets
    (folder / "points.bin").write_bytes(points.tobytes())
    (folder / "signed.bin").write_bytes(scene.signed_distance(points).tobytes())
    (folder / "triangles.bin").write_bytes(corners.astype(np.float32).tobytes())
    for name, wanted in MODULES.items():
        if (installed / name).is_file():
            text = (installed / name).read_text(encoding="utf-8")
            (folder / wanted).write_text(text.replace("from 'three'", "from './three.mjs'"), encoding="utf-8")
    shutil.copy(COMPARE, folder)
    (folder / "index.html").write_text(PAGE, encoding="utf-8")
    return 1e6 * min(_native(scene, points.reshape(-1, CALL, 3), round) for round in range(ROUNDS))


def _native(scene: proximity.Scene, groups: np.ndarray, round: int) -> float:
    """Return seconds of a call, in one round."""
    chosen = [groups[(round * CALLS + call) % len(groups)] for call in range(CALLS)]
    started = time.perf_counter()
    for five in chosen:
        scene.signed_distance(five)
    return (time.perf_counter() - started) / CALLS


def in_node(program: str, folder: str) -> dict:
    """Return the report of Node."""
    command = [program, RELAXED, f"{folder}/compare.mjs", folder]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def in_chromium(folder: str) -> dict:
    """Return the report of a page in headless Chromium."""
    browser = project_module("tests/support", "browsing").browser
    handler = functools.partial(Files, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, browser() as running:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        page = running.new_page()
        page.on("pageerror", lambda failure: print(failure, file=sys.stderr))
        page.goto(f"http://127.0.0.1:{server.server_port}/index.html")
        page.wait_for_function("window.report", timeout=120_000)
        report = page.evaluate("window.report")
        server.shutdown()
    return report


if __name__ == "__main__":
    main()
