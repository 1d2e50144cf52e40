"""The long charts of chapter 6: force, impedance and admittance against walls of any stiffness."""

import numpy as np

from course.charts import build


def test_a_wall_over_its_stiffness():
    force, impedance, admittance = build("touching", points=3)
    exact = force["the loop's matrix"]
    np.testing.assert_allclose(exact.y[:-1], exact.expected[:-1], rtol=0.01)
    assert 1.0 < exact.y[-1] / exact.expected[-1] < 1.4  # there the delay is no longer short
    assert min(impedance["own friction, 0 ms"].y) > 40_000
    lifted, late = (impedance[f"best active damping, {ms} ms"].y for ms in (0, 2))
    assert min(lifted) > 100 * 40_000 and late[-1] < 0.01 * lifted[-1]
    assert np.all(np.diff(admittance.series[0].y) > 0)
