"""A throw-away process for a submission. See `drills.sandbox.process.Child`."""

from drills.sandbox.outcome import (
    Ended,
    Foreign,
    Frame,
    Handle,
    Limits,
    Loaded,
    MissingName,
    Parameter,
    Raised,
    StartFailed,
    SyntaxProblem,
)
from drills.sandbox.process import Child
from drills.sandbox.protections import Protection, protections
from drills.sandbox.submission import Unreadable, decode_submission, read_submission

__all__ = [
    "Child",
    "Ended",
    "Foreign",
    "Frame",
    "Handle",
    "Limits",
    "Loaded",
    "MissingName",
    "Parameter",
    "Protection",
    "Raised",
    "StartFailed",
    "SyntaxProblem",
    "Unreadable",
    "decode_submission",
    "protections",
    "read_submission",
]
