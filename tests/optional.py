"""What a machine may lack: a test that needs it is skipped with a sentence, or fails on request.

A test of a library that `make test` does not install carries `pytest.mark.optional` besides.
COURSE_REQUIRE_OPTIONAL=1 turns these skips into failures: for a machine that has everything.
"""

import os
from typing import NoReturn

import pytest

REQUIRED = os.environ.get("COURSE_REQUIRE_OPTIONAL") == "1"


def skip(reason: str) -> NoReturn:
    """Skip the test that runs, or fail it where everything is required.

    Args:
        reason: A sentence that says what did NOT run, and why.
    """
    if REQUIRED:
        pytest.fail(reason)
    pytest.skip(reason)
