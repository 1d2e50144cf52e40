"""Engines' ways with penetration, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from course.contact import scenes, solve
from course.contact.scenes import GRAVITY
from course.contact.stabilization import (
    erp_cfm,
    solve_erp_cfm,
    split_impulse_steps,
    spring_and_damper,
    xpbd_steps,
)


@pytest.mark.parametrize(("recovery", "dt"), [(0.2, 1e-2), (0.2, 1e-3), (0.5, 1e-4)])
@pytest.mark.parametrize("model", ["lcp", "pgs", "coulomb", "convex"])
def test_baumgarte_ejects_at_the_share_of_the_depth_over_the_step(model, recovery, dt):
    deep = replace(scenes.ball_drop(-0.01).problem(dt), recovery=recovery)
    free = replace(deep, max_recovery_speed=np.inf)
    assert solve(model, free).velocity[0] == pytest.approx(recovery * 0.01 / dt, rel=1e-9)
    bounded = solve(model, replace(deep, max_recovery_speed=0.1)).velocity[0]
    assert bounded == pytest.approx(0.1, rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_erp_and_cfm_are_a_spring_and_damper_integrated_implicitly(seed):
    """(m + h b + h^2 k) v' = m v - h m g - h k x, with the position at the start of the step."""
    rng = np.random.default_rng(seed)
    k, b, m = 10.0 ** rng.uniform([2, 0, -1], [5, 3, 1])
    h, x, v = 10.0 ** rng.uniform(-4, -1), -rng.uniform(0.01, 0.05), -rng.uniform(0.1, 1.0)
    step = scenes.ball_drop(0.0, m).problem(h, np.array([x]), np.array([v]))
    result = solve_erp_cfm(step, *erp_cfm(k, b, h))
    truth = (m * v - h * m * GRAVITY - h * k * x) / (m + h * b + h**2 * k)
    assert result.converged
    assert result.velocity[0] == pytest.approx(truth, rel=1e-9)
    assert spring_and_damper(*erp_cfm(k, b, h), h) == pytest.approx((k, b))


def test_with_erp_and_cfm_a_stack_rests_on_the_depths_of_its_springs():
    k, h, tower = 1e4, 2e-3, scenes.tower([1.0, 3.0])
    q, v = tower.q, tower.v
    for _ in range(2000):
        v = solve_erp_cfm(tower.problem(h, q, v), *erp_cfm(k, 200.0, h)).velocity
        q = q + h * v
    lower = 4.0 * GRAVITY / k
    assert q == pytest.approx([-lower, -lower - 3.0 * GRAVITY / k], rel=1e-6)


def test_with_erp_and_cfm_an_open_contact_lets_go_and_may_just_close():
    high = scenes.ball_drop(1.0).problem(1e-2)
    assert solve_erp_cfm(high, 0.2, 1e-5).impulses[0, 0] == 0.0
    near = scenes.ball_drop(0.0).problem(1e-2, np.array([1e-3]), np.array([-1.0]))
    assert solve_erp_cfm(near, 0.2, 0.0).velocity[0] == pytest.approx(-0.1)


def test_a_split_impulse_takes_back_depth_without_a_velocity():
    for n, (q, v) in enumerate(split_impulse_steps(scenes.ball_drop(-0.01), 1e-2, 20), 1):
        assert q[0] == pytest.approx(-0.01 * 0.8**n, rel=1e-9)
        assert abs(v[0]) < 1e-12
    # The velocities of a braking block are Coulomb's, deep or not.
    scene = scenes.block(0.0, 0.5, (1.0, 0.0))
    deep = replace(scene, q=np.array([0.0, 0.0, -0.01]))
    *_, (q, v) = split_impulse_steps(deep, 1e-3, 100)
    assert v == pytest.approx([1.0 - 0.5 * GRAVITY * 0.1, 0.0, 0.0], abs=1e-9)
    assert q[2] == pytest.approx(-0.01 * 0.8**100, abs=1e-12)


@pytest.mark.parametrize("compliance", [0.0, 1e-5, 1e-3])
def test_xpbd_rests_at_the_compliance_times_the_load(compliance):
    *_, (q, v) = xpbd_steps(scenes.ball_drop(0.0, 2.0), 1e-2, 4000, compliance=compliance)
    assert q[0] == pytest.approx(-compliance * 2.0 * GRAVITY, rel=1e-6, abs=1e-15)
    assert abs(v[0]) < 1e-6


def test_a_step_of_xpbd_is_implicit_euler_of_the_spring():
    """v' = (v - h g - h k x / m) / (1 + h^2 k / m) while the contact pushes."""
    h, m, k, x, v = 5e-3, 2.0, 4e3, -0.02, -0.5
    scene = replace(scenes.ball_drop(0.0, m), q=np.array([x]), v=np.array([v]))
    ((q, end),) = xpbd_steps(scene, h, 1, compliance=1.0 / k)
    truth = (v - h * GRAVITY - h * k * x / m) / (1.0 + h**2 * k / m)
    assert end[0] == pytest.approx(truth, rel=1e-9)
    assert q[0] == pytest.approx(x + h * truth, rel=1e-9)


@pytest.mark.parametrize("substeps", [1, 4, 20])
def test_xpbd_ejects_a_ball_that_starts_deep_with_its_depth_over_the_substep(substeps):
    depth, dt = 0.01, 1e-3
    ((q, v),) = xpbd_steps(scenes.ball_drop(-depth), dt, 1, substeps=substeps)
    # All of the overlap is removed in the first sub-step; after that the ball flies freely.
    h = dt / substeps
    assert v[0] == pytest.approx(depth / h - (substeps - 1) * h * GRAVITY, rel=1e-9)
    flight = sum(depth / h - k * h * GRAVITY for k in range(1, substeps)) * h
    assert q[0] == pytest.approx(flight, rel=1e-9, abs=1e-15)


def test_a_contact_of_xpbd_does_not_pull():
    """A ball that is thrown up flies freely."""
    scene = replace(scenes.ball_drop(0.0), v=np.array([1.0]))
    ((_, v),) = xpbd_steps(scene, 1e-3, 1)
    assert v[0] == pytest.approx(1.0 - 1e-3 * GRAVITY, rel=1e-12)


def test_sub_steps_with_one_iteration_beat_as_many_iterations_in_one_step():
    """Of a heavy body on a light one; the depth is 0 in truth (Macklin et al. 2019)."""

    def deepest(substeps, iterations):
        tower = scenes.tower([1.0, 100.0])
        runs = xpbd_steps(tower, 1e-2, 50, substeps=substeps, iterations=iterations)
        return max(-(tower.jacobian[:, 0] @ q).min() for q, _ in runs)

    depths = [deepest(20, 1), deepest(1, 20)]
    assert 0.0 < 5.0 * depths[0] < depths[1]


def test_wrong_arguments_are_named():
    with pytest.raises(ValueError, match="stiffness"):
        erp_cfm(0.0, 1.0, 1e-3)
    with pytest.raises(ValueError, match="erp"):
        spring_and_damper(1.5, 1.0, 1e-3)
    with pytest.raises(ValueError, match="scene"):
        next(xpbd_steps(scenes.block(), 1e-3, 1))
    with pytest.raises(ValueError, match="substeps"):
        next(xpbd_steps(scenes.ball_drop(), 1e-3, 1, substeps=0))
