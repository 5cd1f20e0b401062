"""Result of a press on a CAD part, beside the same press on the true surface."""

import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from proximity.lab.engine.engine_setup import EngineSetup
from proximity.lab.engine.finger_placement import PlacedFinger
from proximity.lab.simulation.metrics import force_error, onset, work
from proximity.lab.simulation.response import Response
from proximity.transport import Counts


@dataclass(frozen=True, slots=True, eq=False)
class EnginePress:
    """Result of a press; positions of `response` count from the true surface, along the finger's path."""

    finger: PlacedFinger
    setup: EngineSetup
    response: Response
    real: Response  # on the real wall, at the same instants
    states: Counter[str]  # samples of the servo in each state of the controller
    switched_at: float  # s, when the controller first served a force; nan: it did not
    counts: Counts  # frames, as the subscriber counts them
    reported_contact: (
        float  # m past the true surface, the position of contact in the last frame before the touch
    )
    reported_error: float  # m, the bound that this frame gave for it, on the polyline that the tracker had
    advances: int  # samples at which the drum was sent nearer although nothing fresh was known

    @property
    def error(self) -> "ForceError":
        """Against the real wall."""
        return ForceError.of(self)


@dataclass(frozen=True, slots=True)
class ForceError:
    """A press on a part against the same on the real wall, from the touch on."""

    share: float  # rms of the difference of the forces over the rms of the real one
    rms: float  # N, of the difference
    largest: float  # N, of it
    onset: float  # s, by how much the force begins later
    penetration: float  # m, how far the pad's far side was past the real surface, before the release
    work: float  # J, of the finger until the release, less the real one

    @classmethod
    def of(cls, press: EnginePress) -> "ForceError":
        """Compare."""
        response, real = press.response, press.real
        off = response.force[response.zero :] - real.force[response.zero :]
        before_release = response.times < response.press.release_time
        past = response.link - np.maximum(real.link, 0.0)
        return cls(
            force_error(response, real),
            math.sqrt(float(np.square(off).mean())),
            float(np.abs(off).max()),
            onset(response) - onset(real),
            float(past[before_release].max()),
            work(response) - work(real),
        )
