"""The stability limit of a mechanism: a number, compared with the worked answer."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from drills.attempt import Attempt
from drills.case_judge import WHOLE, Answer, Case, coarse, judge_of, largest_error
from drills.chart import chart_of
from drills.chart_plan import Plan
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]
# Mistakes that multiply the limit of one mode.
FACTORS = {"one_over_omega": 0.5, "period": math.pi, "limit_of_rk4": math.sqrt(2.0)}


def _chain(springs: Array) -> Array:
    """Return masses in a row, n + 1 springs between them and to both walls."""
    n = springs.size - 1
    K = np.zeros((n, n))
    for i, k in enumerate(springs):
        ends = [j for j in (i - 1, i) if 0 <= j < n]
        for a in ends:
            for b in ends:
                K[a, b] += k if a == b else -k
    return K


def cases(rng: np.random.Generator) -> list[Case]:
    """Return rows of masses, coupled masses, and mechanisms with a soft or a free part."""

    def chain(n: int, label: str) -> Case:
        springs, masses = rng.uniform(50.0, 5000.0, n + 1), rng.uniform(0.2, 3.0, n)
        return Case((_chain(springs), np.diag(masses)), label)

    def coupled(n: int, label: str) -> Case:
        a, b = rng.normal(size=(2, n, n))
        return Case((1e3 * (a @ a.T), b @ b.T + 0.3 * np.eye(n)), label)

    k, m = 10.0 ** rng.uniform(1.0, 6.0), rng.uniform(0.2, 5.0)
    free = _chain(np.array([0.0, rng.uniform(100.0, 900.0), 0.0]))
    # A soft mode beside a stiff one, in coordinates that mix the two.
    turn = rng.uniform(0.3, 1.2)
    R = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    stiff = R @ np.diag([1e6, 1.0]) @ R.T
    return [
        Case((_chain(np.full(9, k)), m * np.eye(8)), "a chain of equal masses", "simple"),
        chain(3, "a chain"),
        chain(12, "a long chain"),
        Case((np.array([[k]]), np.array([[m]])), "one spring", "simple"),
        coupled(2, "two coordinates, coupled masses"),
        coupled(3, "three coordinates, coupled masses"),
        coupled(6, "six coordinates, coupled masses"),
        Case((free, np.diag(rng.uniform(0.5, 2.0, 2))), "free in space", "edge"),
        Case(
            (0.5 * (stiff + stiff.T), np.diag(rng.uniform(0.5, 2.0, 2))), "stiff and soft", "edge"
        ),
        Case((np.array([[300, -100], [-100, 200]]), np.array([[2, 1], [1, 3]])), WHOLE, "edge"),
        Case((_chain(np.array([k, 2.0 * k])), np.array([[m]])), "one mass, two springs", "simple"),
    ]


def explain(answers: Sequence[Answer]) -> str:
    """Name a wrong factor that the simple cases show, whatever else is wrong."""
    simple = [a for a in answers if a.case.level == "simple"]
    for name, factor in FACTORS.items():
        if simple and all(
            largest_error(a.parts[0], factor * a.truth[0]) <= 1e-9 * a.truth[0] for a in simple
        ):
            return name
    return coarse(answers)


def simulated(attempt: Attempt, answers: Sequence[Answer]) -> None:
    """Check a run just below and one just above the submission's own answer."""
    if attempt.failed:
        return
    springs, masses = attempt.rng.uniform(100.0, 900.0, 5), attempt.rng.uniform(0.5, 2.0, 4)
    K, M = _chain(springs), np.diag(masses)
    limit = attempt.numbers("a simulation agrees", attempt.call(K, M), ())
    if limit is None:
        return
    A, tops = np.linalg.solve(M, K), []
    for factor in (0.995, 1.005):
        dt, x, v, top = factor * float(limit), attempt.rng.normal(size=4), np.zeros(4), 0.0
        with np.errstate(all="ignore"):
            for _ in range(800):
                v = v - dt * (A @ x)
                x = x + dt * v
                top = max(top, float(np.max(np.abs(x))))
        tops.append(top)
    attempt.require(
        "a simulation agrees",
        tops[0] < 1e3 < 1e10 < tops[1],
        sentence=f"800 steps reach {tops[0]:.2g} with 0.995 of your limit and {tops[1]:.2g} with "
        "1.005 of it; the first should stay near 1, the second grow without end.",
        got=f"{tops[0]:.2g} and {tops[1]:.2g}",
        expected="below 1e3 and above 1e10",
        call="semi-implicit Euler on four masses in a row",
    )


def row_of_masses(attempt: Attempt) -> Plan:
    """Return the limit of a row of masses: computed, or found by trying steps in MuJoCo."""
    from course.measure import stability
    from course.measure.work_precision import max_norm
    from course.oracles.mujoco import kit

    n, spring, weight = 5, 1e4, 0.5
    # Slide joints in a row: a coordinate is the stretch of a spring, a joint carries all beyond it.
    K = spring * np.eye(n)
    M = weight * (n - np.maximum.outer(np.arange(n), np.arange(n)))
    body = ""
    for _ in range(n):
        body = (
            f'<body><joint type="slide" stiffness="{spring}"/>'
            f'<inertial pos="0 0 0" mass="{weight}" diaginertia="1 1 1"/>{body}</body>'
        )
    flags = '<flag autoreset="disable" contact="disable" constraint="disable"/>'
    xml = (
        f'<mujoco><option integrator="Euler" gravity="0 0 0">{flags}</option>'
        f"<worldbody>{body}</worldbody></mujoco>"
    )
    runner = kit.Runner(xml, np.zeros(n), np.zeros(n), "Euler")
    # A chain that is held at one end: the frequencies of its fixed-free modes.
    omega = 2.0 * math.sqrt(spring / weight) * math.sin((2 * n - 1) / (2 * n + 1) * 0.5 * math.pi)

    def bisected(width: float) -> tuple[list[float], float]:
        tried = 0

        def one_step(state: Array) -> Array:
            runner.q0, runner.v0 = state[:n], state[n:]
            return np.concatenate(runner.run(1))

        def stable(dt: float) -> bool:
            nonlocal tried
            tried += 1
            runner.dt = dt
            return stability.is_stable_by_matrix(one_step, 2 * n)

        return [stability.limit(stable, 1.0 / omega, 3.0 / omega, width)], tried

    return Plan(
        settings=[1.0],
        ask=lambda place, _: ([float(np.asarray(place.call("largest_stable_step", K, M)))], 1),
        truth=[2.0 / omega],
        check=[attempt.expected(K, M)],
        libraries={"MuJoCo Euler, bisected": bisected},
        own_settings={"MuJoCo Euler, bisected": [1e-1, 1e-2, 1e-3, 1e-4]},
        # An error of exactly zero is luck: nothing is known better than its rounding.
        error=lambda answer, truth: max(max_norm(answer, truth), 1e-16 * float(truth[0])),
    )


_PLAIN = """import numpy as np


def largest_stable_step(stiffness, mass):
    K, M = np.asarray(stiffness, dtype=float), np.asarray(mass, dtype=float)
    return {answer}
"""
_VALUES = "np.linalg.eigvals(np.linalg.solve(M, K)).real"
_RETURN = "return 2.0 / math.sqrt(squares[-1]) if squares[-1] > 0.0 else math.inf"

SLIPS = slips(
    stiffest_spring=(
        _PLAIN.format(answer="2.0 / np.sqrt(np.max(np.diag(K) / np.diag(M)))"),
        "You took the largest k / m on the diagonal. That is a lower bound of omega_max^2: "
        "coupling can multiply it, and a step chosen in this way explodes.",
    ),
    stiffest_over_lightest=(
        _PLAIN.format(answer="2.0 / np.sqrt(np.max(np.diag(K)) / np.min(np.diag(M)))"),
        "You took the stiffest spring and the lightest mass of the diagonals, which need not "
        "belong together; and the coupling counts too. Solve K x = omega^2 M x for its "
        "largest value.",
    ),
    slowest_mode=(
        _PLAIN.format(answer=f"2.0 / np.sqrt(np.abs({_VALUES}).min())"),
        "That is the limit of the slowest mode. The fastest one is the first to explode: take the "
        "largest eigenvalue.",
    ),
    arguments_swapped=(
        _PLAIN.format(answer="2 / np.sqrt(np.linalg.eigvals(np.linalg.pinv(K) @ M).real.max())"),
        "Stiffness and mass are taken for each other: that is K^-1 M where M^-1 K is due.",
    ),
    hertz=(
        _PLAIN.format(answer=f"4.0 * np.pi / np.sqrt({_VALUES}.max())"),
        "The frequency is taken in hertz. The limit 2 / omega is that of the circular frequency, "
        "in rad/s: leave the 2 pi out.",
    ),
    bound_for_eigenvalue=(
        _PLAIN.format(answer="2.0 / np.sqrt(np.abs(np.linalg.solve(M, K)).sum(axis=1).max())"),
        "A sum along a row bounds the largest eigenvalue and is not it (Gershgorin): your step is "
        "safe, but too short. Compute the eigenvalue.",
    ),
    sum_of_eigenvalues=(
        _RETURN,
        "return 2.0 / math.sqrt(squares.sum())",
        "The squares of all frequencies are added (the trace). The fastest mode alone sets the "
        "limit: take the largest eigenvalue.",
    ),
    mass_forgotten=(
        _PLAIN.format(answer="2.0 / np.sqrt(np.linalg.eigvalsh(K)[-1])"),
        "The eigenvalues of K alone have the unit N/m, not 1/s^2: the masses are missing.",
    ),
    coupled_masses_ignored=(
        _PLAIN.format(
            answer="2.0 / np.sqrt(np.max(np.linalg.eigvals(K / np.diag(M)[:, None]).real))"
        ),
        "Only the diagonal of the mass matrix is used. In the joint coordinates of an arm the "
        "masses are coupled, and the off-diagonal terms move the highest frequency.",
    ),
    symmetric_solver_on_unsymmetric_matrix=(
        _PLAIN.format(answer="2.0 / np.sqrt(np.linalg.eigvalsh(np.linalg.solve(M, K))[-1])"),
        "inv(M) K is not symmetric although K and M are, and eigvalsh silently reads only its "
        "lower half. Nothing warns you; use eigvals, or Cholesky to keep the symmetry.",
    ),
    norm_for_eigenvalue=(
        _PLAIN.format(answer="2.0 / np.sqrt(np.linalg.norm(np.linalg.solve(M, K), 2))"),
        "The norm of inv(M) K is not its largest eigenvalue: that holds for symmetric matrices "
        "only, and inv(M) K is not one. The norm is larger, so your step is safe but short.",
    ),
    extremes_apart=(
        _PLAIN.format(answer="2.0 * np.sqrt(np.linalg.eigvalsh(M)[0] / np.linalg.eigvalsh(K)[-1])"),
        "The largest eigenvalue of K over the smallest of M is only an upper bound of omega_max^2: "
        "the two belong to different motions. Your step is safe, and shorter than need be.",
    ),
    one_over_omega=(
        _RETURN,
        "return 1.0 / math.sqrt(squares[-1])",
        "Half of the limit: the step matrix of a mode has trace 2 - (omega dt)^2, which stays "
        "above -2 until omega dt = 2, not 1.",
    ),
    period=(
        _RETURN,
        "return 2.0 * math.pi / math.sqrt(squares[-1])",
        "That is the period of the fastest mode, 2 pi / omega. The limit is 2 / omega: about "
        "three steps a period.",
    ),
    square_root_missing=(
        _RETURN,
        "return 2.0 / squares[-1]",
        "The eigenvalues of K x = omega^2 M x are the *squares* of the frequencies.",
    ),
    limit_of_rk4=(
        _RETURN,
        "return math.sqrt(8.0 / squares[-1])",
        "2 sqrt(2) / omega is the limit of RK4. For semi-implicit Euler it is 2 / omega.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: 1e-9 * float(truth[0]),
        "1e-9 of the limit: eigenvalues of these matrices are known to 1e-12",
        explain=explain,
        last=simulated,
        then=("core", "a simulation at the limit"),
    ),
    examples=(
        "largest_stable_step(np.array([[1e5]]), np.array([[1.0]]))",
        "largest_stable_step(np.array([[200.0, -100.0], [-100.0, 200.0]]), np.eye(2))",
        "largest_stable_step(np.diag([900.0, 100.0]), np.array([[3.0, 1.0], [1.0, 1.0]]))",
    ),
    chart=chart_of(
        "Largest stable step of five masses in a row",
        row_of_masses,
        unit="steps tried",
        tolerance=1e-4,
        error_unit="s",
        failed_above=1.0,
    ),
    slips=SLIPS
    + coarse_slips("largest_stable_step", "What should be just below the limit may be above it.")
    + value_slips("largest_stable_step", in_part=False),
)
