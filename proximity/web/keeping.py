"""The service behind a page, kept running: started, watched, and started anew where it has ended."""

import threading
import time
from collections.abc import Callable

from proximity.errors import ServiceError
from proximity.service.hosting import RunningService, start_service

LOOK_S = 0.1
MOST_RESTARTS = 5
WITHIN_S = 60.0
"""A service that ends more often than that in this time is not started again."""


class ServiceKeeper:
    """A thread that keeps a service running in a process of its own; stopped at the end of a ``with``
    block.
    """

    failure: ServiceError | None  # why it could not be started at all

    def __init__(self, path: str, say: Callable[[str], None]) -> None:
        self.failure = None
        self.process_id: int | None = None
        self._path, self._say = path, say
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="keeps the service", daemon=True)

    def __enter__(self) -> "ServiceKeeper":
        self._thread.start()
        return self

    def __exit__(self, *unused: object) -> None:
        self._over.set()
        self._thread.join()

    def _keep(self) -> None:
        begun: list[float] = []
        while not self._over.is_set():
            try:
                service = start_service(self._path, say=self._say)
            except ServiceError as failure:
                if not begun:
                    self.failure = failure
                self._say(str(failure))
                return
            begun = [at for at in begun if at > time.monotonic() - WITHIN_S] + [time.monotonic()]
            self.process_id = service.beginning.get("pid")
            while service.is_running and not self._over.wait(LOOK_S):
                pass
            self._end(service)
            if self._over.is_set():
                return
            if len(begun) > MOST_RESTARTS:
                self._say(f"the service has ended {len(begun)} times in a minute: it is not restarted")
                return
            self._say("the service has ended and is restarted")

    def _end(self, service: RunningService) -> None:
        try:
            service.stop()
        except ServiceError as failure:
            if not self._over.is_set():
                self._say(str(failure))
