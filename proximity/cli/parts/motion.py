"""Measure the clearance of a moving part for the options ``--hinge``, ``--slide`` and ``--poses``."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from proximity.cli.options import option
from proximity.cli.output import (
    counted,
    in_unit,
    length,
    number,
    print_block,
    printable,
    text_output,
    write_document,
)

if TYPE_CHECKING:
    import proximity

EXIT_NEARER = 1
DEGREE = math.pi / 180.0
MILLIMETRE = 1e-3
AXES = ("x", "y", "z")


@dataclass(frozen=True, slots=True)
class Moving:
    """Options that describe the motion of a part."""

    hinge: Annotated[
        tuple[str, str, str] | None,
        option("POINT AXIS ANGLES", "Turn PART about an axis, as in 0,40,12 1,0,0 0..110 (degrees)."),
    ] = None
    slide: Annotated[
        tuple[str, str] | None,
        option("DIRECTION LENGTHS", "Move PART along a direction, as in 0,0,1 0..25."),
    ] = None
    poses: Annotated[
        Path | None,
        option(
            "FILE",
            "Move PART through the poses of a CSV file: position, x, y, z, qx, qy, qz, qw (quaternion).",
        ),
    ] = None
    along: Annotated[
        str | None,
        option("DIRECTION", "How far the first PART can move before it touches the second: z, -x or 0,1,1."),
    ] = None
    plot: Annotated[Path | None, option("FILE", "Draw the distance over the motion: .png, .svg or .pdf.")] = (
        None
    )
    page: Annotated[
        Path | None,
        option("FILE", "Write a standalone page (.html) that plays the motion, with the distance."),
    ] = None

    @property
    def is_given(self) -> bool:
        """True if one of the options gives a motion."""
        return any(each is not None for each in (self.hinge, self.slide, self.poses))

    @property
    def option_name(self) -> str:
        """Name of the first option that is given."""
        names = ("hinge", "slide", "poses", "along", "plot", "page")
        return next(f"--{name}" for name in names if getattr(self, name))

    def motion(self, metres: float) -> tuple["proximity.Motion", float, str]:
        """Return the motion, the size of the unit of its positions, and the name of the unit.

        The name is "" for a length.
        """
        from proximity.errors import ArgumentError
        from proximity.formats.pose_rows import read_poses
        from proximity.scene.motion import Motion

        if sum(each is not None for each in (self.hinge, self.slide, self.poses)) > 1:
            raise typer.BadParameter("one motion is expected", param_hint=self.option_name)
        if self.hinge is not None:
            point, axis, angles = self.hinge
            centre = [metres * each for each in _vector(point, "--hinge")]
            ends = (DEGREE * each for each in _range(angles, "--hinge"))
            return Motion.hinge(centre, _vector(axis, "--hinge"), *ends), DEGREE, "degrees"
        if self.slide is not None:
            direction, lengths = self.slide
            ends = (metres * each for each in _range(lengths, "--slide"))
            return Motion.slide(_vector(direction, "--slide"), *ends), metres, ""
        assert self.poses is not None
        try:
            positions, poses = read_poses(self.poses, metres)
        except ArgumentError as unfit:
            raise typer.BadParameter(str(unfit), param_hint="--poses") from None
        return Motion.through(poses, positions), 1.0, "position"


def measure_gap(
    scene: "proximity.Scene",
    pair: tuple[str, str],
    direction: str,
    *,
    units: str,
    metres: float,
    as_json: bool,
) -> None:
    """Measure how far the first part can move before it touches the second, and print the result."""
    sign, axis = (-1.0, direction[1:]) if direction.startswith("-") else (1.0, direction)
    vector = [sign * (axis == each) for each in "xyz"] if axis in AXES else _vector(direction, "--along")
    found = scene.gap(*pair, vector)
    values = {
        "first": found.first,
        "second": found.second,
        "direction": found.direction.tolist(),
        "gap": in_unit(found.distance, metres),
        "lower": in_unit(found.lower, metres),
    }
    if as_json:
        write_document({"units": units, **values})
        return
    gap, lower = (length(values[name], 6) for name in ("gap", "lower"))
    first, second = printable(found.first), printable(found.second)
    if found.lower == math.inf:
        print_block([("gap", f"none: {first} does not touch {second} along {direction}")])
    elif found.distance < 0.0:
        print_block([("gap", f"{gap} {units} along {direction}: {first} overlaps {second} by that much")])
    else:
        print_block(
            [
                ("gap", f"{gap} {units} along {direction}: there {first} touches {second}"),
                ("certain", f"no touch before {lower} {units}"),
            ]
        )


def _vector(text: str, name: str) -> list[float]:
    try:
        numbers = [float(word) for word in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 3:
        raise typer.BadParameter(f"{text!r}: expected three numbers, as in 0,0,1", param_hint=name)
    return numbers


def _range(text: str, name: str) -> tuple[float, float]:
    first, _, last = text.partition("..")
    try:
        return float(first), float(last)
    except ValueError:
        raise typer.BadParameter(f"{text!r}: expected two numbers, as in 0..110", param_hint=name) from None


def measure_motion(
    scene: "proximity.Scene",
    part: str,
    others: list[str] | None,
    moving: Moving,
    *,
    title: str,
    below: float | None,
    units: str,
    metres: float,
    csv_path: Path | None,
    as_json: bool,
) -> None:
    """Measure the clearance of a part over its motion and print the result.

    Exit with code 1 if the part may come nearer than *below*.
    """
    motion, scale, unit = moving.motion(metres)
    found = scene.clearance_along(
        part, motion, others=others, below=None if below is None else below * metres
    )
    nearest = found.nearest
    touch = None if found.first_touch is None else [each / scale for each in found.first_touch]
    values: dict[str, Any] = {
        "part": nearest.first,
        "nearest": nearest.second,
        "distance": in_unit(found.distance, metres),
        "lower": in_unit(found.lower, metres),
        "position": found.position / scale,
        "first_touch": touch,
        "from": (nearest.point_on_first / metres).tolist(),
        "to": (nearest.point_on_second / metres).tolist(),
        "samples": len(found.positions),
        "is_complete": found.is_complete,
    }
    if csv_path is not None:
        _write_curve(csv_path, found, scale, metres, units)
    if moving.plot is not None:
        label = {"degrees": "angle [degrees]", "position": "position"}.get(unit, f"displacement [{units}]")
        _draw(moving.plot, found, scale, metres, label, units)
    if moving.page is not None:
        from proximity.web.motion_page import write_motion_page

        write_motion_page(
            moving.page, scene, motion, found, title=title, others=others, unit=unit or "mm",
            scale=scale if unit else MILLIMETRE,
        )  # fmt: skip
    if as_json:
        write_document({"units": units, "position_unit": unit or units, "below": below, **values})
    else:
        print_block(_lines(values, unit or units, units))
    if below is not None:
        verdict = _verdict(values, below, units)
        if not as_json:
            typer.echo(verdict)
        if not values["lower"] >= below:
            raise typer.Exit(EXIT_NEARER)


def _lines(values: dict[str, Any], unit: str, units: str) -> list[tuple[str, str]]:
    at = "at position " if unit == "position" else "at "
    after = "" if unit == "position" else f" {unit}"
    position = f"{at}{number(values['position'], 6)}{after}"
    smallest = f"{length(values['distance'], 6)} {units} to {printable(values['nearest'])}, {position}"
    rows = [("smallest", smallest)]
    if values["lower"]:
        rows.append(("certain", f"nowhere less than {length(values['lower'], 6)} {units}"))
    if values["first_touch"] is not None:
        free, touches = (number(each, 6) for each in values["first_touch"])
        rows.append(("first touch", f"{at}{touches}{after}; certainly free before {free}"))
    for end, name in (("from", values["part"]), ("to", values["nearest"])):
        point = "  ".join(length(each, 6) for each in values[end])
        rows.append((end, f"{point} {units} ({printable(name)})"))
    rows.append(("samples", counted(values["samples"], "pose")))
    return rows


def _verdict(values: dict[str, Any], below: float, units: str) -> str:
    limit = f"{length(below)} {units}"
    if values["lower"] >= below:
        return f"The part keeps {limit} over the whole motion."
    if values["distance"] < below:
        return f"The part comes nearer than {limit}."
    return f"Undecided: the part may come nearer than {limit}."


def _write_curve(
    path: Path, found: "proximity.MotionClearance", scale: float, metres: float, units: str
) -> None:
    """Write a CSV file with positions, distances, and lower bounds up to the next position."""
    with text_output(path) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["position", f"distance_{units}", f"lower_{units}"])
        lower = [*(found.bounds / metres).tolist(), ""]
        rows = zip(
            (found.positions / scale).tolist(), (found.distances / metres).tolist(), lower, strict=True
        )
        writer.writerows(rows)


def _draw(
    path: Path, found: "proximity.MotionClearance", scale: float, metres: float, label: str, units: str
) -> None:
    """Draw the distance over the motion, and its bounds as an area."""
    import numpy as np

    from proximity.scene.picture.distance_field import load_matplotlib

    if path.suffix.lower() not in (".png", ".svg", ".pdf"):
        raise typer.BadParameter(f"{path}: expected .png, .svg or .pdf", param_hint="--plot")
    figure = load_matplotlib().figure.Figure(figsize=(7.0, 3.6), layout="constrained")
    axes = figure.add_subplot()
    positions, distances = found.positions / scale, found.distances / metres
    ends, upper = (np.repeat(each, 2)[1:-1] for each in (positions, distances))
    bounds, colour = np.repeat(found.bounds / metres, 2), "#2a6f97"
    axes.fill_between(ends, bounds, upper, color=colour, alpha=0.25, linewidth=0, label="bounds")
    axes.plot(positions, distances, color=colour, label=f"distance to {found.nearest.second}")
    axes.plot(found.position / scale, found.distance / metres, "o", color="#c1121f")
    axes.annotate(
        f"{number(found.distance / metres, 4)} {units}", (found.position / scale, found.distance / metres),
        textcoords="offset points", xytext=(6, 8), color="#c1121f",
    )  # fmt: skip
    axes.set(xlabel=label, ylabel=f"distance of {found.nearest.first} [{units}]", ylim=(0.0, None))
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    from proximity.system.whole_file import whole_file

    with whole_file(path) as stream:
        figure.savefig(stream, format=path.suffix[1:].lower(), dpi=150)
