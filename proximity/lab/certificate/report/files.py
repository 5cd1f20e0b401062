"""A certificate as files: a page for people, and the same as JSON beside it for machines."""

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np

from proximity.errors import ServiceError
from proximity.lab.certificate.report.page import page
from proximity.lab.certificate.search.starting_positions import surface_samples
from proximity.scene.scene import Scene
from proximity.system.whole_file import whole_file

SUFFIXES = (".html", ".json")
CLOUD = 1200
"""Points of the surface in the page."""


def check_report_name(path: str | os.PathLike[str]) -> None:
    """Refuse what is no name of a report."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise ServiceError(f"{target} does not end in {' or '.join(SUFFIXES)}")
    if not target.parent.is_dir():
        raise ServiceError(f"{target}: there is no folder {target.parent}")


def write_report(path: str | os.PathLike[str], reported: dict[str, Any], scene: Scene) -> tuple[Path, ...]:
    """Write JSON, and then the page if that is asked for; each file wholly or not at all.

    *path*: ends in .html: the page, with the JSON beside it. Ends in .json: that alone.
    """
    check_report_name(path)
    target = Path(path)
    numbers = target.with_suffix(".json")
    with whole_file(numbers) as stream:
        stream.write(as_json(reported).encode())
    if target.suffix.lower() == ".json":
        return (numbers,)
    surface, _ = surface_samples(scene, CLOUD, np.random.default_rng(0))
    text = page(reported, surface)
    with whole_file(target) as stream:
        stream.write(text.encode())
    return target, numbers


def as_json(reported: dict[str, Any]) -> str:
    """Return a document as text; what is no number becomes null."""
    return json.dumps(_plain(reported), allow_nan=False, indent=1, ensure_ascii=False) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value
