"""Catalogue of all figures by name, which are FIG 5a to 5h of the paper and those of this project.

A figure consists of a table of numbers and a drawing function. Image and table are written to one folder.
"""

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from proximity.decaff.glove.glove import Glove
from proximity.errors import ArgumentError
from proximity.lab.figures import (
    error_plots,
    figure_5_plots,
    motion_plots,
    stability_plots,
    style,
)
from proximity.lab.figures.style import AS_DESIGNED, Sheet, Table


@dataclass(frozen=True, slots=True)
class Plate:
    """A figure with the source of its numbers and its drawing function."""

    title: str
    stem: str  # of its files
    numbers: Callable[..., Table]
    draw: "Callable[..., None]"
    size: tuple[float, float]  # inches
    has_drum: bool = False  # numbers and draw take the glove


def _figure_5(name: str) -> Plate:
    title, draw = f"FIG {name}: {figure_5_plots.CAPTIONS[name]}", figure_5_plots.drawer(name)
    return Plate(title, f"figure-{name}", partial(figure_5_plots.numbers, name), draw, figure_5_plots.SIZE)


def _of_drum(
    title: str, stem: str, numbers: Callable[..., Table], draw: Callable[..., None], size: tuple[float, float]
) -> Plate:
    return Plate(title, stem, numbers, draw, size, has_drum=True)


_SPEED, _LATENCY = "force error against speed", "force error against latency"
_PLATES = (
    Plate("FIG 5a to 5h on a page", "figure-5", figure_5_plots.all_numbers, figure_5_plots.draw_all,
          figure_5_plots.PAGE_SIZE),
    Plate("stability region of the sampled wall", "stability", stability_plots.numbers, stability_plots.draw,
          stability_plots.SIZE),
    _of_drum(_SPEED, "error-speed", error_plots.numbers_against_speed, error_plots.draw_against_speed,
             error_plots.SIZE),
    _of_drum(_LATENCY, "error-latency", error_plots.numbers_against_latency, error_plots.draw_against_latency,
             error_plots.SIZE),
    _of_drum("how drums go to their place", "drum-motion", motion_plots.numbers, motion_plots.draw,
             motion_plots.SIZE),
)  # fmt: skip
PLATES = {
    plate.stem.removeprefix("figure-"): plate
    for plate in (*map(_figure_5, figure_5_plots.CAPTIONS), *_PLATES)
}
"""All figures by name."""


def chosen_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return the names of the requested figures without duplicates, or of all if none is requested."""
    chosen = tuple(dict.fromkeys(names))
    for name in chosen:
        if name not in PLATES:
            raise ArgumentError(f"no figure {name!r}, expected some of {', '.join(PLATES)}")
    return chosen or tuple(PLATES)


def write_figure(
    name: str,
    folder: str | os.PathLike[str],
    form: str = "png",
    glove: Glove | None = None,
    sheet: Sheet = AS_DESIGNED,
) -> tuple[Path, Path]:
    """Write a figure of a glove and its numbers, each atomically. Return both paths."""
    (name,) = chosen_names([name])
    plate, folder = PLATES[name], Path(folder)
    style.check_format(form)
    style.load_figure()
    _make(folder)
    worn = {"glove": glove or Glove()} if plate.has_drum else {}
    table = plate.numbers(**worn)
    drawn = style.render(partial(plate.draw, **worn), table, plate.size, form, sheet=sheet)
    image, numbers = folder / f"{plate.stem}.{form}", folder / f"{plate.stem}.csv"
    style.write_bytes(image, drawn)
    style.write_table(numbers, table)
    return image, numbers


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as failure:
        raise ArgumentError(f"{folder}: no folder can be made ({failure.strerror or failure})") from failure
