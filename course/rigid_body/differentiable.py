"""Differentiable simulation: what a recorded slide-and-bounce tells about its parameters.

A block moves in a vertical plane without turning. It flies, bounces on flat ground with
restitution e and Coulomb friction mu, slides, sticks, and is pushed by a known horizontal force.
That is the smallest model in which restitution, friction and mass can all be read off a motion:
mass enters only through push / mass, so without a push nothing can tell it.

Between two events the motion is a parabola, so the model goes from event to event: impacts, the
end of a slide, a change of the push. Each event time is a formula in the parameters, and a
gradient flows through it. A simulation that notices the ground at the end of a fixed step and puts
the block back on it has no such formula; its gradient is wrong at every step size (`naive_drop`
shows it; Hu et al., "DiffTaichi: Differentiable Programming for Physical Simulation", 2020, sec. on
time of impact).

The equations stand here once. They use arithmetic only, so the same lines run on Python floats
(plain numbers, no torch needed) and on torch tensors (gradients).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from course.check import count, finite, invalid, positive, vector
from course.libraries import pytorch
from course.rigid_body.integrators import STANDARD_GRAVITY

NAMES = ("restitution", "friction", "mass")

# A direction in parameter space counts as unknown when a change of its whole scale moves the
# record by less than one standard deviation of the noise, and a parameter as unknown when it has
# more than this share in such a direction.
_SHARE_IN_UNKNOWN = 1e-3


def _is_tensor(value: Any) -> bool:
    return type(value).__module__.split(".")[0] == "torch"


def _number(value: Any) -> float:
    """Return the plain number of a float or a tensor.

    Decisions use it, as no gradient flows through them.
    """
    return float(value.detach()) if _is_tensor(value) else float(value)


@dataclass(frozen=True)
class Setup:
    """What is known about the motion beforehand.

    Position and velocity may be torch scalars; then gradients flow to them as well.

    Attributes:
        position: (x, y) at time 0, y the height of the block's underside [m], y >= 0.
        velocity: (vx, vy) at time 0 [m/s].
        push: horizontal forces as (start [s], end [s], force [N]), in order, not overlapping;
            a force may be a torch scalar where the parameters are a tensor.
        gravity: [m/s^2], positive, acts along -y.
        rest_speed: an impact slower than this does not bounce [m/s], positive. Bounces of e < 1
            follow each other ever faster, without end, in finite time; this ends them, at the cost
            of a height below rest_speed^2 / (2 gravity).

    Raises:
        ValueError: if a number is not finite, the block starts below the ground, gravity or
            rest_speed is not positive, or pushes overlap.
    """

    position: tuple[Any, Any]
    velocity: tuple[Any, Any] = (0.0, 0.0)
    push: tuple[tuple[float, float, float], ...] = ()
    gravity: float = STANDARD_GRAVITY
    rest_speed: float = 1e-3

    def __post_init__(self) -> None:
        for name in ("position", "velocity"):
            pair = getattr(self, name)
            if len(pair) != 2 or not all(math.isfinite(_number(value)) for value in pair):
                raise invalid(name, pair, "two finite numbers")
        if _number(self.position[1]) < 0:
            raise invalid("position", self.position, "a height of 0 m or more")
        positive("gravity", self.gravity, unit="m/s^2")
        positive("rest_speed", self.rest_speed, unit="m/s")
        last = 0.0
        for piece in self.push:
            finite = all(math.isfinite(_number(value)) for value in piece)
            if len(piece) != 3 or not finite or not last <= piece[0]:
                raise invalid(
                    "push",
                    self.push,
                    "(start, end, force), finite, in order, from time 0 on, not overlapping",
                )
            if piece[1] <= piece[0]:
                raise invalid("push", self.push, "an end after its start")
            last = piece[1]


class Segment(NamedTuple):
    """Motion between two events: x and y are parabolas in the time since `start`."""

    start: Any
    x: Any
    y: Any
    vx: Any
    vy: Any
    ax: Any
    ay: Any
    mode: str
    friction_needed: float


def _check(parameters: Any) -> None:
    if len(parameters) != 3:
        raise invalid("parameters", parameters, "3 numbers: restitution, friction, mass")
    restitution, friction, mass = (_number(value) for value in parameters)
    finite("restitution", restitution, 0.0, 1.0)
    finite("friction", friction, 0.0)
    positive("mass", mass, unit="kg")


def _check_times(times: Any) -> np.ndarray:
    return vector("times", times, (None,), low=0.0, unit="s")


def _push_after(scene: Setup, time: float) -> tuple[float, float]:
    """Return the push from `time` on [N], and until when it stays [s]."""
    for start, end, force in scene.push:
        if time < start:
            return 0.0, start
        if time < end:
            return force, end
    return 0.0, math.inf


def _fall_time(y: Any, vy: Any, gravity: float) -> Any:
    """Return the time of flight to the ground [s]: the later root, without cancellation."""
    # The root of y + vy t - g t^2 / 2; for a body that falls, the form whose terms have one sign.
    root = (vy * vy + 2 * gravity * y) ** 0.5
    if vy > 0:
        return (vy + root) / gravity
    return 2 * y / (root - vy)


def _impact(vx: Any, vy: Any, e: Any, mu: Any, rest_speed: float) -> tuple[Any, Any, float]:
    """Return the velocity after an impact, and the friction that sticking took (0 if it slipped).

    The normal impulse is (1 + e) m |vy|. Friction can give up to mu times that, and not more than
    it takes to stop the sliding.
    """
    if -_number(vy) < rest_speed:
        # The last impact keeps nothing of vy. The tangential impulse of all the small bounces that
        # are left out is then the same as that of the contact that replaces them.
        normal, bounce = -vy, 0.0
    else:
        normal, bounce = -(1 + e) * vy, -e * vy
    # Coulomb: the tangential impulse that would stop the sliding, if the cone allows it.
    limit = mu * normal
    if abs(vx) <= limit:
        return 0.0, bounce, abs(_number(vx)) / _number(normal) if _number(vx) != 0 else 0.0
    # Outside the cone friction has its full limit and acts against the sliding.
    return (vx - limit if vx > 0 else vx + limit), bounce, 0.0


def segments(parameters: Any, scene: Setup, end: float) -> Iterator[Segment]:
    """Yield the motion from event to event.

    Args:
        parameters: (restitution [-], friction [-], mass [kg]).
        scene: what is known beforehand.
        end: no segment starts after this time [s].

    Yields:
        The segments in order; each lasts until the next one starts.
    """
    e, mu, m = parameters
    g = scene.gravity
    now: Any = 0.0
    x, y = scene.position
    vx, vy = scene.velocity
    needed = 0.0
    if _number(y) == 0 and _number(vy) < 0:
        vx, vy, needed = _impact(vx, vy, e, mu, scene.rest_speed)

    while _number(now) <= end:
        force, until = _push_after(scene, _number(now))
        push = force / m
        # Events set y and vy to exactly 0 on landing, so this test needs no tolerance.
        on_ground = _number(y) == 0 and _number(vy) == 0
        if not on_ground:
            mode, ax, ay = "flight", push, -g
            span = _fall_time(y, vy, g)
        else:
            ay = 0.0
            span = math.inf
            grip = mu * g
            # It sticks while the push is within the friction cone; the largest demand bounds mu
            # from below.
            if _number(vx) == 0 and abs(push) <= grip:
                mode, ax = "stick", 0.0
                needed = max(needed, abs(_number(push)) / g)
            else:
                mode = "slide"
                forwards = vx > 0 if _number(vx) != 0 else force > 0
                ax = push - grip if forwards else push + grip
                # Friction works against the motion: it stops sliding where the parabola's speed is
                # zero.
                if _number(vx) * _number(ax) < 0:
                    span = -vx / ax

        yield Segment(now, x, y, vx, vy, ax, ay, mode, needed)
        needed = 0.0
        # The next event: a change of the push, or the end of the mode itself, whichever comes
        # first.
        if _number(now) + _number(span) > until:
            t, event = until - now, "push"
        elif span == math.inf:
            return
        else:
            t, event = span, "impact" if mode == "flight" else "stop"
        # An event's time is a function of the parameters: through it the gradient sees when an
        # impact happens.
        now = until if event == "push" else now + t
        # Both parabolas are evaluated with the velocities of the segment's start, so position goes
        # first.
        x = x + vx * t + 0.5 * ax * t * t
        vx = vx + ax * t
        if mode == "flight":
            y = y + vy * t + 0.5 * ay * t * t
            vy = vy + ay * t
        if event == "impact":
            y = 0.0
            vx, vy, needed = _impact(vx, vy, e, mu, scene.rest_speed)
        elif event == "stop":
            vx = 0.0


def trajectory(parameters: Any, scene: Setup, times: Any) -> Any:
    """Return where the block is at given times.

    Args:
        parameters: (restitution [-], friction [-], mass [kg]), shape (3,). As a torch tensor, or
            with torch scalars in the scene, the answer is a tensor with gradients.
        scene: what is known beforehand.
        times: shape (N,), in any order [s].

    Returns:
        x, y, vx, vy, shape (4, N) [m, m, m/s, m/s]; exact up to rounding. At the very moment of an
        impact the velocity is the one after it.

    Raises:
        ValueError: if a parameter or time is out of range.
    """
    _check(parameters)
    times = _check_times(times)
    end = float(times.max(initial=0.0))
    pieces = list(segments(parameters, scene, end))
    starts = [_number(piece.start) for piece in pieces]
    # Each time belongs to the last segment that starts at or before it.
    index = np.searchsorted(starts, times, side="right") - 1
    # Plain numbers take the path through NumPy, which needs no torch.
    if not any(map(_is_tensor, (*parameters, *scene.position, *scene.velocity))):
        columns = np.array([piece[:7] for piece in pieces]).T[:, index]
        return _positions_and_velocities(columns, times, np)
    torch = pytorch()
    table = [
        torch.stack([torch.as_tensor(value, dtype=torch.float64) for value in column])[index]
        for column in list(zip(*pieces, strict=True))[:7]
    ]
    return _positions_and_velocities(table, torch.as_tensor(times), torch)


def _positions_and_velocities(table: Any, times: Any, xp: Any) -> Any:
    start, x, y, vx, vy, ax, ay = table
    t = times - start
    return xp.stack(
        [x + (vx + 0.5 * ax * t) * t, y + (vy + 0.5 * ay * t) * t, vx + ax * t, vy + ay * t]
    )


def jacobian(parameters: Sequence[float] | np.ndarray, scene: Setup, times: Any) -> np.ndarray:
    """Return the derivative of the trajectory with respect to the parameters.

    Reverse-mode automatic differentiation, all outputs in one batch, through the event times.

    Args:
        parameters: (restitution, friction, mass), shape (3,).
        scene: what is known beforehand.
        times: shape (N,) [s].

    Returns:
        d(x, y, vx, vy) / d(parameter), shape (4, N, 3).

    Raises:
        ValueError: if a parameter or time is out of range.
        ModuleNotFoundError: if torch is missing.
    """
    torch = pytorch()
    point = torch.tensor(np.asarray(parameters, dtype=float), requires_grad=True)
    out = trajectory(point, scene, times)
    if not out.requires_grad:  # a block that never moves depends on nothing
        return np.zeros((*out.shape, 3))
    # One row of the identity for each output: all vector-Jacobian products in one batch.
    rows = torch.eye(out.numel(), dtype=torch.float64)
    (derivatives,) = torch.autograd.grad(out.reshape(-1), point, rows, is_grads_batched=True)
    return derivatives.reshape(*out.shape, 3).numpy()


@dataclass(frozen=True)
class Recording:
    """Positions of a block, measured.

    Attributes:
        times: shape (N,) [s].
        positions: x and y, shape (2, N) [m].
        noise: standard deviation of each measured number [m], positive.

    Raises:
        ValueError: if shapes disagree, a number is not finite, or the noise is not positive.
    """

    times: np.ndarray
    positions: np.ndarray
    noise: float

    def __post_init__(self) -> None:
        _check_times(self.times)
        vector("positions", self.positions, (2, len(self.times)), unit="m")
        positive("noise", self.noise, unit="m")


def record(
    parameters: Sequence[float] | np.ndarray,
    scene: Setup,
    times: Any,
    noise: float,
    generator: np.random.Generator,
) -> Recording:
    """Record a drop as a camera would: the exact positions with normal noise.

    Args:
        parameters: the true (restitution, friction, mass).
        scene: what is known beforehand.
        times: shape (N,) [s].
        noise: standard deviation [m], positive.
        generator: source of the noise.

    Returns:
        The recording.
    """
    exact = trajectory(np.asarray(parameters, dtype=float), scene, times)[:2]
    return Recording(np.asarray(times, float), generator.normal(exact, noise), noise)


def loss(parameters: Any, recorded: Recording, scene: Setup) -> Any:
    """Return half the sum of squared residuals in units of the noise: minus the log-likelihood.

    Args:
        parameters: (restitution, friction, mass); a torch tensor gives a tensor.
        recorded: the measured positions.
        scene: what is known beforehand.

    Returns:
        The loss, without unit.
    """
    positions = trajectory(parameters, scene, recorded.times)[:2]
    measured: Any = recorded.positions
    if _is_tensor(positions):
        measured = pytorch().as_tensor(measured)
    return 0.5 * (((positions - measured) / recorded.noise) ** 2).sum()


def gradient(
    parameters: Sequence[float] | np.ndarray, recorded: Recording, scene: Setup
) -> np.ndarray:
    """Return the gradient of the loss, by reverse-mode differentiation.

    Args:
        parameters: (restitution, friction, mass).
        recorded: the measured positions.
        scene: what is known beforehand.

    Returns:
        d loss / d parameter, shape (3,).
    """
    torch = pytorch()
    point = torch.tensor(np.asarray(parameters, dtype=float), requires_grad=True)
    value = loss(point, recorded, scene)
    if value.requires_grad:
        value.backward()
    return np.zeros(3) if point.grad is None else point.grad.numpy().copy()


@dataclass(frozen=True)
class Information:
    """What a trajectory can tell about the parameters, before anything is measured.

    Attributes:
        singular_values: of the Jacobian, in standard deviations of the record per unit of a
            parameter's scale (1 for restitution and friction, the mass itself for mass), falling,
            shape (3,).
        directions: row k is the combination of parameters that belongs to singular value k, in
            units of the scales, shape (3, 3).
        covariance: of (restitution, friction, mass) [their units]; rows and columns of unknown
            parameters are inf.
        standard_errors: smallest that any unbiased estimator can reach (Cramer and Rao), shape
            (3,); inf where unknown.
        identified: for each parameter, whether the trajectory tells it.
        friction_at_least: what friction must have been for the block to stick where it stuck [-].
            Sticking gives this bound and nothing else.
    """

    singular_values: np.ndarray
    directions: np.ndarray
    covariance: np.ndarray
    standard_errors: np.ndarray
    identified: tuple[bool, bool, bool]
    friction_at_least: float

    @property
    def unknown(self) -> tuple[str, ...]:
        """Names of the parameters that the trajectory does not tell."""
        return tuple(name for name, known in zip(NAMES, self.identified, strict=True) if not known)

    def __str__(self) -> str:
        lines = []
        for name, error, known in zip(NAMES, self.standard_errors, self.identified, strict=True):
            lines.append(
                f"{name:<12} standard error {error:.2g}" if known else f"{name:<12} not identified"
            )
        if "friction" in self.unknown and self.friction_at_least > 0:
            lines[1] += f", but at least {self.friction_at_least:.4g} at this mass: it stuck"
        values = ", ".join(f"{value:.3g}" for value in self.singular_values)
        return "\n".join([*lines, f"singular values {values}"])


def information(
    parameters: Sequence[float] | np.ndarray, scene: Setup, times: Any, noise: float = 1e-3
) -> Information:
    """Return what positions recorded at given times would tell about the parameters.

    Args:
        parameters: (restitution, friction, mass) at which to look; the answer is local.
        scene: what is known beforehand.
        times: shape (N,) [s].
        noise: standard deviation of each measured position [m], positive.

    Returns:
        Singular values, standard errors, and which parameters are told.

    Raises:
        ValueError: if the noise is not positive, or a parameter or time is out of range.
    """
    positive("noise", noise, unit="m")
    # In standard deviations of the noise J is whitened, and J^T J is the Fisher information.
    J = jacobian(parameters, scene, times)[:2].reshape(-1, 3) / noise
    # Columns of the Jacobian in relative units of the mass, so that the singular values compare.
    scale = np.array([1.0, 1.0, float(parameters[2])])
    _, values, directions = np.linalg.svd(J * scale, full_matrices=True)
    # With fewer measurements than parameters, the missing singular values are zero.
    values = np.concatenate([np.abs(values), np.zeros(3 - len(values))])
    # A direction is known if one scale moves the record by more than one deviation.
    known = values > 1.0
    # How much of each parameter lies in the directions that the record does not determine.
    share = np.linalg.norm(directions[~known], axis=0)
    identified = share <= _SHARE_IN_UNKNOWN
    # Covariance of the least-squares estimate, (J^T J)^-1, on the known directions only.
    root = directions[known].T / values[known]
    covariance = (root @ root.T) * np.outer(scale, scale)
    covariance[~identified, :] = np.inf
    covariance[:, ~identified] = np.inf
    end = float(np.max(times, initial=0.0))
    # Sticking only bounds friction from below, by the largest ratio of forces that it needed.
    floor = max(
        piece.friction_needed
        for piece in segments([_number(value) for value in parameters], scene, end)
    )
    return Information(
        values,
        directions,
        covariance,
        np.sqrt(np.diag(covariance)),
        (bool(identified[0]), bool(identified[1]), bool(identified[2])),
        floor,
    )


@dataclass(frozen=True)
class Recovery:
    """Parameters read off a recording.

    Attributes:
        parameters: (restitution, friction, mass), shape (3,). Where `information` says unknown,
            the number is the guess or an accident of it, not an answer.
        information: standard errors and identifiability at the solution.
        chi_squared_per_degree: squared residual per degree of freedom in units of the noise: near
            1 for a good fit; far above it the model, the noise or the guess is wrong.
        iterations: steps of the search that were tried.
        converged: whether the search ended because nothing improved any more.
        losses: after each accepted step, starting with the guess.
    """

    parameters: np.ndarray
    information: Information
    chi_squared_per_degree: float
    iterations: int
    converged: bool
    losses: tuple[float, ...]

    @property
    def fits(self) -> bool:
        """True if the stated noise explains the residual (below 2 per degree of freedom)."""
        return self.chi_squared_per_degree < 2.0

    def __str__(self) -> str:
        lines = []
        for name, value, error, known in zip(
            NAMES,
            self.parameters,
            self.information.standard_errors,
            self.information.identified,
            strict=True,
        ):
            lines.append(
                f"{name:<12} {value:.5f} +- {error:.5f}" if known else f"{name:<12} not identified"
            )
        if "friction" in self.information.unknown and self.information.friction_at_least > 0:
            lines[1] += (
                f", but at least {self.information.friction_at_least:.4g} at this mass: it stuck"
            )
        verdict = "fits" if self.fits else "does NOT fit: try another guess, or doubt the model"
        lines.append(f"chi^2 per degree {self.chi_squared_per_degree:.3g}: {verdict}")
        return "\n".join(lines)


def recover(
    recorded: Recording,
    scene: Setup,
    guess: Sequence[float] | np.ndarray,
    iterations: int = 60,
) -> Recovery:
    """Return parameters from a noisy recording, by Levenberg and Marquardt's method.

    Each step solves the linearised problem with the Jacobian that torch gives; damping keeps it
    where the linearisation holds (Marquardt, 1963). The search is local: bounces that are out of
    step with the record by half a period trap it, and a guess with so much friction that the block
    sticks has no gradient towards less. `fits` tells.

    Args:
        recorded: the measured positions.
        scene: what is known beforehand.
        guess: (restitution, friction, mass) to start from.
        iterations: most steps to try.

    Returns:
        The parameters with their standard errors and what could not be told.

    Raises:
        ValueError: if the guess is out of range or `iterations` is below 1.
        ModuleNotFoundError: if torch is missing.
    """
    count("iterations", iterations, 1)
    point = np.array(guess, dtype=float)
    _check(point)
    # At e = 0 exactly nothing bounces any more, and no gradient would lead back.
    lowest, highest = np.array([1e-6, 0.0, 1e-9]), np.array([1.0, np.inf, np.inf])

    def residual(parameters: np.ndarray) -> np.ndarray:
        positions = trajectory(parameters, scene, recorded.times)[:2]
        return ((positions - recorded.positions) / recorded.noise).ravel()

    r = residual(point)
    losses = [0.5 * float(r @ r)]
    damping = 1e-3
    J = None
    converged = False
    tried = 0
    while tried < iterations and not converged:
        tried += 1
        # The Jacobian is computed again only after an accepted step.
        if J is None:
            J = jacobian(point, scene, recorded.times)[:2].reshape(-1, 3) / recorded.noise
        # Levenberg-Marquardt: the Gauss-Newton matrix, damped in proportion to its diagonal.
        curvature = J.T @ J
        # A parameter without influence has a zero column; the floor leaves it where it is.
        diagonal = np.maximum(np.diag(curvature), 1e-12)
        step = -np.linalg.solve(curvature + damping * np.diag(diagonal), J.T @ r)
        # Projected onto the admissible box, so that every trial is a valid set of parameters.
        trial = np.clip(point + step, lowest, highest)
        # The mass may fall by at most a factor of ten in a step: it stays positive.
        if trial[2] < 0.1 * point[2]:
            trial[2] = 0.1 * point[2]
        trial_r = residual(trial)
        trial_loss = 0.5 * float(trial_r @ trial_r)
        # Accept only what lowers the loss; trust the linearisation more after success, less after
        # failure.
        gained = losses[-1] - trial_loss
        if gained > 0:
            point, r, J = trial, trial_r, None
            losses.append(trial_loss)
            damping = max(damping / 10, 1e-12)
            converged = gained < 1e-10 * (1 + trial_loss)
        else:
            damping *= 10
            converged = damping > 1e8
    # Residuals less the three fitted parameters: the degrees of freedom of chi squared.
    degrees = max(recorded.positions.size - 3, 1)
    return Recovery(
        point,
        information(point, scene, recorded.times, recorded.noise),
        2 * losses[-1] / degrees,
        tried,
        converged,
        tuple(losses),
    )


def naive_drop(
    height: Any,
    restitution: Any,
    dt: float,
    duration: float,
    gravity: float = STANDARD_GRAVITY,
    clamp: bool = True,
) -> Any:
    """Return height of a dropped body at the end, by fixed steps that ignore the time of impact.

    The usual first version: semi-implicit Euler, and when a step ends below the ground the
    velocity is turned round there. Its value converges to the true one as dt shrinks. Its
    derivative does not: the steps until the impact are a whole number, which no small change of
    the height alters. It is here to be differentiated, and to be seen to be wrong.

    Args:
        height: at time 0 [m].
        restitution: [-].
        dt: step [s], positive.
        duration: [s].
        gravity: [m/s^2].
        clamp: whether the body is put back on the ground.

    Returns:
        The height after round(duration / dt) steps [m]; a tensor if a tensor came in.

    Raises:
        ValueError: if dt is not positive.
    """
    positive("dt", dt, unit="s")
    # A product with 0, so that the speed is a tensor where the parameters are.
    y, v = height, 0.0 * restitution
    for _ in range(round(duration / dt)):
        v = v - dt * gravity
        y = y + dt * v
        # The impact is applied at the end of the step, up to dt late, and its time has no gradient.
        if y < 0 and v < 0:
            v = -restitution * v
            if clamp:
                y = 0.0 * height
    return y


class DropGradients(NamedTuple):
    """Height of a dropped body at the end [m] and its derivatives, d/d height and d/d e."""

    height: float
    by_height: float
    by_restitution: float


def naive_drop_gradients(
    height: float, restitution: float, dt: float, duration: float, clamp: bool = True
) -> DropGradients:
    """Return the gradients that automatic differentiation computes for `naive_drop`.

    They are the exact derivative of the wrong map.

    Args:
        height: at time 0 [m].
        restitution: [-].
        dt: step [s].
        duration: [s].
        clamp: as in `naive_drop`.

    Returns:
        The value and its derivatives.
    """
    torch = pytorch()
    h = torch.tensor(height, dtype=torch.float64, requires_grad=True)
    e = torch.tensor(restitution, dtype=torch.float64, requires_grad=True)
    out = naive_drop(h, e, dt, duration, clamp=clamp)
    out.backward()
    return DropGradients(_number(out), float(h.grad), float(e.grad))


def drop_gradients(height: float, restitution: float, duration: float) -> DropGradients:
    """Return the same drop from event to event, differentiated through the impact times.

    Args:
        height: at time 0 [m].
        restitution: [-].
        duration: [s].

    Returns:
        The value and its derivatives.
    """
    torch = pytorch()
    h = torch.tensor(height, dtype=torch.float64, requires_grad=True)
    parameters = torch.tensor([restitution, 0.0, 1.0], dtype=torch.float64, requires_grad=True)
    out = trajectory(parameters, Setup(position=(0.0, h)), [duration])[1, 0]
    out.backward()
    by_restitution = 0.0 if parameters.grad is None else float(parameters.grad[0])
    return DropGradients(_number(out), float(h.grad), by_restitution)
