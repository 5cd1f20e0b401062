"""Receipts of verifications, as JSON files that can be checked by measuring again.

Lengths are in m. The path of the file of requirements is relative to the folder of the receipt, and other
paths are relative to the folder of that file.
"""

import datetime
import hashlib
import json
import math
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import proximity
from proximity.errors import ServiceError
from proximity.requirements.records import Verification, VerifiedPair
from proximity.requirements.verification import verify
from proximity.system.regular_file import open_regular
from proximity.system.whole_file import whole_file

FORMAT = 1
"""Number of the format of receipts."""
COMPARED = ("verdict", "settings", "files", "geometry", "results")
PROGRAM = ("version", "program")
RELATIVE, ABSOLUTE = 1e-9, 1e-12
"""Differences of numbers, relative and in m, up to which they are equal."""
MAX_BYTES = 1 << 28
Values = dict[str, Any]


class ReceiptCheck(NamedTuple):
    """Comparison of a receipt with a new verification.

    ``differences`` and ``notes`` are sentences. The receipt is confirmed if there are no differences. Notes
    do not affect the result: another version of the program may confirm a receipt.
    """

    verification: Verification
    differences: tuple[str, ...]
    notes: tuple[str, ...]


def write_receipt(path: str | os.PathLike[str], verification: Verification) -> None:
    """Write a receipt. It replaces an existing file."""
    text = json.dumps(_values(verification, Path(path)), indent=1, allow_nan=False)
    with whole_file(path) as stream:
        stream.write(text.encode() + b"\n")


def check_receipt(
    path: str | os.PathLike[str], requirements: str | os.PathLike[str] | None = None, *, cache: bool = True
) -> ReceiptCheck:
    """Verify the requirements of a receipt again and compare.

    *requirements*: the file of requirements if it is not where the receipt has it.
    """
    recorded = _read(path)
    if requirements is None:
        requirements = Path(path).parent / recorded["requirements"]
    verification = verify(requirements, cache=cache)
    present = _values(verification, Path(path))
    differences = _differences({key: (recorded.get(key), present[key]) for key in COMPARED})
    notes = _differences({key: (recorded.get(key), present[key]) for key in PROGRAM})
    return ReceiptCheck(verification, differences, notes)


def _values(verification: Verification, receipt: Path) -> Values:
    """Return the content of a receipt."""
    folder = Path(verification.path).absolute().parent
    return {
        "receipt": FORMAT,
        "version": proximity.__version__,
        "program": _program_digest(),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "requirements": _relative(verification.path, receipt.absolute().parent),
        "verdict": str(verification.verdict),
        "settings": dict(verification.settings),
        "files": {_relative(name, folder): digest for name, digest in verification.files.items()},
        "geometry": verification.geometry,
        "notes": list(verification.notes),
        "seconds": verification.seconds,
        "results": {
            each.name: {
                "kind": each.kind,
                "limits": [_finite(limit) for limit in each.limits],
                "verdict": str(each.verdict),
                "pairs": {
                    f"{pair.first!r} and {pair.second!r}": _values_of_pair(pair) for pair in each.pairs
                },
            }
            for each in verification.requirements
        },
    }


def _values_of_pair(pair: VerifiedPair) -> Values:
    """Return the verdict on a pair, its bounds and points."""
    return {
        "verdict": str(pair.verdict),
        "bounds": [_finite(pair.lower), _finite(pair.upper)],
        "deviation": _finite(pair.deviation),
        "from": [_finite(each) for each in pair.point_on_first.tolist()],
        "to": [_finite(each) for each in pair.point_on_second.tolist()],
        "position": pair.position,
    }


def _finite(value: float) -> float | None:
    """Return a number, or None for an infinite or missing one."""
    return value if math.isfinite(value) else None


def _relative(name: str, folder: Path) -> str:
    """Return the path of a file relative to a folder, with slashes; absolute on another drive."""
    path = os.path.abspath(name)
    is_on_drive = Path(path).drive == folder.drive
    return Path(os.path.relpath(path, folder) if is_on_drive else path).as_posix()


@cache
def _program_digest() -> str:
    """Return the SHA-256 of the sources of the program."""
    package, digest = Path(proximity.__file__).parent, hashlib.sha256()
    sources = {path.relative_to(package).as_posix(): path for path in package.rglob("*.py")}
    for name, path in sorted(sources.items()):
        content = path.read_bytes()
        digest.update(f"{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def _read(path: str | os.PathLike[str]) -> Values:
    """Read a receipt."""
    name, expected = os.fsdecode(path), "expected a receipt of proximity verify"
    try:
        with open_regular(path) as stream:
            content = json.loads(stream.read(MAX_BYTES))
    except OSError as failure:
        raise ServiceError(f"{name}: cannot be read ({failure.strerror or failure})") from failure
    except (ValueError, RecursionError) as unfit:
        raise ServiceError(f"{name}: is not JSON ({unfit}), {expected}") from unfit
    if not isinstance(content, dict) or not isinstance(content.get("requirements"), str):
        raise ServiceError(f"{name}: has no key 'requirements', {expected}")
    if content.get("receipt") != FORMAT:
        raise ServiceError(f"{name}: has format {content.get('receipt')!r}, expected {FORMAT}")
    return content


def _differences(values: dict[str, tuple[Any, Any]]) -> tuple[str, ...]:
    """Return a sentence for each difference of the values in the receipt and now."""
    return tuple(
        sentence for key, (before, now) in values.items() for sentence in _compared(key, before, now)
    )


def _compared(key: str, before: Any, now: Any) -> Iterator[str]:
    """Yield a sentence for each difference. Numbers are equal up to rounding; points are not compared."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in before | now:
            if name not in ("from", "to", "position"):  # they may differ where several points are nearest
                yield from _compared(f"{key}: {name}", before.get(name), now.get(name))
        return
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for each, other in zip(before, now, strict=True):
            yield from _compared(key, each, other)
        return
    are_numbers = isinstance(before, float | int) and isinstance(now, float | int)
    if before != now and not (are_numbers and math.isclose(before, now, rel_tol=RELATIVE, abs_tol=ABSOLUTE)):
        yield f"{key} is {_shown(before)} in the receipt, and {_shown(now)} now"


def _shown(value: Any) -> str:
    """Return a value as text."""
    return "missing" if value is None else "present" if isinstance(value, dict | list) else str(value)
