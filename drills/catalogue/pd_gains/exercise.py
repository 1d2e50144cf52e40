"""PD gains for a joint: values against the worked answer."""

from __future__ import annotations

import numpy as np

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips


def cases(rng: np.random.Generator) -> list[Case]:
    """Return cases from a simple one to those at the edge."""

    def draw(label: str, level: str = "core", *, n: int = 4, friction: float = 2.0) -> Case:
        args = (
            rng.uniform(0.05, 8.0, n),
            rng.uniform(0.0, friction, n),
            rng.uniform(0.5, 12.0, n),
            rng.uniform(0.3, 1.5, n),
        )
        return Case(args, label, level)

    return [
        draw("one joint without friction", "simple", n=1, friction=0.0),
        draw("one joint", "simple", n=1),
        *(draw("several joints") for _ in range(6)),
        draw("friction beyond the damping", friction=500.0),
        draw("six joints", "edge", n=6),
        Case(
            (np.array([2, 3]), np.array([1, 0]), np.array([1, 4]), np.array([1, 2])), WHOLE, "edge"
        ),
    ]


SLIPS = slips(
    hertz_for_radians=(
        "2.0 * np.pi * np.asarray(frequency, dtype=float)",
        "1.0 * np.asarray(frequency, dtype=float)",
        "The frequency is used in Hz. omega = 2 pi f is in rad/s.",
    ),
    friction_ignored=(
        " - np.asarray(friction, dtype=float)",
        "",
        "The joint's own friction is not subtracted: together with your kd it damps more than "
        "desired.",
    ),
    friction_added=(
        "J - np.asarray(friction, dtype=float)",
        "J + np.asarray(friction, dtype=float)",
        "Friction is added to kd. It damps already, so kd needs less.",
    ),
    inertia_forgotten=(
        "omega**2 * J, kd",
        "omega**2, kd / J",
        "The inertia is missing: those gains are right for 1 kg m^2.",
    ),
    two_missing=(
        "kd = 2.0 * ",
        "kd = ",
        "The damping term is 2 zeta omega J; the factor of two is missing.",
    ),
    half_of_it=(
        "kd = 2.0 * ",
        "kd = 4.0 * ",
        "kd is twice what it should be: the damping ratio is (kd + friction) / (2 omega J).",
    ),
    damped_frequency=(
        "return omega**2 * J, kd",
        "zeta2 = np.minimum(np.asarray(ratio, dtype=float) ** 2, 0.99)\n    return omega**2 / "
        "(1.0 - zeta2) * J, kd",
        "The frequency is taken for that of the damped swing. It is the undamped one, sqrt(kp / "
        "J).",
    ),
    inertia_forgotten_in_both=(
        "omega**2 * J, kd",
        "omega**2, kd + 2.0 * np.asarray(ratio, dtype=float) * omega * (1.0 - J)",
        "The inertia is missing in both gains: they are right for 1 kg m^2. The friction that is "
        "subtracted belongs to the real joint.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(
        cases,
        lambda case, truth: [1e-12 * max(1.0, float(np.abs(t).max())) for t in truth],
        "products",
        explain=coarse,
    ),
    examples=(
        "pd_gains([0.5], [0.0], [2.0], [1.0])",
        "pd_gains([0.5, 2.0], [1.0, 3.0], [2.0, 1.0], [0.7, 1.0])",
    ),
    slips=SLIPS
    + coarse_slips("pd_gains", "Gains are small next to the torques they make.")
    + value_slips("pd_gains", swapped=True),
)
