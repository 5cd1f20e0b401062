"""The service: poses in, every period a frame out, with times, validity, and safe behaviour when late.

    input (poses) → gate (which may be used) → answering (contacts) → framing (times, state) → publishers, log

`Service` is the loop. It knows no geometry and no files: who answers is given to it, and so is its clock.
"""

from proximity.service.answering import Answering, TrackerAnswers
from proximity.service.clock import Clock, MonotonicClock, SkippingClock
from proximity.service.gloves import GloveWays
from proximity.service.histogram import Histogram
from proximity.service.inputs import CallableInput, PoseInput, RecordingInput
from proximity.service.log_writer import Log
from proximity.service.loop import Service
from proximity.service.moves import MovesInput
from proximity.service.realtime import RealTime
from proximity.service.report import Report
from proximity.service.samples import Hands
from proximity.service.sensor import Measurements, SensorInput
from proximity.service.stream import StreamInput
from proximity.service.teleoperation import SensorAnswers

__all__ = [
    "Answering",
    "CallableInput",
    "Clock",
    "GloveWays",
    "Hands",
    "Histogram",
    "Log",
    "Measurements",
    "MonotonicClock",
    "MovesInput",
    "PoseInput",
    "RealTime",
    "RecordingInput",
    "Report",
    "SensorAnswers",
    "SensorInput",
    "Service",
    "SkippingClock",
    "StreamInput",
    "TrackerAnswers",
]
