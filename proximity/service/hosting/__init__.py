"""Run the service of a scene file in this process or in a separate one.

`serve` builds the objects of the file, runs the loop, and watches the file for edits. `start_service` runs
the service in another process, so that neither the interpreter lock nor the garbage collector of this one can
delay a tick.
"""

from proximity.service.hosting.process import RunningService, start_service
from proximity.service.hosting.scene_service import Beginning, serve

__all__ = ["Beginning", "RunningService", "serve", "start_service"]
