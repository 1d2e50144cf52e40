"""The soft model against MuJoCo's own constraint forces, and trajectories beside MuJoCo's.

The long form, every combination over 1,000 steps, is in tests/prove/contact.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest

from course.contact import scenes, solve
from course.contact.models import defect, gauss_seidel
from course.contact.problem import Problem
from course.contact.soft import Softness, rows_of, soft_forces
from course.oracles.mujoco import contact as mujoco_contact
from course.oracles.mujoco.contact import ContactState, Options, contact_state
from course.oracles.mujoco.kit import Runner

SCENES: dict[str, Callable[[Options], Runner]] = {
    "box on a plane": mujoco_contact.box,
    "sliding block": lambda options: mujoco_contact.box(options, (0.5, 0.2)),
    "stack of 4": lambda options: mujoco_contact.box(options, (0.3, 0.0), 4),
    "links and wall": mujoco_contact.links,
}
OPTIONS: dict[str, dict[str, Any]] = {
    "default": {},
    "condim 1": {"condim": 1},
    "condim 4": {"condim": 4},
    "condim 6": {"condim": 6},
    "impratio 10": {"impratio": 10.0},
    "margin 10 mm": {"margin": 0.01},
    "solref below zero": {"solref": (-2000.0, -100.0)},
    "3.6 ms, refsafe": {"solref": (0.0036, 1.0)},
    "3.6 ms, refsafe off": {"solref": (0.0036, 1.0), "refsafe": False},
    "diagexact": {"diagexact": True},
}


def touching(runner: Runner, steps: int, every: int = 1) -> Iterator[ContactState]:
    """What MuJoCo's solver is given and finds on the way, wherever something touches."""
    runner.reset()
    for k in range(steps):
        state = contact_state(runner) if k % every == 0 else None
        if state is not None:
            yield state
        mujoco.mj_step(runner.model, runner.data)


def compared(runner: Runner, options: Options, steps: int, every: int = 1) -> tuple[float, int]:
    """(worst difference in force, over the largest force of the step, states with contact)."""
    worst = [0.0]
    for state in touching(runner, steps, every):
        difference = np.max(np.abs(ours(state, options)[0] - state.force))
        worst.append(difference / max(1e-3, np.max(np.abs(state.force))))
    return max(worst), len(worst) - 1


def ours(state: ContactState, options: Options) -> tuple[np.ndarray, np.ndarray, int, float]:
    return soft_forces(state.problem, options.softness(state.weight))


@pytest.mark.slow
@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
@pytest.mark.parametrize("what", OPTIONS)
@pytest.mark.parametrize("scene", SCENES)
def test_forces_are_mujocos(scene: str, what: str, cone: str) -> None:
    options = Options(cone=cone, **OPTIONS[what])
    every = 5 if scene == "links and wall" else 40
    worst, observed = compared(SCENES[scene](options), options, 320, every)
    assert worst < 1e-9
    assert observed >= (1 if scene == "links and wall" else 3)


@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_reference_and_compliance_are_mujocos(cone: str) -> None:
    for what in OPTIONS.values():
        options = Options(cone=cone, **what)
        runner = mujoco_contact.box(options, (0.02, 0.01))
        runner.run(4)
        state = contact_state(runner)
        assert state is not None
        rows = rows_of(state.problem, options.softness(state.weight))
        scale = np.max(np.abs(state.reference))
        assert np.max(np.abs(rows.reference - state.reference)) < 1e-12 * scale
        assert np.max(np.abs(rows.compliance / state.compliance - 1.0)) < 1e-12


@pytest.mark.slow
def test_our_own_block_and_tower_move_as_mujocos_do() -> None:
    """Course's scene, forces and step; MuJoCo lends the inverse weights of its start pose. Without
    friction it takes a least coefficient; the pyramid's compliance is then 1e-10 of the usual."""
    for cone, mu in itertools.product(("elliptic", "pyramidal"), (0.5, 0.0)):
        options = Options(cone=cone, friction=(mu, 0.005, 0.0001))
        deviation = 1e-11 if mu else 1e-7
        pairs = [
            (scenes.block(0.2, mu, (1.0, 0.5)), mujoco_contact.block(options, 0.2, (1.0, 0.5))),
            (
                scenes.tower([1.0, 2.0, 0.5, 1.0]),
                mujoco_contact.tower(replace(options, condim=1), [1.0, 2.0, 0.5, 1.0]),
            ),
        ]
        for scene, runner in pairs:
            weights = runner.model.body_invweight0
            pairs_of = [(i, i + 1) for i in range(scene.distance.size)]
            weight = np.array([weights[a] + weights[b] for a, b in pairs_of])
            steps = 300
            result = scenes.run(scene, "soft", options.dt, steps, cone=cone, weight=weight)
            q, v = runner.run(steps)
            assert result.unsolved == 0
            assert np.allclose(result.q[:, -1], q, rtol=0.0, atol=deviation)
            assert np.allclose(result.v[:, -1], v, rtol=0.0, atol=max(deviation, 1e-9))


def own_links(options: Options, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """The arm at the wall, stepped here: MuJoCo tells mass matrix, free acceleration and contacts
    of our state; forces and step are ours."""
    runner = mujoco_contact.links(options)
    runner.reset()
    q, v = runner.q0.copy(), runner.v0.copy()
    for _ in range(steps):
        runner.data.qpos[:], runner.data.qvel[:] = q, v
        state = contact_state(runner)
        acceleration = runner.data.qacc_smooth.copy()
        if state is not None:
            _, force, _, _ = ours(state, options)
            acceleration += state.problem.response @ force.ravel()
        v = v + options.dt * acceleration
        q = q + options.dt * v
    return q, v


def test_our_own_arm_at_the_wall_moves_as_mujocos_does() -> None:
    options = Options()
    q, _ = own_links(options, 250)
    assert np.allclose(q, mujoco_contact.links(options).run(250)[0], rtol=0.0, atol=1e-10)


def test_newton_takes_few_iterations() -> None:
    options = Options()
    states = touching(SCENES["sliding block"](options), 100)
    assert max(ours(state, options)[2] for state in states) <= 12


# --- what sweeps find of the same problem ---------------------------------------------------------


def swept(state: ContactState, options: Options, sweeps: int, block: bool) -> np.ndarray:
    """Forces of the elliptic rows by projected Gauss-Seidel on the dual of the soft problem."""
    problem = state.problem
    rows = rows_of(problem, options.softness(state.weight))
    d = problem.jacobian.shape[1]
    scale = np.hstack((np.ones((rows.mu.shape[0], 1)), rows.mu)).ravel()
    J = rows.rows
    free = (problem.free - problem.velocity) / problem.dt
    A = J @ np.linalg.solve(problem.mass, J.T) + np.diag(rows.compliance)
    b = scale * (J @ free - rows.reference)
    g = np.zeros(b.size)
    A = np.ascontiguousarray(scale[:, None] * A * scale)
    gauss_seidel(A, b, g, d, associated=block, sweeps=sweeps, tolerance=1e-13)
    return np.asarray(scale * g)


def sliding_states(steps: int = 100) -> list[ContactState]:
    """A point block that comes down sliding: the impact and what follows."""
    runner = mujoco_contact.block(Options(), 0.0, (2.0, 0.5), 0.01)
    runner.v0[2] = -1.0
    return list(touching(runner, steps))


def test_a_contact_swept_as_one_block_finds_mujocos_forces_and_normal_first_does_not() -> None:
    """The soft problem is convex: its friction acts back on the normal. Normal first, then
    friction cut back, has other fixed points (it is Coulomb's law, not this one)."""
    options = Options()
    wrong = {True: 0, False: 0}
    states = sliding_states()
    for state in states:
        for block in wrong:
            f = swept(state, options, 3000, block)
            largest = max(1e-3, np.max(np.abs(state.force)))
            wrong[block] += bool(np.max(np.abs(f - state.force)) > 1e-6 * largest)
    assert len(states) >= 10
    assert wrong[True] == 0
    assert wrong[False] > 0.2 * len(states)


# --- properties -----------------------------------------------------------------------------------


def test_softness_that_vanishes_is_the_convex_law() -> None:
    """Impedance near 1 and a reference that stops within the step: velocities of the convex model
    to the share that is left to softness."""
    scene = scenes.block(0.0, 0.5, (1.0, 0.0))
    problem = scene.problem(0.002)
    stops = 1.0 / 0.002
    result = solve(
        "soft",
        problem,
        cone="elliptic",
        refsafe=False,
        solref=(-1e-9, -stops),
        solimp=(0.9999, 0.9999, 0.001, 0.5, 2.0),
        margin=1e-9,
    )
    convex = solve("convex", problem)
    assert np.allclose(result.velocity, convex.velocity, atol=2e-3)
    assert defect(problem, result.impulses, "convex") < 5e-3


@pytest.mark.parametrize(
    "wrong",
    [
        {"solref": (0.02, -1.0)},
        {"solref": (0.0, 0.0)},
        {"solref": (np.nan, 1.0)},
        {"solimp": (0.9, 0.95)},
        {"impratio": 0.0},
        {"cone": "round"},
        {"margin": -0.1},
        {"weight": [[-1.0, 0.0]]},
    ],
)
def test_bad_softness_is_named(wrong: dict[str, Any]) -> None:
    problem: Problem = scenes.ball_drop(-0.001).problem(0.01)
    with pytest.raises(ValueError, match=next(iter(wrong))):
        solve("soft", problem, **wrong)
    assert Softness().cone == "pyramidal"
