"""The long charts of chapter 6: walls of any stiffness, laws along a path, what logs tell."""

import numpy as np
import pytest

from course.charts import build
from course.charts.control import logs, tracking


def test_a_wall_over_its_stiffness():
    force, impedance, admittance = build("touching", points=3)
    exact = force["the loop's matrix"]
    np.testing.assert_allclose(exact.y[:-1], exact.expected[:-1], rtol=0.01)
    assert 1.0 < exact.y[-1] / exact.expected[-1] < 1.4  # there the delay is no longer short
    assert min(impedance["own friction, 0 ms"].y) > 40_000
    lifted, late = (impedance[f"best active damping, {ms} ms"].y for ms in (0, 2))
    assert min(lifted) > 100 * 40_000 and late[-1] < 0.01 * lifted[-1]
    assert np.all(np.diff(admittance.series[0].y) > 0)


def test_along_the_path_mpc_without_limits_is_the_regulator() -> None:
    result = [
        tracking.error(tracking.LAWS[name](tracking.ARM, 0.02), 0.02, 1.0, last=0.5)
        for name in ("LQR along the path", "MPC")
    ]
    assert result[0] == pytest.approx(result[1], rel=0.05) and result[0] < 1e-3


def test_a_log_tells_the_inertia_and_the_cause() -> None:
    inertia, causes = build("what_a_log_tells", noises=(3e-5,), joints=2, causes=1)
    integral, usual, *filtered = inertia.series
    assert integral.y[0] < 1e-3 < 0.1 < usual.y[0]
    assert all(one.y[0] < 0.01 for one in filtered)
    assert [series.y[0] for series in causes.series] == [1.0] * len(logs.CAUSES)


def test_a_learned_law_is_as_good_inside_and_worse_outside() -> None:
    (panel,) = build("learned_beside_adaptive", rounds=4, seeds=2, dt=8e-3)
    inside, outside = panel.series
    assert inside.y[-1] < 0.02 * inside.y[0] and outside.y[-1] > 3.0 * inside.y[-1]
    assert 5.0 * max(line[1] for line in panel.lines) < outside.y[-1]
