"""The page: a scene, hands over it and their distances, in a browser or a headset.

A *bridge*, a process of its own, gives the page its files, what the service says and the geometry, and takes
from it poses of fingers and moves of parts. It computes no distance; the service does. Outside of it nothing
knows that there is a page.
"""

from proximity.web.viewing import RunningPage, view

__all__ = ["RunningPage", "view"]
