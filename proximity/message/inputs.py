"""What a service may be fed with over a transport: poses of fingers, moves of parts, distances of a sensor.

A sender fills a `Message` of the kind and publishes it; any language can. Not known is nan.
"""

import numpy as np

from proximity.message.envelope import PREFIX, Kind

_PREFIX = [(name, PREFIX.fields[name][0].str) for name in PREFIX.names]  # type: ignore[index, union-attr]
_VECTOR = ("<f8", (3,))

PATH_CORNERS = 65
"""Corners of the polyline that tells a finger's path, evenly in its bend from 0 to 1. On the finger of PAPER
9.1 they are 3.6 mm apart at most, and the path is 0.03 mm off the line at most."""

INPUT_HEADER = np.dtype([*_PREFIX, ("send_ns", "<i8"), ("count", "<u4"), ("reserved", "<u1", (4,))])
"""The header of what a service is fed with, 48 bytes."""

POSE = np.dtype(
    [
        ("finger", "<u4"),  # which finger of the service: 0, 1, …
        ("reserved", "<u1", (4,)),
        ("pose_ns", "<i8"),  # instant of the pose
        ("position", *_VECTOR),  # m, centre of the fingertip sphere in the scene's frame; nan: not tracked
        ("velocity", *_VECTOR),  # m/s; nan: to be estimated
        ("bend", "<f8"),  # where on its path the finger is; nan: the nearest place
    ]
)
"""One finger of a ``poses`` message, 72 bytes."""

PATH_POSE = np.dtype([*POSE.descr, ("corners", "<f8", (PATH_CORNERS, 3))])
"""One finger of a ``path_poses`` message, 1632 bytes: a pose, and where the fingertip goes as the finger
bends (m, scene's frame). A first corner of nan: the finger has no path."""

MOVE = np.dtype(
    [
        ("name", "S64"),  # of the part, UTF-8, ended by a zero where shorter
        ("rotation", "<f8", (3, 3)),  # world_from_part
        ("translation", *_VECTOR),  # m
        ("velocity", *_VECTOR),  # m/s, of the part's origin
        ("angular_velocity", *_VECTOR),  # rad/s
    ]
)
"""One part of a ``moves`` message."""

MEASUREMENT = np.dtype(
    [
        ("finger", "<u4"),
        ("surface", "<u1"),  # Surface
        ("force_is_valid", "<u1"),
        ("reserved", "<u1", (2,)),
        ("measured_ns", "<i8"),  # instant of the measurement
        ("signed_distance", "<f8"),  # m, of the fingertip's surface; nan: nothing was measured
        ("error", "<f8"),  # m, how far off the distance may be
        ("position", *_VECTOR),  # m, of the fingertip; nan: not known
        ("velocity", *_VECTOR),  # m/s, of the fingertip; nan: not known
        ("normal", *_VECTOR),  # unit, from the object to the finger; nan: not known
        ("approach_speed", "<f8"),  # m/s, closing is positive; nan: to be estimated
        ("bend", "<f8"),
        ("bend_rate", "<f8"),  # 1/s
        ("force", "<f8"),  # N, on the slave finger
        ("stiffness", "<f8"),  # N/m, of a deformable object
        ("damping", "<f8"),  # N s/m
    ]
)
"""One finger of a ``measured`` message."""

POSES = Kind("poses", 0x50434544, INPUT_HEADER, POSE)  # "DECP"
PATH_POSES = Kind("path_poses", 0x54434544, INPUT_HEADER, PATH_POSE)  # "DECT"
MOVES = Kind("moves", 0x4D434544, INPUT_HEADER, MOVE)  # "DECM"
MEASURED = Kind("measured", 0x53434544, INPUT_HEADER, MEASUREMENT)  # "DECS"
