"""Pairs of parts as ``proximity clearance`` measures them: which ones, how they lie, and the verdict."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import product
from pathlib import Path
from typing import Any

import typer

import proximity
from proximity.cli.output import counted, in_unit, length, printable
from proximity.errors import MeshError, SceneError
from proximity.scene.overlap import overlap
from proximity.scene.pairs import SHARING, deepest_of
from proximity.system.table_text import table_text

CONTACT_M = 1e-8
"""Depth up to which parts touch, where the file has triangles; the import of STEP rounds by as much."""
MAX_SHOWN = 20
TOLERANCE, WAY_TOLERANCE = 0.001, 0.01
"""Shares between the bounds of the deepest point and of the way out."""
FEW_DIGITS = 3


@dataclass(frozen=True, slots=True)
class MeasuredPair:
    """Two parts, and lengths in m, scene's frame; None for a volume or depth that is not known."""

    clearance: proximity.Clearance
    relation: proximity.Relation
    deepest: float = 0.0
    deepest_lower: float = 0.0
    deepest_point: Any = None
    is_clash: bool = False
    volume: float | None = 0.0
    depth: float | None = 0.0
    direction: Any = None

    @property
    def names(self) -> frozenset[str]:
        """Names of both parts."""
        return frozenset(self.clearance[:2])

    @property
    def is_fit(self) -> bool:
        """Whether the parts overlap by more than rounding and no more than the contact limit."""
        return not self.is_clash and self.deepest_lower > CONTACT_M

    @property
    def rank(self) -> tuple[bool, float, float]:
        """Key by which clashes come first, the deepest of them at the top, then the nearest pairs."""
        return (not self.is_clash, -self.deepest if self.is_clash else 0.0, self.clearance.distance)


def matching(scene: proximity.Scene, name: str) -> list[str]:
    """Return the part of that name, or the parts that match a pattern such as ``bolt*``."""
    names = [part.name for part in scene.parts]
    found = [name] if name in names else [each for each in names if fnmatchcase(each, name)]
    return found or [scene.part(name).name]


def find_pairs(
    scene: proximity.Scene, groups: list[list[str]], limit: float | None, *, is_whole: bool
) -> list[proximity.Clearance]:
    """Return pairs of all parts, of one group and the rest, or of two groups.

    *limit*, m: only pairs within it. None: the nearest `MAX_SHOWN` and those that meet, or all.
    """
    found: list[proximity.Clearance] = []
    if len(groups) == 2:
        are_same = groups[0] == groups[1] and len(groups[0]) > 1
        found = [scene.clearance(*pair) for pair in product(*groups) if not (are_same and pair[0] == pair[1])]
    else:
        for of in groups[0] if groups else [None]:
            if limit is not None or is_whole:
                found += scene.closest_pairs(of=of, **({} if limit is None else {"max_distance": limit}))
            else:
                found += scene.closest_pairs(of=of, max_distance=CONTACT_M)
                found += scene.closest_pairs(of=of, most=MAX_SHOWN)
    kept: dict[frozenset[str], proximity.Clearance] = {}
    for pair in found:
        kept.setdefault(frozenset(pair[:2]), pair)
    return [pair for pair in kept.values() if limit is None or pair.distance <= limit]


def measure(scene: proximity.Scene, pair: proximity.Clearance, contact: float) -> MeasuredPair:
    """Measure how deep two parts are in each other; up to *contact*, m, they touch."""
    touching = proximity.Relation.TOUCHING
    if pair.relation not in SHARING:
        return MeasuredPair(pair, touching if pair.distance <= contact else pair.relation)
    upper, lower, point, _ = deepest_of(scene, pair.first, pair.second, TOLERANCE)
    volume = _volume(scene, pair)
    is_open = not all(scene.part(name).solid.has_inside for name in pair[:2])
    if upper <= contact and not is_open:
        return MeasuredPair(pair, touching, upper, lower, point, volume=volume)
    deep = scene.penetration(pair.first, pair.second, tolerance=WAY_TOLERANCE)
    return MeasuredPair(pair, pair.relation, upper, lower, point, True, volume, deep.depth, deep.direction)


def _volume(scene: proximity.Scene, pair: proximity.Clearance) -> float | None:
    """Return the common volume of two parts; None where a part is open."""
    try:
        common = overlap(scene, pair.first, pair.second)
    except MeshError:
        return None
    return 0.0 if common is None else common.volume


def read_allowed(path: Path, scene: proximity.Scene) -> dict[frozenset[str], int]:
    """Return the pairs that a CSV file with the columns first and second allows, with their line numbers."""
    shown = {table_text(part.name): part.name for part in scene.parts}
    allowed: dict[frozenset[str], int] = {}
    line = 1
    try:
        with path.open(encoding="utf-8-sig", newline="") as stream:
            reader = csv.DictReader(stream)
            for row in reader:
                line = reader.line_num
                groups = [matching(scene, shown.get(row[key], row[key])) for key in ("first", "second")]
                allowed |= {frozenset(pair): line for pair in product(*groups)}
    except OSError as failure:
        reason = f"{path}: cannot be read ({failure.strerror or failure})"
    except SceneError as unknown:
        reason = f"{path}, line {line}: {unknown}"
    except (KeyError, TypeError, UnicodeDecodeError, csv.Error):
        reason = f"{path}: expected CSV with the columns first and second"
    else:
        return allowed
    raise typer.BadParameter(reason, param_hint="--allow")


def verdict(
    pairs: Sequence[MeasuredPair], contact: float, approximation: float, metres: float, units: str
) -> str:
    """Return the sentence about clashes and fits; *approximation*, m: of the file, if it is the limit."""
    clashes = [pair for pair in pairs if pair.is_clash]
    fits = sum(pair.is_fit for pair in pairs)
    said = []
    if clashes:
        worst = max(clashes, key=lambda pair: pair.deepest)
        depth = length(in_unit(worst.deepest, metres), FEW_DIGITS)
        volume = (
            "" if not worst.volume else f", {length(in_unit(worst.volume, metres**3), FEW_DIGITS)} {units}³"
        )
        names = " and ".join(map(printable, worst.clearance[:2]))
        which = "the deepest " if len(clashes) > 1 else ""
        said.append(f"{counted(len(clashes), 'clash', 'clashes')}, {which}{names}: {depth} {units}{volume}")
    else:
        said.append("no clash")
    if fits:
        within = "within the approximation of" if approximation == contact else "within"
        limit = f"{length(in_unit(contact, metres))} {units}"
        said.append(f"{counted(fits, 'pair')} {'fits' if fits == 1 else 'fit'} {within} {limit}")
    sentence = "; ".join(said)
    return f"{sentence[0].upper()}{sentence[1:]}."
