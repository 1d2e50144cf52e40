"""The closed list of reasons a verdict can have, each with the sentence that explains it."""

from __future__ import annotations

from enum import StrEnum


class Reason(StrEnum):
    """Why an attempt passed or failed. `RIGHT` passes; every other reason fails."""

    RIGHT = "right"
    NOT_ATTEMPTED = "not_attempted"
    # what came back is not the answer
    WRONG_VALUE = "wrong_value"
    WRONG_SHAPE = "wrong_shape"
    WRONG_TYPE = "wrong_type"
    NOT_FINITE = "not_finite"
    NOTHING_RETURNED = "nothing_returned"
    WRONG_PROPERTY = "wrong_property"
    NOT_DETERMINISTIC = "not_deterministic"
    INPUTS_CHANGED = "inputs_changed"
    MISSING_ERROR = "missing_error"
    # the code could not be used
    UNREADABLE = "unreadable"
    SYNTAX_ERROR = "syntax_error"
    MISSING_NAME = "missing_name"
    WRONG_SIGNATURE = "wrong_signature"
    BORROWED_NAME = "borrowed_name"
    RAISED = "raised"
    # the process ended before it had answered
    TIMED_OUT = "timed_out"
    OUT_OF_MEMORY = "out_of_memory"
    OUTPUT_FLOOD = "output_flood"
    DISK_FLOOD = "disk_flood"
    PROCESSES = "processes"
    EXITED = "exited"
    CRASHED = "crashed"
    KILLED = "killed"
    GARBLED = "garbled"


SENTENCES: dict[Reason, str] = {
    Reason.RIGHT: "Right.",
    Reason.NOT_ATTEMPTED: "Not attempted yet: this is still the starter.",
    Reason.WRONG_VALUE: "The values differ from the right ones by more than the tolerance.",
    Reason.WRONG_SHAPE: "The answer has the wrong shape.",
    Reason.WRONG_TYPE: "The answer is of a type that is not accepted here.",
    Reason.NOT_FINITE: "The answer holds NaN or infinity.",
    Reason.NOTHING_RETURNED: "Nothing was returned (None). Is there a return statement?",
    Reason.WRONG_PROPERTY: "A property that the answer must have does not hold.",
    Reason.NOT_DETERMINISTIC: "The same call gave different answers.",
    Reason.INPUTS_CHANGED: "An argument was changed in place. Work on a copy.",
    Reason.MISSING_ERROR: "A wrong argument was accepted where an error is asked for.",
    Reason.UNREADABLE: "The file could not be read as Python source.",
    Reason.SYNTAX_ERROR: "This is not valid Python.",
    Reason.MISSING_NAME: "The name that is graded is not defined.",
    Reason.WRONG_SIGNATURE: "The arguments differ from those in the task.",
    Reason.BORROWED_NAME: "The code uses a name that is defined elsewhere in the notebook.",
    Reason.RAISED: "The code raised an exception.",
    Reason.TIMED_OUT: "The code took longer than the limit and was stopped.",
    Reason.OUT_OF_MEMORY: "The code used more memory than the limit.",
    Reason.OUTPUT_FLOOD: "The code printed more than the limit and was stopped.",
    Reason.DISK_FLOOD: "The code wrote more to disk than the limit and was stopped.",
    Reason.PROCESSES: "The code tried to start another process, which a drill does not need.",
    Reason.EXITED: "The code ended the process before it had answered.",
    Reason.CRASHED: "The process crashed.",
    Reason.KILLED: "The process was killed from outside.",
    Reason.GARBLED: "What came back over the grader's pipe was not an answer.",
}
