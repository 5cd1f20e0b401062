"""Recording of fingertips, which can be resampled and placed in a scene.

Times are whole nanoseconds, positions are in metres. The position of a finger that the sensor lost is nan and
never estimated.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from proximity.checks import positive
from proximity.errors import RecordingError
from proximity.pose import Pose

NANOSECONDS = 1_000_000_000  # in a second
GAP_LIMIT_S = 0.05
"""Maximum time between two samples of a finger between which its position is interpolated, s."""
MIDDLE_SHARE = 0.8
"""Share of all samples along each axis that is inside the box of a hand, so that jumps do not affect it."""
MAX_TICK_COUNT = 10_000_000  # ticks of a resampled recording: 2 hours and 46 minutes at 1 kHz

FINGERS = ("thumb", "index", "middle", "ring", "little")


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """Positions of N fingertips at T instants."""

    times_ns: np.ndarray  # (T,) int64, rising
    positions: np.ndarray  # (T, N, 3) float64, m; nan where a finger is missing
    fingers: tuple[tuple[int, int], ...]  # (hand, finger) of each column; finger 0 is the thumb
    path: str = ""
    notes: tuple[str, ...] = ()  # sentences for the user

    def __post_init__(self) -> None:
        self.times_ns.flags.writeable = False
        self.positions.flags.writeable = False

    @property
    def duration_s(self) -> float:
        """Time from the first instant to the last, s."""
        return float(self.times_ns[-1] - self.times_ns[0]) / NANOSECONDS

    @property
    def is_present(self) -> np.ndarray:
        """Mask of fingers whose position is known, (T, N)."""
        return ~np.isnan(self.positions).any(axis=2)

    @property
    def hand_count(self) -> int:
        """Number of hands with at least one finger in the recording."""
        return len({hand for hand, _ in self.fingers})

    @property
    def sample_count(self) -> int:
        """Number of positions."""
        return int(self.is_present.sum())

    def finger_name(self, row: int) -> str:
        """Return the name of a finger. With several hands it includes the number of the hand."""
        hand, finger = self.fingers[row]
        return FINGERS[finger] if self.hand_count == 1 else f"{FINGERS[finger]} of hand {hand}"

    def gap_count(self) -> int:
        """Return the number of times a finger is lost for longer than `GAP_LIMIT_S` and then found again."""
        limit_ns = GAP_LIMIT_S * NANOSECONDS
        present = self.is_present
        return sum(
            int((np.diff(self.times_ns[present[:, row]]) > limit_ns).sum())
            for row in range(len(self.fingers))
        )

    def first(self, duration_s: float) -> "Recording":
        """Return the first *duration_s* seconds of the recording."""
        if not duration_s > 0.0:
            raise RecordingError(f"{duration_s:g} s of a recording cannot be taken, expected more than zero")
        last = self.times_ns - self.times_ns[0] <= duration_s * NANOSECONDS
        return replace(self, times_ns=self.times_ns[last].copy(), positions=self.positions[last].copy())

    def resampled(self, period_s: float, *, gap_limit_s: float = GAP_LIMIT_S) -> "Recording":
        """Return the recording resampled at equal time steps from its first instant.

        Positions are interpolated linearly between two samples of a finger. The finger is missing between
        samples farther apart than *gap_limit_s*; positions are never extrapolated.
        """
        if not (math.isfinite(period_s) and period_s * NANOSECONDS >= 1.0):
            raise RecordingError(f"a period of {period_s:g} s is too short, expected 1 ns or more")
        period_ns = round(period_s * NANOSECONDS)
        count = int(self.times_ns[-1] - self.times_ns[0]) // period_ns + 1
        if count > MAX_TICK_COUNT:
            raise RecordingError(
                f"{self.path}: {self.duration_s:g} s in steps of {period_s:g} s are {count} ticks, "
                f"expected at most {MAX_TICK_COUNT}"
            )
        ticks_ns = self.times_ns[0] + np.arange(count, dtype=np.int64) * period_ns
        positions = np.full((count, len(self.fingers), 3), np.nan)
        present = self.is_present
        for row in range(len(self.fingers)):
            seen = present[:, row]
            if seen.any():
                positions[:, row] = _interpolated(
                    ticks_ns, self.times_ns[seen], self.positions[seen, row], gap_limit_s * NANOSECONDS
                )
        return replace(self, times_ns=ticks_ns, positions=positions)

    def placed(self, pose: Pose, scale: float = 1.0) -> "Recording":
        """Return the recording in another frame.

        The positions are scaled about the origin and then transformed by *pose*. *scale*: positive factor.
        """
        scale = positive("scale", scale, "times the size")
        return replace(self, positions=pose.point(self.positions * scale))

    def middle(self) -> tuple[np.ndarray, np.ndarray]:
        """Return two corners of the box around the middle 80 % of the samples on each axis, m."""
        rest = 50.0 * (1.0 - MIDDLE_SHARE)
        lower, upper = np.percentile(self.positions[self.is_present], [rest, 100.0 - rest], axis=0)
        return lower, upper

    def fitted_to(
        self, lower: np.ndarray, upper: np.ndarray, *, rotation: np.ndarray | None = None, scale: float = 1.0
    ) -> Pose:
        """Return the pose that moves the middle of the recording to the middle of a box.

        *lower*, *upper*: corners of the box, (3,) m. *rotation*: (3, 3), rotation of the hand; by default the
        identity. *scale*: factor that is passed to `placed` together with the returned pose.
        """
        own_lower, own_upper = self.placed(Pose(rotation), scale).middle()
        return Pose(rotation, 0.5 * (np.asarray(lower) + upper) - 0.5 * (own_lower + own_upper))


def _interpolated(
    ticks_ns: np.ndarray, times_ns: np.ndarray, points: np.ndarray, gap_ns: float
) -> np.ndarray:
    """Return the positions of one finger at *ticks_ns*, (T, 3).

    They are nan outside its samples and in gaps.
    """
    after = np.searchsorted(times_ns, ticks_ns, side="left")  # row of the first sample not before the tick
    is_past = after == len(times_ns)
    after[is_past] = len(times_ns) - 1
    before = np.maximum(after - 1, 0)
    span = times_ns[after] - times_ns[before]
    weight = (ticks_ns - times_ns[before]) / np.where(span > 0, span, 1)
    found = points[before] + weight[:, None] * (points[after] - points[before])
    found[(span > gap_ns) | (after == before)] = np.nan
    is_sample = times_ns[after] == ticks_ns
    found[is_sample] = points[after[is_sample]]
    found[is_past] = np.nan
    return found
