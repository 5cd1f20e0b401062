"""A service with another library's distances: ``python -m benchmarks.service.library_service``.

The rest is this package's: poses, loop, frames. A library is called only for new poses, and returns the
signed distance alone: no velocity, prediction or time to contact.
"""

import argparse
import sys
import threading
from typing import Any

import numpy as np

from benchmarks.rivals.interface import Contender
from benchmarks.rivals.registry import CONTENDERS
from proximity.message import ContactFlag, Source
from proximity.scene.loader import load
from proximity.service import FingerPoses, MessageInput, Service
from proximity.transport import forget, open_publisher

KNOWN = ContactFlag.TRACKED | ContactFlag.EXACT | ContactFlag.SIGNED | ContactFlag.IN_RANGE


class LibraryContacts:
    """Contacts by another library.

    Parameters
    ----------
    contender : Contender
        Built of the part.
    count : int
        Of fingers.
    radius : float, m
        Of their spheres.
    """

    source, epoch, refused, is_late = Source.GEOMETRY, 0, (0, 0, 0), False
    is_ticked_by_loop = False
    notes: tuple[str, ...] = ()

    def __init__(self, contender: Contender, count: int, radius: float) -> None:
        self.count, self._contender, self._radius = count, contender, radius

    def labels(self) -> Any:
        """Return the name of the only part."""
        return ("part",), np.zeros(1, bool)

    def new_samples(self) -> FingerPoses:
        """Return poses, all unknown."""
        return FingerPoses(self.count)

    def rehearse(self) -> None:
        """Query once."""
        self._distances(np.zeros((self.count, 3)))

    def fill(self, contacts: np.ndarray, samples: FingerPoses, now_ns: int) -> None:
        """Measure at new poses."""
        contacts["age_ns"] = now_ns - samples.pose_ns
        contacts["predicted_ns"] = now_ns
        if (contacts["pose_ns"] == samples.pose_ns).all():
            return
        forget(contacts)
        contacts["pose_ns"] = samples.pose_ns
        tracked = np.isfinite(samples.positions).all(axis=1)
        if tracked.any():
            distances = self._distances(samples.positions[tracked]) - self._radius
            contacts["position"][tracked] = samples.positions[tracked]
            for name in ("signed_distance", "lower", "upper", "predicted_distance"):
                contacts[name][tracked] = distances
            contacts["time_to_contact"][tracked] = np.inf
            contacts["flags"][tracked] = KNOWN

    def close(self) -> None:
        """No-op."""

    def _distances(self, points: np.ndarray) -> np.ndarray:
        return self._contender.signed_distance(np.ascontiguousarray(points)).answer()


def main() -> int:
    """Serve until standard input ends; prints when it starts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for name in ("library", "file", "frames", "poses"):
        parser.add_argument(name)
    parser.add_argument("--fingers", type=int, required=True)
    parser.add_argument("--radius", type=float, required=True)
    options = parser.parse_args()
    (part,) = load(options.file, units="m").parts
    contender = next(kind for kind in CONTENDERS if kind.name == options.library)()
    contender.build(part.solid.mesh.vertices, part.solid.mesh.faces)
    stop = threading.Event()
    service = Service(
        LibraryContacts(contender, options.fingers, options.radius),
        MessageInput(options.poses, options.fingers),
        [open_publisher(options.frames)],
        period=1e-3,
        valid_for=0.1,
    )
    threading.Thread(target=lambda: (sys.stdin.read(), stop.set()), daemon=True).start()
    print("begun", flush=True)
    service.run(stop=stop)
    return 0


if __name__ == "__main__":
    sys.exit(main())
