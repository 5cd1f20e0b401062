"""Messages to a service, which contain poses of fingers, moves of parts, or distances of a sensor.

A sender fills a `Message` of the kind, including ``send_ns`` in the header, and publishes it. Programs in any
language can do this. A service on another machine estimates the sender's clock from ``send_ns``. Unknown
values are nan.
"""

from proximity.message.envelope import PREFIX_FIELDS, Kind
from proximity.message.fields import VECTOR, Field, dtype_of, reserved

PATH_CORNERS = 65
"""Number of corners of the polyline of a finger's path, at equally spaced bends from 0 to 1. On the default
finger they are at most 3.6 mm apart, and the path is at most 0.03 mm off the polyline."""

INPUT_FIELDS = (
    *PREFIX_FIELDS,
    Field("send_ns", "<i8", "ns", "instant at which the message was sent"),
    Field("count", "<u4", "", "records that follow"),
    reserved(4),
)
INPUT_HEADER = dtype_of(INPUT_FIELDS)
"""The header of messages to a service, 48 bytes."""

POSE_FIELDS = (
    Field("finger", "<u4", "", "which finger of the service: 0, 1, …"),
    reserved(4),
    Field("pose_ns", "<i8", "ns", "instant of the pose"),
    Field("position", "<f8", "m", "centre of the fingertip sphere; nan: not tracked", VECTOR),
    Field("velocity", "<f8", "m/s", "nan: to be estimated", VECTOR),
    Field("bend", "<f8", "", "of the finger, 0 to 1; nan: not known, on a path the nearest position"),
)
POSE = dtype_of(POSE_FIELDS)
"""One finger of a ``poses`` message, 72 bytes."""

PATH_POSE_FIELDS = (
    *POSE_FIELDS,
    Field(
        "corners",
        "<f8",
        "m",
        "path of the fingertip over the bend, evenly from 0 to 1; a first corner of nan: no path",
        (PATH_CORNERS, 3),
    ),
)
PATH_POSE = dtype_of(PATH_POSE_FIELDS)
"""One finger of a ``path_poses`` message, 1632 bytes: a pose, and the finger's path."""

GLOVE_POSE_FIELDS = (
    Field("finger", "<u4", "", "which finger of the service: 0, 1, …"),
    reserved(4),
    Field("pose_ns", "<i8", "ns", "instant of pose and bend"),
    Field(
        "rotation",
        "<f8",
        "",
        "world_from_finger, row by row: x along the flat finger, y out of the back of the hand",
        (3, 3),
    ),
    Field("translation", "<f8", "m", "of the knuckle; nan: not tracked", VECTOR),
    Field("bend", "<f8", "", "of the finger, 0 to 1; nan: derived from the counts"),
    Field("counts", "<f8", "counts", "of the glove's potentiometer; nan: the bend is reported"),
)
GLOVE_POSE = dtype_of(GLOVE_POSE_FIELDS)
"""One finger of a ``glove_poses`` message, 128 bytes: the pose of its knuckle, and its bend."""

MOVE_FIELDS = (
    Field("name", "S64", "", "of the part, UTF-8, ended by a zero where shorter"),
    Field("pose_ns", "<i8", "ns", "instant of the pose, which its velocities extrapolate for 100 ms"),
    Field("rotation", "<f8", "", "world_from_part, row by row", (3, 3)),
    Field("translation", "<f8", "m", "of the part's origin", VECTOR),
    Field("velocity", "<f8", "m/s", "of the part's origin", VECTOR),
    Field("angular_velocity", "<f8", "rad/s", "about the part's origin", VECTOR),
)
MOVE = dtype_of(MOVE_FIELDS)
"""One part of a ``moves`` message, 216 bytes."""

MEASUREMENT_FIELDS = (
    Field("finger", "<u4", "", "which finger of the service: 0, 1, …"),
    Field("surface", "<u1", "", "a Surface"),
    Field("force_is_valid", "<u1", "", "1 where the force was measured"),
    reserved(2),
    Field("measured_ns", "<i8", "ns", "instant of the measurement"),
    Field("signed_distance", "<f8", "m", "of the fingertip's surface; nan: not measured"),
    Field("error", "<f8", "m", "largest error of the distance"),
    Field("position", "<f8", "m", "centre of the fingertip sphere; nan: not known", VECTOR),
    Field("velocity", "<f8", "m/s", "of the fingertip; nan: not known", VECTOR),
    Field("normal", "<f8", "", "unit, from the object to the finger; nan: not known", VECTOR),
    Field("approach_speed", "<f8", "m/s", "closing is positive; nan: to be estimated"),
    Field("bend", "<f8", "", "of the finger on its path, 0 to 1; nan: not known"),
    Field("bend_rate", "<f8", "1/s", "of bend; nan: not known"),
    Field("force", "<f8", "N", "on the slave finger"),
    Field("stiffness", "<f8", "N/m", "of a deformable object"),
    Field("damping", "<f8", "N s/m", "of a deformable object"),
)
MEASUREMENT = dtype_of(MEASUREMENT_FIELDS)
"""One finger of a ``measured`` message, 152 bytes."""

POSES = Kind("poses", 0x50434544, INPUT_HEADER, POSE, sent="send_ns")  # "DECP"
PATH_POSES = Kind("path_poses", 0x54434544, INPUT_HEADER, PATH_POSE, sent="send_ns")  # "DECT"
GLOVE_POSES = Kind("glove_poses", 0x47434544, INPUT_HEADER, GLOVE_POSE, sent="send_ns")  # "DECG"
MOVES = Kind("moves", 0x4D434544, INPUT_HEADER, MOVE, sent="send_ns")  # "DECM"
MEASURED = Kind("measured", 0x53434544, INPUT_HEADER, MEASUREMENT, sent="send_ns")  # "DECS"
