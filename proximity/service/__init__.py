"""Service that reads poses and publishes a frame of contacts every period, with its time and validity.

input (poses) → loop (compiled): newest poses → contacts → times, state → publishers, log

`Service` is the loop. It is independent of geometry and files, which its contact source provides.
"""

from proximity.service.clock import Clock, SkippingClock
from proximity.service.contact_source import ContactSource, TrackedContacts
from proximity.service.description import Describer
from proximity.service.frame_log import Log
from proximity.service.held_contacts import HeldContacts, NoPoses
from proximity.service.inputs.changes_input import Addition, ChangesInput, Request, carry_out
from proximity.service.inputs.gloves import GloveChoices
from proximity.service.inputs.message_input import MessageInput
from proximity.service.inputs.moves_input import MovesInput
from proximity.service.inputs.part_prediction import ReportedMotion
from proximity.service.inputs.sources import PoseInput, RecordingInput
from proximity.service.loop import Service
from proximity.service.realtime import RealTime
from proximity.service.report import Histogram, Report
from proximity.service.samples import FingerPoses, Measurements
from proximity.service.sensed_contacts import SensedContacts

__all__ = [
    "Addition",
    "ChangesInput",
    "Clock",
    "ContactSource",
    "Describer",
    "FingerPoses",
    "GloveChoices",
    "HeldContacts",
    "Histogram",
    "Log",
    "Measurements",
    "MessageInput",
    "MovesInput",
    "NoPoses",
    "PoseInput",
    "RealTime",
    "RecordingInput",
    "Report",
    "ReportedMotion",
    "Request",
    "SensedContacts",
    "Service",
    "SkippingClock",
    "TrackedContacts",
    "carry_out",
]
