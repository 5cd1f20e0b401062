"""The memory that Python shares with a service's loop, which is compiled: records, as NumPy has them.

`tools/core_tables.py` generates the structures in C from these. All fields are of eight bytes; addresses are
those of NumPy's arrays.
"""

from proximity.core.receiver_state import REAL, RECEIVER, WHOLE
from proximity.core.receiver_state import record as _record

BINS, OUTPUTS, HOSTS, STATES = 1216, 8, 4, 6
"""Lengths, in C ``LOOP_BINS`` and so on."""


MOTION = _record(
    "number",  # of the report; 0: there was none
    "pose_ns ends_ns",  # it is believed to go on until then
    "is_moving is_hidden",
    ("matrix", REAL, 16),
    ("velocity turning", REAL, 3),  # world_from_part, m; m/s, of the origin, and rad/s about it
    ("across back", REAL, 9),  # what turning adds: by the sine of the angle, and by one less its cosine
    ("turn_rate top_speed", REAL),  # rad/s; m/s, of any point of it
)
"""What was reported of a part."""
SENSOR = _record(
    "motions error_sums unknown",  # of each finger: estimates, and the contact of one that is not known
    "latency_ns",
    ("horizon max_speed max_acceleration", REAL),
)
"""A sensor that measures distances, in place of a scene."""
SOURCE = _record(
    "sensor",  # 0: there is a scene
    "model",  # words of its arrays, as kernels take them
    "tracker",  # likewise, as `TrackerArrays`
    "bend_motions",  # estimates of the bends, two a finger
    "epoch",  # of the scene
    "is_moved",  # whether the tracker has not seen where parts stand
    "answers",  # bits of the answers of all ticks
    "scene",  # a proximity_scene, in which the loop moves parts; 0: they stand
    "motions next_motions",  # a LoopMotion a part: in use, and newer ones; 0: there are none
    "applied",  # numbers of the reports that parts were put at
    "rows matrices velocities turnings",  # of parts that are put elsewhere: scratch
    "has_looked all_stand",  # whether `motions` were applied; and whether nothing more is reported of any
    "is_edited rows_after",  # whether it is the source before with other parts; the rows that those have now
)
"""A scene and its tracker. The loop goes over to the next one between ticks; the last is Python's again."""
CONTACTS = _record(
    "source epoch",  # the LoopSource that they are of
    "is_late",
    "spent_ns",  # that a simulated clock went on while they were made
)
"""Contacts that were made beside the loop; the records are behind it."""
OUTPUT = _record(
    "socket",  # that is connected; -1: none
    "box",  # a proximity_mailbox that is open for writing; 0: none
    "key",  # 32 bytes; 0: no tags
    "session",  # ns of the calendar
    ("sequences", WHOLE, 2),  # the next numbers of frames and of descriptions
    "awake_ns",  # of the calendar on the monotonic clock, at the message before
    "failures",  # frames that were not sent, and why the first was not (errno)
    "first_failure",
    "lost",  # for which the system had no room
)
INPUT = _record(
    "is_measured",  # whether messages are of a sensor, not of poses
    "socket",  # -1: none
    "timer",  # by which waiting at the socket ends
    "box",  # a proximity_mailbox to read, open or not; 0: none
    "name",  # of the mailbox; 0: it is in the memory of this process
    ("hosts", WHOLE, HOSTS),
    "host_count port",  # IPv4, in the order of the network; 0: any port
    "key",
    "message longest",  # where a message is read to, and how long it may be
    "refused unverified unserved failures first_failure",
    ("receiver", RECEIVER),
    "looked_ns",
)
RECORDING = _record(
    "times_ns positions rows",  # from 0 on; of all fingers; 0: there is none
    "latency_ns round_ns",  # how old a pose is when it comes; from one beginning to the next, 0: there is one
    "row start_ns has_begun is_over",  # the last row that was played, and the instant of the first
)
"""Poses that were recorded, and are played by their times."""
TIMES = _record(
    "count max_ns",
    ("bins", WHOLE, BINS),
)
"""A histogram of spans."""
LOOP = _record(
    "instructions",  # name of the set of instructions
    "set",  # that set, once it was looked for: to ask the processor takes long
    "count",  # of fingers
    "period_ns valid_for_ns stale_after_ns",
    "is_simulated simulated_ns",  # a clock that stands, and jumps to the next instant
    "is_coarse",  # whether the system's monotonic clock is the coarse one of Windows
    "is_ahead",  # whether that clock runs ahead of the one that readers of frames have
    "counts_processor",  # whether ticks are timed by the processor's time for the thread
    "is_given",  # whether contacts are made beside the loop, and come as messages: LoopContacts
    "is_polled",  # whether poses that come do not wake it: they are given when a thread asks for them
    "is_late",  # whether what contacts are made of is too old already
    "frame",  # the message
    "pose_ns positions width refused_ns row_of",  # of the newest poses, a row a finger; or distances
    "measured",  # newest measurements
    "velocities paths bends has_velocities has_paths has_bends",
    "given_ns given fingers defects",  # of the poses of a message
    "lost_hand",  # defect of a pose, as the kernels have it, of a hand that is lost
    ("metres_a_bend", REAL),  # by which bends are followed as positions are
    "next source",  # the source that is to be used from the next tick on; and the one in use
    "stop ticks_wanted",  # -1: no limit
    "pending pending_size",  # a message of the description, to be sent behind the next frame
    "is_begun due_ns posed_ns epoch_offset epoch",
    "has_started reported_missed",
    "ticks missed",
    ("states", WHOLE, STATES),
    "future backwards too_old lost_hands",
    ("first_off_ns", WHOLE, 4),  # of the first ones of these kinds
    ("compute lateness", TIMES),
    ("input", INPUT),
    ("recording", RECORDING),
    ("outputs", OUTPUT, OUTPUTS),
    "output_count",
    "log",  # a proximity_mailbox without a file, for frames as the first output has sealed them; 0: none
    "datagram",  # where tagged messages are put together
)

LENGTHS = {
    "BINS": BINS,
    "OUTPUTS": OUTPUTS,
    "HOSTS": HOSTS,
    "STATES": STATES,
}
RECORDS = {
    "LoopMotion": MOTION,
    "LoopSensor": SENSOR,
    "LoopSource": SOURCE,
    "LoopContacts": CONTACTS,
    "LoopOutput": OUTPUT,
    "LoopInput": INPUT,
    "LoopRecording": RECORDING,
    "LoopTimes": TIMES,
    "Loop": LOOP,
}
"""By their names in C."""
