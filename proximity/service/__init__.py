"""The service: takes poses and publishes a frame every period, with times, validity and a safe late state.

    input (poses) → filter (usable ones) → answers (contacts) → frame builder (times, state) → publishers, log

`Service` is the loop. It knows no geometry and no files: who answers is given to it, and so is its clock.
"""

from proximity.service.answers import Answering, TrackerAnswers
from proximity.service.clock import Clock, MonotonicClock, SkippingClock
from proximity.service.description import Describer
from proximity.service.histogram import Histogram
from proximity.service.inputs.changes_input import Addition, ChangesInput, Request, carry_out
from proximity.service.inputs.gloves import GloveChoices
from proximity.service.inputs.moves_input import MovesInput
from proximity.service.inputs.openxr_input import OpenXrInput
from proximity.service.inputs.sensor import Measurements, SensorInput
from proximity.service.inputs.sources import CallableInput, PoseInput, RecordingInput
from proximity.service.inputs.stream import StreamInput
from proximity.service.inputs.teleoperation import SensorAnswers
from proximity.service.log_writer import Log
from proximity.service.loop import Service
from proximity.service.realtime import RealTime
from proximity.service.report import Report
from proximity.service.samples import FingerPoses

__all__ = [
    "Addition",
    "Answering",
    "CallableInput",
    "ChangesInput",
    "Clock",
    "Describer",
    "FingerPoses",
    "GloveChoices",
    "Histogram",
    "Log",
    "Measurements",
    "MonotonicClock",
    "MovesInput",
    "OpenXrInput",
    "PoseInput",
    "RealTime",
    "RecordingInput",
    "Report",
    "Request",
    "SensorAnswers",
    "SensorInput",
    "Service",
    "SkippingClock",
    "StreamInput",
    "TrackerAnswers",
    "carry_out",
]
