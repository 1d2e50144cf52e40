"""The standing biped of chapter 6: its program against SciPy, its limits, the judge's verdicts."""

import math

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from scipy.optimize import linprog, minimize

from course import charts
from course.control.standing import GRAVITY, biped, program, stand, steepest
from drills.cards import card
from drills.catalogue.standing_qp.exercise import violations
from drills.grader import attempt
from drills.verify import in_this_process
from solutions.control import nonnegative_least_squares, standing_qp
from tests.budget import examples

CASES = (
    {"slope": 0.0, "mu": 0.6},
    {"slope": 0.5, "mu": 0.6},
    {"slope": -0.3, "mu": 0.4, "weight": 0.05},
    {"slope": 0.3, "mu": 0.6, "lean": 0.18},
    {"slope": 0.3, "mu": 0.6, "limit": 11.0},
)


def minimum(standing):
    """The program's minimum by SciPy's sequential quadratic programming, forces over m g (8,)."""
    p = program(standing)
    result = minimize(
        lambda x: np.sum((p.root @ x) ** 2),
        np.full(8, 0.1),
        jac=lambda x: 2.0 * p.root.T @ (p.root @ x),
        constraints=[
            {"type": "eq", "fun": lambda x: p.E @ x - p.e, "jac": lambda x: p.E},
            {"type": "ineq", "fun": lambda x: p.h - p.G @ x, "jac": lambda x: -p.G},
        ],
        method="SLSQP",
        options={"ftol": 1e-14, "maxiter": 500},
    )
    assert result.success
    return result.x


@pytest.mark.parametrize("changed", CASES)
def test_forces_are_scipys_minimum(changed):
    standing = biped(**changed)
    expected = minimum(standing)
    heavy = standing.mass * GRAVITY
    ours, answer = stand(standing), standing_qp(*standing)
    assert ours.feasible and answer[2] == 1.0
    for forces in (ours.forces, answer[0]):
        np.testing.assert_allclose(forces.ravel() / heavy, expected, atol=1e-6)
    np.testing.assert_allclose(answer[1], ours.torques, atol=1e-8 * heavy)


def test_forces_carry_the_weight_and_torques_carry_the_forces():
    """In world axes, with the moment about each joint from cross products of NumPy."""
    standing = biped(0.4, 0.6, lean=0.05)
    result = stand(standing)
    c, s = math.cos(0.4), math.sin(0.4)
    world = result.forces @ np.array([[c, s], [-s, c]])
    np.testing.assert_allclose(world.sum(axis=(0, 1)), [0.0, standing.mass * GRAVITY], atol=1e-9)

    def moment(levers, forces):
        pad = [(0, 0)] * (levers.ndim - 1) + [(0, 1)]
        return np.cross(np.pad(levers, pad), np.pad(forces, pad))[..., 2].sum()

    assert moment(standing.contacts - standing.com, world) == pytest.approx(0.0, abs=1e-9)
    for leg in range(2):
        for k in range(3):
            expected = moment(standing.contacts[leg] - standing.joints[leg, k], world[leg])
            assert result.torques[leg, k] == pytest.approx(expected, abs=1e-9)


@examples(30)
@given(
    st.floats(-0.9, 0.9), st.floats(0.1, 1.0), st.floats(-0.3, 0.3), st.sampled_from([12.0, 1e4])
)
@example(slope=0.12006004354551325, mu=0.12006004354551325, lean=0.1171875, limit=1e4)
def test_what_is_feasible_is_so_by_a_linear_program_too(slope, mu, lean, limit):
    standing = biped(slope, mu, lean=lean, limit=limit)
    p = program(standing)

    def allowed(margin):
        slack = p.h + margin
        return linprog(np.zeros(8), p.G, slack, p.E, p.e, bounds=(None, None)).status == 0

    assume(allowed(-1e-4) == allowed(1e-4))  # not within rounding of a limit
    assert stand(standing).feasible == allowed(0.0) == bool(standing_qp(*standing)[2])


@pytest.mark.parametrize("mu", [0.2, 0.5, 1.0])
def test_the_steepest_slope_is_the_friction_angle(mu):
    assert math.tan(steepest(mu)) == pytest.approx(mu, rel=1e-5)
    assert math.tan(steepest(mu, limit=13.0)) < 0.95 * mu


@examples(20)
@given(st.integers(0, 2**32 - 1))
def test_nonnegative_least_squares_are_scipys(seed):
    from scipy.optimize import nnls

    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(6, 12)), rng.normal(size=6)
    x = nonnegative_least_squares(A, b)
    assert x.min() >= 0.0
    assert np.linalg.norm(A @ x - b) == pytest.approx(nnls(A, b)[1], abs=1e-9)


def test_the_judges_conditions_hold_at_the_minimum_and_nowhere_near():
    for changed in CASES:
        standing = biped(**changed)
        p, heavy = program(standing), standing.mass * GRAVITY
        x = stand(standing).forces.ravel() / heavy
        assert max(violations(p, x)) < 1e-6
        inside = np.linalg.svd(p.E)[2][3]
        assert max(violations(p, x + 1e-2 * inside)[1:]) > 1e-3
        assert violations(p, 1.01 * x)[0] > 5e-3


@pytest.mark.parametrize("bad", [{"mu": -0.1}, {"slope": 1.6}, {"limit": 0.0}, {"weight": -1.0}])
def test_a_biped_that_cannot_be_is_rejected(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        biped(**({"slope": 0.1, "mu": 0.5} | bad))


@pytest.mark.parametrize("changed", CASES)
def test_no_forces_are_decided_by_rounding(changed):
    standing = biped(**changed)
    moved = standing._replace(
        mu=standing.mu * (1.0 + 1e-12),
        slope=standing.slope * (1.0 + 1e-12),
        com=standing.com * (1.0 + 1e-12),
        joints=standing.joints * (1.0 + 1e-12),
        contacts=standing.contacts * (1.0 + 1e-12),
        limit=standing.limit * (1.0 + 1e-12),
    )
    for k in range(3):
        before, after = (np.asarray(standing_qp(*s)[k]) for s in (standing, moved))
        np.testing.assert_allclose(before, after, atol=1e-6)


COMMON = """
import numpy as np
from scipy.optimize import linprog, minimize, nnls


def program(mass, mu, slope, com, joints, contacts, limit):
    com, joints, contacts = map(np.asarray, (com, joints, contacts))
    t = np.array([np.cos(slope), np.sin(slope)])
    n = np.array([-t[1], t[0]])
    W = mass * 9.81
    E, G, h, T = np.zeros((3, 8)), [], [], np.zeros((6, 8))
    for leg in range(2):
        for k in range(2):
            for a, axis in enumerate((t, n)):
                col = 4 * leg + 2 * k + a
                E[:2, col] = axis
                r = contacts[leg, k] - com
                E[2, col] = r[0] * axis[1] - r[1] * axis[0]
                for j in range(3):
                    r = contacts[leg, k] - joints[leg, j]
                    T[3 * leg + j, col] = (r[0] * axis[1] - r[1] * axis[0]) * W / limit
            for sign in (1.0, -1.0):
                row = np.zeros(8)
                row[4 * leg + 2 * k] = sign
                row[4 * leg + 2 * k + 1] = -mu
                G.append(row)
                h.append(0.0)
    G = np.vstack((G, T, -T))
    h = np.concatenate((h, np.ones(12)))
    return E, np.array([0.0, 1.0, 0.0]), G, h, T, W


def standing_qp(mass, mu, slope, com, joints, contacts, limit, weight):
    E, e, G, h, T, W = program(mass, mu, slope, com, joints, contacts, limit)
    first = linprog(np.zeros(8), G, h, E, e, bounds=(None, None))
    if first.status != 0:
        return np.zeros((2, 2, 2)), np.zeros((2, 3)), 0.0
    H = T.T @ T + weight * np.eye(8)
"""
DUAL = """
    # The whole program as a least distance problem, equations as pairs of inequalities.
    L = np.linalg.cholesky(H)
    A = np.linalg.solve(L, np.vstack((E, -E, G)).T)
    c = np.concatenate((e, -e, h))
    stacked = np.vstack((-A, -c))
    target = np.zeros(9); target[-1] = 1.0
    w = nnls(stacked, target)[0]
    r = stacked @ w - target
    x = np.linalg.solve(L.T, -r[:-1] / r[-1])
    return (x * W).reshape(2, 2, 2), (T @ x * limit).reshape(2, 3), 1.0
"""
SEQUENTIAL = """
    best = minimize(lambda x: x @ H @ x, first.x, jac=lambda x: 2 * H @ x, method="SLSQP",
        constraints=[{"type": "eq", "fun": lambda x: E @ x - e, "jac": lambda x: E},
                     {"type": "ineq", "fun": lambda x: h - G @ x, "jac": lambda x: -G}],
        options={"ftol": 1e-15, "maxiter": 1000})
    # Its active constraints, then the linear system they make.
    active = h - G @ best.x < 1e-6
    for _ in range(20):
        C, d = np.vstack((E, G[active])), np.concatenate((e, h[active]))
        K = np.block([[2 * H, C.T], [C, np.zeros((len(d), len(d)))]])
        z = np.linalg.lstsq(K, np.concatenate((np.zeros(8), d)), rcond=None)[0]
        lost = z[11:] < -1e-9
        if not lost.any():
            break
        active[np.flatnonzero(active)[np.argmin(z[11:])]] = False
    x = z[:8]
    return (x * W).reshape(2, 2, 2), (T @ x * limit).reshape(2, 3), 1.0
"""


@pytest.mark.prove
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("style", [DUAL, SEQUENTIAL], ids=["dual", "sequential"])
def test_the_judge_accepts_other_right_styles(style, seed):
    report = attempt(card("standing_qp"), COMMON + style, seed=seed, place=in_this_process).report
    assert report.passed, report.sentence


@pytest.mark.slow
def test_the_chart_meets_theory_on_both_sides():
    limit, share = charts.build("standing_limit", frictions=(0.3, 0.8), slopes=5)
    strong, weak = limit.series
    np.testing.assert_allclose(strong.y, strong.expected, atol=1e-2)
    assert np.all(np.array(weak.y) < 0.95 * np.array(strong.y))
    assert "0.98 times the friction angle's tangent: 2 of 2" in limit.notes[0]
    assert "1.02 times the friction angle's tangent: 0 of 2" in limit.notes[1]
    assert share["friction [%]"].y[-1] == pytest.approx(99.9, abs=0.5)
