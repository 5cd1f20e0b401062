"""The page: a scene, hands over it and their distances, in a browser or a headset.

A *bridge* sends the page its files, the frames of a service and the geometry, and receives poses of fingers
and moves of parts. It computes no distances; a service does: one in a thread next to the bridge, or a running
one in another process. No other package depends on the page.
"""

from proximity.web.running_page import RunningPage, view

__all__ = ["RunningPage", "view"]
