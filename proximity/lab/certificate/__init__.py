"""Latency certificate of a scene: the cost of ticks at its worst positions, compared with sample periods.

    file → subject → search (worst positions) → measure (ticks) → loop (waking) → document → page, JSON

The search climbs on work, which is the same on every run; only what is measured at the end is time.
"""

from proximity.lab.certificate.certification import (
    SECONDS,
    SEED,
    TICKS,
    Certificate,
    Verdict,
    certify,
    check_request,
)
from proximity.lab.certificate.fingerprint import fingerprint
from proximity.lab.certificate.period import parse_period
from proximity.lab.certificate.report.document import SCHEMA, document
from proximity.lab.certificate.report.files import as_json, check_report_name, write_report
from proximity.lab.certificate.subject import Subject, read_subject

__all__ = [
    "SCHEMA",
    "SECONDS",
    "SEED",
    "TICKS",
    "Certificate",
    "Subject",
    "Verdict",
    "as_json",
    "certify",
    "check_report_name",
    "check_request",
    "document",
    "fingerprint",
    "parse_period",
    "read_subject",
    "write_report",
]
