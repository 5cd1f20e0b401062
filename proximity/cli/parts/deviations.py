"""Statistics of signed distances, for the deviations of a scan from its part."""

import math
from array import array
from collections.abc import Iterator
from typing import Any

import numpy as np

import proximity
from proximity.cli.output import counted, number, printable, report
from proximity.cli.parts.answers import Answers
from proximity.errors import ArgumentError
from proximity.formats.units import UNIT_NAMES, metres_per_unit, scan_unit

SHARE = 95  # percentile of the deviations
MAX_KEPT = 20_000_000
"""Maximum number of points for the percentile, which limits the memory. Later points do not affect it."""
DIGITS, PLACE_DIGITS = 5, 9
MAX_WORST = 10
MAX_DRAWN = 20_000  # maximum number of points in a picture
_WORST = ("query", "signed_distance", "part_name")


def check_unit(sides: list[float], scene: "proximity.Scene", units: str, *, is_gate: bool) -> None:
    """Report a scan that is probably in another unit than *units*.

    *is_gate*: whether to raise an error instead. *sides*: sides of the box around the scan, in *units*; empty
    if it has no points.
    """
    metres, part = metres_per_unit(units), np.subtract(*scene.bounds[::-1]).tolist()
    unit = scan_unit([side * metres for side in sides], part, units) if sides else None
    if unit is not None:
        sizes = f"{number(max(sides), 4)} {units} across, the part {number(max(part) / metres, 4)} {units}"
        words = f"the scan is {sizes}: is it in {UNIT_NAMES.get(unit, unit)}? give --points-units {unit}"
        if is_gate:
            raise ArgumentError(words)
        report(f"note: {words}")


class Deviations:
    """Collects signed distances from a stream of answers.

    *units*: unit of the answers, which is *metres* long. *within*: tolerance in this unit; points farther
    from the surface are counted.
    """

    def __init__(self, units: str, metres: float, within: float | None) -> None:
        self.units, self.metres, self.within = units, metres, within
        self.count = self.farther_count = 0
        self.worst: list[dict[str, Any]] = []  # answers for the farthest points, with their rows
        self.shown, self._stride = np.empty((0, 3)), 1  # points to draw, of which every `_stride`-th is kept
        self._min, self._max, self._sum, self._squares = np.inf, -np.inf, 0.0, 0.0
        self._unknown_count, self._distances = 0, array("d")

    @property
    def distances(self) -> np.ndarray:
        """The first `MAX_KEPT` signed distances that are known."""
        return np.frombuffer(self._distances) if self._distances else np.empty(0)

    def collected(self, chunks: Iterator[Answers]) -> Iterator[Answers]:
        """Collect answers, and yield them unchanged."""
        for chunk in chunks:
            self._add(chunk)
            yield chunk

    def _add(self, chunk: Answers) -> None:
        distances = np.array(chunk["signed_distance"], dtype=np.float64)
        sizes = np.where(np.isfinite(distances), np.abs(distances), -1.0)
        known = distances[sizes >= 0.0]
        for row in np.argsort(-sizes, kind="stable")[: min(len(known), MAX_WORST)].tolist():
            self.worst.append({"row": self.count + row} | {name: chunk[name][row] for name in _WORST})
        self.worst = sorted(self.worst, key=lambda each: -abs(each["signed_distance"]))[:MAX_WORST]
        rows = np.array(chunk["query"], dtype=np.float64).reshape(-1, 3)
        self.shown = np.concatenate([self.shown, rows[-self.count % self._stride :: self._stride]])
        while len(self.shown) > MAX_DRAWN:
            self.shown, self._stride = self.shown[::2], 2 * self._stride
        self.count += len(distances)
        self._unknown_count += len(distances) - len(known)
        if self.within is not None:  # an unknown distance is not within the tolerance
            self.farther_count += len(distances) - int(np.sum(np.abs(known) <= self.within))
        if len(known):
            self._min = min(self._min, float(known.min()))
            self._max = max(self._max, float(known.max()))
            self._sum += float(known.sum())
            self._squares += float(known @ known)
            self._distances.frombytes(known[: max(MAX_KEPT - len(self._distances), 0)].tobytes())

    def values(self) -> dict[str, Any]:
        """Return the statistics as values for JSON. They are nan if no distance is known."""
        known = self.count - self._unknown_count
        sizes = np.abs(self.distances) if known else np.array([np.nan])
        values: dict[str, Any] = {
            "count": self.count,
            "not_answered": self._unknown_count,
            "min": self._min if known else np.nan,
            "max": self._max if known else np.nan,
            "mean": self._sum / known if known else np.nan,
            "rms": (self._squares / known) ** 0.5 if known else np.nan,
            f"within_{SHARE}_percent": float(np.quantile(sizes, SHARE / 100, method="inverted_cdf")),
            "worst": self.worst[0] if self.worst else None,
        }
        if self.within is not None:
            share = 1.0 - self.farther_count / max(self.count, 1)
            values |= {"within": self.within, "farther": self.farther_count, "share_within": share}
        return values

    def share_within(self) -> str:
        """Return the share of the points within the tolerance in words.

        It is rounded down, so that 100 % means all points.
        """
        tenths = math.floor(1e3 * (self.count - self.farther_count) / max(self.count, 1))
        return f"{tenths / 10:.1f} % within ±{number(self.within or 0.0, DIGITS)} {self.units}"

    def sentence(self) -> str:
        """Return the statistics as one line, and the worst point as another."""
        found = {name: number(value, DIGITS) for name, value in self.values().items() if name != "worst"}
        unknown = f", {self._unknown_count} not answered" if self._unknown_count else ""
        share = found[f"within_{SHARE}_percent"]
        farther = "" if self.within is None else f"; {self.share_within()}, {self.farther_count} farther"
        words = (
            f"{counted(self.count, 'point')}{unknown}: {found['min']} to {found['max']} {self.units}, mean "
            f"{found['mean']}, RMS {found['rms']}, {SHARE} % within {share} {self.units}{farther}."
        )
        for worst in self.worst[:1]:
            place = "  ".join(number(coordinate, PLACE_DIGITS) for coordinate in worst["query"])
            distance = f"{number(worst['signed_distance'], DIGITS)} {self.units}"
            part = printable(worst["part_name"])
            words += f"\nThe worst is #{worst['row']} at {place}: {distance} from {part}."
        return words
