"""Files of the page that shows a scene, with the layout of what it reads and writes: messages, and slices."""

from pathlib import Path

from proximity.message import clients
from proximity.message.fields import VECTOR, Field, dtype_of
from proximity.message.javascript_layout import layout_module
from proximity.web.server.page_files import PageFiles

PAGE = Path(__file__).parent / "page"
CLIENT = Path(clients.__file__).parent / "javascript" / "decaff.mjs"

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
