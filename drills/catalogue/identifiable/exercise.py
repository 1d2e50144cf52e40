"""What a log tells: all is seen, then directions are hidden, with units of all sizes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import WHOLE, Case, coarse, judge_of
from drills.exercise import Exercise, coarse_slips, slips, value_slips

Array = NDArray[np.float64]


def cases(rng: np.random.Generator) -> list[Case]:
    """Return Jacobians with a stated number of hidden directions, in parameters of all sizes."""

    def log(
        label: str,
        level: str = "core",
        *,
        n: int = 60,
        p: int = 4,
        hidden: int = 0,
        sizes: float = 0.0,
        alone: bool = False,
        unit: float = 1.0,
    ) -> Case:
        scale = 10.0 ** rng.uniform(-sizes, sizes, p)
        relative = rng.normal(size=(n, p)) @ (np.eye(p) + 0.3 * rng.normal(size=(p, p)))
        if alone:
            relative[:, 1] = 0.0
        elif hidden:
            N = np.linalg.qr(rng.normal(size=(p, hidden)))[0]
            if p > 3:  # one parameter at least keeps its interval
                N[0] = 0.0
                N = np.linalg.qr(N)[0]
            relative = relative - relative @ N @ N.T
        # The unit of the samples: signal and noise are larger or smaller together.
        return Case(
            (unit * relative / scale, scale, unit * float(rng.uniform(0.5, 2.0))), label, level
        )

    whole = np.array([[1, 2, 2], [0, 1, 1], [3, 0, 0], [1, 1, 1]]), np.array([1, 2, 2]), 2
    return [
        log("one parameter", "simple", p=1),
        log("all seen", "simple"),
        log("a column of zeros", "simple", alone=True),
        log("all seen, unlike sizes", sizes=3.0),
        log("all seen, many samples", n=400, p=5),
        *(log("one hidden", hidden=1) for _ in range(2)),
        *(log("one hidden, unlike sizes", hidden=1, sizes=3.0) for _ in range(2)),
        log("one hidden, samples in nanometres", hidden=1, unit=1e9),
        log("one hidden, nanometres in metres", hidden=1, unit=1e-9),
        log("two hidden", hidden=2, p=6),
        log("two hidden, unlike sizes", hidden=2, p=6, sizes=2.0),
        log("fewer samples than parameters", "edge", n=2, p=4, sizes=1.0),
        log("as many samples as parameters", "edge", n=3, p=3),
        Case(whole, WHOLE, "edge"),
    ]


def allowed(case: Case, truth: tuple[Array, ...]) -> list[float]:
    """Return the rank exactly, the projector to 1e-9, half-widths to 1e-9 of the largest number."""
    return [0.0, 1e-9, 1e-9 * max(1.0, float(np.abs(truth[2]).max()))]


_HALF = "half = 1.96 * size * np.sqrt(variance)"
_RETURN = "np.where(np.diag(projector) > 1e-8, -1.0, half)"
_RELATIVE = "relative = np.asarray(jacobian, dtype=float) * size"

SLIPS = slips(
    variance_for_deviation=(
        _HALF,
        "half = 1.96 * size**2 * variance",
        "This is the variance. A half-width is 1.96 times its root.",
    ),
    pseudo_inverse_hides_it=(
        _RETURN,
        "half",
        "A pseudo-inverse gives each parameter an error bar, also one that the log does not show: "
        "it takes the hidden part for known. Such a parameter has none.",
    ),
    absolute_threshold=(
        "values > 1e-8 * values[0]",
        "values > 1e-8",
        "The threshold is a fixed number. Singular values have the unit of the samples: in another "
        "unit all would be hidden, or rounding errors seen. Compare with the largest one.",
    ),
    noise_counted_twice=(
        "sigma**2 * np",
        "sigma**4 * np",
        "The noise is counted twice: the covariance is sigma^2 (J^T J)^-1, with a Jacobian that "
        "is not yet divided by it.",
    ),
    noise_forgotten=(
        "sigma**2 * np",
        "1.0 * np",
        "The noise is missing: with samples twice as noisy an interval is twice as wide.",
    ),
    one_deviation=("1.96 * size", "1.0 * size", "This is one standard deviation, 68 % and not 95."),
    scale_forgotten=(
        _RELATIVE,
        "relative, size = np.asarray(jacobian, dtype=float), 1.0",
        "Changes are measured in each parameter's own unit. Small parameters then look hidden, and "
        "the hidden direction is another one: multiply the columns by the scale.",
    ),
    scale_not_taken_back=(
        _HALF,
        "half = 1.96 * np.sqrt(variance)",
        "The half-widths are relative. They are asked for in each parameter's unit.",
    ),
    each_by_itself=(
        "np.sum((observable / values[:rank, None]) ** 2, axis=0)",
        "1.0 / np.maximum(np.sum(relative**2, axis=0), 1e-300)",
        "Each parameter is looked at as if the others were known. Take the diagonal of the "
        "inverse, not the inverse of the diagonal.",
    ),
    seen_for_hidden=(
        "projector = hidden.T @ hidden",
        "projector = observable.T @ observable",
        "This is the projector onto what is seen.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, allowed, "rounding, with singular values down to 1e-2", explain=coarse),
    examples=(
        "identifiable([[1.0, 0.0], [0.0, 2.0], [1.0, 1.0]], [1.0, 1.0], 0.1)",
        "identifiable([[1.0, 1.0], [2.0, 2.0]], [1.0, 3.0], 0.1)",
    ),
    slips=SLIPS
    + coarse_slips("identifiable", "A small half-width has no digits left.")
    + value_slips("identifiable"),
)
