"""Files of the page that shows a scene."""

from pathlib import Path

from proximity.web.layout import page_layout
from proximity.web.server.page_files import PageFiles

PAGE = Path(__file__).parent / "page"


def scene_page_files(frame_ancestors: str = "'self'") -> PageFiles:
    """Return them, with the layout of messages."""
    return PageFiles(PAGE, {"/layout.js": page_layout()}, frame_ancestors)
