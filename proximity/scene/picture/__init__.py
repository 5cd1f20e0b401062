"""Pictures of scenes: the parts, points with their shortest connections, and a slice of the signed distance.

No screen is needed. PyVista draws the parts, and matplotlib draws the page around them. Both are imported on
first use. Every number on a picture comes from the scene. Lengths are in metres, except in text on the page,
which is in the caller's unit.
"""

from proximity.scene.picture.sheet import Picture, load_renderer, write_picture

__all__ = ["Picture", "load_renderer", "write_picture"]
