"""The contact models: closed forms, each other, chapter 1's impact, what none of them can do."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from course.contact import Problem, residuals, solve
from course.contact.models import defect, duality_gap, lemke
from course.contact.scenes import (
    GRAVITY,
    Scene,
    ball_drop,
    block,
    march,
    pinch,
    rod,
    run,
    spinning_disc,
    tower,
)
from course.rigid_body import planar_contact
from tests.budget import examples

RIGID = ("lcp", "pgs", "coulomb")
SOLVED = (*RIGID, "convex")
SEEDS = st.integers(0, 2**32 - 1)


def drawn(seed: int, contacts: int, rows: int, bodies: int = 0) -> Problem:
    """A step of some bodies with contacts drawn at random, which can be kept: a velocity is drawn
    that moves all of them apart, by more than what a gap wants."""
    rng = np.random.default_rng(seed)
    nv = bodies or contacts * rows
    root = rng.normal(size=(nv, nv))
    jacobian = rng.normal(size=(contacts, rows, nv))
    if contacts > nv:  # all normals into one half space
        jacobian[:, 0] *= np.sign(jacobian[:, 0, :1])
    v = rng.normal(size=nv)
    return Problem(
        root @ root.T + np.eye(nv),
        jacobian,
        v,
        v + 0.1 * rng.normal(size=nv),
        rng.uniform(-1e-3, 1e-3, contacts),
        rng.uniform(0.0, 0.5, (contacts, rows - 1)),
        0.01,
    )


# --- the law itself -------------------------------------------------------------------------------


@given(seed=SEEDS, contacts=st.integers(1, 4), rows=st.sampled_from([1, 2, 3, 4, 6]))
@examples(15)
def test_newton_on_the_true_cone_obeys_coulomb(seed: int, contacts: int, rows: int) -> None:
    """The residuals are written from the physics and share nothing with the solver's own."""
    problem = drawn(seed, contacts, rows)
    result = solve("coulomb", problem)
    if result.converged:
        owed = residuals(problem, result.impulses)
        assert max(owed.signorini, owed.cone, owed.dissipation) < 1e-8
    else:  # with strong coupling the law may have no solution; then nobody finds one
        assert not solve("pgs", problem, sweeps=500).converged


def test_newton_finds_a_solution_nearly_always() -> None:
    solved = [solve("coulomb", drawn(seed, 3, 3)).converged for seed in range(60)]
    assert np.mean(solved) > 0.9


@given(seed=SEEDS, contacts=st.integers(1, 4), rows=st.sampled_from([1, 2, 3, 4, 6]))
@examples(40)
def test_the_convex_law_is_the_least_change_of_velocity(
    seed: int, contacts: int, rows: int
) -> None:
    """Its optimality conditions: force and velocity in dual cones, and no power between them."""
    problem = drawn(seed, contacts, rows)
    result = solve("convex", problem)
    assert result.converged
    u = problem.jacobian @ result.velocity
    w = u[:, 0] - problem.target_velocity - np.linalg.norm(problem.friction * u[:, 1:], axis=1)
    gap, outside = duality_gap(problem, result.impulses)
    assert np.min(w) > -1e-8 and outside < 1e-8
    assert abs(gap) < 1e-8 * max(1.0, np.sum(result.impulses[:, 0]))
    assert residuals(problem, result.impulses).cone < 1e-9
    # No other velocity that keeps the cones is nearer to the free one, in the metric of the mass.
    change = result.velocity - problem.free
    cost = change @ problem.mass @ change
    rng = np.random.default_rng(seed)
    for _ in range(20):
        near = result.velocity + 0.1 * rng.normal(size=change.size)
        v = problem.jacobian @ near
        open_ = v[:, 0] - problem.target_velocity >= np.linalg.norm(
            problem.friction * v[:, 1:], axis=1
        )
        if np.all(open_):
            assert (near - problem.free) @ problem.mass @ (near - problem.free) > cost - 1e-9


@given(seed=SEEDS, contacts=st.integers(1, 3))
@examples(30)
def test_with_one_tangent_pyramid_and_cone_are_the_same(seed: int, contacts: int) -> None:
    problem = drawn(seed, contacts, 2)
    pyramid = solve("lcp", problem)
    assert pyramid.converged
    assert defect(problem, pyramid.impulses) < 1e-8


@given(seed=SEEDS)
@examples(30)
def test_sweeps_reach_what_newton_does(seed: int) -> None:
    problem = drawn(seed, 3, 3)
    swept = solve("pgs", problem, sweeps=20000)
    if swept.converged:
        again = solve("coulomb", problem, start=swept.impulses)
        assert again.converged
        assert np.allclose(again.velocity, swept.velocity, atol=1e-8)
    convex = solve("pgs", problem, law="convex", sweeps=20000)
    # Contacts that act on nearly the same motion slow the sweeps down: no end to compare.
    if convex.converged:
        assert np.allclose(convex.velocity, solve("convex", problem).velocity, atol=1e-7)


@pytest.mark.parametrize("ratio", [1.0, 2.0, 4.0])
def test_friction_opposes_the_slip_where_the_tangents_weigh_differently(ratio: float) -> None:
    """Divided row by row, friction is 18 degrees off at a ratio of 2 of the diagonals, 31 at 4."""
    v = np.array([-1.0, 3.0, 3.0])
    problem = Problem(
        np.diag([1.0, 1.0, 1.0 / ratio]),
        np.eye(3)[None],
        v,
        v,
        np.zeros(1),
        np.full((1, 2), 0.5),
        1e-2,
    )
    swept = solve("pgs", problem)
    assert swept.converged
    normal, along = swept.impulses[0, 0], swept.impulses[0, 1:]
    slip = swept.velocity[1:]
    assert normal == pytest.approx(1.0)
    assert along == pytest.approx(-0.5 * normal * slip / np.linalg.norm(slip), abs=1e-9)
    assert residuals(problem, swept.impulses).dissipation < 1e-9
    assert np.allclose(swept.velocity, solve("coulomb", problem).velocity, atol=1e-9)


@given(
    angle=st.floats(0.05, 1.5),
    vx=st.floats(-3.0, 3.0),
    spin=st.floats(-5.0, 5.0),
    mu=st.floats(0.0, 1.0),
)
@examples(60)
def test_one_corner_is_the_impact_of_chapter_1(
    angle: float, vx: float, spin: float, mu: float
) -> None:
    """Stronge's impact without restitution, unless its slip turns round on the way, which one
    impulse for the whole step cannot follow."""
    rx, rz = -math.cos(angle), -math.sin(angle)
    mass, inertia = 2.0, 0.3
    rows = np.array([[[0.0, 1.0, rx], [1.0, 0.0, -rz]]])
    v = np.array([vx, -2.0, spin])
    vn, vt = (rows[0] @ v).tolist()
    if vn >= -0.01:
        return
    pt, pn = planar_contact.impact(vt, vn, rx, rz, 1 / mass, 1 / inertia, 0.0, mu)[:2]
    problem = Problem(
        np.diag([mass, mass, inertia]), rows, v, v, np.zeros(1), np.array([[mu]]), 1e-3
    )
    stronge = problem.after([[pn, pt]])
    if (rows[0, 1] @ stronge) * vt < -1e-9:
        return
    for model in RIGID:
        result = solve(model, problem, **({"sweeps": 100000} if model == "pgs" else {}))
        if result.converged and defect(problem, [[pn, pt]]) < 1e-9:
            same = np.allclose(result.velocity, stronge, atol=1e-7)
            # Painleve: where the coupling is strong the law has several solutions.
            a = problem.delassus
            assert same or mu * abs(a[0, 1]) >= a[0, 0]


# --- the scenes -----------------------------------------------------------------------------------


@pytest.mark.parametrize("model", SOLVED)
@pytest.mark.parametrize("mu", [0.1, 0.5, 1.2])
def test_a_block_sticks_below_the_angle_of_friction_and_slides_above(model: str, mu: float) -> None:
    holds = run(block(math.atan(mu) - 1e-3, mu), model, 0.01, 20)
    assert np.max(np.abs(holds.v)) < 1e-9
    angle = math.atan(mu) + 0.2
    slides = run(block(angle, mu), model, 0.01, 20)
    acceleration = slides.v[0, -1] / slides.times[-1]
    expected = GRAVITY * (math.sin(angle) - mu * math.cos(angle))
    if model == "convex":  # it hops, but the mean normal force is the weight's
        assert acceleration == pytest.approx(expected, rel=0.2)
        assert np.max(slides.q[2]) > 1e-4
    else:
        assert acceleration == pytest.approx(expected, rel=1e-6)
        assert np.max(np.abs(slides.q[2])) < 1e-12


def test_a_penalty_block_creeps_where_the_others_stick() -> None:
    """Regularised friction holds with a speed: mg sin(a) = mu f_n v / slip."""
    angle, mu, slip = 0.2, 0.5, 1e-3
    scene = block(angle, mu)
    crept = run(scene, "penalty", 1e-4, 2000, stiffness=1e5, damping=400.0, slip=slip)
    assert crept.v[0, -1] == pytest.approx(slip * math.tan(angle) / mu, rel=1e-6)
    assert -crept.q[2, -1] == pytest.approx(GRAVITY * math.cos(angle) / 1e5, rel=1e-6)


def test_a_damper_that_may_pull_holds_back_what_leaves() -> None:
    problem = ball_drop(0.0).problem(1e-3, np.array([-1e-4]), np.array([1.0]))
    for pull, force in ((True, 1e4 * 1e-4 - 50.0), (False, 0.0)):
        result = solve("penalty", problem, stiffness=1e4, damping=50.0, pull=pull)
        assert result.impulses[0, 0] == pytest.approx(1e-3 * force)


def test_what_slides_on_the_convex_cone_separates() -> None:
    """u_n = mu |u_t| at the end of a step that slides."""
    first = solve("convex", block(0.0, 0.5, (1.0, 0.0)).problem(1e-3))
    assert first.velocity[2] == pytest.approx(0.5 * first.velocity[0], rel=1e-9)


@pytest.mark.parametrize("model", RIGID)
def test_only_torsion_stops_a_spinning_disc(model: str) -> None:
    torsion, spin, dt, steps = 0.01, 10.0, 1e-3, 200
    remaining = run(spinning_disc(spin, 0.5, 0.0), model, dt, steps).v[3, -1]
    assert remaining == pytest.approx(spin, abs=1e-12)
    braked = run(spinning_disc(spin, 0.5, torsion), model, dt, steps)
    expected = spin - torsion * GRAVITY / 0.005 * dt * steps
    assert braked.v[3, -1] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("model", SOLVED)
@pytest.mark.parametrize("ratio", [1.0, 100.0, 10000.0])
def test_a_tower_carries_its_weight_at_any_mass_ratio(model: str, ratio: float) -> None:
    options = {"sweeps": 300000} if model == "pgs" else {}
    result = solve(model, tower([1.0, ratio]).problem(0.01), **options)
    assert result.converged
    weights = GRAVITY * np.array([1.0 + ratio, ratio])
    assert result.impulses[:, 0] / 0.01 == pytest.approx(weights, rel=1e-6)


@pytest.mark.parametrize("model", SOLVED)
def test_a_ball_comes_back_to_the_height_of_its_restitution(model: str) -> None:
    fall = run(ball_drop(0.1, restitution=0.8), model, 1e-3, 350)
    assert np.max(fall.q[0, 200:]) == pytest.approx(0.64 * 0.1, rel=0.03)


@pytest.mark.parametrize(
    "scene",
    [
        block(0.3, 0.5, (1.0, 0.5)),
        tower([1.0, 3.0, 2.0]),
        pinch(5.0, 0.25),
        ball_drop(0.1, restitution=0.6),
        spinning_disc(),
    ],
)
def test_the_compiled_march_is_the_same_motion(scene: Scene) -> None:
    slow = run(scene, "pgs", 2e-3, 120, tolerance=1e-11)
    q, v, taken = march(scene, 2e-3, 120, tolerance=1e-13)
    assert np.allclose(q, slow.q[:, -1], rtol=0.0, atol=1e-9)
    assert np.allclose(v, slow.v[:, -1], rtol=0.0, atol=1e-8)
    assert 0 < taken


# --- no solution, no claim ------------------------------------------------------------------------


@pytest.mark.parametrize("model", RIGID)
def test_painleves_rod_jams_in_any_step_however_short(model: str) -> None:
    """Slides on: no normal force is enough, as friction presses harder than it lifts. Forces have
    no answer; one step has, an impulse that stops its end and does not vanish with the step."""
    least = [1.0 + 3.0 * math.cos(1.0) ** 2, 3.0 * math.sin(1.0) * math.cos(1.0)]
    critical = least[0] / least[1]
    jammed = [solve(model, rod(1.0, critical + 1.5).problem(dt)) for dt in (1e-3, 1e-5, 1e-7)]
    for result in jammed:
        assert result.converged and result.impulses[0, 0] > 0.3
        end = rod(1.0, 3.0).jacobian[0] @ result.velocity
        assert np.allclose(end, 0.0, atol=1e-9)
    mild = [solve(model, rod(1.0, critical - 0.3).problem(dt)) for dt in (1e-3, 1e-5)]
    assert mild[1].impulses[0, 0] == pytest.approx(0.01 * mild[0].impulses[0, 0], rel=1e-3)


def test_painleves_rod_that_lifts_its_end_has_two_answers() -> None:
    """With enough spin the end may fly off, or jam; models choose, each by its own way."""
    problem = rod(1.0, 3.0, spin=6.0).problem(1e-4)
    flies, jams = solve("coulomb", problem), solve("lcp", problem)
    assert flies.converged and jams.converged
    assert flies.impulses[0, 0] == 0.0 and jams.impulses[0, 0] > 0.3
    assert max(defect(problem, flies.impulses), defect(problem, jams.impulses)) < 1e-9


def test_what_cannot_be_kept_is_not_claimed() -> None:
    """A weight between a floor that rises and a ceiling that does not."""
    rows = np.array([[[1.0]], [[-1.0]]])
    problem = Problem(
        np.eye(1), rows, np.zeros(1), np.zeros(1), np.array([-0.01, 0.0]), np.zeros((2, 0)), 0.01
    )
    for model in SOLVED:
        result = solve(model, problem)
        assert not result.converged and result.residual > 1e-3
        assert "NOT solved" in str(result)


def test_too_few_sweeps_say_so() -> None:
    problem = tower([1.0, 1000.0]).problem(0.01)
    result = solve("pgs", problem, sweeps=50)
    assert not result.converged
    assert result.residual == pytest.approx(defect(problem, result.impulses))
    assert result.residual > 1e-6


@pytest.mark.parametrize("size", [1e-9, 1e9])
@pytest.mark.parametrize("model", SOLVED)
def test_masses_in_other_units_move_alike(model: str, size: float) -> None:
    problem = drawn(4, 3, 3)
    other = solve(model, replace(problem, mass=size * problem.mass))
    assert other.converged
    assert np.allclose(other.velocity, solve(model, problem).velocity, atol=1e-8)
    either = rod(1.0, 3.0, spin=6.0).problem(1e-4)  # which has two answers
    other = solve(model, replace(either, mass=size * either.mass))
    assert np.allclose(other.velocity, solve(model, either).velocity, atol=1e-8)


@pytest.mark.parametrize("model", ["lcp", "pgs", "coulomb"])
@pytest.mark.parametrize("fastest", [0.1, 1.0, np.inf])
def test_what_starts_deep_comes_out_no_faster_than_allowed(model: str, fastest: float) -> None:
    """A share of the depth a step is a speed that grows without end as steps get shorter."""
    for dt in (1e-2, 1e-3, 1e-4):
        problem = Problem(
            mass=np.eye(2),
            jacobian=np.array([[[0.0, 1.0], [1.0, 0.0]]]),
            velocity=np.zeros(2),
            free=np.array([0.0, -9.81 * dt]),
            gap=np.array([-0.01]),
            friction=np.full((1, 1), 0.5),
            dt=dt,
            max_recovery_speed=fastest,
        )
        result = solve(model, problem)
        assert result.converged
        assert result.velocity[1] == pytest.approx(min(0.2 * 0.01 / dt, fastest), abs=1e-8)


def test_lemke_ends_on_a_ray_where_there_is_nothing() -> None:
    z, _, solved = lemke([[-1.0]], [-1.0])
    assert not solved
    # A body wedged between two walls, both of which should push it out.
    assert not lemke([[1.0, -1.0], [-1.0, 1.0]], [-1.0, -1.0])[2]
    z, _, solved = lemke([[2.0, 1.0], [1.0, 2.0]], [-5.0, -6.0])
    assert solved
    assert np.allclose(z, [4.0 / 3.0, 7.0 / 3.0])


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("mass", [[0.0]], "mass"),
        ("mass", [[np.nan]], "mass"),
        ("jacobian", np.ones((1, 1, 2)), "mass.shape"),
        ("jacobian", np.zeros((0, 1, 1)), "jacobian.shape"),
        ("gap", [np.nan], "gap"),
        ("gap", [0.0, 0.0], "gap.shape"),
        ("velocity", [np.inf], "velocity"),
        ("dt", 0.0, "dt"),
        ("restitution", 1.5, "restitution"),
        ("recovery", -0.1, "recovery"),
        ("max_recovery_speed", -0.1, "max_recovery_speed"),
        ("max_recovery_speed", np.nan, "max_recovery_speed"),
        ("friction", np.ones((1, 1)), "friction.shape"),
    ],
)
def test_bad_input_is_named(name: str, value: object, text: str) -> None:
    good: dict[str, object] = {
        "mass": np.eye(1),
        "jacobian": np.ones((1, 1, 1)),
        "velocity": np.zeros(1),
        "free": np.zeros(1),
        "gap": np.zeros(1),
        "friction": np.zeros((1, 0)),
        "dt": 0.01,
    }
    arguments: Any = good | {name: value}
    with pytest.raises(ValueError, match=text.replace(".", r"\.")):
        Problem(**arguments)


def test_friction_below_zero_and_asymmetric_masses_are_refused() -> None:
    with pytest.raises(ValueError, match="friction"):
        block(friction=-0.1)
    with pytest.raises(ValueError, match="symmetric"):
        Problem(
            np.array([[1.0, 0.5], [0.0, 1.0]]),
            np.ones((1, 1, 2)),
            np.zeros(2),
            np.zeros(2),
            np.zeros(1),
            np.zeros((1, 0)),
            0.01,
        )
    with pytest.raises(ValueError, match=r"model must be .*, got 'bullet'"):
        solve("bullet", ball_drop().problem(0.01))
    with pytest.raises(ValueError, match="edges"):
        solve("lcp", block().problem(0.01), edges=5)


@pytest.mark.parametrize("model", SOLVED)
@given(seed=SEEDS, rows=st.sampled_from([1, 3]))
@examples(5)
def test_a_contact_between_fixed_bodies_changes_nothing(model: str, seed: int, rows: int) -> None:
    """Its rows are zero: the others get the impulses that they have without it."""
    alone = drawn(seed, 2, rows)
    both = replace(
        alone,
        jacobian=np.insert(alone.jacobian, 1, 0.0, axis=0),
        gap=np.insert(alone.gap, 1, 0.0),
        friction=np.insert(alone.friction, 1, 0.5, axis=0),
    )
    expected, solution = solve(model, alone), solve(model, both)
    assert np.isfinite(solution.residual)
    assert solution.converged == expected.converged
    assert np.allclose(solution.impulses[[0, 2]], expected.impulses, atol=1e-9)
    assert not solution.impulses[1].any()


@pytest.mark.parametrize("model", SOLVED)
def test_only_contacts_between_fixed_bodies_are_solved_by_nothing(model: str) -> None:
    problem = replace(block().problem(0.01), jacobian=np.zeros((1, 3, 3)), gap=np.zeros(1))
    problem = replace(problem, friction=np.full((1, 2), 0.5))
    solution = solve(model, problem)
    assert solution.converged and not solution.impulses.any()


def test_a_contact_that_no_impulse_moves_has_a_finite_violation() -> None:
    """It keeps its velocity: right where the gap is open, too slow by what a depth asks for."""
    base = block(0.0, 0.5).problem(0.01)
    fixed = replace(base, jacobian=np.zeros_like(base.jacobian), recovery=0.2)
    impulses = np.zeros(base.jacobian.shape[:2])
    opened = replace(fixed, gap=np.full_like(base.gap, 0.1))
    assert defect(opened, impulses) == 0.0
    sunk = replace(fixed, gap=np.full_like(base.gap, -1e-3))
    assert defect(sunk, impulses) == pytest.approx(0.2 * 1e-3 / 0.01)
