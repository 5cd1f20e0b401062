"""Latency certificate of a scene: the cost of ticks at its worst positions, compared with sample periods.

    file → subject → worst positions → measurement (ticks, loop) → document → report (page, JSON)

The search climbs on work, which is the same on every run; only what is measured at the end is time.
"""

from proximity.lab.certificate.certification import Certificate, certify, check_request
from proximity.lab.certificate.deadlines import parse_period
from proximity.lab.certificate.document import document
from proximity.lab.certificate.report import as_json, check_libraries, check_report_name, write_report
from proximity.lab.certificate.subject import Subject, read_subject

__all__ = [
    "Certificate",
    "Subject",
    "as_json",
    "certify",
    "check_libraries",
    "check_report_name",
    "check_request",
    "document",
    "parse_period",
    "read_subject",
    "write_report",
]
