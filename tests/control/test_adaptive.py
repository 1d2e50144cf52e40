"""The adaptive law on a joint: its sampled limit, its drift under noise, and the four cures."""

import numpy as np
import pytest

from course.control.adaptive import (
    Cures,
    JointAdaptive,
    adaptation_limit,
    adaptation_matrix,
    adapted,
    drift_rate,
    run_adaptive,
)
from course.control.joint import Joint
from course.control.sampled import growth, held, joint_system, loop_matrix, pid_law

J, B, DT = 0.5, 0.5, 2e-3


def at_rest(samples):
    return np.zeros((3, samples))


def waves(samples):
    t = DT * np.arange(samples)
    rows = [
        np.array([a * np.sin(w * t), a * w * np.cos(w * t), -a * w * w * np.sin(w * t)])
        for a, w in ((0.5, 2.0), (0.2, 5.0))
    ]
    return np.sum(rows, axis=0)


@pytest.mark.parametrize("dt", [1e-3, 5e-3])
@pytest.mark.parametrize("damping", [1.0, 20.0])
def test_the_sampled_limit_is_where_the_loop_stops_to_settle(dt, damping) -> None:
    limit = adaptation_limit(damping, B, dt)
    joint = Joint(J, B)
    assert growth(adaptation_matrix(joint, damping, limit, dt)) == pytest.approx(1.0, abs=1e-9)
    for factor, settles in ((0.98, True), (1.02, False)):
        matrix = adaptation_matrix(joint, damping, factor * limit, dt)
        # A speed loop as it runs: s and the torque that the estimate misses.
        s, torque, sizes = 1.0, 0.0, []
        decay = np.exp(-B / J * dt)
        push = (1.0 - decay) / B
        for _ in range(4000):
            sizes.append(abs(s))
            s, torque = (
                decay * s - push * (damping * s + torque),
                torque + dt * factor * limit * s,
            )
        assert (max(sizes[-500:]) < max(sizes[:500])) == settles
        assert (growth(matrix) < 1.0) == settles


def test_the_estimate_without_cures_is_an_euler_step() -> None:
    rng = np.random.default_rng(0)
    theta, Y, s = rng.standard_normal(3), rng.standard_normal((2, 3)), rng.standard_normal(2)
    assert adapted(theta, Y, s, 2.0, 0.1) == pytest.approx(theta + 0.2 * Y.T @ s)
    batch = adapted(
        np.stack([theta, theta], 1), np.stack([Y, Y], 2), np.stack([s, -s], 1), 2.0, 0.1
    )
    assert batch[:, 1] == pytest.approx(theta - 0.2 * Y.T @ s)


def test_each_cure_does_what_its_formula_says() -> None:
    theta, Y, s = np.array([1.0, -2.0]), np.array([[3.0, 4.0]]), np.array([0.5])
    step = 0.1 * Y.T @ s
    assert adapted(theta, Y, s, 1.0, 0.1, Cures(dead_zone=0.6)) == pytest.approx(theta)
    assert adapted(theta, Y, s, 1.0, 0.1, Cures(dead_zone=0.4)) == pytest.approx(theta + step)
    assert adapted(theta, Y, s, 1.0, 0.1, Cures(low=-1.5, high=[1.1, 5.0])) == pytest.approx(
        [1.1, -1.5]
    )
    leaked = adapted(theta, Y, 0.0 * s, 1.0, 0.1, Cures(leakage=2.0, nominal=(0.0, 1.0)))
    assert leaked == pytest.approx([1.0 - 0.2, -2.0 + 0.6])
    normal = adapted(theta, Y, s, 1.0, 0.1, Cures(normalisation=2.0))
    assert normal == pytest.approx(theta + step / (1.0 + 2.0 * 25.0))


def test_without_noise_the_law_learns_the_load_and_tracks() -> None:
    law = JointAdaptive(10.0, 5.0, 5.0)
    run = run_adaptive(Joint(J, B, 1.0), law, waves(15_000), DT)
    assert np.abs(run.error[-2500:]).max() < 0.05 * np.abs(run.error[:2500]).max()
    # Two sines excite three parameters. The held torque and the late rate bias the inertia.
    assert run.estimate[-1, :, 0] == pytest.approx([J, B, -1.0], abs=0.15)


@pytest.mark.parametrize("noise", [1e-4, 3e-4])
@pytest.mark.parametrize("slope", [5.0, 10.0])
def test_noise_alone_drives_the_estimate_at_the_predicted_speed(noise, slope) -> None:
    law, seconds = JointAdaptive(slope, 5.0, 2.0), 4.0
    run = run_adaptive(
        Joint(J, B),
        law,
        at_rest(round(seconds / DT)),
        DT,
        estimate=(J, B, 0.0),
        noise=noise,
        seeds=12,
    )
    # The loop feels the noise a little: the joint follows some of it.
    drift = (run.estimate[-1, 0] - J) / (seconds - DT)
    assert np.mean(drift) == pytest.approx(drift_rate(2.0, slope, noise, DT), rel=0.1)


def test_the_joint_is_lost_when_the_estimate_passes_the_limit_of_pd() -> None:
    """The estimate of the inertia adds to the damping, whose sampled limit is 2 J / dt."""
    slope, damping, noise, seeds = 10.0, 5.0, 3e-4, 10
    law = JointAdaptive(slope, damping, 5.0)
    run = run_adaptive(
        Joint(J, B), law, at_rest(8000), DT, estimate=(J, B, 0.0), noise=noise, seeds=seeds
    )
    largest = (2.0 * J / DT - damping) / slope
    # The friction of the joint counts little against that damping.
    plant = held(*joint_system(J, B), DT)
    for factor, stable in ((0.98, True), (1.02, False)):
        kd = damping + slope * factor * largest
        matrix = loop_matrix(plant, pid_law(slope * damping, 0.0, kd, dt=DT))
        assert (growth(matrix) < 1.0) == stable
    passed = np.argmax(~(run.estimate[:, 0] < largest), axis=0)
    lost = np.argmax(~(np.abs(run.error) < 0.5), axis=0)
    for i in range(seeds):
        assert np.abs(run.error[: passed[i], i]).max() < 0.05
    assert (lost > passed).all()
    assert ((lost - passed) * DT < 1.0).all()


@pytest.mark.prove
@pytest.mark.parametrize(
    "cures",
    [
        Cures(dead_zone=0.8),
        Cures(low=(0.1, 0.0, -5.0), high=(1.0, 2.0, 5.0)),
        Cures(leakage=1.0, nominal=(0.25, 0.25, 0.0)),
    ],
    ids=("dead zone", "projection", "leakage"),
)
def test_three_cures_end_the_drift_and_two_of_them_track_well(cures) -> None:
    joint = Joint(J, B, 1.0)

    def run(rate, guards, reference, estimate):
        law = JointAdaptive(10.0, 5.0, rate, guards)
        return run_adaptive(joint, law, reference, DT, estimate=estimate, noise=3e-4, seeds=10)

    right, wrong = (J, B, -1.0), (0.25, 0.25, 0.0)
    assert np.abs(run(5.0, cures, at_rest(8000), right).error).max() < 0.2
    assert not np.abs(run(5.0, Cures(), at_rest(8000), right).error).max() < 0.2
    # A dead zone as wide as the noise hardly adapts to this motion: its price.
    if cures.dead_zone:
        return
    # Compared with an estimate that stays wrong.
    cured, fixed = run(5.0, cures, waves(8000), wrong), run(1e-9, Cures(), waves(8000), wrong)
    assert np.sqrt(np.mean(cured.error[-2500:] ** 2)) < 0.75 * np.sqrt(
        np.mean(fixed.error[-2500:] ** 2)
    )


def test_without_noise_a_wide_dead_zone_never_adapts() -> None:
    law = JointAdaptive(10.0, 5.0, 5.0, Cures(dead_zone=0.8))
    run = run_adaptive(Joint(J, B, 1.0), law, waves(4000), DT, estimate=(0.25, 0.25, 0.0))
    assert run.estimate[-1, :, 0] == pytest.approx([0.25, 0.25, 0.0])


def test_normalisation_slows_the_drift_and_does_not_end_it() -> None:
    law = JointAdaptive(10.0, 5.0, 5.0, Cures(normalisation=1.0))
    run = run_adaptive(
        Joint(J, B), law, at_rest(8000), DT, estimate=(J, B, 0.0), noise=3e-4, seeds=10
    )
    early, late = run.estimate[4000, 0], run.estimate[-1, 0]
    plain = drift_rate(5.0, 10.0, 3e-4, DT)
    assert (late - early > 0.05 * plain * 4000 * DT).all()
    assert (late - early < 0.3 * plain * 4000 * DT).all()


def test_leakage_leaves_an_error_under_a_load() -> None:
    """At rest the estimate stops where leakage and error balance: rate s = leakage estimate."""
    leak, rate, slope, damping = 0.5, 5.0, 10.0, 5.0
    law = JointAdaptive(slope, damping, (1e-9, 1e-9, rate), Cures(leakage=leak))
    run = run_adaptive(Joint(J, B, 1.0), law, at_rest(10_000), DT)
    # estimate + damping s = -1 with estimate = rate s / leak and s = slope e.
    assert run.error[-1, 0] == pytest.approx(-1.0 / (slope * (damping + rate / leak)), rel=1e-4)


BAD = {
    "low": lambda: Cures(low=1.0, high=0.0),
    "leakage": lambda: Cures(leakage=-1.0),
    "slope": lambda: JointAdaptive(0.0, 1.0, 1.0),
    "rate": lambda: JointAdaptive(1.0, 1.0, 0.0),
    "coulomb": lambda: run_adaptive(
        Joint(J, B, 0.0, 1.0), JointAdaptive(1.0, 1.0, 1.0), at_rest(3), DT
    ),
    "reference": lambda: run_adaptive(
        Joint(J, B), JointAdaptive(1.0, 1.0, 1.0), np.zeros((2, 3)), DT
    ),
}


@pytest.mark.parametrize("match", BAD)
def test_bad_input_is_named(match) -> None:
    with pytest.raises(ValueError, match=match):
        BAD[match]()
