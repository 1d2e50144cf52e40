"""Every control, preset, drag and key of every live simulation, and its memory, in Chromium."""

import pytest

from tests.site.player.test_browser import (
    browser,
    open_page,
    test_every_preset_and_both_ends_of_every_input,
    test_memory_stays_flat_over_2000_pictures_and_200_resets,
    test_pointer_and_keys_do_what_they_do_in_the_notebook,
)

pytestmark = pytest.mark.browser

__all__ = [
    "browser",
    "open_page",
    "test_every_preset_and_both_ends_of_every_input",
    "test_memory_stays_flat_over_2000_pictures_and_200_resets",
    "test_pointer_and_keys_do_what_they_do_in_the_notebook",
]
