"""Chapter 4: arms. Where the tip is, how it moves, which joints put it there, what torques do.

The public names of the chapter; each lives in the file of its section.

The chapter's algorithms, and the functions of their steps:

- Recursive Newton-Euler (Luh, Walker and Paul, 1980): `dynamics._rnea`, a forward and a backward
  pass.
- Composite rigid bodies (Walker and Orin, 1982): `dynamics._crba`; `_merge` adds a body to its
  parent.
- Articulated bodies (Featherstone, 1983): `dynamics._aba` in three passes; `_articulate` adds an
  inertia to its parent.
- Damped least squares and Levenberg-Marquardt (Wampler, 1986; Sugihara, 2011): `inverse._solve` is
  the loop, `step` and `_marquardt` its steps, `_held` the joint limits.
- Differential inverse kinematics within limits (Stark and Parker, 1995):
  `differential.bounded_velocity`, an active-set method.
- Closed form of a 7-R arm (He and Liu, 2021): `seven_joint._closed_form`, wrist, elbow, cone and
  plane, shoulder.
- Geometric Jacobian (Whitney, 1972): `motion.place` does the forward kinematics, `columns` the
  Jacobian.

Examples:
    >>> from course import kinematics
    >>> arm = kinematics.planar((1.0, 0.7))  # links [m]
    >>> print(kinematics.tip(arm, [0.0, 0.0])[:3])
    [1.7 0.  0. ]
    >>> print(kinematics.manipulability(kinematics.jacobian(arm, [0.3, 0.0])[:2]).round(9))
    0.0
"""

from course.kinematics.chain import Chain, compose, invert, panda, planar, random_chain, turn_to
from course.kinematics.differential import (
    BoundedVelocity,
    bounded_velocity,
    damped_velocity,
    velocity_bounds,
)
from course.kinematics.dynamics import (
    acceleration,
    bias,
    energy,
    forward_dynamics,
    inertial_parameters,
    inverse_dynamics,
    linearise,
    mass_matrix,
    pack,
    regressor,
)
from course.kinematics.inverse import (
    METHODS,
    IKResult,
    Samples,
    disc_distance,
    elbow_height,
    ik,
    mid_range,
    null_space_step,
    pose_error,
    uniform_starts,
)
from course.kinematics.motion import (
    analytic_jacobian,
    condition_number,
    frames,
    jacobian,
    jacobian_rate,
    manipulability,
    null_space,
    singular_values,
    tip,
    within,
)
from course.kinematics.seven_joint import closed_form, postures_within_limits, swivel_angle
from course.kinematics.two_link import TwoLink, TwoLinkIK, two_link_ik

__all__ = [
    "METHODS",
    "BoundedVelocity",
    "Chain",
    "IKResult",
    "Samples",
    "TwoLink",
    "TwoLinkIK",
    "acceleration",
    "analytic_jacobian",
    "bias",
    "bounded_velocity",
    "closed_form",
    "compose",
    "condition_number",
    "damped_velocity",
    "disc_distance",
    "elbow_height",
    "energy",
    "forward_dynamics",
    "frames",
    "ik",
    "inertial_parameters",
    "inverse_dynamics",
    "invert",
    "jacobian",
    "jacobian_rate",
    "linearise",
    "manipulability",
    "mass_matrix",
    "mid_range",
    "null_space",
    "null_space_step",
    "pack",
    "panda",
    "planar",
    "pose_error",
    "postures_within_limits",
    "random_chain",
    "regressor",
    "singular_values",
    "swivel_angle",
    "tip",
    "turn_to",
    "two_link_ik",
    "uniform_starts",
    "velocity_bounds",
    "warm",
    "within",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    import numpy as np

    from course.kinematics import dynamics, inverse, motion, seven_joint
    from course.rigid_body import System, simulate

    motion.kernels()
    dynamics.kernels()
    inverse.kernel()
    seven_joint.kernel()
    arm = planar([1.0])
    simulate(System("arm", acceleration, pack(arm), np.zeros(1), np.zeros(1)), "rk4", 1e-3, 1)
