"""Web page that shows a scene, hands and their distances, in a browser or a headset.

A *bridge* sends the page its files, the frames of a service and the geometry, and receives poses of fingers
and moves of parts. The bridge computes no distances; the service does, in a thread next to the bridge or in
another process. No other package depends on this one.
"""

from proximity.web.running_page import RunningPage, view

__all__ = ["RunningPage", "view"]
