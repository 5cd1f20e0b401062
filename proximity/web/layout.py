"""The layout of what the page reads and writes: that of all messages, and of slices."""

from proximity.message.javascript_layout import layout_module
from proximity.web.slice_fields import SLICE_FIELDS, SLICE_MAGIC


def page_layout() -> str:
    """Return the text of ``layout.js``, an ES module."""
    return layout_module({"slice_header": SLICE_FIELDS}, {"SLICE_MAGIC": SLICE_MAGIC})
