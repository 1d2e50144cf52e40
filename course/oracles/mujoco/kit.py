"""What every scene asked of MuJoCo shares: the library, a model from text, a run, a batch.

A scene is a function of its family (`free`, `oscillator`, `box`, ...) that returns a `Runner`: the
model is compiled and the data allocated before the clock starts, and `run(steps)` goes through
MuJoCo's own compiled loop (`mj_step(model, data, nstep)`), so Python's overhead is not charged to
MuJoCo. States are MuJoCo's: a free joint is q = (x, y, z, qw, qx, qy, qz) with v = (linear velocity
in the world, angular velocity in the body).

What is switched off so that MuJoCo runs at its fastest fair setting: sensors, actuation, automatic
reset, islands, the mid-phase and energy (off by default) in every scene; gravity, springs and
dampers where a scene has none; the whole constraint solver, with its warm start and collision
detection, where nothing touches. None of these changes the motion. The automatic reset has to go
for another reason as well: it would put a diverging state back to the start, and an unstable run
would look stable.

Integrators (MuJoCo 4 documentation, Computation, Numerical integration): "Euler" is semi-implicit
with joint damping taken implicitly, "implicit" and "implicitfast" are implicit in velocity, "RK4"
is the classical method, "discrete" is implicit in velocity and position.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from course.check import POSITIVE, count, finite, invalid, one_of, positive, vector
from course.libraries import import_error

_log = logging.getLogger(__name__)

MUJOCO_INTEGRATORS = ("Euler", "RK4", "implicit", "implicitfast", "discrete")
EVALUATIONS_PER_STEP = {name: 4 if name == "RK4" else 1 for name in MUJOCO_INTEGRATORS}
GRAVITY = 9.81  # m/s^2; not the standard value, but what a model has that names none

ALWAYS_OFF = ("actuation", "sensor", "autoreset", "island", "midphase")
CONTACT_OFF = ("constraint", "contact", "warmstart")


def library() -> ModuleType:
    """Return MuJoCo.

    Raises:
        ImportError: it is not installed; the message names the package.
    """
    try:
        import mujoco
    except ImportError as error:
        raise import_error("MuJoCo", "pip install 'mujoco>=4.0'", error) from error
    # MuJoCo writes the warning of a diverging state into MUJOCO_LOG.TXT in the current folder. Here
    # divergence is a result, which the caller sees in the state, so the text goes to the log.
    if mujoco.get_mju_user_warning() is None:
        mujoco.set_mju_user_warning(_log.info)
    return mujoco


@dataclass(frozen=True)
class Samples:
    """A sampled motion: times (n,) [s], q (nq, n) and v (nv, n), components along axis 0."""

    times: NDArray[np.float64]
    q: NDArray[np.float64]
    v: NDArray[np.float64]


class Runner:
    """One prepared scene: model, data and start state; `run` is the part to be timed."""

    def __init__(self, xml: str, q0: ArrayLike, v0: ArrayLike, integrator: str) -> None:
        mujoco = library()
        self.integrator = integrator
        self.model = mujoco.MjModel.from_xml_string(xml)
        self.data = mujoco.MjData(self.model)
        self._step = mujoco.mj_step
        self.q0 = vector("q0", q0, (self.model.nq,)).copy()
        self.v0 = vector("v0", v0, (self.model.nv,)).copy()
        self.reset()

    @property
    def dt(self) -> float:
        """The time step [s]; may be set between runs."""
        return float(self.model.opt.timestep)

    @dt.setter
    def dt(self, value: float) -> None:
        self.model.opt.timestep = positive("dt", value, unit="s")

    def reset(self) -> None:
        """Back to the start state (and without the solver's memory of the last run)."""
        data = self.data
        data.time, data.qpos[:], data.qvel[:] = 0.0, self.q0, self.v0
        # A warm start of the last run would change the solver's rounding, and with it the bits.
        data.qacc_warmstart[:] = 0.0

    def run(self, steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the state after `steps` steps from the start, in one compiled loop.

        A run that diverges returns what it reached, NaN or infinity included; nothing is clamped.

        Args:
            steps: how many, not negative.

        Returns:
            Copies of (q, v), shapes (nq,) and (nv,).
        """
        count("steps", steps)
        self.reset()
        if steps:
            # One call for all steps: Python's overhead is paid once.
            self._step(self.model, self.data, steps)
        return self.data.qpos.copy(), self.data.qvel.copy()

    def samples(self, steps: int, every: int = 1) -> Samples:
        """Return the motion from the start, recorded every `every` steps (the start included)."""
        count("steps", steps)
        count("every", every, 1)
        self.reset()
        n = steps // every + 1
        times, q, v = np.empty(n), np.empty((self.model.nq, n)), np.empty((self.model.nv, n))
        for i in range(n):
            if i:
                self._step(self.model, self.data, every)
            times[i], q[:, i], v[:, i] = self.data.time, self.data.qpos, self.data.qvel
        return Samples(times, q, v)

    def sensitivity(self, steps: int, direction: ArrayLike) -> NDArray[np.float64]:
        """Return how the state after `steps` steps moves if the start state does.

        The derivative of every step by central differences (mjd_transitionFD), multiplied. MuJoCo
        has no reverse mode; the course calls it once a step, as there is no compiled loop for it.

        Args:
            steps: how many, not negative.
            direction: change of the start state (q, v), in nv + nv tangent coordinates.

        Returns:
            Change of the end state, shape (2 nv,).
        """
        count("steps", steps)
        nv = self.model.nv
        moved = vector("direction", direction, (2 * nv,)).copy()
        step = library()
        A = np.zeros((2 * nv, 2 * nv))
        self.reset()
        for _ in range(steps):
            step.mjd_transitionFD(self.model, self.data, 1e-6, True, A, None, None, None)
            moved = A @ moved
            self._step(self.model, self.data)
        return moved

    def evaluations(self, steps: int) -> int:
        """Return the force evaluations that `run(steps)` costs: one a step, four with RK4."""
        return EVALUATIONS_PER_STEP[self.integrator] * steps


class BatchRunner:
    """N copies of one scene in `mujoco.batch`: q is (nq, N), v is (nv, N)."""

    def __init__(self, one: Runner, q0: ArrayLike, v0: ArrayLike, threads: int) -> None:
        library()
        from mujoco import batch

        count("threads", threads)
        self.integrator = one.integrator
        self.model = one.model
        self.q0 = np.array(q0, dtype=float)
        self.v0 = np.array(v0, dtype=float)
        n = self.q0.shape[-1]
        if self.q0.shape != (one.model.nq, n) or self.v0.shape != (one.model.nv, n) or n < 1:
            raise invalid(
                "(q0.shape, v0.shape)",
                (self.q0.shape, self.v0.shape),
                f"(({one.model.nq}, N), ({one.model.nv}, N))",
            )
        self._batch = batch.Batch(one.model, n, threads)
        self._q, self._v = self._batch.bind("qpos"), self._batch.bind("qvel")
        self.threads: int = self._batch.nthread
        self.reset()

    @property
    def size(self) -> int:
        """How many bodies."""
        return self.q0.shape[1]

    def reset(self) -> None:
        """Back to the start states."""
        self._batch.state[:] = 0.0
        self._q[:], self._v[:] = self.q0.T, self.v0.T

    def step(self, steps: int) -> None:
        """Go on by `steps` steps, in one compiled call: the part to be timed."""
        count("steps", steps)
        self._batch.step(nstep=steps)

    def run(self, steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the states after `steps` steps from the start, shapes (nq, N) and (nv, N)."""
        self.reset()
        self.step(steps)
        return self._q.T.copy(), self._v.T.copy()


def scene_xml(
    body: str,
    dt: float,
    integrator: str,
    gravity: float,
    *,
    springs: bool = False,
    touching: bool = False,
    gap: Sequence[str] = (),
    extra: str = "",
) -> str:
    """Return the model's text: the body with the options that its scene needs.

    Args:
        body: what stands in the world.
        dt: step [s].
        integrator: one of `MUJOCO_INTEGRATORS`.
        gravity: downwards along z [m/s^2].
        springs: whether springs and dampers act.
        touching: whether contacts and constraints do.
        gap: further flags to switch off.
        extra: what stands beside the world: pairs, actuators.

    Raises:
        ValueError: for an argument out of its range.
    """
    one_of("integrator", integrator, MUJOCO_INTEGRATORS)
    positive("dt", dt, unit="s")
    finite("gravity", gravity, unit="m/s^2")
    flags = [*ALWAYS_OFF, *gap]
    # Flags only remove work, never a force that the scene has.
    if not touching:
        flags += CONTACT_OFF
    if not springs:
        flags += ["spring", "damper"]
    if gravity == 0.0:
        flags.append("gravity")
    switched = " ".join(f'{flag}="disable"' for flag in flags)
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{dt:.17g}" integrator="{integrator}" '
        f'gravity="0 0 {-gravity:.17g}" cone="elliptic"><flag {switched}/></option>'
        f"<worldbody>{body}</worldbody>{extra}</mujoco>"
    )


def inertial(mass: float, z: float, moments: NDArray[np.float64]) -> str:
    """Return an element with this mass [kg], centre (0, 0, z) [m] and central moments [kg m^2]."""
    positive("mass", mass, unit="kg")
    text = " ".join(f"{moment:.17g}" for moment in moments)
    return f'<inertial pos="0 0 {z:.17g}" mass="{mass:.17g}" diaginertia="{text}"/>'


def principal_moments(name: str, value: ArrayLike) -> NDArray[np.float64]:
    """Return three moments of inertia that some body has, else ValueError."""
    moments = vector(name, value, (3,), low=POSITIVE, unit="kg m^2")
    largest = float(np.max(moments))
    # Triangle inequality of the moments, with room for rounding.
    if 2.0 * largest > float(np.sum(moments)) * (1.0 + 1e-9):
        raise invalid(name, moments, "three moments of which none is above the sum of the others")
    return moments
