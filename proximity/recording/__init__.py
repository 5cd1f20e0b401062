"""Read recordings of hands, and read and write the frames of a service.

A recording is a table of the positions of fingertips over time, as sensors write it. A frame log holds the
published frames of a service, byte for byte. This package is independent of scenes and trackers.
"""

from proximity.recording.frame_log import FrameLog
from proximity.recording.frame_reader import Damage, FrameReader
from proximity.recording.frame_tables import load_pyarrow, write_frames_csv, write_frames_parquet
from proximity.recording.recording import FINGERS, GAP_LIMIT_S, NANOSECONDS, Recording
from proximity.recording.recording_reader import read_recording

__all__ = [
    "FINGERS",
    "GAP_LIMIT_S",
    "NANOSECONDS",
    "Damage",
    "FrameLog",
    "FrameReader",
    "Recording",
    "load_pyarrow",
    "read_recording",
    "write_frames_csv",
    "write_frames_parquet",
]
