"""Arms that vary: the plant against SciPy, the law against its theory, the methods over seeds."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from course.control.adaptive import guarded
from course.sim_to_real import varying_arms as va

LAW = va.Gains(20.0, 15.0, 0.0)


def task(n: int = 6, seed: int = 0, seconds: float = 4.0) -> tuple[np.ndarray, np.ndarray]:
    """Return arms of the family and references."""
    rng = np.random.default_rng(seed)
    return va.family(n, rng), va.references(n, rng, seconds)


def test_the_reference_is_the_integral_of_its_rates() -> None:
    (path,) = va.references(1, np.random.default_rng(0))
    for i in (0, 1):
        slope = np.gradient(path[:, i], va.DT)
        np.testing.assert_allclose(slope[1:-1], path[1:-1, i + 1], atol=2e-2)


@pytest.mark.prove
def test_the_true_model_needs_no_feedback_and_a_wrong_one_does() -> None:
    # With the arm's own coefficients only sampling, delay and dry friction are left.
    arms, paths = task()
    arms[:, 1:] = 0.0
    weak = va.Gains(2.0, 2.0)
    known = va.track(arms, weak, paths, estimate=arms, noise=0.0).error
    assumed = va.track(arms, weak, paths, noise=0.0).error
    assert np.all(known < 0.1)
    wrong = np.abs(arms[:, 0] - va.MIDDLE[0]) > 0.3
    assert np.all(assumed[wrong] > 2.0 * known[wrong])


def test_the_closed_loop_follows_scipys_solution_of_the_same_equations() -> None:
    # One arm held at a constant angle: the exact offset follows from the balance of torques.
    arms = np.array([[1.5, 0.3, 0.0]])
    still = np.zeros((1, 4000, 3))
    run = va.track(arms, LAW, still, noise=0.0)
    inertia, _, _, weight = va.coefficients(va.MIDDLE[None])[0]
    true = va.coefficients(arms)[0]

    def rates(_: float, x: np.ndarray) -> list[float]:
        s = -x[1] - LAW.slope * x[0]
        torque = inertia * (LAW.damping * s - LAW.slope * x[1]) + weight * np.cos(x[0])
        torque += va.MIDDLE[1] * -LAW.slope * x[0]
        torque += va.MIDDLE[2] * np.tanh(-LAW.slope * x[0] / va.SLIP)
        load = true[1] * x[1] + true[3] * np.cos(x[0])
        return [x[1], (torque - load) / true[0]]

    end = solve_ivp(rates, (0.0, 20.0), [0.0, 0.0], method="Radau", rtol=1e-9, atol=1e-10).y[0, -1]
    assert abs(end) > 1e-3
    assert run.angle[0, -1] == pytest.approx(-end, rel=1e-3)


def test_late_torques_drive_the_estimate_of_a_light_arm_up() -> None:
    # The settings that `tune_methods` finds for the adaptive law.
    law, n = va.Gains(14.3, 10.0), 8
    rises, stays, heavy = 0, 0, 0
    for seed in range(3):
        arms, paths = task(n, seed)
        for load in (0.0, 4.0):
            arms[:, 0] = load
            inertia = va.coefficients(arms)[:, 0]
            middle = va.track(arms, law, paths, rate=0.3).estimate[:, -1, 0] / inertia
            known = va.track(arms, law, paths, rate=0.3, estimate=arms).estimate[:, -1, 0] / inertia
            if load == 0.0:
                rises += np.sum(middle > 5.0)
                stays += np.sum(known < 2.0)
            else:
                heavy += np.sum(np.abs(middle - 1.0) < 0.5)
    assert rises > 1.5 * n and stays > 2.0 * n and heavy > 2.5 * n


def test_an_integral_removes_the_offset_of_an_unknown_load() -> None:
    arms, still = np.array([[1.5, 0.3, 0.0]]), np.zeros((1, 8000, 3))
    plain = va.track(arms, LAW, still, noise=0.0).angle[0, -1]
    integral = va.track(arms, LAW._replace(integral=2.0), still, noise=0.0).angle[0, -1]
    assert abs(integral) < 1e-2 * abs(plain)


def test_the_adaptive_law_learns_the_gravity_torque_and_stays_in_its_box() -> None:
    arms, paths = task(seconds=12.0)
    law = va.Gains(10.0, 8.0)
    without, adapted = (va.track(arms, law, paths, rate=rate, noise=0.0) for rate in (0.0, 0.1))
    true = va.coefficients(arms)
    before = np.abs(without.estimate[:, -1, 3] - true[:, 3])
    after = np.abs(adapted.estimate[:, -1, 3] - true[:, 3])
    assert np.median(after) < 0.3 * np.median(before)
    assert np.mean(np.abs(adapted.angle[:, -2000:])) < 0.7 * np.mean(
        np.abs(without.angle[:, -2000:])
    )
    low, high = 0.5 * va.coefficients([va.LOW])[0], 3.0 * va.coefficients([va.HIGH])[0]
    wild = va.track(arms, law, paths, rate=1e3)
    assert np.all((wild.estimate >= low - 1e-12) & (wild.estimate <= high + 1e-12))
    # Chapter 6's step with the same numbers is the same step.
    assert guarded(np.array([5.0]), np.array([100.0]), 0.1, low[0], high[0])[0] == high[0]


def test_the_network_in_the_loop_is_the_network_in_numpy() -> None:
    arms, paths = task(2)
    rng = np.random.default_rng(3)
    shapes = ((8, 13), (8, 9), (3, 9))
    student = va.Student(*(0.3 * rng.standard_normal(shape) for shape in shapes))
    run = va.track(arms, LAW, paths, student=student)
    x = va.stack_history(run.history, 4)
    for i, w in enumerate(student):
        x = x @ w[:, :-1].T + w[:, -1]
        x = np.tanh(x) if i < 2 else x
    latent = np.maximum(va.MIDDLE + 0.5 * (va.HIGH - va.LOW) * x, 0.0)
    windows = run.estimate.shape[1] - 1
    expected = va.coefficients(latent).reshape(2, windows + 1, 4)[:, :windows]
    np.testing.assert_allclose(run.estimate[:, :windows], expected, rtol=1e-9)


def test_coefficients_are_those_of_a_rod_cut_into_slices_and_a_point_mass() -> None:
    middles = (np.arange(10_000) + 0.5) / 10_000 * va.LENGTH
    slices = np.full(middles.size, va.LINK / middles.size)
    (got,) = va.coefficients([[1.3, 0.4, 0.7]])
    inertia = np.sum(slices * middles**2) + 1.3 * va.LENGTH**2
    moment = 9.81 * (np.sum(slices * middles) + 1.3 * va.LENGTH)
    np.testing.assert_allclose(got, [inertia, 0.4, 0.7, moment], rtol=1e-6)


@pytest.mark.parametrize(("load", "assumed"), [(0.0, 1.0), (1.0, 1.0), (2.0, 1.0), (0.0, 0.0)])
def test_a_disturbance_grows_beyond_the_linear_limit_and_dies_below_it(
    load: float, assumed: float
) -> None:
    arms, held = np.array([[load, 0.3, 0.0]]), np.zeros((1, 1500, 3))
    start = (assumed, 0.3, 0.0)
    limit = va.largest_damping(load, assumed, 5.0, 0.3)
    for factor in (0.9, 1.1):
        law = va.Gains(5.0, factor * limit)
        radius = va.spectral_radius(load, assumed, law, 0.3)
        assert (radius > 1.0) == (factor > 1.0)
        run = va.track(arms, law, held, estimate=start, noise=1e-9)
        # Differences, without the slow drift to the offset of a wrong load.
        early, late = (np.diff(run.angle[0, k : k + 200]).std() for k in (300, 600))
        if factor < 1.0:
            assert late < max(0.5 * early, 1e-7)
        elif load == assumed:
            assert late / early == pytest.approx(radius**300, rel=0.2)
        else:
            assert late > early


def test_the_limit_is_proportional_to_the_true_inertia_over_the_assumed_one() -> None:
    # Both gains, slope included, act on the torque with the assumed inertia as a factor: for a
    # small slope the loop depends on damping times the ratio of the inertias alone.
    light, middle, heavy = va.coefficients([[0, 0, 0], [1, 0, 0], [2, 0, 0]])[:, 0]
    known = va.largest_damping(1.0, 1.0, 1e-3)
    assert va.largest_damping(0.0, 1.0, 1e-3) == pytest.approx(known * light / middle, rel=1e-2)
    assert va.largest_damping(2.0, 1.0, 1e-3) == pytest.approx(known * heavy / middle, rel=1e-2)
    assert va.largest_damping(0.0, 0.0, 1e-3) == pytest.approx(known, rel=1e-9)


def test_noise_moves_the_arm_and_torque_and_error_have_their_limits() -> None:
    arms, held = np.array([[0.5, 0.3, 0.0]]), np.zeros((1, 1000, 3))
    quiet, noisy = (va.track(arms, LAW, held, estimate=arms, noise=x) for x in (0.0, 3e-3))
    assert quiet.angle.std() < 1e-6 < 1e-4 < noisy.angle.std()
    # Noise has the same sample for every method, and another one for another seed.
    again = va.track(arms, LAW, held, estimate=arms, noise=3e-3)
    other = va.track(arms, LAW, held, estimate=arms, noise=3e-3, seed=1)
    assert np.array_equal(again.angle, noisy.angle) and not np.array_equal(other.angle, noisy.angle)
    wild = va.track(arms, va.Gains(100.0, 2000.0), np.zeros((1, 4000, 3)), estimate=(2.0, 0.3, 0.0))
    torque = np.abs(wild.history[:, :, 2]) * va.SCALES[2]
    assert torque.max() <= va.TORQUE * (1.0 + 1e-12)
    # Far too heavy a load pulls the link down to where it hangs; the error counts to its cap.
    fallen = va.track([[20.0, 0.3, 0.0]], va.Gains(1.0, 1.0), held, estimate=(0.0, 0.3, 0.0))
    assert va.CAP < np.abs(fallen.angle).max()
    capped = np.clip(fallen.angle, -va.CAP, va.CAP)
    assert fallen.error[0] == pytest.approx(np.linalg.norm(capped) / capped.size**0.5)


@pytest.mark.slow
def test_the_student_drives_every_round_but_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    drivers = []

    def recorded(arms: np.ndarray, *args: object, **law: object) -> va.Run:
        drivers.append((law["estimate"] is arms, law["student"] is not va.NOBODY))
        return run(arms, *args, **law)  # type: ignore[arg-type]

    run = va.track
    monkeypatch.setattr(va, "track", recorded)
    va.train_student(LAW, 0, entries=2, rounds=3, n=4, updates=2)
    assert drivers == [(True, False), (False, True), (False, True)]


@pytest.mark.prove
def test_every_gain_set_is_bounded_by_the_best_in_hindsight_and_memory_is_not() -> None:
    means: dict[str, list[float]] = {}
    for seed in range(3):
        methods = va.tune_methods(seed, 8)
        student = va.train_student(methods.teacher, seed, rounds=3, n=64, updates=250)
        arms, paths = task(24, 100 + seed)
        errors = va.compare(methods, student, arms, paths)
        bound = errors["best gains in hindsight"]
        for name in ("one tuned gain set", "randomised gains"):
            assert np.all(errors[name] >= bound)
        for name, values in errors.items():
            means.setdefault(name, []).append(float(values.mean()))
    mean = {name: float(np.mean(values)) for name, values in means.items()}
    assert mean["teacher"] < mean["student with history"] < 0.8 * mean["randomised gains"]
    assert mean["teacher"] < mean["best gains in hindsight"] < 0.9 * mean["randomised gains"]


def test_bad_input_names_argument_rule_and_value() -> None:
    arms, paths = task(2)
    with pytest.raises(ValueError, match=r"reference\.shape"):
        va.track(arms, LAW, paths[:1])
    with pytest.raises(ValueError, match="gains"):
        va.track(arms, (0.0, 1.0, 0.0), paths)
    with pytest.raises(ValueError, match="rate"):
        va.track(arms, LAW, paths, rate=-1.0)
