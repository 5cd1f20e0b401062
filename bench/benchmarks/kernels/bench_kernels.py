"""Single kernels against textbook code, with pytest-benchmark: ``python -m pytest bench -k kernels``.

A compiled loop makes many calls; the table has the time of one. Their inputs fit the nearest caches. numba
compiles the loops together with the kernels: set ``PROXIMITY_ISA=jit``.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest

from benchmarks.kernels import loops
from benchmarks.queries import cases
from benchmarks.rivals import registry
from proximity.kernels.layout import (
    BLOCK_STRIDE,
    LANES,
    NODE_CHILDREN,
    NODE_STRIDE,
)
from proximity.kernels.segment.plan import PLAN, PROBE, make_plan
from proximity.mesh.topology import build_topology, corners_of
from proximity.mesh.triangle_mesh import TriangleMesh
from proximity.native import IS_AHEAD
from proximity.scene.solid_arrays import part_model

pytestmark = pytest.mark.skipif(
    IS_AHEAD, reason="a single kernel is left out: it has numba compile it (PROXIMITY_ISA=jit)"
)

CALLS, WINDING_CALLS = 10_000, 1_000
BASE_COUNT = 64  # blocks or nodes used in turn: 36 KB and 16 KB
MESH = "sphere"
EXACT, BOUND = 1e-12, 1e-5  # local units: float64, and float32 widened
GRAZING = 0.005  # share of calls in which a bound may hit a box that the textbook code just misses
WINDING = ("proximity", "libigl")  # contenders with winding numbers by trees
WINDING_ERROR = 0.05  # of a turn, as docs/science/accuracy.md says


@dataclass(frozen=True, slots=True, eq=False)
class Operands:
    """A part, and blocks and nodes of it in which all eight lanes are used."""

    model: object
    reals: np.ndarray
    words: np.ndarray
    blocks: np.ndarray  # (CALLS,) first real of a block
    nodes: np.ndarray  # (CALLS,) first word of a node
    rays: np.ndarray  # (CALLS, 6) point and direction
    plans: np.ndarray  # (CALLS,) PLAN

    @property
    def corners(self):
        """(CALLS, 8, 9) triangles of the blocks."""
        return np.ascontiguousarray(
            np.stack([self.reals[b : b + BLOCK_STRIDE].reshape(9, 8).T for b in self.blocks])
        )

    @property
    def boxes(self):
        """(CALLS, 8, 6) boxes of the nodes."""
        return np.stack([self.words[b : b + 48].reshape(6, 8).T for b in self.nodes]).astype(np.float64)


@pytest.fixture(scope="module")
def operands():
    return make_operands()


def make_operands():
    """Return blocks and nodes of the mesh, and rays; seeds are fixed."""
    vertices, faces = cases.load_mesh(MESH)
    mesh = TriangleMesh(vertices, faces)
    topology = build_topology(mesh)
    model = part_model(corners_of(mesh, topology), topology.corner_ids, topology.neighbors)
    nodes = NODE_STRIDE * (model.parts["root"][0] + np.arange(model.parts["node_count"][0]))
    children = model.words.view(np.int32)[(nodes[:, None] + np.arange(NODE_CHILDREN, NODE_CHILDREN + LANES))]
    blocks = BLOCK_STRIDE * ~children[children < 0]
    blocks = [b for b in blocks if np.isfinite(model.reals[b : b + BLOCK_STRIDE]).all()]
    nodes = [b for b in nodes if np.isfinite(model.words[b : b + NODE_CHILDREN]).all()]
    rng = np.random.default_rng(11)
    rays = rng.uniform(-1.2, 1.2, (CALLS, 6))
    rays[:, 3:] /= np.abs(rays[:, 3:]).max(axis=1)[:, None]
    plans, probe = np.zeros(CALLS, PLAN), np.zeros(1, PROBE)[0]
    for plan, ray in zip(plans, rays, strict=True):
        make_plan(plan, probe, *ray[:3], *(ray[:3] + 0.1 * ray[3:]))
    return Operands(
        model,
        model.reals,
        model.words,
        np.resize(blocks[:BASE_COUNT], CALLS),
        np.resize(nodes[:BASE_COUNT], CALLS),
        rays,
        plans,
    )


def _of_blocks(ours, plain):
    return lambda operands: {
        "proximity": partial(ours, operands.reals, operands.blocks, operands.rays),
        "textbook": partial(plain, operands.corners, operands.rays),
    }


def _of_nodes(ours, plain):
    return lambda operands: {
        "proximity": partial(ours, operands.words, operands.nodes, operands.rays),
        "textbook": partial(plain, operands.boxes, operands.rays),
    }


KERNELS = {
    "point to one triangle": (_of_blocks(loops.triangle_loop, loops.plain_triangle_loop), EXACT),
    "point to eight triangles": (_of_blocks(loops.block_loop, loops.plain_block_loop), EXACT),
    "ray at eight triangles": (_of_blocks(loops.ray_block_loop, loops.plain_ray_block_loop), EXACT),
    "point to eight boxes": (_of_nodes(loops.boxes_loop, loops.plain_boxes_loop), BOUND),
    "ray at eight boxes": (_of_nodes(loops.ray_boxes_loop, loops.plain_ray_boxes_loop), BOUND),
    "a node: bounds, nearest taken, rest left waiting": (
        _of_nodes(loops.node_loop, loops.plain_node_loop),
        BOUND,
    ),
}


@pytest.mark.parametrize("name", KERNELS)
@pytest.mark.parametrize("who", ["proximity", "textbook"])
def test_kernel(timed, operands, name, who):
    make, tolerance = KERNELS[name]
    runs = make(operands)
    found = {each: np.empty(CALLS) for each in runs}
    for each, run in runs.items():
        run(found[each])
    share = share_off(found["proximity"], found["textbook"], tolerance)
    assert share <= (0.0 if tolerance == EXACT else GRAZING), f"{share:.2%} of the answers differ"
    timed(who, f"kernel, {name}", partial(runs[who], found[who]), CALLS)


def test_segment_kernel(timed, operands):
    """No other library has it; the tests compare it with brute force."""
    found = np.empty(CALLS)
    run = partial(loops.segment_block_loop, operands.reals, operands.blocks, operands.plans, found)
    run()
    plain = np.empty(CALLS)
    loops.plain_block_loop(operands.corners, operands.rays, plain)
    assert (found <= plain + EXACT).all(), "a segment is never farther than its start"
    timed("proximity", "kernel, segment to eight triangles", run, CALLS)


@pytest.mark.parametrize("who", [kind.name for kind in registry.CONTENDERS if kind.name in WINDING])
def test_winding(timed, operands, contender, who):
    """A whole traversal: most points are far from most faces."""
    model, queries, found = operands.model, operands.rays[:WINDING_CALLS], np.empty(WINDING_CALLS)
    root, moments = int(model.parts["root"][0]), int(model.parts["moments"][0])
    run = partial(loops.winding_loop, operands.reals, operands.words, root, moments, queries, found)
    run()
    if who == "libigl":
        igl = contender("libigl", MESH).library
        vertices, faces = cases.load_mesh(MESH)
        tree = igl.FastWindingNumberBVH()
        tree.init(vertices, faces, 2)
        centre, scale = model.frames["centre"][0], model.frames["scale"][0]
        run = partial(tree.winding_number, np.ascontiguousarray(queries[:, :3] / scale + centre), 2.0)
        error = np.abs(run() - found).max()
        assert error <= WINDING_ERROR, f"winding numbers are up to {error:.3f} apart"
    timed(who, f"kernel, winding number, {MESH}: {len(cases.load_mesh(MESH)[1])} faces", run, WINDING_CALLS)


def share_off(ours, theirs, tolerance):
    """Share of the answers that differ; infinities are equal."""
    with np.errstate(invalid="ignore"):
        is_off = ~((ours == theirs) | (np.abs(ours - theirs) <= tolerance * np.maximum(1.0, np.abs(theirs))))
    return float(is_off.mean())
