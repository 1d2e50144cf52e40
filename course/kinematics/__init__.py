"""Chapter 4: arms. Where the tip is, how it moves, which joints put it there, what torques do.

The public names of the chapter; each lives in the file of its section.
"""

from course.kinematics.chain import Chain, compose, invert, panda, planar, random_chain, turn_to
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
    "analytic_jacobian",
    "compose",
    "condition_number",
    "frames",
    "invert",
    "jacobian",
    "jacobian_rate",
    "manipulability",
    "null_space",
    "panda",
    "planar",
    "random_chain",
    "singular_values",
    "tip",
    "turn_to",
    "two_link_ik",
    "warm",
    "within",
]


def warm() -> None:
    """Compile, or load from the cache, everything in this chapter that is compiled."""
    from course.kinematics import motion

    motion.kernels()
