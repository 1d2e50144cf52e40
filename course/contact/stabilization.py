"""What engines do about penetration: ERP and CFM, split impulses, and XPBD with sub-steps.

All of it runs on the scenes of `course.contact.scenes`, so that the methods differ in this alone.
Baumgarte stabilisation itself is part of every `Problem` (`recovery`, `max_recovery_speed`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.check import count, finite, invalid, positive
from course.contact.models import gauss_seidel, solve
from course.contact.problem import Problem, Solution
from course.contact.scenes import Scene

Array = NDArray[np.float64]


def erp_cfm(stiffness: float, damping: float, dt: float) -> tuple[float, float]:
    """Return the ERP and CFM that make a constraint a spring and damper, integrated implicitly.

    ERP = h k / (h k + b) and CFM = 1 / (h k + b) (Smith, Open Dynamics Engine User Guide, 2006,
    section 3.8).

    Args:
        stiffness: k [N/m].
        damping: b [N s/m].
        dt: h [s].

    Returns:
        (erp, cfm): the share of the depth that a step takes back, and the compliance added to the
        constraint's diagonal [(m/s)/N].
    """
    positive("stiffness", stiffness, unit="N/m")
    finite("damping", damping, 0.0)
    positive("dt", dt, unit="s")
    whole = dt * stiffness + damping
    return dt * stiffness / whole, 1.0 / whole


def spring_and_damper(erp: float, cfm: float, dt: float) -> tuple[float, float]:
    """Return the (stiffness [N/m], damping [N s/m]) that an ERP and a CFM stand for at this step.

    The inverse of `erp_cfm`. With fixed ERP and CFM the spring depends on the step.
    """
    finite("erp", erp, 0.0, 1.0)
    positive("cfm", cfm)
    positive("dt", dt, unit="s")
    return erp / (dt * cfm), (1.0 - erp) / cfm


def solve_erp_cfm(
    problem: Problem,
    erp: float,
    cfm: float,
    *,
    sweeps: int = 1000,
    tolerance: float = 1e-10,
) -> Solution:
    """Return the impulses of a step whose normal rows are softened with an ERP and a CFM.

    Each normal row asks for u + erp gap / h + cfm f = 0 instead of u = 0, with f >= 0.

    Args:
        problem: the step; its own `recovery` is not used.
        erp: share of the depth that the step takes back, 0 to 1.
        cfm: compliance [(m/s)/N].
        sweeps: of projected Gauss-Seidel, at most.
        tolerance: of a sweep's largest correction [m/s].
    """
    finite("erp", erp, 0.0, 1.0)
    finite("cfm", cfm, 0.0)
    d = problem.jacobian.shape[1]
    A = problem.scaled.copy()
    # CFM belongs to a force and the unknown is an impulse, hence the division by the step.
    A[np.diag_indices(len(A))] += np.where(np.arange(len(A)) % d == 0, cfm / problem.dt, 0.0)
    b = problem.scale * (problem.rows @ problem.free)
    # An open contact may just close; one that overlaps takes back its share.
    b[::d] += np.where(problem.gap > 0.0, 1.0, erp) * problem.gap / problem.dt
    g = np.zeros(len(A))
    taken = gauss_seidel(
        A, b, g, d, associated=False, sweeps=count("sweeps", sweeps, 1), tolerance=tolerance
    )
    impulses = (problem.scale * g).reshape(problem.jacobian.shape[:2])
    # How far the softened complementarity is missed, with the impulse scaled to a velocity.
    normal = (A @ g + b)[::d]
    missed = float(np.max(np.abs(np.minimum(g[::d] * np.diag(A)[::d], normal))))
    return Solution(
        "erp and cfm", impulses, problem.after(impulses), taken, missed, missed <= 10.0 * tolerance
    )


def split_impulse_steps(
    scene: Scene,
    dt: float,
    steps: int,
    *,
    model: str = "pgs",
    recovery: float = 0.2,
    **options: Any,
) -> Iterator[tuple[Array, Array]]:
    """Yield (q, v) after each step, with penetration taken back by a split impulse.

    The velocity is solved for without any recovery. A second solve, from rest and without friction,
    finds the pseudo-velocity that takes back a share of the depth; it moves the bodies in this step
    and is then forgotten, so it never becomes kinetic energy (Catto, Modeling and solving
    constraints, Game Developers Conference 2009).

    Args:
        scene: the bodies.
        dt: step [s].
        steps: how many.
        model: one of `course.contact.MODELS`, for both solves.
        recovery: share of the depth that a step takes back, 0 to 1.
        **options: of the model.
    """
    count("steps", steps, 1)
    finite("recovery", recovery, 0.0, 1.0)
    q, v = scene.q.copy(), scene.v.copy()
    for _ in range(steps):
        # The velocity is solved for without recovery, so no overlap turns into kinetic energy.
        step = replace(scene.problem(dt, q, v), recovery=0.0)
        still = np.zeros_like(v)
        # The position problem: from rest, without friction, at whatever speed the depth asks for.
        push = replace(
            step,
            velocity=still,
            free=still,
            friction=np.zeros_like(step.friction),
            recovery=recovery,
            max_recovery_speed=np.inf,
        )
        v = solve(model, step, **options).velocity
        # The pseudo-velocity moves the positions only; v does not contain it.
        q = q + dt * (v + solve(model, push, **options).velocity)
        yield q, v


def xpbd_steps(
    scene: Scene,
    dt: float,
    steps: int,
    *,
    substeps: int = 1,
    iterations: int = 1,
    compliance: float = 0.0,
) -> Iterator[tuple[Array, Array]]:
    """Yield (q, v) after each step of extended position-based dynamics, without friction.

    Positions are predicted, moved out of the overlaps contact by contact, and the velocity is what
    the positions changed by (Macklin, Müller and Chentanez 2016; sub-steps with one iteration each:
    Macklin et al. 2019).

    Args:
        scene: the bodies; its contacts have one row each.
        dt: step [s].
        steps: how many.
        substeps: of each step.
        iterations: over the contacts, of each sub-step.
        compliance: of a contact, one over its stiffness [m/N].

    Raises:
        ValueError: for a scene with friction.
    """
    if scene.jacobian.shape[1] != 1:
        raise invalid("scene.jacobian.shape", scene.jacobian.shape, "contacts with one row each")
    count("steps", steps, 1)
    count("iterations", iterations, 1)
    finite("compliance", compliance, 0.0)
    h = positive("dt", dt, unit="s") / count("substeps", substeps, 1)
    # M and J are constant, so the responses of the contacts are computed once.
    first = scene.problem(h)
    rows, response, soft = first.rows, first.response, compliance / h**2
    # Generalised inverse mass of each constraint.
    weight = np.diag(first.delassus)
    acceleration = np.linalg.solve(scene.mass, scene.force)
    q, v = scene.q.copy(), scene.v.copy()
    for _ in range(steps):
        for _ in range(substeps):
            before = q
            # Predicted position: semi-implicit Euler without contact.
            q = q + h * v + h**2 * acceleration
            # XPBD starts its multipliers at zero in each sub-step.
            multiplier = np.zeros(len(rows))
            for _ in range(iterations):
                # A Gauss-Seidel sweep: each contact uses the positions that the last one has
                # corrected.
                for i, row in enumerate(rows):
                    gap = scene.distance[i] + row @ q
                    # XPBD's update of the multiplier, with the compliance over h^2 (Macklin et al.,
                    # 2016).
                    change = (-gap - soft * multiplier[i]) / (weight[i] + soft)
                    change = max(change, -multiplier[i])  # a contact only pushes
                    multiplier[i] += change
                    q = q + response[:, i] * change
            # The velocity is the change of position, whatever the projection has added to it.
            v = (q - before) / h
        yield q, v
