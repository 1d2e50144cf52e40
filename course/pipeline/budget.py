"""Which stage owns which millimetre: all subsets of repairs, beside what theory says of each.

Parts of an error are vectors and may cancel, so a part's share of the squared error depends on what
else is mended. The signed means add up; the shares are those of Shapley (1953), which add up too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from course.check import invalid, one_of
from course.kinematics import two_link_ik
from course.pipeline import theory
from course.pipeline.run import errors, run_many, successes
from course.pipeline.scenario import STAGES, Scenario, Settings, repair
from course.pipeline.stages import Stages
from course.role import Stage, age
from course.sim_to_real.transfer import Subset, attribution, subsets

Array = NDArray[np.float64]
Band = tuple[float, float, float]


def predicted(scenario: Scenario, settings: Settings) -> tuple[Array, Array]:
    """Predict the mean (2,) [m] and covariance (2, 2) [m^2] of the tip's final error.

    Bias as it is; what a filter that is not settled makes of noise and speed; age times speed; the
    lag and the sag of the arm. A plan that is there in time, and a step that is stable, cost
    nothing once the arm stands.

    Args:
        scenario: the task.
        settings: with the law "pd" and a pipelined camera; an ideal stage costs nothing.

    Raises:
        ValueError: for another law or rule of overrun, and for a physics step at which the arm is
            unstable where it comes to rest: no formula says what it does then.
    """
    one_of("law", settings.law, ("pd",))
    one_of("overrun", settings.overrun, ("pipelined",))
    u, ideal, T = np.array(scenario.velocity), settings.ideal, settings.frame
    # The posture that the plan ends in: the branch nearer to the start.
    q = np.asarray(two_link_ik(scenario.arm.lengths, scenario.at(scenario.seconds)).q)
    error = np.abs((q - np.array(scenario.start)[:, None] + math.pi) % (2.0 * math.pi) - math.pi)
    q = q[:, int(np.argmin(np.hypot(*error)))]
    if not ideal & {"move", "control"}:
        limit = theory.step_limit(scenario.plant, q, settings.kp, settings.kd)
        if settings.physics >= limit:
            allowed = f"less than {limit:.3g} s, the stability limit in the posture of the reach"
            raise invalid("physics", settings.physics, allowed)
    late = 0.0 if "age" in ideal else settings.latency
    # The arm is a low-pass filter with this time constant.
    slow = (settings.kd + float(np.mean(scenario.arm.damping))) / settings.kp
    selected = 0.0 if "control" in ideal else math.exp(-T / slow)
    mean, variance, pictures = np.zeros(2), 0.0, 1 + int((scenario.seconds - late) / T)
    if "perceive" not in ideal:
        mean, pull, sigma = mean + settings.bias, 0.0, settings.noise
        if settings.filtered and sigma > 0.0:
            drift, speed = settings.drift
            pull, gain = theory.settling(pictures, T, speed / sigma, drift / sigma, selected)
        else:
            gain = theory.low_pass(T, slow) if selected else 1.0
        mean, variance = mean + pull * u, gain * sigma**2
    if "age" not in ideal and not (settings.carried and settings.filtered):
        # A slow arm averages the estimates; an ideal one stands at the newest one.
        camera = Stage("camera", late or 1e-9, T, overload="pipelined")
        # What arrives in the last step is too late for it.
        newest = scenario.seconds - T * int((scenario.seconds - settings.physics - late) / T)
        mean = mean - u * (age([camera]).mean if selected else newest)
    if "control" not in ideal:
        mean = mean + theory.lag(scenario.arm, q, settings.kp, settings.kd, u)
        mean = mean + (theory.sag(scenario.plant, q, settings.kp) if scenario.tilt else 0.0)
    return mean, variance * np.eye(2)


@dataclass(frozen=True, eq=False)
class Budget:
    """Errors of the tip with each subset of the parts mended, on the same seeds.

    Attributes:
        parts: of `STAGES`.
        errors: mended -> shape (2, N) [m].
        moments: mended -> mean (2,) and covariance (2, 2) as predicted.
    """

    parts: tuple[str, ...]
    errors: dict[Subset, Array]
    moments: dict[Subset, tuple[Array, Array]]

    def only(self, *parts: str) -> Subset:
        """Return what is mended where only these parts are as they were."""
        return frozenset(self.parts) - frozenset(parts)

    def mean(self, mended: Subset) -> tuple[Array, Array]:
        """Return the mean error and its standard error, each (2,) [m]."""
        result = self.errors[mended]
        return result.mean(axis=1), result.std(axis=1, ddof=1) / math.sqrt(result.shape[1])

    def rms(self, mended: Subset) -> tuple[float, float]:
        """Return the root of the mean squared error, measured and predicted [m]."""
        mean, covariance = self.moments[mended]
        square = float(np.mean(np.sum(self.errors[mended] ** 2, axis=0)))
        return math.sqrt(square), math.sqrt(float(mean @ mean + np.trace(covariance)))

    def gap(self) -> tuple[Array, Array]:
        """Return the sum of the sources' mean errors minus the mean of the whole, (2,) [m].

        The second result is its standard error run by run, (2,) [m].
        """
        # If the error were linear in its sources, the sum of each alone would be the whole.
        rest = (len(self.parts) - 1) * self.errors[self.only()]
        parts = sum((self.errors[self.only(part)] for part in self.parts), -rest)
        error = parts - self.errors[frozenset()]
        return error.mean(axis=1), error.std(axis=1, ddof=1) / math.sqrt(error.shape[1])

    def squares(self, runs: NDArray[np.int64] | None = None) -> dict[Subset, float]:
        """Return the mean squared error with each subset mended, of all runs or of some [m^2]."""
        each = {some: np.sum(result**2, axis=0) for some, result in self.errors.items()}
        return {some: float(np.mean(x if runs is None else x[runs])) for some, x in each.items()}

    def shares(self, repeats: int = 200, seed: int = 0) -> dict[str, Band]:
        """Return each source's share of the mean squared error, and its 95 % interval [m^2].

        Args:
            repeats: of the bootstrap over runs.
            seed: of the same.
        """
        rng, n = np.random.default_rng(seed), self.errors[frozenset()].shape[1]
        owned = attribution(self.squares())
        # Bootstrap over runs: the same resampled seeds for all subsets.
        drawn = [attribution(self.squares(some)) for some in rng.integers(0, n, (repeats, n))]
        result = {}
        for part in self.parts:
            # Attribution is by mending, which lowers the error: a source owns minus that change.
            low, high = np.quantile([-one[part][1] for one in drawn], [0.025, 0.975])
            result[part] = (-owned[part][1], float(low), float(high))
        return result

    def orders(self, slack: float = 0.01) -> list[tuple[str, ...]]:
        """Return orders of repairs in which no step makes the mean squared error worse.

        Args:
            slack: share by which a step may raise it and still count as none.
        """
        value, result = self.squares(), []
        for order in permutations(self.parts):
            path = [value[frozenset(order[:k])] for k in range(len(order) + 1)]
            if all(b <= (1.0 + slack) * a for a, b in pairwise(path)):
                result.append(order)
        return result


def budget(
    scenario: Scenario,
    settings: Settings,
    seeds: Sequence[int],
    parts: Sequence[str] = STAGES,
    stages: Stages | None = None,
) -> Budget:
    """Run every subset of repairs on the same seeds, 2^n runs a seed.

    Args:
        scenario: the task.
        settings: with all its errors.
        seeds: at least two.
        parts: that are repaired; the others stay as they are.
        stages: whose functions do it.
    """
    measured, report = {}, {}
    for some in subsets(parts):
        mended = repair(settings, *sorted(some))
        report[some] = predicted(scenario, mended)  # it rejects a case before any run
        result = errors(run_many(scenario, mended, seeds, stages or Stages()))
        if result.shape[1] < 2 or not np.isfinite(result).all():
            raise invalid("errors", result, "two or more runs that come to their end")
        measured[some] = result
    return Budget(tuple(parts), measured, report)


NORMAL = 1.959963984540054  # quantile of a two-sided 95 %


class Compared(NamedTuple):
    """The second setting against the first on the same seeds.

    Attributes:
        succeeded: whether each run was a success, shape (2, N), as `course.measure.success.paired`
            takes them.
        square: difference of the mean squared errors, and its 95 % [m^2].
        saved: how many times as many runs it takes on seeds of their own, for the squares.
    """

    succeeded: NDArray[np.bool_]
    square: Band
    saved: float


def compare(
    scenario: Scenario,
    first: Settings,
    second: Settings,
    seeds: Sequence[int],
    stages: Stages | None = None,
) -> Compared:
    """Return two settings on the same seeds; arguments are those of `budget`."""
    records = [run_many(scenario, some, seeds, stages or Stages()) for some in (first, second)]
    a, b = (np.sum(errors(one) ** 2, axis=0) for one in records)
    # Paired differences: what both settings have in common cancels.
    middle, half = float(np.mean(b - a)), NORMAL * float(np.std(b - a)) / math.sqrt(a.size)
    # Ratio of variances: how many times fewer runs the paired comparison needs.
    own = float(np.var(a) + np.var(b)) / max(float(np.var(b - a)), 1e-300)
    return Compared(
        np.stack([successes(one) for one in records]), (middle, middle - half, middle + half), own
    )
