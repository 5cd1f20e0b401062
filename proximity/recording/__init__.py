"""Hand recordings in, contact logs out.

A recording is a table of fingertips over time, as sensors write it; a contact log is what a tracker answered.
Neither a scene nor a tracker is known here.
"""

from proximity.recording.contact_log import SUFFIXES, check_log_name, write_contacts
from proximity.recording.reading import read_recording
from proximity.recording.records import FINGERS, GAP_LIMIT_S, NANOSECONDS, Recording

__all__ = [
    "FINGERS",
    "GAP_LIMIT_S",
    "NANOSECONDS",
    "SUFFIXES",
    "Recording",
    "check_log_name",
    "read_recording",
    "write_contacts",
]
