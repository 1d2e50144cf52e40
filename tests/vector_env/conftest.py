"""Garbage is collected often here: after each test, and by Gymnasium after each video."""

import gc

import pytest


@pytest.fixture(autouse=True, scope="package")
def old_objects_stay():
    """What was there before these tests is not gone through by each collection, which would be
    most of their time; what they make is."""
    gc.collect()
    gc.freeze()
