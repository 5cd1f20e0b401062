"""Contents of a page over HTTP, which are its files, the engine, and the scene, which requires the token."""

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from proximity.clients.wasm_package import package_files
from proximity.kernels.layout import BLOCK_STRIDE
from proximity.scene.saved.archive import HEADER, read_archive, write_archive
from proximity.scene.saved.compiled_scene import LAYOUT
from proximity.scene.scene import Scene
from proximity.web.geometry import scene_glb
from proximity.web.server.page_files import PageFiles

PAGE = Path(__file__).parent / "page"
READ = ("reals", "words", "frames", "parts")
"""Arrays of a compiled scene that the engine reads, in the order of the file."""
TEXT_SIZE = 4
"""Index of the size of the description in the fields of the header."""


def scene_page_files(frame_ancestors: str = "'self'") -> PageFiles:
    """Return the files of the page, of the engine for browsers, and of the client of a service."""
    engine = package_files()
    made = {f"/{name}": content for name, content in engine.items() if name != "example.mjs"}
    return PageFiles(PAGE, made, frame_ancestors)


def shown_contents(
    scene: Scene | None, welcome: dict[str, Any] | None = None, points: bytes = b""
) -> dict[str, bytes]:
    """Return the contents for pages by name, including the scene in two forms.

    It is compiled for the engine, and as geometry to draw. *welcome*: data for a page that computes distances
    itself; None if a service does. *points*: coordinates to show, float64.
    """
    contents = {"welcome": json.dumps(welcome).encode(), "points": points}
    if scene is not None:
        contents |= {"geometry": scene_glb(scene), "scene": _compiled(scene)}
    return contents


def _compiled(scene: Scene) -> bytes:
    """Return the compiled scene for the engine without the coordinates of triangles.

    They equal those of the parts' corners, so that `local_scene.js` fills them in.
    """
    with tempfile.TemporaryDirectory(prefix="proximity_page_") as folder:
        path = Path(folder, "scene.prox")
        scene.save(path)
        contents = read_archive(path, LAYOUT)
        arrays = {name: contents.arrays[name] for name in READ}
        write_archive(path, contents.metadata, arrays, LAYOUT)
        whole = bytearray(path.read_bytes())
    data_at = HEADER.size + HEADER.unpack_from(whole)[TEXT_SIZE]
    reals = np.frombuffer(whole, np.float64, len(arrays["reals"]), data_at)
    for row in arrays["parts"][:-1]:
        first, count = (int(row[LAYOUT[name]]) for name in ("PART_FIRST_BLOCK", "PART_BLOCK_COUNT"))
        reals[BLOCK_STRIDE * first : BLOCK_STRIDE * (first + count)] = 0.0
    return bytes(whole)
