"""The page: a scene, hands over it and their distances, in a browser or a headset.

A *bridge* gives the page its files, the frames of a service and the geometry, and takes from it poses of
fingers and moves of parts. It computes no distance; a service does: one in a thread beside the bridge, or one
that runs already, in a process of its own. Outside of it nothing knows that there is a page.
"""

from proximity.web.running_page import RunningPage, view

__all__ = ["RunningPage", "view"]
