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


def test_without_lag_the_torque_is_the_command_minus_friction() -> None:
    # A lag of one substep makes the current the command; 1e6 rad/s leave the voltage unlimited.
    drive = an.Drive(delay=0, lag=an.DT / 5.0, free_speed=1e6)
    run = an.record(drive, an.targets(4, np.random.default_rng(2)))
    middle = 0.5 * (run.speed[:, :-1] + run.speed[:, 1:])
    # Stribeck (1902): friction falls with speed, from its value at rest to that in motion.
    extra = 1.0 + 0.6 * np.exp(-((middle / 0.4) ** 2))
    gear = 0.8 * extra * np.tanh(middle / 0.05) + 0.15 * middle
    command = np.clip(60.0 * run.error - 1.0 * run.speed, -20.0, 20.0)[:, :-1]
    error = run.torque[:, :-1] - (command - gear)
    assert np.sqrt(np.mean(error**2)) < 0.02
    np.testing.assert_allclose(an.friction(middle, 0.8, 0.15), gear)


def test_the_voltage_bounds_the_speed_and_heat_weakens_the_torque() -> None:
    far = np.full((1, 400), 30.0)
    far[:, 0] = 0.0
    free = an.Drive(delay=0, dry=0.0, viscous=0.0)
    fast = an.record(free, far)
    # From rest towards a distant target: the speed rises to the free speed and not beyond.
    assert 0.9 * free.free_speed < fast.speed.max() <= free.free_speed * (1.0 + 1e-9)
    warm = an.record(an.Drive(delay=0, dry=0.0, viscous=0.0, free_speed=1e6, strength=0.5), far)
    cold = an.record(an.Drive(delay=0, dry=0.0, viscous=0.0, free_speed=1e6), far)
    np.testing.assert_allclose(warm.torque[0, 1:20], 0.5 * cold.torque[0, 1:20])


def test_the_error_is_the_root_of_the_mean_square_of_each_run() -> None:
    still = np.zeros((2, 4))
    run = an.Recording(still, still, np.array([[1.0, -1.0, 1.0, -1.0], [0.0, 0.0, 0.0, 4.0]]))
    np.testing.assert_allclose(an.torque_error(still, run), [1.0, 2.0])


@pytest.mark.prove
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
