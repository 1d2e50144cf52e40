"""What a contact solution owes to physics, whichever solver computed it.

Models answer to their own laws, which differ; these five numbers are the same for all of them, and
for every engine that tells its impulses.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from course.check import vector
from course.contact.problem import Problem


@dataclass(frozen=True)
class Residuals:
    """The first four are 0 for Coulomb's rigid contact that starts without penetration.

    Its energy is then not positive, without restitution: with it, friction can make Newton's rule
    gain (Kane and Levinson 1985), and taking back a penetration costs energy too.

    Attributes:
        penetration: the deepest overlap after the step [m], with Jacobian and gap of its start.
        signorini: largest of |min(f_n A_nn, u_n - target)|, force against gap [m/s].
        cone: by how much friction leaves its cone, in the normal's units [N s].
        dissipation: what friction could take out and leaves, at its normal force [J]; it must act
            straight against the slip, with all the cone gives.
        energy: kinetic energy that the contacts put in [J]; of a passive contact not positive.
    """

    penetration: float
    signorini: float
    cone: float
    dissipation: float
    energy: float


def residuals(problem: Problem, impulses: ArrayLike) -> Residuals:
    """Judge the impulses of a step.

    Args:
        problem: the step.
        impulses: shape (n, d), in the rows of the problem's Jacobian [N s, N m s].

    Returns:
        The largest of each over the contacts, and the energy of all; units stand in `Residuals`.

    Raises:
        ValueError: for impulses of another shape, or that are not finite.
    """
    n, d, _ = problem.jacobian.shape
    f = vector("impulses", impulses, (n, d))
    # Contact velocities with the impulses, and without any.
    u = problem.jacobian @ problem.after(f)
    before = problem.jacobian @ problem.free
    inverse_mass = np.diag(problem.delassus)[::d]  # A_nn, of the contact along its normal
    mu = problem.friction
    # |f_t / mu|, to be compared with f_n; infinite for friction in a row that has no coefficient.
    share = np.linalg.norm(
        np.divide(f[:, 1:], mu, out=np.where(f[:, 1:] == 0.0, 0.0, np.inf), where=mu > 0.0), axis=1
    )
    # Moreau's principle of maximum dissipation: the most work that the cone allows at this slip,
    # plus the work of friction, which is negative where it opposes the slip.
    able = np.maximum(f[:, 0], 0.0) * np.linalg.norm(mu * u[:, 1:], axis=1)
    lost = able + np.sum(f[:, 1:] * u[:, 1:], axis=1)
    return Residuals(
        penetration=float(np.max(np.maximum(0.0, -(problem.gap + problem.dt * u[:, 0])))),
        # Signorini's condition: of force and separation, brought to one unit, the smaller one is 0.
        signorini=float(
            np.max(np.abs(np.minimum(f[:, 0] * inverse_mass, u[:, 0] - problem.target_velocity)))
        ),
        cone=float(np.max(np.maximum(0.0, np.maximum(share - f[:, 0], -f[:, 0])))),
        dissipation=float(np.max(np.maximum(0.0, lost))),
        # An impulse works on the mean of the velocities before and after it.
        energy=float(0.5 * np.sum(f * (u + before))),
    )
