"""The chart of a pose with and without the outline, on smaller sizes."""

import pytest

from course import charts


@pytest.mark.slow
def test_only_the_outline_shows_where_a_part_is_that_is_seen_from_above():
    above, tilted = charts.build("outline_precision", widths=(160, 320), pictures=4, repeats=1)
    # Half of a pixel is 2.7 mm and 1.4 mm at 0.8 m.
    assert max(above["points and outline"].y) < 1e-3
    assert min(above["points"].y) > 5.0 * max(above["points and outline"].y)
    assert max(tilted["points and outline"].y) < 1e-3
