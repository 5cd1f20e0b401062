"""TinyBVH as a contender, compiled from the header in a folder: ``bench/report.py --tinybvh FOLDER``."""

import ctypes
import subprocess
import sys
import tempfile
import weakref
from pathlib import Path

import numpy as np

from benchmarks.rivals.interface import Contender, Task
from benchmarks.support.project import TEMPORARY_PREFIX

COMPILE = (
    "ziglang",
    "c++",
    "-O3",
    "-march=native",
    "-std=c++20",
    "-shared",
    "-fPIC",
    "-w",
    "-fno-sanitize=all",
)
SOURCE = """#define TINYBVH_IMPLEMENTATION
#include "tiny_bvh.h"
using namespace tinybvh; using Row = const double (*)[3];
struct Hit { double t, u, v; unsigned long face; };
extern "C" void* build(const POINT* at, unsigned n) { auto* t = new TREE; t->Build(at, n); return t; }
extern "C" void destroy(TREE* tree) { delete tree; }
extern "C" void cast(const TREE* tree, long n, Row o, Row d, Hit* hits) { for (long i = 0; i < n; i++) {
    RAY ray({(REAL)o[i][0], (REAL)o[i][1], (REAL)o[i][2]}, {(REAL)d[i][0], (REAL)d[i][1], (REAL)d[i][2]});
    tree->Intersect(ray);
    hits[i] = {ray.hit.t < 1e29 ? ray.hit.t : INFINITY, ray.hit.u, ray.hit.v, ray.hit.prim}; } }"""


class TinyBvh(Contender):
    """TinyBVH in double precision: length, barycentrics and face of the first hit, one ray after the other.

    Its tree has four children a node, with AVX2, if the header has it (`BVH4_Double`), and else two: version
    1.6 has two. Faces whose area is below an absolute tolerance are not hit. Its build starts threads.
    """

    name, questions, version = "TinyBVH (double)", ("cast",), ""
    folder = Path()  # of tiny_bvh.h
    types = {"TREE": "BVH_Double", "POINT": "bvhdbl3", "RAY": "RayEx", "REAL": "double"}  # noqa: RUF012
    corner = np.dtype((np.float64, 3))

    def __init__(self) -> None:
        header = (self.folder / "tiny_bvh.h").read_text(encoding="utf-8", errors="replace")
        wider = {"TREE": "BVH4_Double"} if self.types["REAL"] == "double" and "BVH4_Double" in header else {}
        with tempfile.TemporaryDirectory(prefix=TEMPORARY_PREFIX) as made:
            Path(made, "rays.cpp").write_text(SOURCE, encoding="ascii")
            words = [f"-D{name}={kind}" for name, kind in (self.types | wider).items()]
            words += [f"-I{self.folder}", f"{made}/rays.cpp", "-o", f"{made}/rays.so"]
            subprocess.run([sys.executable, "-m", *COMPILE, *words], check=True)
            self.library = ctypes.CDLL(f"{made}/rays.so")
        self.library.build.restype = ctypes.c_void_p

    def builder(self, vertices, faces):
        corners = np.zeros(faces.size, self.corner)
        corners[:, :3] = vertices[faces.ravel()]

        def build():
            tree = ctypes.c_void_p(self.library.build(corners.ctypes.data_as(ctypes.c_void_p), len(faces)))
            weakref.finalize(
                tree, lambda *at: self.library.destroy(at[0]), ctypes.c_void_p(tree.value), corners
            )
            return tree

        return build

    def cast(self, origins, directions):
        hits, tree, run = np.empty((len(origins), 4)), self.engine, self.library.cast
        rows = [
            each.ctypes.data_as(ctypes.c_void_p) for each in (origins, directions, hits)
        ]  # keep the arrays
        return Task(lambda: run(tree, ctypes.c_long(len(origins)), *rows), lambda _: hits[:, 0].copy())


class TinyBvhSingle(TinyBvh):
    """TinyBVH's tree with eight children a node and AVX2; float32."""

    name = "TinyBVH (float32)"
    types = {"TREE": "BVH8_CPU", "POINT": "bvhvec4", "RAY": "Ray", "REAL": "float"}  # noqa: RUF012
    corner = np.dtype((np.float32, 4))
