"""What the page that shows a scene is given: its files, slices of the signed distance, distances of parts."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import SceneError
from proximity.message import clients
from proximity.message.fields import VECTOR, Field, dtype_of
from proximity.message.javascript_layout import layout_module
from proximity.scene.scene import Scene
from proximity.web.page_inbox import FARTHEST
from proximity.web.server.access import UnfitError
from proximity.web.server.page_files import PageFiles

PAGE = Path(__file__).parent / "page"
CLIENT = Path(clients.__file__).parent / "javascript" / "decaff.mjs"

MOST_POINTS = 40_000
"""Of a slice: 40 ms on one core for a part of 100 k faces."""
SLICE_MAGIC = 0x4C434544  # "DECL"
SLICE_FIELDS = (
    Field("magic", "<u4", "", "SLICE_MAGIC"),
    Field("ticket", "<u4", "", "what the page asked with"),
    Field("width", "<u4", "", "points along u"),
    Field("height", "<u4", "", "points along v; width times height float32 follow, m, row by row"),
    Field("origin", "<f8", "m", "the first point", VECTOR),
    Field("u", "<f8", "m", "from the first point of a row to the last", VECTOR),
    Field("v", "<f8", "m", "from the first row to the last", VECTOR),
    Field("lowest", "<f8", "m", "least of the distances"),
    Field("highest", "<f8", "m", "largest of them"),
)
SLICE_HEADER = dtype_of(SLICE_FIELDS)
"""The header of a slice, 104 bytes."""


def page_layout() -> str:
    """Return the text of ``layout.mjs``, an ES module."""
    return layout_module({"slice_header": SLICE_FIELDS}, {"SLICE_MAGIC": SLICE_MAGIC})


def scene_page_files(frame_ancestors: str = "'self'") -> PageFiles:
    """Return the page with the JavaScript client for its messages."""
    made = {"/layout.mjs": page_layout(), "/decaff.mjs": CLIENT.read_text(encoding="utf-8")}
    return PageFiles(PAGE, made, frame_ancestors)


def slice_bytes(scene: Scene, asked: Any) -> bytes:
    """Measure what a page asks for, and return it as a message.

    *asked*: ``ticket``, ``origin``, ``u`` and ``v``, m, ``width`` and ``height``; from a page, not trusted.
    """
    try:
        corners = {name: np.array([float(x) for x in asked[name]]) for name in ("origin", "u", "v")}
        ticket, width, height = (int(asked[name]) for name in ("ticket", "width", "height"))
    except (TypeError, KeyError, ValueError, OverflowError) as unfit:
        raise UnfitError("a slice is asked for by ticket, origin, u, v, width and height") from unfit
    if any(each.shape != (3,) or not np.abs(each).max() <= FARTHEST for each in corners.values()):
        raise UnfitError("a slice is given by three vectors of up to 10 km")
    if not (width >= 2 and height >= 2 and width * height <= MOST_POINTS and 0 <= ticket < 2**32):
        raise UnfitError(f"a slice has 2 by 2 to {MOST_POINTS} points in all")
    origin, u, v = corners["origin"], corners["u"], corners["v"]
    along, across = np.linspace(0.0, 1.0, width), np.linspace(0.0, 1.0, height)
    points = origin + across[:, None, None] * v + along[None, :, None] * u
    distances = scene.signed_distance(points)
    header = np.zeros((), SLICE_HEADER)
    for name, value in (
        ("magic", SLICE_MAGIC), ("ticket", ticket), ("width", width), ("height", height),
        ("origin", origin), ("u", u), ("v", v),
    ):  # fmt: skip
        header[name] = value
    finite = distances[np.isfinite(distances)]
    header["lowest"] = finite.min() if len(finite) else math.nan
    header["highest"] = finite.max() if len(finite) else math.nan
    return header.tobytes() + distances.astype("<f4").tobytes()


def clearance_document(scene: Scene, asked: Any) -> dict[str, Any]:
    """Measure how far two parts are apart, and return what a page is told."""
    if not (isinstance(asked, list) and len(asked) == 2 and all(isinstance(name, str) for name in asked)):
        raise UnfitError("how far parts are apart is asked with two names")
    try:
        found = scene.clearance(*asked)
    except SceneError as unfit:
        raise UnfitError(str(unfit)) from unfit
    return {
        "names": asked,
        "distance": found.distance,
        "from": found.point_on_first.tolist(),
        "to": found.point_on_second.tolist(),
    }
