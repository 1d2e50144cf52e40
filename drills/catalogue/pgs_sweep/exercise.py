"""A sweep over contacts: values against the worked answer, and cases for each face of the cone."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return one contact on each part of the cone, then several that are coupled."""

    def delassus(n: int, coupling: float = 1.0) -> Array:
        """Return the Delassus matrix of n contacts on bodies that share coordinates."""
        J = rng.normal(size=(3 * n, 3 * n + 2))
        A = J @ J.T / 3.0 + 0.2 * np.eye(3 * n)
        blocks = np.kron(np.eye(n), np.ones((3, 3)))
        return np.asarray(A * (blocks + coupling * (1.0 - blocks)))

    def alone(normal: float, slip: float, mu: float, label: str, level: str = "core") -> Case:
        """Return a contact whose impulse, before it is projected, is (normal, slip).

        The slip points in a random direction.
        """
        A, turn = delassus(1), rng.uniform(-math.pi, math.pi)
        expected = np.array([normal, slip * math.cos(turn), slip * math.sin(turn)])
        start = rng.uniform(0.0, 0.3, (1, 3))
        b = np.linalg.eigvalsh(A)[-1] * (start[0] - expected) - A @ start[0]
        return Case((start, A, b, mu), label, level)

    def several(n: int, mu: float, label: str = "several contacts") -> Case:
        start = np.abs(rng.normal(size=(n, 3)))
        return Case((start, delassus(n), rng.normal(size=3 * n) - 0.5, mu), label)

    return [
        alone(1.0, 0.2, 0.6, "inside the cone", "simple"),
        Case((np.zeros((1, 3)), np.eye(3), np.array([-2.0, 0.0, 0.0]), 0.5), "no slip", "simple"),
        alone(1.0, 2.0, 0.5, "sliding", "simple"),
        alone(-1.0, 0.3, 0.5, "coming apart"),
        alone(-0.3, 0.2, 1.0, "coming apart"),
        alone(-0.2, 1.5, 0.8, "sliding, the step below zero"),
        alone(0.4, 3.0, 1.2, "sliding, much friction"),
        *(several(n, mu) for n, mu in ((2, 0.5), (3, 0.8), (5, 0.3), (8, 1.0))),
        Case((np.zeros((4, 3)), delassus(4, 0.0), rng.normal(size=12), 0.7), "not coupled"),
        alone(1.0, 0.5, 0.0, "no friction", "edge"),
        alone(-1.0, 0.5, 0.0, "no friction", "edge"),
        Case((np.zeros((1, 3)), np.diag([1.0, 2.0, 4.0]), np.zeros(3), 0.5), "at rest", "edge"),
        Case(
            (
                np.array([[1, 0, 0], [2, 1, 0]]),
                2 * np.eye(6, dtype=int) + 1,
                np.array([-3, 1, 0, 2, -1, 4]),
                1,
            ),
            WHOLE,
            "edge",
        ),
    ]


CONE = "on_cone, *(mu * on_cone / slip * np.array(tangent))"

SLIPS = slips(
    friction_scaled_back=(
        "on_cone = (normal + mu * slip) / (1.0 + mu * mu)",
        "on_cone = max(normal, 0.0)",
        "You keep the normal impulse and shorten friction to mu times it. That point is on the "
        "cone but not the nearest one. The projection changes both, and it converges to other "
        "impulses than yours.",
    ),
    tangents_one_by_one=(
        "            g[i] = " + CONE,
        "            normal = max(normal, 0.0)\n"
        "            g[i] = normal, *np.clip(tangent, -mu * normal, mu * normal)",
        "You clamp each tangent on its own. That is a box, not a cone: on the diagonal it allows "
        "sqrt(2) times as much friction. Limit the length of both tangents together.",
    ),
    old_impulses=(
        "velocity = A[rows] @ g.ravel()",
        "velocity = A[rows] @ np.asarray(impulses, dtype=float).ravel()",
        "You use the impulses from before the sweep for all contacts. That is the Jacobi method. "
        "Gauss-Seidel uses the new impulses of the contacts that it has already visited.",
    ),
    against_the_sign=(
        "g[i] - step * velocity",
        "g[i] + step * velocity",
        "You change the impulses along the velocity. They must act against it.",
    ),
    apex_forgotten=(
        "elif mu * slip <= -normal:",
        "elif False:",
        "Separating contacts get the wrong impulse. Behind the apex, where mu |t| <= -n, the "
        "nearest point of the cone is the apex: zero.",
    ),
    zero_when_negative=(
        "elif mu * slip <= -normal:",
        "elif normal <= 0.0:",
        "You set every contact with a negative normal impulse to zero. If the tangents are long, "
        "the nearest point of the cone is on its side.",
    ),
    not_projected=(
        "if slip <= mu * normal:",
        "if True:",
        "You change the impulses but do not project them: contacts pull, and friction is "
        "unlimited.",
    ),
    diagonal_for_eigenvalue=(
        "np.linalg.eigvalsh(A[rows, rows])[-1]",
        "A[3 * i, 3 * i]",
        "You divide by the normal entry of A. The task divides by the largest eigenvalue of the "
        "whole block.",
    ),
    trace_for_eigenvalue=(
        "np.linalg.eigvalsh(A[rows, rows])[-1]",
        "np.trace(A[rows, rows])",
        "You divide by the trace of the block. That is safe, but the step is shorter than the "
        "task's, which divides by the largest eigenvalue.",
    ),
    smallest_eigenvalue=(
        "np.linalg.eigvalsh(A[rows, rows])[-1]",
        "np.linalg.eigvalsh(A[rows, rows])[0]",
        "You divide by the smallest eigenvalue. In the stiff direction such steps are too long and "
        "do not converge. Divide by the largest one.",
    ),
    block_alone=(
        "velocity = A[rows] @ g.ravel()",
        "velocity = A[rows, rows] @ g[i]",
        "You use only the contact's own block, but the impulses of the others move it too. Use all "
        "columns of its rows.",
    ),
    free_velocity_forgotten=(
        " + np.asarray(b, dtype=float)[rows]",
        "",
        "b is missing: the velocity that the contacts have without any impulse.",
    ),
    impulse_forgotten=(
        "*tangent = g[i] - step * velocity",
        "*tangent = -step * velocity",
        "The new impulse is the old one minus a step, not the step alone.",
    ),
    cone_turned=(
        "(normal + mu * slip) / (1.0 + mu * mu)",
        "(mu * normal + slip) / (1.0 + mu * mu)",
        "You swapped normal and tangent in the projection. The side of the cone is the line "
        "t = mu n, so n becomes (n + mu |t|) / (1 + mu^2).",
    ),
    normal_last=(
        "normal, *tangent = g[i]",
        "*tangent, normal = g[i]",
        "g[i] = normal, *tangent",
        "g[i] = *tangent, normal",
        "g[i] = " + CONE,
        "g[i] = *(mu * on_cone / slip * np.array(tangent)), on_cone",
        "You treat the last of a contact's three impulses as the normal one. It is the first.",
    ),
)


def allowed(case: Case, truth: tuple[Any, ...]) -> float:
    """Return 1e-11 of the largest impulse, one added."""
    return 1e-11 * (1.0 + float(np.abs(truth[0]).max()))


EXERCISE = Exercise(
    judge=judge_of(
        cases,
        allowed,
        "a sweep is a few dozen products, and the eigenvalues are accurate to 1e-14",
        explain=coarse,
    ),
    examples=(
        "pgs_sweep(np.zeros((1, 3)), np.eye(3), np.array([-1.0, 0.2, 0.0]), 0.5)",
        "pgs_sweep(np.zeros((1, 3)), np.eye(3), np.array([-1.0, 2.0, 0.0]), 0.5)",
        "pgs_sweep(np.ones((2, 3)), np.eye(6) + 0.2, np.array([-1.0, 0, 0, 3.0, 1.0, 0]), 0.5)",
    ),
    slips=SLIPS
    + coarse_slips("pgs_sweep", "The solver could then not converge any further than that.")
    + value_slips("pgs_sweep", in_part=False),
)
