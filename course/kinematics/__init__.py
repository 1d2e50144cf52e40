"""Chapter 4: arms. Where the tip is, how it moves, which joints put it there, what torques do.

The public names of the chapter; each lives in the file of its section.
"""

from course.kinematics.chain import Chain, compose, invert, panda, planar, random_chain, turn_to
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
from course.kinematics.two_link import TwoLink, TwoLinkIK, two_link_ik

__all__ = [
    "Chain",
    "TwoLink",
    "TwoLinkIK",
    "acceleration",
    "analytic_jacobian",
    "bias",
    "compose",
    "condition_number",
    "energy",
    "forward_dynamics",
    "frames",
    "inertial_parameters",
    "inverse_dynamics",
    "invert",
    "jacobian",
    "jacobian_rate",
    "linearise",
    "manipulability",
    "mass_matrix",
    "null_space",
    "pack",
    "panda",
    "planar",
    "random_chain",
    "regressor",
    "singular_values",
    "tip",
    "turn_to",
    "two_link_ik",
    "warm",
    "within",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    import numpy as np

    from course.kinematics import dynamics, motion
    from course.rigid_body import System, simulate

    motion.kernels()
    dynamics.kernels()
    arm = planar([1.0])
    simulate(System("arm", acceleration, pack(arm), np.zeros(1), np.zeros(1)), "rk4", 1e-3, 1)
