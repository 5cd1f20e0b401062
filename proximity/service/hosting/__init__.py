"""Serving a scene file, in this process or in one of its own.

`serve` makes what the file describes and runs the loop; meanwhile it looks whether the file is edited.
`start_service` has another process do that, so that neither the interpreter lock nor the collector of this
one can delay a tick.
"""

from proximity.service.hosting.process import RunningService, start_service
from proximity.service.hosting.scene_service import Beginning, serve

__all__ = ["Beginning", "RunningService", "serve", "start_service"]
