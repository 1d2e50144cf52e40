"""What the charts of the PID drill show, on smaller maps."""

import numpy as np
import pytest

from course.charts import build
from course.charts.control.pid import JAM, LOOP, STEP


@pytest.mark.slow
def test_the_map_of_the_loop_has_its_boundary_where_theory_has_it() -> None:
    (panel,) = build("pid_stability", nx=9, ny=30)
    theory, mujoco = panel.series
    assert panel.grid is not None
    for gain, edge in zip(panel.grid.y[1:-1:4], panel.grid.boundary()[1:-1:4], strict=True):
        known = np.interp(-gain, -np.array(theory.y), theory.x)  # a faster loop stands more
        assert edge == pytest.approx(known, abs=0.51 * (panel.grid.x[1] - panel.grid.x[0]))
    np.testing.assert_allclose(mujoco.y, np.interp(mujoco.x, theory.x, theory.y), rtol=0.4)


def test_without_anti_windup_the_jam_is_paid_for() -> None:
    angles, commands = build("pid_windup")
    best, worst = angles["conditional integration, exact"], angles["no anti-windup, exact"]
    assert max(worst.y) - STEP > 10.0 * (max(best.y) - STEP) > 0.0
    held = np.array(commands["no anti-windup, exact"].x) < JAM
    assert np.max(commands["no anti-windup, exact"].y[held]) == LOOP.limit
    for key in ("conditional integration", "no anti-windup"):  # MuJoCo's joint does the same
        exact, mujoco = (angles[f"{key}, {model}"] for model in ("exact", "MuJoCo"))
        np.testing.assert_allclose(mujoco.y, exact.y, atol=0.02)
