"""Select and measure pairs of parts for ``proximity clearance``, and state the verdict."""

import csv
from collections.abc import Sequence
from fnmatch import fnmatchcase
from itertools import product
from math import inf
from pathlib import Path

import typer

import proximity
from proximity.cli.output import counted, in_unit, length, printable, report
from proximity.errors import SceneError
from proximity.scene.clashes import CONTACT, MeasuredPair, contact_limit, measure_pairs
from proximity.system.table_text import table_text

MAX_SHOWN = 20
FEW_DIGITS = 3


def matching(scene: proximity.Scene, name: str) -> list[str]:
    """Return the part with a name, or the parts whose names match a pattern such as ``bolt*``."""
    names = [part.name for part in scene.parts]
    found = [name] if name in names else [each for each in names if fnmatchcase(each, name)]
    return found or [scene.part(name).name]


def find_pairs(
    scene: proximity.Scene, groups: list[list[str]], limit: float | None, *, is_whole: bool
) -> list[proximity.Clearance]:
    """Return pairs of all parts, of one group and the rest, or of two groups.

    *limit*: maximum distance of a pair, m. If it is None, the result is all pairs if *is_whole*, else the
    nearest `MAX_SHOWN` and those that touch or overlap.
    """
    found: list[proximity.Clearance] = []
    if len(groups) == 2:
        are_same = groups[0] == groups[1] and len(groups[0]) > 1
        found = [scene.clearance(*pair) for pair in product(*groups) if not (are_same and pair[0] == pair[1])]
    else:
        for of in groups[0] if groups else [None]:
            if limit is not None or is_whole:
                found += scene.closest_pairs(of=of, max_distance=inf if limit is None else limit)
            else:
                found += scene.closest_pairs(of=of, max_distance=CONTACT)
                found += scene.closest_pairs(of=of, most=MAX_SHOWN)
    kept: dict[frozenset[str], proximity.Clearance] = {}
    for pair in found:
        kept.setdefault(frozenset(pair[:2]), pair)
    return [pair for pair in kept.values() if limit is None or pair.distance <= limit]


def deviation_of(deviations: dict[str, float], pair: MeasuredPair) -> float:
    """Return the sum of the deviations of two parts, m.

    *deviations*: of each part, by name.
    """
    return sum(deviations[name] for name in pair.clearance[:2])


def read_allowed(path: Path, scene: proximity.Scene) -> dict[frozenset[str], int]:
    """Read the allowed pairs from a CSV file, and return them with their line numbers.

    The file has the columns first and second.
    """
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


def without_allowed(
    pairs: list[MeasuredPair], allowed: dict[frozenset[str], int], path: Path | None
) -> list[MeasuredPair]:
    """Return the pairs that are not allowed. Report how many allowed pairs of *path* were not found."""
    found = {pair.names for pair in pairs}
    used = {line for pair, line in allowed.items() if pair in found}
    if unused := len({*allowed.values()} - used):
        report(f"note: {counted(unused, 'pair')} of {path} {'is' if unused == 1 else 'are'} no longer near")
    return [pair for pair in pairs if pair.names not in allowed]


def find_clashes(scene: proximity.Scene, contact: float | None, path: Path | None) -> list[MeasuredPair]:
    """Return the pairs that overlap by more than *contact*, m, except those allowed in *path*."""
    allowed = {} if path is None else read_allowed(path, scene)
    limit = contact_limit(scene) if contact is None else contact
    pairs = measure_pairs(scene, scene.closest_pairs(max_distance=0.0), limit)
    return [pair for pair in without_allowed(pairs, allowed, path) if pair.is_clash]


def _rounded(value: float) -> str:
    """Return a number with at least `FEW_DIGITS` significant digits and all its integer digits."""
    return length(value, max(FEW_DIGITS, len(str(int(value)))))


def verdict(
    pairs: Sequence[MeasuredPair],
    contact: float,
    approximation: float,
    metres: float,
    units: str,
    *,
    is_cad: bool = False,
) -> str:
    """Return a sentence about the pairs that clash and those that fit.

    *approximation*: deviation of the file's triangles from curved surfaces, m, named if it is the limit.
    """
    clashes = [pair for pair in pairs if pair.is_clash]
    fits = sum(pair.is_fit for pair in pairs)
    said = []
    if clashes:
        worst = max(clashes, key=lambda pair: pair.deepest)
        depth = _rounded(in_unit(worst.deepest, metres))
        volume = f", {_rounded(in_unit(worst.volume, metres**3))} {units}³" if worst.volume else ""
        names = " and ".join(map(printable, worst.clearance[:2]))
        which = "the deepest " if len(clashes) > 1 else ""
        said.append(f"{counted(len(clashes), 'clash', 'clashes')}, {which}{names}: {depth} {units}{volume}")
    else:
        said.append("no clash")
    if fits:
        within = "within the approximation of" if approximation == contact else "within"
        limit = f"{length(in_unit(contact, metres))} {units}"
        if is_cad:
            within, limit = "within", "the deviation of the triangles"
        said.append(f"{counted(fits, 'pair')} {'fits' if fits == 1 else 'fit'} {within} {limit}")
    sentence = "; ".join(said)
    return f"{sentence[0].upper()}{sentence[1:]}."
