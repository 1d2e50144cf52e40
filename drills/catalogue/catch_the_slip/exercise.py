"""Programs that tumble a body, right and wrong in ways that are drawn; none is shown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drills.case_judge import Case, judge_of
from drills.exercise import Exercise, slips, value_slips

Array = NDArray[np.float64]
STEP = 4e-3
RIGHT = ("right", "coarse", "principal")
BENT = ("mirror", "scaled", "sheared once", "none", "turned inside out")
LATE = ("body's axes", "sign", "one sample", "first", "last", "transposed", "no rate", "slow")
PUSHED = (
    "no gyroscopic torque",
    "gyroscopic torque turned",
    "damped",
    "kicked",
    "kicked with its energy",
    "swells",
)
SWELL = 0.05  # of the momentum, in the middle of a record


def tumble(kind: str, R: Array, w: Array, moments: Array, n: int) -> tuple[Array, Array]:
    """Return attitudes (n, 3, 3) and body rates (n, 3) of a body under the law of a kind.

    A body that swells has the momentum L(0) (1 + SWELL sin^2(pi t / T)), T the record's duration:
    it is right at both ends and wrong in between.
    """
    sign = {"no gyroscopic torque": 0.0, "gyroscopic torque turned": -1.0}.get(kind, 1.0)
    duration = STEP * (n - 1)

    def growth(t: float) -> float:
        """Return the relative rate of change of the momentum [1/s]."""
        if kind == "swells":
            phase = np.pi * t / duration
            swing = SWELL * np.pi / duration * np.sin(2.0 * phase)
            return float(swing / (1.0 + SWELL * np.sin(phase) ** 2))
        return -1.0 if kind == "damped" else 0.0

    def change(t: float, R: Array, w: Array) -> tuple[Array, Array]:
        x, y, z = w
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        return R @ cross, -sign * (cross @ (moments * w)) / moments + growth(t) * w

    attitudes, rates = [R], [w]
    for k in range(1, n):
        t = STEP * (k - 1)
        a = change(t, R, w)
        b = change(t + STEP / 2, R + STEP / 2 * a[0], w + STEP / 2 * a[1])
        c = change(t + STEP / 2, R + STEP / 2 * b[0], w + STEP / 2 * b[1])
        d = change(t + STEP, R + STEP * c[0], w + STEP * c[1])
        R, w = (
            old + STEP / 6 * (a[i] + 2 * b[i] + 2 * c[i] + d[i]) for i, old in enumerate((R, w))
        )
        if kind == "kicked" and k == n // 2:
            w = w * 1.025
        if kind == "kicked with its energy" and k == n // 2:
            energy = moments @ w**2
            w = w * np.where(moments == moments.max(), 1.045, 1.0)
            w = w * np.sqrt(energy / (moments @ w**2))
        attitudes.append(R)
        rates.append(w)
    return np.array(attitudes), np.array(rates)


def program(kind: str, rng: np.random.Generator, n: int) -> tuple[Array, Array, Array]:
    """Return the attitudes, world rates and moments that a program of that kind returns."""
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    Q[:, 0] *= np.linalg.det(Q)
    moments = rng.permutation([2.0, 3.0, 4.0]) * 10.0 ** rng.uniform(-5.0, 2.0)
    w = rng.choice([-1.0, 1.0], 3) * rng.uniform(2.0, 4.0, 3)
    if kind == "principal":
        w[:2] = 0.0
    R, body = tumble(kind, Q, w, moments, n)
    rates, at = np.einsum("nij,nj->ni", R, body), int(rng.integers(2, n - 2))
    if kind == "coarse":
        R, rates = (one.astype(np.float32).astype(float) for one in (R, rates))
    elif kind == "mirror":
        R = R * [1.0, 1.0, -1.0]
    elif kind == "scaled":
        R = R * 1.002
    elif kind == "sheared once":
        R[at, :, 0] += 0.003 * R[at, :, 1]
    elif kind == "none":
        R[at, 1, 2] = np.nan
    elif kind == "turned inside out":
        R = -R
    elif kind == "body's axes":
        rates = body
    elif kind == "sign":
        rates = -rates
    elif kind == "transposed":
        R = np.swapaxes(R, 1, 2).copy()
    elif kind == "no rate":
        rates[at, 0] = np.nan
    elif kind == "slow":
        rates = 0.7 * rates
    elif kind in ("one sample", "first", "last"):
        rates[{"one sample": at, "first": 0, "last": n - 1}[kind], rng.integers(3)] += 0.7
    return R, rates, moments


def cases(rng: np.random.Generator) -> list[Case]:
    """Return batches of programs: each family of slips alone, then all.

    Every batch holds correct programs, too.
    """

    def batch(label: str, level: str, kinds: tuple[str, ...], n: int = 40) -> Case:
        drawn = [program(str(kind), rng, n) for kind in rng.permutation(np.array(kinds))]
        turns, rates, moments = (np.array(one) for one in zip(*drawn, strict=True))
        return Case((turns, rates, moments, STEP), label, level)

    return [
        batch("right ones", "simple", RIGHT),
        batch("matrices", "simple", (*BENT, "right")),
        batch("rates", "simple", (*LATE, "right")),
        batch("motion", "simple", (*PUSHED, "right")),
        batch("matrices and right ones", "core", (*BENT, *RIGHT)),
        batch("rates and right ones", "core", (*LATE, *RIGHT)),
        batch("motion and right ones", "core", (*PUSHED, *RIGHT)),
        *(
            batch(
                "all kinds",
                "core",
                (
                    *RIGHT,
                    *(
                        str(rng.choice(family))
                        for family in (BENT, BENT, LATE, LATE, PUSHED, PUSHED)
                    ),
                ),
            )
            for _ in range(2)
        ),
        batch("a short record", "edge", ("right", "mirror", "slow"), 10),
        batch("one right program", "edge", ("right",)),
        batch("no number", "edge", ("no rate",)),
    ]


_BENT = "bent = np.abs(back @ R - np.eye(3)).max(axis=(1, 2, 3))"
_DET = "mirrored = np.abs(np.linalg.det(R) - 1.0).max(axis=1)"
_SPIN = "spin = np.gradient(R, step, axis=1, edge_order=2) @ back"
_LATE = "late = np.abs(rate - w).max(axis=(1, 2))"
_DRIFT = "drift = np.linalg.norm(momentum - momentum[:, :1], axis=2).max(axis=1)"
_PART = "drift = drift / np.linalg.norm(momentum[:, 0], axis=1)"
_ENERGY = """energy = np.sum(momentum * w, axis=2)
    drift = np.abs(energy - energy[:, :1]).max(axis=1) / energy[:, 0]"""
_KEPT = "[~one for one in passed], [1, 2, 3], 0"

SLIPS = slips(
    mirrors_pass=(
        _DET,
        "mirrored = 0.0 * bent",
        "A mirror passes: its columns are orthonormal, too. The determinant must be +1.",
    ),
    determinant_alone=(
        _BENT,
        "bent = np.zeros(len(R))",
        "The determinant alone is looked at. A sheared matrix has the determinant 1, too: its "
        "columns must be orthonormal.",
    ),
    exact=(
        "mirrored) < 1e-4",
        "mirrored) == 0.0",
        "Rotations are asked to be exact: single precision, and rounding itself, is a false alarm.",
    ),
    none_passes=(
        _KEPT,
        "[np.maximum(bent, mirrored) >= 1e-4, late >= 0.25, drift >= 1e-3], [1, 2, 3], 0",
        "What is no number passes: every comparison with NaN is false. Ask whether the error is "
        "small, not whether it is large.",
    ),
    on_average=(
        _LATE,
        "late = np.abs(rate - w).mean(axis=(1, 2))",
        "The rates are compared on average: one wrong sample in a record disappears. Take the "
        "worst.",
    ),
    ends_left_out=(
        _LATE,
        "late = np.abs(rate - w)[:, 1:-1].max(axis=(1, 2))",
        "The first and the last sample are left out, where central differences don't reach. "
        "Differences to one side do, of second order.",
    ),
    body_axes=(
        _SPIN,
        _SPIN.replace("np.gradient", "back @ np.gradient").replace(" @ back", ""),
        "R^T dR/dt is the rate in the body's axes. In the world's it is dR/dt R^T.",
    ),
    sign_of_the_rates=(
        "np.abs(rate - w)",
        "np.abs(rate + w)",
        "The rates are compared with the other sign: look at which element of the matrix is which "
        "component.",
    ),
    speed_alone=(
        _LATE,
        "late = np.abs(np.linalg.norm(rate, axis=2) - np.linalg.norm(w, axis=2)).max(axis=1)",
        "Only the size of the rates is compared: in other axes, or with the other sign, it is the "
        "same.",
    ),
    one_sided=(
        "np.gradient(R, step, axis=1, edge_order=2)",
        "np.diff(R, axis=1, append=2 * R[:, -1:] - R[:, -2:-1]) / step",
        "late < 0.25",
        "late < 1e-3",
        "Right rates are reported as wrong. Try your difference quotient on a body that turns at a "
        "constant rate: is it divided by the time between its two samples? If so, see whether it "
        "looks to one side: that is off by half a step of angular acceleration, more than your "
        "limit. Take central ones.",
    ),
    energy_for_momentum=(
        f"{_DRIFT}\n    {_PART}",
        _ENERGY,
        "A single number is compared, such as the energy or the length of the angular momentum. "
        "A wrong law or a kick can conserve it. Compare the vector of the angular momentum.",
    ),
    length_of_the_momentum=(
        _DRIFT,
        "size = np.linalg.norm(momentum, axis=2)\n    "
        "drift = np.abs(size - size[:, :1]).max(axis=1)",
        "Only the length of the momentum is compared: a momentum that turns with the body keeps "
        "it. It is a vector that stays in the world.",
    ),
    momentum_in_the_body=(
        _DRIFT,
        _DRIFT.replace(
            "momentum - momentum[:, :1]",
            '(m := np.einsum("knji,knj->kni", R, momentum)) - m[:, :1]',
        ),
        "The momentum that you compute changes although the motion is free. Turn the rates into "
        "the body, multiply by the moments, turn the result back, and compare in the world's axes.",
    ),
    last_sample_alone=(
        _DRIFT,
        "drift = np.linalg.norm(momentum[:, -1] - momentum[:, 0], axis=1)",
        "Only the last sample's momentum is compared with the first one's. A momentum that grows "
        "and comes back passes: compare every sample with the first.",
    ),
    absolute=(
        _PART,
        "pass",
        "The momentum's limit is in kg m^2/s: a light body may do anything, and a heavy one fails "
        "by rounding. Compare with the momentum itself.",
    ),
    inertia_not_turned=(
        'inertia * np.einsum("knji,knj->kni", R, w)',
        "inertia * w",
        "The momentum that you compute changes although the motion is free. The moments are along "
        "the body's axes and the rates along the world's: turn the rates into the body, multiply "
        "by the moments, and turn the result back.",
    ),
    not_asked=(
        ", drift < 1e-3]",
        ", drift > -1.0]",
        "Whether the motion is free is not asked at all.",
    ),
)

EXERCISE = Exercise(
    judge=judge_of(cases, 1e-12, "whole numbers"),
    examples=(
        "catch_the_slip([[np.eye(3)] * 10, [np.diag([1, 1, -1])] * 10, [np.eye(3)] * 10], "
        "[np.zeros((10, 3)) + [0, 0, 1e-8], np.ones((10, 3)), np.ones((10, 3))], "
        "[[2, 3, 4]] * 3, 0.004)",
    ),
    slips=SLIPS + value_slips("catch_the_slip", in_part=False, whole=False),
)
