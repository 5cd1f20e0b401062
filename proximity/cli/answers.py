"""Questions to a scene in people's units, answers as plain lists in the same units.

Lengths of answers have at most 15 significant digits, as `lengths` rounds them; directions and barycentric
coordinates are exact.

An answer is a mapping from a field's name to a list with one entry a query: a number, three numbers, a word,
or None where there is nothing. Fields are named as in the library's results; ``face`` is the row of the
file's faces, ``face_id`` that of the part's mesh.
"""

from typing import Any

import numpy as np

import proximity
from proximity.cli.lengths import distances_in_units, in_units
from proximity.scene.queries.results import NO_FACE, Feature

Fields = dict[str, list[Any]]

FEATURE_WORDS = {int(feature): feature.name.lower() for feature in Feature}


def closest(scene: "proximity.Scene", points: np.ndarray, metres: float, workers: int) -> Fields:
    """Ask for the surface points nearest to *points*.

    Parameters
    ----------
    scene : Scene
        Where to look.
    points : (N, 3) float64, in the unit
        Where to measure from.
    metres : float
        Metres in one unit.
    workers : int
        Threads; -1 is all cores.
    """
    asked_from = _in_metres(points, metres)
    hits = scene.closest(asked_from, workers=workers)
    features = [FEATURE_WORDS.get(code) for code in hits.feature.tolist()]
    found = (hits.face_id != NO_FACE).tolist()
    return {
        "query": points.tolist(),
        "signed_distance": distances_in_units(hits.signed_distance, metres, asked_from, hits.point).tolist(),
        "distance": distances_in_units(hits.distance, metres, asked_from, hits.point).tolist(),
        "is_signed": hits.is_signed.tolist(),
        "point": in_units(hits.point, metres).tolist(),
        "gradient": hits.gradient.tolist(),
        **_faces(scene, hits),
        "feature": [word if is_found else None for word, is_found in zip(features, found, strict=True)],
        "barycentric": hits.barycentric.tolist(),
    }


def cast(
    scene: "proximity.Scene", origins: np.ndarray, direction: np.ndarray, metres: float, workers: int
) -> Fields:
    """Ask what rays from *origins* hit first.

    Parameters
    ----------
    scene : Scene
        Where to look.
    origins : (N, 3) float64, in the unit
        Where the rays start.
    direction : (3,) float64
        Where all of them go; of any length but zero.
    metres : float
        Metres in one unit.
    workers : int
        Threads; -1 is all cores.
    """
    directions = np.broadcast_to(direction, origins.shape)
    starts = _in_metres(origins, metres)
    hits = scene.cast(starts, directions, workers=workers)
    return {
        "origin": origins.tolist(),
        "direction": directions.tolist(),
        "distance": distances_in_units(hits.distance, metres, starts, hits.point).tolist(),
        "point": in_units(hits.point, metres).tolist(),
        "normal": hits.normal.tolist(),
        **_faces(scene, hits),
        "barycentric": hits.barycentric.tolist(),
    }


def closest_to_segments(scene: "proximity.Scene", ends: np.ndarray, metres: float, workers: int) -> Fields:
    """Ask for the shortest connections from segments to the surface.

    Parameters
    ----------
    scene : Scene
        Where to look.
    ends : (2 N, 3) float64, in the unit
        Start and end of each segment in turn.
    metres : float
        Metres in one unit.
    workers : int
        Threads; -1 is all cores.
    """
    starts, stops = ends[0::2], ends[1::2]
    hits = scene.closest_to_segments(_in_metres(starts, metres), _in_metres(stops, metres), workers=workers)
    return {
        "start": starts.tolist(),
        "end": stops.tolist(),
        "distance": distances_in_units(
            hits.distance, metres, hits.point_on_segment, hits.point_on_solid
        ).tolist(),
        "fraction": hits.fraction.tolist(),
        "point_on_segment": in_units(hits.point_on_segment, metres).tolist(),
        "point_on_solid": in_units(hits.point_on_solid, metres).tolist(),
        **_faces(scene, hits),
    }


def _in_metres(points: np.ndarray, metres: float) -> np.ndarray:
    with np.errstate(over="ignore"):  # too far for a float64 is not finite, and answered so
        return points * metres


def _faces(scene: "proximity.Scene", hits: Any) -> Fields:
    """Name part and face of each hit; None where nothing was found."""
    names = [*(part.name for part in scene.parts), None]  # NO_FACE, -1, takes the last
    faces = np.full(hits.face_id.shape, NO_FACE, dtype=np.int64)
    for index in np.unique(hits.part[hits.face_id != NO_FACE]):
        here = hits.part == index
        faces[here] = scene.parts[index].source_faces[hits.face_id[here]]
    return {
        "part": _or_none(hits.part),
        "part_name": [names[index] for index in hits.part.tolist()],
        "face": _or_none(faces),
        "face_id": _or_none(hits.face_id),
    }


def _or_none(ids: np.ndarray) -> list[int | None]:
    return [None if number == NO_FACE else number for number in ids.tolist()]
