"""Pictures of scenes: the parts, points with their shortest connections, and a slice of the signed distance.

Files without a screen: PyVista draws the parts, matplotlib the page around them. Both are imported when
they are needed. Every number on a picture is an answer of the scene. Lengths are in metres; only what is
written on the page is in the unit of whoever asks.
"""

from proximity.scene.picture.sheet import Picture, load_renderer, write_picture

__all__ = ["Picture", "load_renderer", "write_picture"]
