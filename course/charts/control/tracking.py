"""Which law follows a motion how well, how often asked, for how much, and by which model."""

import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.charts import chart
from course.control import Adaptive, JointLaw, horizon, lqr, mpc, mppi, rollouts, track
from course.control.residual import Learned, learn
from course.control.sampling import shifted
from course.kinematics import TwoLink, linearise
from course.measure.figure import Panel, Series
from course.measure.timing import calls, interleaved
from course.oracles.mujoco import chain as mujoco
from course.oracles.pinocchio import Arm

Array = NDArray[np.float64]
ARM = TwoLink(payload=0.5, damping=(0.6, 0.5), gravity=9.81)
WRONG = TwoLink(gravity=9.81)  # neither payload nor this friction
DOWN = (0.0, -9.81, 0.0)
KP, KD = 100.0, 20.0  # before the inertia [1/s^2, 1/s]
STIFF, DAMP = (60.0, 30.0), (8.0, 3.0)  # of the joints [N m/rad, N m s/rad]
SLOPE, ADAPTIVE_DAMP = 10.0, (5.0, 2.5)  # of the adaptive law [1/s, N m s/rad]
SECONDS = 4.0
Q, R = np.diag([1e4, 1e4, 1e2, 1e2]), 0.01 * np.eye(2)


def motion(times: ArrayLike, size: float = 1.0, speed: float = 1.0) -> list[Array]:
    """Return a smooth motion of both joints: angles, rates, accelerations, each (2, T)."""
    w = speed * np.array([[2.0], [3.0]])
    wave, depth = w * np.asarray(times) + [[0.3], [1.0]], size * np.array([[0.8], [0.5]])
    return [
        depth * np.sin(wave) + [[0.0], [0.6]],
        depth * w * np.cos(wave),
        -depth * w**2 * np.sin(wave),
    ]


def error(
    law: Callable[..., Array],
    dt: float,
    seconds: float = SECONDS,
    arm: TwoLink = ARM,
    last: float = 2.0,
    **how: float,
) -> float:
    """Return the largest error of an angle at the samples of the last seconds [rad].

    Infinite if it falls.
    """
    run = track(arm, law, partial(motion, **how), dt, seconds)
    # At the samples of the last two seconds, after the start has been forgotten.
    worst = np.abs(run.q[:, :-1] - run.setpoint)[:, -round(last / dt) :].max()
    return float(worst) if worst < 3.0 else np.inf


# --- laws that look along the path ----------------------------------------------------------------


class Along:
    """What is known beforehand of a path: torques of each sample's middle, and the small motion."""

    correct: Callable[[int, Array], Array]  # torques against the deviation of a sample

    def __init__(self, model: TwoLink, dt: float, seconds: float = SECONDS) -> None:
        self.model, self.dt = model, dt
        times = dt * np.arange(round(seconds / dt) + 200)
        self.aim = np.concatenate(motion(times)[:2])
        q, v, a = motion(times + 0.5 * dt)
        self.ahead = model.inverse_dynamics(q, v, a)
        self.k, chain = 0, model.chain()
        self.small = [
            self._held(linearise(chain, *x.T, gravity=DOWN))
            for x in np.stack([q, v, self.ahead], axis=2).transpose(1, 0, 2)
        ]

    def _held(self, system: tuple[Array, Array]) -> tuple[Array, Array]:
        whole, total = np.zeros((6, 6)), np.eye(6)
        whole[:4] = np.hstack(system)
        for order in range(8, 0, -1):
            # Exponential of the augmented matrix by Horner's scheme: the exact zero-order hold.
            total = np.eye(6) + self.dt / order * whole @ total
        return total[:4, :4], total[:4, 4:]

    def __call__(self, q: Array, v: Array, *_: Array) -> Array:
        """Return the feedforward torque of the next sample plus the correction of the deviation."""
        self.k += 1
        return self.ahead[:, self.k - 1] + self.correct(
            self.k - 1, np.concatenate([q, v]) - self.aim[:, self.k - 1]
        )


class PathLQR(Along):
    """A gain for each sample, from the Riccati recursion backwards along the path."""

    def __init__(self, model: TwoLink, dt: float) -> None:
        super().__init__(model, dt)
        self.gains: list[Any] = []
        P = lqr(*self.small[-1], Q, R).P
        for A, B in reversed(self.small):
            K = np.asarray(np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A))
            # Backward Riccati recursion along the path, from the stationary solution at its end.
            P = Q + A.T @ P @ (A - B @ K)
            self.gains.insert(0, K)

    def correct(self, k: int, x: Array) -> Array:
        """Return the state feedback of sample k."""
        return -self.gains[k] @ x


class PathMPC(Along):
    """Ten samples ahead, the motors' limits as a box."""

    def __init__(self, model: TwoLink, dt: float, limit: float = 30.0) -> None:
        super().__init__(model, dt)
        self.plans = [horizon(*system, Q, R, 10) for system in self.small]
        self.last: Array | None = None
        # What the feedforward leaves of the motors' limits.
        self.room = limit - np.abs(self.ahead)

    def correct(self, k: int, x: Array) -> Array:
        """Return the first input of the plan from sample k, warm-started with the last plan."""
        self.last = mpc(self.plans[k], x, self.room[:, k], self.last)
        return self.last[0]


class PathMPPI(Along):
    """128 tries over 8 pieces of 8 ms about the torques of the path, by the model."""

    def __init__(self, model: TwoLink, dt: float) -> None:
        super().__init__(model, dt)
        self.rng, self.plan = np.random.default_rng(0), np.zeros((8, 2))
        self.piece = max(1, round(0.008 / dt))

    def correct(self, k: int, x: Array) -> Array:
        """Return the correction at sample k by importance-weighted random plans."""
        end = k + 8 * self.piece
        aim, known = self.aim[:, k + 1 : end + 1].T, self.ahead[:, k:end].T
        state = np.split(x + self.aim[:, k], 2)

        def cost(plans: Array) -> Array:
            # Samples perturb the feedforward torque, piecewise constant.
            torques = known + np.repeat(plans, self.piece, axis=1)
            q, v = rollouts(self.model, torques, self.dt, (state[0], state[1]))
            deviation = np.concatenate([q[1:], v[1:]], axis=1) - aim[:, :, None]
            return np.asarray(np.einsum("tik,i->k", deviation**2, np.diag(Q)) * self.dt)

        result = mppi(cost, self.plan, self.rng, samples=128, spread=(0.15, 0.05), temperature=1e-3)
        # Warm start: shifted once a whole piece has passed.
        self.plan = result.plan if (k + 1) % self.piece else shifted(result.plan)
        return np.asarray(result.plan[0])


def adaptive(
    model: TwoLink, dt: float, rate: float = 5.0, bounds: ArrayLike | None = None
) -> Adaptive:
    """Return the adaptive law, which starts from the model's numbers."""
    return Adaptive(model, SLOPE, ADAPTIVE_DAMP, rate, dt, model.parameters, bounds)


LAWS: dict[str, Callable[[TwoLink, float], Any]] = {
    "PD": lambda model, dt: JointLaw("pd", model, STIFF, DAMP),
    "PD + gravity": lambda model, dt: JointLaw("pd_gravity", model, STIFF, DAMP),
    "computed torque": lambda model, dt: JointLaw("computed_torque", model, KP, KD),
    "half-sample preview": lambda model, dt: JointLaw("computed_torque", model, KP, KD, dt),
    "adaptive law": adaptive,
    "LQR along the path": PathLQR,
    "MPC": PathMPC,
    "MPPI": PathMPPI,
}


def rounds_until(
    bar: float,
    model: TwoLink,
    seed: int,
    rounds: int = 4,
    shown: TwoLink | None = None,
    dt: float = 8e-3,
) -> float:
    """Count rounds of collecting and fitting until a law's largest error is below a limit.

    The count is infinite if that never happens.

    With `shown` that model's law collects first.
    """
    result: list[float] = []

    def collect(law: Learned) -> Any:
        first = law if result or shown is None else Learned(shown, KP, KD)
        run = track(ARM, first, motion, dt, 3.0)
        result.append(float(np.abs(run.q[:, :-1] - run.setpoint)[:, round(1 / dt) :].max()))
        return run

    learn(Learned(model, KP, KD), collect, np.random.default_rng(seed), rounds)
    good = np.flatnonzero(np.array(result) < bar)
    return float(good[0]) if good.size else np.inf


def springs(model: TwoLink, kp: float, kd: float) -> tuple[Array, Array]:
    """Return gains of PD that are as stiff at the joints as computed torque is by this model.

    Computed torque multiplies kp and kd by the mass matrix; its diagonal in the middle of the
    motion is what a joint feels.

    Returns:
        Stiffness [N m/rad] and damping [N m s/rad], shape (2,) each.
    """
    middle = np.array([0.0, 0.6])
    # Equal stiffness at the joints makes the comparison of the two laws fair.
    felt = np.diag(model.mass_matrix(middle))
    return kp * felt, kd * felt


@chart(columns=2)
def equal_stiffness(
    gains: Sequence[float] = (50.0, 100.0, 200.0, 400.0, 800.0, 1600.0), dt: float = 1e-3
) -> Iterator[Panel]:
    """Chart the error of PD with gravity and of computed torque over one and the same stiffness.

    Args:
        gains: kp of computed torque [1/s^2]; damping is critical.
        dt: sample time [s].
    """
    for words, model in (("right", ARM), ("wrong", WRONG)):
        panel = Panel(
            f"The model {words}",
            "stiffness of the elbow [N m/rad]",
            "largest error [rad]",
            scale="log",
        )
        stiffness: list[float] = []
        rows: dict[str, list[float]] = {"PD + gravity": [], "computed torque": []}
        for kp in gains:
            kd = 2.0 * np.sqrt(kp)
            stiff, damp = springs(model, kp, kd)
            stiffness.append(float(stiff[1]))
            rows["PD + gravity"].append(error(JointLaw("pd_gravity", model, stiff, damp), dt))
            rows["computed torque"].append(error(JointLaw("computed_torque", model, kp, kd), dt))
        for name, y in rows.items():
            message = ", ".join(f"{x:.3g}: {e:.2g}" for x, e in zip(stiffness, y, strict=True))
            note = f"{name:<16} model {words}, stiffness of the elbow: error [rad] {message}"
            panel.series.append(Series(name, stiffness, y, name, note=note))
        yield panel


SLOW = ("MPC", "MPPI")
# The same computed torque with preview, the loop in Python, law and arm by a library.
FOLLOW: dict[str, Callable[..., Callable[[], Array]]] = {
    "Pinocchio": lambda rows, kp, kd, dt: Arm(ARM.chain(), DOWN).follow(rows, kp, kd, dt),
    "MuJoCo": lambda rows, kp, kd, dt: mujoco.follow(ARM.chain(), rows, kp, kd, dt, DOWN),
}


@chart(columns=2)
def tracking_laws(
    rates: Sequence[int] = (125, 250, 500, 1000),
    repeats: int = 3,
    clock: Callable[[], float] = time.process_time,
) -> Iterator[Panel]:
    """Chart error over samples a second with the right and a wrong model, and over computing time.

    Args:
        rates: samples a second.
        repeats: rounds of timing.
        clock: as for `course.measure.timing.calls`.
    """
    errors: dict[tuple[str, str], list[float]] = {}
    for words, model in (("right", ARM), ("wrong", WRONG)):
        panel = Panel(
            f"The model {words}",
            "samples per second",
            "largest error [rad]",
            scale="log",
            ticks=rates,
        )
        for name, law in LAWS.items():
            result = [error(law(model, 1.0 / f), 1.0 / f) for f in rates]
            errors[words, name] = result
            panel.series.append(
                Series(
                    name,
                    rates,
                    result,
                    name,
                    extra=name in ("PD", "MPC"),
                    note=f"{name:<20} model {words}: {result[0]:.1e} rad at {rates[0]} Hz, "
                    f"{result[-1]:.1e} at {rates[-1]}",
                )
            )
        yield panel
    yield _costs(rates, errors, repeats, clock)


def _costs(
    rates: Sequence[int],
    errors: dict[tuple[str, str], list[float]],
    repeats: int,
    clock: Callable[[], float],
) -> Panel:
    """Return the error against the computing time per second, the simulated arm's included."""
    spent: dict[str, list[float]] = {}
    error = {name: errors["right", name] for name in LAWS}
    gains = np.full(2, KP), np.full(2, KD)
    for f in rates:
        dt, length = 1.0 / f, {name: (40 if name in SLOW else 400) / f for name in (*LAWS, *FOLLOW)}
        whole = np.array(motion(dt * (np.arange(round(SECONDS * f)) + 0.5)))
        aim = motion(dt * np.arange(whole.shape[2] + 1))[0].T
        runs = {
            name: calls(_run, law(ARM, dt), dt, length[name], clock=clock)
            for name, law in LAWS.items()
        }
        for name, of in FOLLOW.items():
            far = np.abs(of(whole, *gains, dt=dt)() - aim)[-round(2.0 * f) :]
            error.setdefault(name, []).append(float(far.max()))
            runs[name] = calls(of(whole[:, :, :400], *gains, dt=dt), clock=clock)
        # All laws and libraries in turn; the simulated arm's own time is included for everyone.
        timed = interleaved(list(runs.values()), repeats=repeats, sample=3e-3)
        for name, result in zip(runs, timed, strict=True):
            spent.setdefault(name, []).append(result.median / length[name])
    panel = Panel(
        "What it costs, the model right",
        "computing time per second of motion [s]",
        "largest error [rad]",
        scale="log",
        lines=[("x", 1.0, "real time")],
    )
    for name, x in spent.items():
        ratio = np.median(np.array(x) / spent["half-sample preview"])
        panel.series.append(
            Series(
                name,
                x,
                error[name],
                name,
                hollow=name in FOLLOW,
                extra=name in ("PD", "PD + gravity", "computed torque", "adaptive law"),
                note=f"{name:<20} {1e6 * x[-1] / rates[-1]:7.1f} us a sample with the arm's "
                f"motion, {ratio:6.1f} times the compiled loop with preview; "
                f"{error[name][-1]:.4e} rad at {rates[-1]} Hz",
            )
        )
    return panel


def _run(law: Callable[..., Array], dt: float, seconds: float) -> None:
    if isinstance(law, Along):
        law.k = 0
    track(ARM, law, motion, dt, seconds)
