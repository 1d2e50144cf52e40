"""Tests of chapter 9."""

import importlib.util
import os

import pytest


def needs_stable_baselines3() -> None:
    """Skip a test where Stable-Baselines3 is missing, unless COURSE_REQUIRE_OPTIONAL is 1."""
    required = os.environ.get("COURSE_REQUIRE_OPTIONAL") == "1"
    if importlib.util.find_spec("stable_baselines3") is None and not required:
        pytest.skip("PPO was NOT compared with Stable-Baselines3: pip install -e '.[sb3]'")
