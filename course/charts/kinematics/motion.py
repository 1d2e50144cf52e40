"""How a tip moves: Jacobians by differences, a step in the null space, damping near the edge."""

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from course.charts import chart
from course.kinematics import (
    Chain,
    jacobian,
    jacobian_rate,
    panda,
    planar,
    pose_error,
    tip,
    two_link_ik,
)
from course.kinematics.chain import PLACE, QUAT
from course.measure.figure import Panel, Series
from course.measure.stability import stability_map
from course.measure.timing import calls, interleaved
from course.measure.work_precision import machine
from course.rigid_body import quaternion

Array = NDArray[np.float64]
POSTURE = np.array([0.4, -0.6, 0.3, -1.9, 0.5, 1.7, -0.8])  # of the 7-R arm [rad], nothing special


# --- a Jacobian by differences --------------------------------------------------------------------


def placed(chain: Chain, q: Any, library: Any = np) -> Any:
    """Return the tip of a serial arm of revolute joints by matrices, (3,) [m], for any number type.

    The course's own is compiled for real numbers. Here q (n,) may be real, complex, or a tensor of
    PyTorch, with the `library` whose `cos`, `sin` and `stack` fit it.
    """
    point: Any = chain.table[-1, PLACE:QUAT]
    # From the tip back to the base, so that one point is transformed and no matrices are
    # multiplied.
    for i in reversed(range(chain.n)):
        c, s = library.cos(q[i]), library.sin(q[i])
        turned = (c * point[0] - s * point[1], s * point[0] + c * point[1], point[2])
        offset, R = chain.placement[:3, i], quaternion.to_matrix(chain.placement[3:, i])
        point = [offset[k] + sum(R[k, j] * turned[j] for j in range(3)) for k in range(3)]
    return library.stack(point)


def forward(f: Callable[[Any], Any], q: Array, h: float) -> Array:
    """Return columns (f(q + h e) - f(q)) / h; n + 1 calls."""
    here = f(q)
    return np.stack([(f(q + h * e) - here) / h for e in np.eye(q.size)], axis=1)


def central(f: Callable[[Any], Any], q: Array, h: float) -> Array:
    """Return columns (f(q + h e) - f(q - h e)) / 2h; 2 n calls."""
    return np.stack([(f(q + h * e) - f(q - h * e)) / (2 * h) for e in np.eye(q.size)], axis=1)


def complex_step(f: Callable[[Any], Any], q: Array, h: float) -> Array:
    """Return columns Im f(q + i h e) / h, the complex-step derivative.

    There is no difference, so nothing cancels (Squire and Trapp, 1998).
    """
    return np.stack([f(q + 1j * h * e).imag / h for e in np.eye(q.size)], axis=1)


def autograd(chain: Chain, q: Array) -> Array:
    """Return the Jacobian by PyTorch in reverse mode, one row at a time."""
    import torch

    result = torch.autograd.functional.jacobian(lambda x: placed(chain, x, torch), torch.tensor(q))
    return np.asarray(result)


@chart
def jacobian_precision(
    steps: Sequence[float] = tuple(np.logspace(-16, 0, 33)), repeats: int = 9
) -> Iterator[Panel]:
    """Chart error and cost of a Jacobian: differences [rad], complex steps, autograd, analytic."""
    arm, q = panda(), POSTURE

    def f(x: Any) -> Any:
        return placed(arm, x)

    # h = 1e-100 leaves no truncation error, and a complex step has no cancellation.
    exact = functools.partial(complex_step, f, h=1e-100)  # only rounding is left
    truth = exact(q)

    def error(J: Array) -> float:
        return max(float(np.abs(J - truth).max()), 1e-17)

    # Second and third derivatives by joint: J at shifted postures, differenced.
    size, eps = float(np.abs(f(q)).max()), float(np.finfo(float).eps)
    shifted = [[exact(q + d * 1e-3 * e) for d in (-1, 0, 1)] for e in np.eye(7)]
    # Coefficients of the next Taylor terms, for the theoretical curves.
    second = max(np.abs((b - a)[:, i]).max() / 2e-3 for i, (a, _, b) in enumerate(shifted))
    third = max(np.abs((a - 2 * m + b)[:, i]).max() / 1e-6 for i, (a, m, b) in enumerate(shifted))
    methods: dict[str, tuple[Callable[..., Array], Any]] = {
        "forward": (forward, lambda h: h * second / 2 + eps * size / h),
        "central": (central, lambda h: h * h * third / 6 + eps * size / (2 * h)),
        "complex step": (complex_step, lambda h: h * h * third / 6 + eps),
    }
    precision_panel = Panel(
        "Differences lose digits on both sides of their best step",
        "step h [rad]",
        "largest error of the Jacobian [m/rad]",
        scale="log",
        theory="truncation + rounding",
    )
    best: dict[str, tuple[float, Callable[[], Any]]] = {}
    for name, (method, theory) in methods.items():
        errors = [error(method(f, q, h)) for h in steps]
        h = steps[int(np.argmin(errors))]
        best[name] = min(errors), functools.partial(method, f, q, h)
        precision_panel.series.append(
            Series(
                name,
                steps,
                errors,
                name,
                theory=theory,
                note=f"{name:<14} best step {h:.0e} rad, error {min(errors):.1e}",
            )
        )
    yield precision_panel

    approaches = {
        **best,
        "autograd": (error(autograd(arm, q)), lambda: autograd(arm, q)),
        "analytic": (error(jacobian(arm, q)[:3]), lambda: jacobian(arm, q)),
    }
    # Each method at its own best step; a first call, which may compile, is not counted.
    timed = interleaved(
        [calls(run) for _, run in approaches.values()], repeats=repeats, sample=0.01
    )
    right = Panel(
        "The analytic one costs least",
        "time of one Jacobian [s]",
        precision_panel.y,
        scale="log",
        footer=machine(max(t.busy for t in timed)),
    )
    for (name, (wrong, _)), time in zip(approaches.items(), timed, strict=True):
        ratio = time.median / timed[-1].median
        right.series.append(
            Series(
                name,
                [time.median],
                [wrong],
                name,
                "",
                low=[time.low],
                high=[time.high],
                across=True,
                size=8,
                note=f"{name:<14} error {wrong:.1e}, "
                f"{ratio:5.1f} times the time of the analytic one",
            )
        )
    yield right


# --- a step in the null space ---------------------------------------------------------------------


@chart
def null_space_step(
    steps: Sequence[float] = tuple(np.logspace(-3, 0, 13)), postures: int = 200
) -> Iterator[Panel]:
    """Chart how far a null-space step of length h [rad] moves the tip.

    It also shows the error that a following IK step leaves.

    At random postures of the 7-R arm, those with a singular value below 0.05 left out.
    """
    arm = panda()
    q = np.random.default_rng(4).uniform(arm.lower, arm.upper, (postures, 7)).T
    J = np.moveaxis(jacobian(arm, q), 2, 0)
    _, s, Vt = np.linalg.svd(J)
    # Near singular postures the null space is not one-dimensional any more.
    q, J, v = q[:, s[:, -1] > 0.05], J[s[:, -1] > 0.05], Vt[s[:, -1] > 0.05, -1].T
    home = tip(arm, q)
    # Along the null vector the tip accelerates by J' v although J v = 0: the h^2 term.
    bent = np.einsum("ijk,jk->ik", jacobian_rate(arm, q, v), v)[:3]
    c = float(np.median(np.linalg.norm(bent, axis=0))) / 2
    # A damped inverse in the projector, as one has it near a singularity.
    damped = np.linalg.solve(J @ J.transpose(0, 2, 1) + 0.1**2 * np.eye(6), J)
    wish = np.random.default_rng(5).normal(size=q.shape)
    leaky = wish - np.einsum("kji,jk->ik", np.einsum("kij,kil->kjl", damped, J), wish)
    leaky /= np.linalg.norm(leaky, axis=0)

    def away(x: Array) -> float:
        return float(np.median(np.linalg.norm((tip(arm, x) - home)[:3], axis=0)))

    def mended(x: Array) -> Array:
        back = np.linalg.pinv(np.moveaxis(jacobian(arm, x), 2, 0))
        return x + np.einsum("kij,jk->ik", back, pose_error(home, tip(arm, x)))

    panel = Panel(
        "A step in the null space moves the tip by c h^2",
        "length of the step h [rad]",
        "median motion of the tip [m]",
        scale="log",
        theory="c h^2",
    )
    methods: dict[str, Any] = {
        "exact projector": lambda h: q + h * v,
        "exact projector, then one IK step": lambda h: mended(q + h * v),
        "damped projector, lambda = 0.1": lambda h: q + h * leaky,
    }
    for key, (name, method) in zip(
        ("null space", "re-projected", "damped"), methods.items(), strict=True
    ):
        moved = np.array([away(method(h)) for h in steps])
        observed = (moved > 1e-13) & (np.array(steps) < 0.2)
        # Fitted between rounding below and higher terms above.
        order = np.polyfit(np.log(np.array(steps)[observed]), np.log(moved[observed]), 1)[0]
        panel.series.append(
            Series(
                f"{name}: order {order:.1f}",
                steps,
                moved,
                key,
                theory=(lambda h: c * h * h) if key == "null space" else None,
                note=f"{name:<34} order {order:.2f}",
            )
        )
    panel.notes = [f"c = {c:.4f} m in the median of {q.shape[1]} postures of the 7-R arm"]
    yield panel


# --- damping near a singularity -------------------------------------------------------------------

ARM = (1.0, 0.8)  # m
SPEED = 0.1  # m/s, of the tip along the arm
RATE = 2.0  # rad/s: what a joint can do


def gain(J: Array, damping: float) -> float:
    """Return largest joint rate that the damped inverse asks for, for a tip speed of 1 [rad/m]."""
    return float(np.linalg.norm(J.T @ np.linalg.inv(J @ J.T + damping**2 * np.eye(2)), 2))


def past_the_hole(damping: float, gap: float, step: float = 0.002) -> tuple[float, float]:
    """Return a tip led along a line past the hole around the base, one damped step a point.

    The line has a `gap` to the hole, where the arm is folded, its points are a `step` apart [m].
    Returns the largest distance from the points [m] and the largest joint step [rad].
    """
    arm = planar(ARM)
    line = np.array([[x, ARM[0] - ARM[1] + gap] for x in np.arange(-0.6, 0.6, step)])
    q, deviation, largest = two_link_ik(ARM, line[0]).q[:, 0], 0.0, 0.0
    for point in line:
        J = jacobian(arm, q)[:2]
        # One damped least-squares step per point of the line.
        dq = J.T @ np.linalg.solve(J @ J.T + damping**2 * np.eye(2), point - tip(arm, q)[:2])
        q = q + dq
        deviation = max(deviation, float(np.linalg.norm(tip(arm, q)[:2] - point)))
        largest = max(largest, float(np.linalg.norm(dq)))
    return deviation, largest


@chart
def damping_map(
    nx: int = 81, ny: int = 61, dampings: Sequence[float] = tuple(np.logspace(-3.5, 0, 15))
) -> Iterator[Panel]:
    """Chart where damping [m/rad] keeps the joints within their speed, and the error it costs.

    The map has nx times ny points; `dampings` are those of the tracking error.
    """
    bend, damping = np.logspace(-4, 0, nx), np.logspace(-3, 0, ny)
    arm, highest = planar(ARM), RATE / SPEED
    grid = stability_map(
        lambda x, y: gain(jacobian(arm, np.array([0.0, x]))[:2], y) / highest,
        bend,
        damping,
        quantity="joint rate over its limit",
    )
    # In theory the direction of s_min decides: s / (s^2 + lambda^2) = most.
    s = np.array([np.linalg.svd(jacobian(arm, np.array([0.0, x]))[:2])[1][-1] for x in bend])
    # Solve s / (s^2 + lambda^2) = limit for lambda.
    needed = np.sqrt(np.maximum(s / highest - s * s, 1e-12))
    peak = 1 / (2 * highest)
    map_panel = Panel(
        f"A tip at {SPEED:g} m/s, joints of {RATE:g} rad/s",
        "elbow from stretched [rad]",
        "damping lambda [m/rad]",
        scale="log",
        grid=grid,
        ylim=(damping[0], damping[-1]),
    )
    map_panel.series = [
        Series("theory: s / (s^2 + lambda^2) = w / v", bend, needed, "theory on a map", "--"),
        Series("1 / (2 lambda) = w / v", bend, 0 * bend + peak, "theory on a map", ":"),
    ]
    safe = damping[(grid.values <= 1).all(axis=1)].min()
    map_panel.notes = [
        f"never too fast from lambda = {safe:.4f} m/rad on; v / (2 w) is {peak:.4f} m/rad",
        f"without damping too fast within {np.interp(1 / highest, s, bend):.3f} rad of stretched",
    ]
    yield map_panel

    right = Panel(
        "What damping costs a tip led past the folded arm",
        "damping lambda [m/rad]",
        "largest tracking error [m]",
        scale="log",
    )
    for gap, key in ((1e-2, ""), (1e-3, ""), (1e-4, "")):
        deviation, largest = np.array([past_the_hole(x, gap) for x in dampings]).T
        right.series.append(
            Series(
                f"{1e3 * gap:g} mm from the hole",
                dampings,
                deviation,
                key,
                note=f"{1e3 * gap:g} mm from the hole: error {deviation[0]:.1e} to "
                f"{deviation[-1]:.1e} m, "
                f"largest joint step {largest[0]:.3g} to {largest[-1]:.3g} rad",
            )
        )
    yield right
