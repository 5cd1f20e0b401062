"""The job ``field``: signed distance on a grid or near the surface, in a file that others train on."""

import shutil
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import ServiceError
from proximity.lab.sweep.design import Factor, Job, Kind, Measure, Values
from proximity.lab.sweep.node_files import NodeFiles
from proximity.lab.sweep.part_jobs import SCENE_FACTORS, SEEDS
from proximity.scene.scene import Scene
from proximity.service.config.table_fields import Range
from proximity.system.extras import needed
from proximity.system.whole_file import whole_file

GRID, SURFACE = "grid", "surface"
NPZ, VTI, ZARR = "npz", "vti", "zarr"
ZARR_CHUNK = 64
FACTORS = {
    **SCENE_FACTORS,
    "sampling": Factor(Kind.WORD, GRID, words=(GRID, SURFACE)),
    "resolution": Factor(
        Kind.WHOLE, 64, Range("samples along the longest side", 2, 4096), only={"sampling": (GRID,)}
    ),
    "margin": Factor(Kind.NUMBER, 0.1, Range("of the longest side", 0.0, 10.0), only={"sampling": (GRID,)}),
    "points": Factor(Kind.WHOLE, 100_000, Range("", 1, 10**9), only={"sampling": (SURFACE,)}),
    "spread": Factor(
        Kind.NUMBER, 0.01, Range("of the longest side", 0.0, 10.0), only={"sampling": (SURFACE,)}
    ),
    "seed": Factor(Kind.WHOLE, 0, SEEDS, only={"sampling": (SURFACE,)}),
    "format": Factor(Kind.WORD, NPZ, words=(NPZ, VTI, ZARR)),
}
"""`margin`: free space around the box of the parts. `spread`: rms distance of points from the surface."""
MEASURES = {
    "bytes": Measure("bytes"),
    "samples": Measure(),
    "inside": Measure("share", is_worse_high=False),
    "lowest": Measure("m", is_worse_high=False),
    "highest": Measure("m"),
}


def run(values: Values, files: NodeFiles) -> dict[str, Any]:
    """Write the samples of one scene to a file, and return what is in it.

    A grid is ``distance`` (X, Y, Z) float32 in metres with ``origin`` and ``spacing`` in metres; samples near
    the surface are ``points`` (N, 3) and ``distance`` (N,) with ``gradient`` (N, 3).
    """
    scene = files.scene(values["scene"], values["units"])
    if values["sampling"] == GRID:
        arrays = _grid(scene, values["resolution"], values["margin"])
    elif values["format"] == VTI:
        raise ServiceError('sampling "surface" makes points, which format "vti" cannot hold: use "npz"')
    else:
        arrays = _near_surface(scene, values["points"], values["spread"], values["seed"])
    path = files.output(f".{values['format']}")
    WRITERS[values["format"]](path, arrays)
    distance = arrays["distance"]
    sizes = [each.stat().st_size for each in (path.rglob("*") if path.is_dir() else [path])]
    return {
        "bytes": sum(sizes),
        "samples": distance.size,
        "inside": float((distance < 0.0).mean()),
        "lowest": float(distance.min()),
        "highest": float(distance.max()),
        "file": f"{path.parent.name}/{path.name}",
    }


def _grid(scene: Scene, resolution: int, margin: float) -> dict[str, np.ndarray]:
    lower, upper = scene.bounds
    free = margin * float((upper - lower).max())
    origin, size = lower - free, upper - lower + 2.0 * free
    spacing = float(size.max()) / (resolution - 1)
    counts = np.ceil(size / spacing - 1e-9).astype(int) + 1
    x, y, z = (start + spacing * np.arange(count) for start, count in zip(origin, counts, strict=True))
    distance = np.empty(counts, np.float32)
    slab = np.empty((counts[1], counts[2], 3))
    slab[..., 1], slab[..., 2] = y[:, None], z
    for row, across in enumerate(x):  # points of the whole grid would take six times its memory
        slab[..., 0] = across
        distance[row] = scene.signed_distance(slab)
    return {"distance": distance, "origin": origin, "spacing": np.full(3, spacing)}


def _near_surface(scene: Scene, count: int, spread: float, seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    corners = np.concatenate(
        [part.pose.point(part.solid.mesh.vertices[part.solid.mesh.faces]) for part in scene.parts]
    )
    sides = corners[:, 1:] - corners[:, :1]
    areas = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    faces = rng.choice(len(areas), count, p=areas / areas.sum())
    weights = rng.uniform(size=(count, 2))
    weights = np.where(weights.sum(axis=1, keepdims=True) > 1.0, 1.0 - weights, weights)
    on_surface = corners[faces, 0] + np.einsum("nk,nkd->nd", weights, sides[faces])
    lower, upper = scene.bounds
    points = on_surface + rng.normal(scale=spread * float((upper - lower).max()), size=(count, 3))
    hits = scene.closest(points)
    return {"points": points, "distance": hits.signed_distance, "gradient": hits.gradient}


def _write_npz(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with whole_file(path) as stream:
        np.savez_compressed(stream, **arrays)  # type: ignore[arg-type]


def _write_vti(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with needed("this format needs", "picture"):
        pyvista = import_module("pyvista")
    distance = arrays["distance"]
    image = pyvista.ImageData(dimensions=distance.shape, origin=arrays["origin"], spacing=arrays["spacing"])
    image["distance"] = distance.ravel(order="F")  # VTK counts x fastest
    unfinished = path.with_name(f".{path.stem}.unfinished.vti")
    image.save(unfinished)
    unfinished.replace(path)


def _write_zarr(path: Path, arrays: dict[str, np.ndarray]) -> None:
    with needed("this format needs", "study"):
        zarr = import_module("zarr")
    unfinished = path.with_name(f".{path.name}.unfinished")
    for folder in (unfinished, path):  # of a run that was killed, or of a condition that is done again
        shutil.rmtree(folder, ignore_errors=True)
    group = zarr.open_group(str(unfinished), mode="w")
    for name, array in arrays.items():
        chunks = tuple(min(side, ZARR_CHUNK if array.ndim == 3 else 1 << 16) for side in array.shape)
        group.create_array(name, data=array, chunks=chunks)
    unfinished.rename(path)


WRITERS = {NPZ: _write_npz, VTI: _write_vti, ZARR: _write_zarr}
FIELD = Job("field", FACTORS, MEASURES, run, texts=("file",))
