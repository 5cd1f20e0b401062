"""What many signed distances are together: of a scan, its deviations from the part."""

from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np

from proximity.cli.output import counted, number
from proximity.cli.parts.answers import Answers

SHARE = 95  # per cent of the points, of which the greatest deviation is given
MOST_KEPT = 20_000_000
"""Points: the share is of those that come first, so that memory stays bounded."""
DIGITS = 5


class Deviations:
    """Collects signed distances as they are answered.

    *within*: in the unit of the answers; points that are farther from the surface are counted.
    """

    def __init__(self, within: float | None) -> None:
        self.within, self.count, self.farther_count = within, 0, 0
        self._least, self._most, self._sum, self._squares = np.inf, -np.inf, 0.0, 0.0
        self._unknown_count, self._sizes = 0, array("d")

    def collected(self, chunks: Iterator[Answers]) -> Iterator[Answers]:
        """Yield answers as they come, and keep what is asked of them."""
        for chunk in chunks:
            self._add(np.array(chunk["signed_distance"], dtype=np.float64))
            yield chunk

    def _add(self, distances: np.ndarray) -> None:
        known = distances[np.isfinite(distances)]
        sizes = np.abs(known)
        self.count += len(distances)
        self._unknown_count += len(distances) - len(known)
        if self.within is not None:  # what is not known to be near is not near
            self.farther_count += len(distances) - int(np.sum(sizes <= self.within))
        if len(known):
            self._least = min(self._least, float(known.min()))
            self._most = max(self._most, float(known.max()))
            self._sum += float(known.sum())
            self._squares += float(known @ known)
            self._sizes.frombytes(sizes[: max(MOST_KEPT - len(self._sizes), 0)].tobytes())

    def values(self) -> dict[str, Any]:
        """Return all as plain values, nan where no distance is known."""
        known = self.count - self._unknown_count
        sizes = np.frombuffer(self._sizes) if self._sizes else np.array([np.nan])
        values: dict[str, Any] = {
            "count": self.count,
            "not_answered": self._unknown_count,
            "min": self._least if known else np.nan,
            "max": self._most if known else np.nan,
            "mean": self._sum / known if known else np.nan,
            "rms": (self._squares / known) ** 0.5 if known else np.nan,
            f"within_{SHARE}_percent": float(np.quantile(sizes, SHARE / 100, method="inverted_cdf")),
        }
        if self.within is not None:
            values |= {"within": self.within, "farther": self.farther_count}
        return values

    def sentence(self, units: str) -> str:
        """Return all in one line."""
        found = {name: number(value, DIGITS) for name, value in self.values().items()}
        unknown = f", {found['not_answered']} not answered" if self._unknown_count else ""
        farther = f"; {found['farther']} farther than {found['within']} {units}" if "farther" in found else ""
        share = found[f"within_{SHARE}_percent"]
        return (
            f"{counted(self.count, 'point')}{unknown}: {found['min']} to {found['max']} {units}, mean "
            f"{found['mean']}, RMS {found['rms']}, {SHARE} % within {share} {units}"
            f"{farther}."
        )
