"""Actuator models: the drive against closed forms, both fits against drives that they can be."""

import numpy as np
import pytest

from course.sim_to_real import actuator_network as an


def test_torque_moves_the_load_by_newtons_law() -> None:
    run = an.record(an.Drive(), an.targets(3, np.random.default_rng(0)))
    gained = np.cumsum(run.torque, axis=1)[:, :-1] * an.DT / an.INERTIA
    np.testing.assert_allclose(gained, run.speed[:, 1:], atol=1e-9)


def test_a_stalled_drive_reaches_its_limit_with_the_lag_of_its_current() -> None:
    # A step far beyond the limit: after the delay the torque follows 1 - exp(-t / lag), as long as
    # the joint is slow.
    drive = an.Drive(delay=0, dry=0.0, viscous=0.0, free_speed=1e6)
    target = np.full((1, 40), 2.0)
    target[:, 0] = 0.0
    run = an.record(drive, target)
    times = an.DT * (np.arange(1, 6) - 0.5)
    # The drive's command is zero during the first period.
    expected = an.TORQUE * (1.0 - np.exp(-times / drive.lag))
    np.testing.assert_allclose(run.torque[0, 1:6], expected, atol=0.08 * an.TORQUE)


def test_the_parametric_fit_recovers_a_drive_that_it_can_represent() -> None:
    drive = an.Drive(delay=2, lag=0.02, free_speed=1e6, dry=1e-6, viscous=0.3)
    run = an.record(drive, an.targets(6, np.random.default_rng(1), amplitude=(0.02, 0.05)))
    model = an.fit_parametric(run)
    assert model.delay == 2
    assert model.lag == pytest.approx(0.02, rel=0.1)
    assert model.viscous == pytest.approx(0.3, rel=0.1)
    assert an.torque_error(an.parametric(run, model), run).max() < 0.05 * run.torque.std()


def test_the_network_wins_as_recorded_and_gets_worse_off_the_recording() -> None:
    rows = [an.compare(seed, 12, 1500) for seed in range(3)]

    def middle(case: str, model: str, share: float = 50.0) -> float:
        return float(np.percentile(np.concatenate([r[case][model] for r in rows]), share))

    own = middle("as recorded", "network")
    assert own < 0.6 * middle("as recorded", "lag and friction")
    assert middle("as recorded", "lag and friction") < middle("as recorded", "ideal drive")
    assert middle("faster, 3 to 6 Hz", "network") > 3.0 * own
    # A lower voltage limits only fast runs, so compare the worst tenth of both.
    worst = middle("as recorded", "network", 90.0)
    assert middle("half the voltage", "network", 90.0) > 2.0 * worst


def test_inputs_are_the_past_and_repeat_the_first_value() -> None:
    values = np.arange(12.0)[None]
    x = an.inputs(an.Recording(0.3 * values, 3.0 * values, values))
    assert x[10].tolist() == pytest.approx([10, 6, 2, 10, 6, 2])
    assert x[3].tolist() == pytest.approx([3, 0, 0, 3, 0, 0])


def test_bad_input_names_argument_rule_and_value() -> None:
    with pytest.raises(ValueError, match="lag"):
        an.Drive(lag=0.0)
    with pytest.raises(ValueError, match="frequency"):
        an.targets(1, np.random.default_rng(0), frequency=(2.0, 1.0))
