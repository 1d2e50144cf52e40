"""Noise of a camera that is not white and Gaussian, and what it does to the contracts.

Real detectors err in other ways than independent normal numbers: now and then by far (heavy tails),
alike in neighbouring frames (correlation in time), and not at all while something hides the target
(occlusion). Tails and correlation here leave the variance of a frame as it was.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from course.check import POSITIVE, finite, invalid, vector
from course.pipeline.blame import SURE
from course.pipeline.run import Record, run
from course.pipeline.scenario import Scenario, Settings
from course.pipeline.stages import OURS, Frames, Sight, Stages, perceive

Array = NDArray[np.float64]
NO_MEASUREMENT = np.diag([np.inf, np.inf])  # covariance of a frame without a detection


@dataclass(frozen=True)
class Noise:
    """The law of a camera's noise, at the standard deviation that the settings state.

    Attributes:
        tails: degrees of freedom of Student's t, above 2; infinity for the normal distribution.
        memory: correlation of a frame's noise with that of the frame before, from 0 to below 1.
        camera: position of a camera in the plane (2,) [m], whose line of sight to the target the
            arm can block; None where nothing blocks it.
    """

    tails: float = math.inf
    memory: float = 0.0
    camera: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not self.tails > 2.0:
            raise invalid("tails", self.tails, "above 2: else the noise has no variance")
        if not 0.0 <= self.memory < 1.0:
            raise invalid("memory", self.memory, "at least 0 and below 1")
        if self.camera is not None:
            vector("camera", self.camera, (2,), unit="m")

    def shape(self, draws: Array, rng: np.random.Generator) -> Array:
        """Return noise of variance 1 with these tails and this memory.

        Student's t is a normal number over the root of chi2 / tails. An AR(1) process takes over
        the share `memory` of the last value and adds sqrt(1 - memory^2) of a fresh one.

        Args:
            draws: independent standard normal numbers, (N, ...), in the order of the frames.
            rng: for what the tails need beyond them.

        Returns:
            Shape of `draws`.
        """
        fresh = np.array(draws, dtype=float)
        if math.isfinite(self.tails):
            # t has the variance tails / (tails - 2); the factor brings it back to 1.
            scale = np.sqrt(self.tails / rng.chisquare(self.tails, fresh.shape))
            fresh *= math.sqrt((self.tails - 2.0) / self.tails) * scale
        result, share = fresh.copy(), math.sqrt(1.0 - self.memory**2)
        # The first frame starts in the stationary state, so all frames have the same variance.
        for k in range(1, len(result)):
            result[k] = self.memory * result[k - 1] + share * fresh[k]
        return result

    def disturb(self, frames: Frames, seed: int) -> Frames:
        """Return a timetable whose frames carry this noise; the seed is that of the run."""
        rng = np.random.default_rng([seed, 3])  # streams 0 to 2 belong to frames and plans
        return replace(frames, draws=self.shape(frames.draws, rng))

    def stages(self) -> Stages:
        """Return the course's stages, with a camera that can be blocked."""
        if self.camera is None:
            return OURS
        camera = np.asarray(self.camera, dtype=float)

        def observe(sight: Sight, scenario: Scenario, settings: Settings):
            place, covariance, frame, stamp = perceive(sight, scenario, settings)
            # An ideal camera is not blocked: the target is known to it without a view.
            if "perceive" not in settings.ideal and blocked(camera, sight, scenario):
                covariance = NO_MEASUREMENT
            return place, covariance, frame, stamp

        return replace(OURS, perceive=observe)


def run_with(scenario: Scenario, settings: Settings, noise: Noise, seed: int) -> Record:
    """Run the pipeline once with another law of the camera's noise."""
    return run(scenario, settings, noise.stages(), seed, lambda f: noise.disturb(f, seed))


def run_many_with(
    scenario: Scenario, settings: Settings, noise: Noise, seeds: Iterable[int]
) -> list[Record]:
    """Run the pipeline once for each seed with another law of the camera's noise."""
    return [run_with(scenario, settings, noise, seed) for seed in seeds]


def blocked(camera: Array, sight: Sight, scenario: Scenario) -> bool:
    """Return whether a link lies on the line of sight from a camera to the target.

    Links are capsules: the line is blocked where it comes nearer to a link's axis than the
    link's radius.

    Args:
        camera: position of the camera (2,) [m].
        sight: of a frame; its target and joint angles.
        scenario: the arm and the radius of its links.
    """
    joints = np.zeros((3, 2))
    for k, (length, angle) in enumerate(zip(scenario.arm.lengths, np.cumsum(sight.q), strict=True)):
        joints[k + 1] = joints[k] + length * np.array([math.cos(angle), math.sin(angle)])
    return any(
        segment_distance(camera, sight.target, joints[k], joints[k + 1]) < scenario.radius
        for k in range(2)
    )


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> float:
    """Return the distance of the segments ab and cd in the plane; points are of shape (2,) [m]."""

    def side(p: Array, q: Array, r: Array) -> float:
        return float((q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]))

    # Each segment separates the ends of the other: they cross.
    if side(a, b, c) * side(a, b, d) < 0.0 and side(c, d, a) * side(c, d, b) < 0.0:
        return 0.0

    def from_point(p: Array, q: Array, r: Array) -> float:
        along = r - q
        share = float(np.clip((p - q) @ along / max(float(along @ along), 1e-300), 0.0, 1.0))
        return math.dist(p, q + share * along)

    # Otherwise the nearest pair contains an end of one of them.
    return min(from_point(a, c, d), from_point(b, c, d), from_point(c, a, b), from_point(d, a, b))


def alarms_of_frames(n: int, tails: float = math.inf) -> float:
    """Return the rate of false alarms of the limit on single frames, for independent frames.

    One of 2 n numbers exceeds SURE + 1 standard deviations: 1 - (1 - p)^(2 n).

    Args:
        n: frames in a run.
        tails: as in `Noise`.
    """
    from scipy.stats import norm, t

    limit = SURE + 1.0
    if math.isfinite(tails):
        # The limit in units of Student's t, whose own deviation is sqrt(tails / (tails - 2)).
        p = 2.0 * t.sf(limit * math.sqrt(tails / (tails - 2.0)), tails)
    else:
        p = 2.0 * norm.sf(limit)
    return float(-np.expm1(2 * n * np.log1p(-p)))


def variance_of_mean(n: int, memory: float) -> float:
    """Return n times the variance of the mean of n AR(1) numbers of variance 1.

    1 for independent numbers; (1 + memory) / (1 - memory) for many.
    """
    finite("n", float(n), POSITIVE)
    rest = 2.0 * memory * (1.0 - memory**n) / (n * (1.0 - memory) ** 2)
    return (1.0 + memory) / (1.0 - memory) - rest


def alarms_of_mean(n: int, memory: float = 0.0) -> float:
    """Return the rate of false alarms of the limit on the mean error, for Gaussian noise.

    The mean on one of two axes exceeds SURE times the standard error of independent frames.

    Args:
        n: frames in a run.
        memory: as in `Noise`.
    """
    from scipy.stats import norm

    p = 2.0 * norm.sf(SURE / math.sqrt(variance_of_mean(n, memory)))
    return float(-np.expm1(2.0 * np.log1p(-p)))
