"""``proximity replay``: run a recorded hand through a scene tick by tick, and check the bounds."""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import proximity
from proximity.cli import progress
from proximity.cli.options import (
    FILE,
    JSON,
    UNITS,
    argument,
    milliseconds,
    option,
    with_option_groups,
    within,
)
from proximity.cli.output import MM_PER_M, in_unit, in_units, report
from proximity.system.time_units import MS_PER_S

if TYPE_CHECKING:
    from proximity.recording import Recording

EXIT_BROKEN_BOUND = 1
FARTHEST_M = 1e6
"""How far away a recording may be put, and how large a fingertip may be."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Options that say where the recording is put."""

    place: Annotated[
        tuple[float, float, float] | None,
        option("X Y Z", "Position of the recording's origin. Fitted if not given."),
    ] = None
    turn: Annotated[
        tuple[float, float, float],
        option(
            "RX RY RZ",
            "Rotation of the recording in degrees about the scene's x, then y, then z.",
            show_default=False,
        ),
    ] = (0.0, 0.0, 0.0)
    scale: Annotated[
        float,
        option(
            "S", "Factor by which the recording is enlarged.", callback=within(1e-6, 1e6, "times the size")
        ),
    ] = 1.0

    def origin(self, metres: float, units: str) -> list[float] | None:
        """Return the origin of the recording in metres, or None if it is to be fitted."""
        if self.place is None:
            return None
        for coordinate in self.place:
            if not abs(coordinate * metres) <= FARTHEST_M:
                raise typer.BadParameter(
                    f"{coordinate:g}: expected coordinates of at most {FARTHEST_M / metres:g} {units}",
                    param_hint="--place",
                )
        return [coordinate * metres for coordinate in self.place]

    def pose(
        self, scene: "proximity.Scene", recorded: "Recording", origin: list[float] | None, radius: float
    ) -> "proximity.Pose":
        """Return the pose of the recording: at *origin* (m), or fitted where there is none."""
        from proximity.tracker.replay import fitted_pose, turn_about_axes

        rotation = turn_about_axes(self.turn)
        if origin is not None:
            return proximity.Pose(rotation, origin)
        return fitted_pose(scene, recorded, radius, rotation=rotation, scale=self.scale)


@dataclass(frozen=True, slots=True)
class TrackerOptions:
    """Options that say how the tracker is made."""

    rate: Annotated[float, option("HZ", "Ticks per second.", callback=within(1.0, 1e6, "ticks a second"))] = (
        1000.0
    )
    radius: Annotated[
        float, option("MM", "Radius of the fingertips.", callback=within(0.0, 100.0, "mm", is_open=True))
    ] = 7.0
    latency: Annotated[
        float,
        option("MS", "Age of a pose at its tick.", parser=milliseconds, callback=within(0.0, 1e3, "ms")),
    ] = 1.0
    budget: Annotated[
        int | None,
        option(
            "N",
            "Largest number of tree nodes and leaves visited per finger and tick.",
            callback=within(1, 2**31 - 1, "nodes and leaves"),
        ),
    ] = None
    working_range: Annotated[
        float,
        option(
            "MM",
            "Distance beyond which only bounds are reported.",
            "--range",
            callback=within(0.0, 10_000.0, "mm", is_open=True),
        ),
    ] = 120.0

    def settings(self) -> dict[str, Any]:
        """Return what `proximity.Tracker` calls these options, in SI units."""
        return {
            "radius": self.radius / MM_PER_M,
            "period": 1.0 / self.rate,
            "latency": self.latency / MS_PER_S,
            "budget": self.budget,
            "working_range": self.working_range / MM_PER_M,
        }


@with_option_groups
def replay(
    file: FILE,
    recording: Annotated[Path, argument("RECORDING", "CSV file of fingertips over time.")],
    placement: Placement,
    tracker: TrackerOptions,
    limit: Annotated[
        float | None,
        option("S", "Replay only this much of the recording.", callback=within(1e-3, 1e9, "seconds")),
    ] = None,
    out: Annotated[
        Path | None, option("FILE", "Write all contacts to this file: .npz, .npy or .csv.")
    ] = None,
    as_json: JSON = False,
    units: UNITS = "mm",
) -> None:
    """Run a recorded hand past the parts of FILE, tick by tick, and check every bound.

    RECORDING is a CSV file with the columns time_s, hand, finger (0 thumb to 4 little), x_m, y_m, z_m.
    It is resampled to --rate. A finger that the sensor lost for more than 50 ms is not tracked. --place
    sets the position of the recording's origin. Without it the hand is fitted to the parts: its middle
    is moved to their middle, then up until at most a tenth of its samples touch; if no sample touches,
    it is moved to the nearest part.

    Each tick is computed with the instant that it would have in real time. The summary has the
    durations of ticks, the touches, and how many of the bounds and of the certified times to contact
    held. A certified time is checked if the finger kept its velocity within 5 %. The exit code is 1 if
    a bound or a certified time did not hold.

    Examples:
      proximity replay bracket.stl hand.csv --place 0 0 0
      proximity replay gearbox.step grab.csv --out contacts.npz
      proximity replay bracket.stl grab.csv --turn 90 0 0 --scale 0.8 --radius 6 --json
    """
    from proximity.cli.lab import replay_report
    from proximity.formats import metres_per_unit
    from proximity.recording import check_log_name, read_recording, write_contacts
    from proximity.tracker.replay import replay, summarise

    metres = metres_per_unit(units)
    settings = tracker.settings()
    origin = placement.origin(metres, units)
    if out is not None:
        check_log_name(out)
    recorded = read_recording(recording)
    if limit is not None:
        recorded = recorded.first(limit)
    progress.prepare_kernels()
    with progress.spinner(f"reading {file}") as count:
        scene = proximity.load(str(file), units=units, progress=count)
    pose = placement.pose(scene, recorded, origin, settings["radius"])
    ticked = recorded.placed(pose, placement.scale).resampled(1.0 / tracker.rate)
    tracker_of = partial(proximity.Tracker, scene, fingers=len(ticked.fingers), **settings)
    with progress.spinner("replaying ticks") as show:
        run = replay(
            tracker_of,
            ticked,
            latency=settings["latency"],
            watch=lambda chunks: progress.counted(chunks, show, total=sum(map(len, chunks))),
        )
    with progress.spinner("checking the bounds"):
        summary = summarise(scene, run, settings["radius"])
    if out is not None:
        with progress.spinner(f"writing {out}"):
            write_contacts(out, run.contacts, ticked.times_ns, ticked.fingers)
    ended = {
        **replay_report.inputs(scene, str(file), recorded, units),
        "placement": {
            "is_fitted": placement.place is None,
            "position": in_units(pose.translation, metres).tolist(),
            "turn_degrees": list(placement.turn),
            "scale": placement.scale,
        },
        "settings": {
            "rate_hz": tracker.rate,
            "radius": in_unit(settings["radius"], metres),
            "latency_ms": tracker.latency,
            "budget": tracker.budget,
            "working_range": in_unit(settings["working_range"], metres),
        },
        **replay_report.results(summary, metres),
        "out": None if out is None else str(out),
    }
    replay_report.write(ended, as_json=as_json)
    sentences = replay_report.broken(ended)
    for sentence in sentences:
        report(sentence)
    if sentences:
        raise typer.Exit(EXIT_BROKEN_BOUND)
